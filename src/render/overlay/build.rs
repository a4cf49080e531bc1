//! From items in patient mm to primitives in view and pixels.

use glam::DVec3;

use super::curve::catmull_rom;
use super::item::{Curve, Landmark, Line, Mesh, OverlayItem, Overlays, Radius};
use super::layers::Rank;
use super::lens::{Lens, NEAR_MM};
use super::shape::{Ball, Primitive, Shape, Stroke, Triangle};
use crate::volume::Grid;

/// Colour and width of the bounding box.
const BOX_RGB: [f64; 3] = [0.95, 0.8, 0.35];
const BOX_WIDTH_PX: f64 = 2.0;

/// Everything that a request wants drawn, in the order of its items.
pub(super) fn primitives(overlays: &Overlays, lens: &Lens, grid: &Grid) -> Vec<Primitive> {
    let mut builder = Builder { lens, primitives: Vec::with_capacity(overlays.items.len()) };
    if overlays.bounding_box {
        builder.bounding_box(grid);
    }
    for item in &overlays.items {
        match item {
            OverlayItem::Landmark(landmark) => builder.landmark(landmark),
            OverlayItem::Line(Line { ends, width_px, rgb }) => {
                builder.stroke(ends.map(|end| lens.place(end)), *width_px, *rgb);
            }
            OverlayItem::Curve(curve) => builder.curve(curve),
            OverlayItem::Mesh(mesh) => builder.mesh(mesh),
        }
    }
    builder.primitives
}

struct Builder<'a> {
    lens: &'a Lens,
    primitives: Vec<Primitive>,
}

impl Builder<'_> {
    #[expect(clippy::cast_possible_truncation, reason = "colours are kept as f32")]
    fn push(&mut self, shape: Shape, rgb: [f64; 3], opacity: f64) {
        let rgb = rgb.map(|channel| (channel * 255.0) as f32);
        self.primitives.push(Primitive { shape, rgb, opacity: opacity as f32, rank: Rank::Scene });
    }

    fn landmark(&mut self, landmark: &Landmark) {
        let center = self.lens.place(landmark.at);
        if center.z < NEAR_MM {
            return;
        }
        let radius_mm = match landmark.radius {
            Radius::Mm(mm) => mm,
            Radius::Px(px) => px * self.lens.mm_per_px(center.z),
        };
        if let Some(ball) = Ball::new(self.lens, center, radius_mm) {
            self.push(Shape::Ball(ball), landmark.rgb, 1.0);
        }
    }

    fn stroke(&mut self, ends: [DVec3; 2], width_px: f64, rgb: [f64; 3]) {
        if let Some(stroke) = Stroke::new(self.lens, ends, width_px) {
            self.push(Shape::Stroke(stroke), rgb, 1.0);
        }
    }

    fn curve(&mut self, curve: &Curve) {
        let points: Vec<DVec3> = curve.points.iter().map(|&point| self.lens.place(point)).collect();
        let line = if curve.smooth {
            catmull_rom(&points, curve.closed)
        } else {
            let first = curve.closed.then(|| points[0]);
            points.into_iter().chain(first).collect()
        };
        for ends in line.windows(2) {
            self.stroke([ends[0], ends[1]], curve.width_px, curve.rgb);
        }
    }

    fn mesh(&mut self, mesh: &Mesh) {
        let places: Vec<DVec3> = mesh.vertices.iter().map(|&vertex| self.lens.place(vertex)).collect();
        for &corners in &mesh.triangles {
            let [a, b, c] = corners.map(|corner| places[corner as usize]);
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            let kept = Lens::clip_triangle([a, b, c]);
            for i in 2..kept.len() {
                let part = [kept[0], kept[i - 1], kept[i]];
                if let Some(triangle) = Triangle::new(self.lens, part, normal) {
                    self.push(Shape::Triangle(triangle), mesh.rgb, mesh.opacity);
                }
            }
        }
    }

    /// The twelve edges of the box that spans the volume's outermost faces.
    fn bounding_box(&mut self, grid: &Grid) {
        let corners = grid.corners().map(|corner| self.lens.place(corner));
        for bit in [1, 2, 4] {
            for from in (0..8).filter(|corner| corner & bit == 0) {
                self.stroke([corners[from], corners[from | bit]], BOX_WIDTH_PX, BOX_RGB);
            }
        }
    }
}
