//! From items in patient mm to primitives in view and pixels.

use glam::DVec3;

use super::ball::Ball;
use super::instruments::{caption, orientation_cube, scale_bar};
use super::item::{Curve, Landmark, Line, Mesh, OverlayItem, Overlays, Radius, Text};
use super::labels::{self, Label};
use super::layers::Rank;
use super::lens::{Lens, NEAR_MM};
use super::primitive::{Primitive, PrimitiveForm};
use super::shape::{Stroke, Triangle};
use super::text::{Style, Typesetter, usual_height_px};
use relief_annotation::catmull_rom;
use relief_volume::Grid;

/// Colour and width of the bounding box.
const BOX_RGB: [f64; 3] = [0.95, 0.8, 0.35];
const BOX_WIDTH_PX: f64 = 2.0;

/// Segments of a smooth curve: the total of its spans, and the minimum and maximum of each span.
const PARTS: usize = 20_000;
const PARTS_OF_SPAN: [usize; 2] = [4, 32];

/// Everything that a request wants drawn, in the order of its items.
pub(super) fn primitives(overlays: &Overlays, lens: &Lens, grid: &Grid) -> Vec<Primitive> {
    let mut builder = Builder {
        lens,
        primitives: Vec::with_capacity(overlays.items.len()),
        typesetter: Typesetter::default(),
        labels: Vec::new(),
    };
    if overlays.orientation_cube {
        orientation_cube(lens, &mut builder.primitives);
    }
    if overlays.scale_bar {
        scale_bar(lens, &mut builder.typesetter, &mut builder.primitives);
    }
    if let Some(text) = &overlays.caption {
        caption(text, lens, &mut builder.typesetter, &mut builder.primitives);
    }
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
            OverlayItem::Text(text) => builder.text(text),
        }
    }
    let Builder { mut primitives, mut typesetter, labels, .. } = builder;
    let height_px = overlays.label_height_px.unwrap_or_else(|| usual_height_px(lens.size_px.y));
    let shown = overlays.label_depths_mm;
    labels::set(labels, height_px, shown, lens, &mut typesetter, &mut primitives);
    primitives
}

struct Builder<'a> {
    lens: &'a Lens,
    primitives: Vec<Primitive>,
    typesetter: Typesetter,
    labels: Vec<Label<'a>>,
}

impl<'a> Builder<'a> {
    fn push(&mut self, shape: PrimitiveForm, rgb: [f64; 3], opacity: f64) {
        let rgb = rgb.map(|channel| (channel * 255.0) as f32);
        let (opacity, rank) = (opacity as f32, Rank::Scene);
        self.primitives.push(Primitive { shape, rgb, opacity, rank, shown_mm: None });
    }

    fn landmark(&mut self, landmark: &'a Landmark) {
        let center = self.lens.place(landmark.at);
        if center.z < NEAR_MM {
            return;
        }
        let radius_mm = match landmark.radius {
            Radius::Mm(mm) => mm,
            Radius::Px(px) => px * self.lens.mm_per_px(center.z),
        };
        let Some(ball) = Ball::new(self.lens, center, radius_mm) else { return };
        self.push(PrimitiveForm::Ball(ball), landmark.rgb, 1.0);
        let middle = self.lens.pixel(center);
        let is_shown = middle.min_element() >= 0.0 && middle.cmple(self.lens.size_px).all();
        if let Some(text) = landmark.label.as_deref().filter(|_| is_shown) {
            let radius_px = radius_mm / self.lens.mm_per_px(center.z);
            let depth_mm = center.z - radius_mm;
            self.labels.push(Label { text, middle, radius_px, depth_mm, rgb: landmark.rgb });
        }
    }

    fn stroke(&mut self, ends: [DVec3; 2], width_px: f64, rgb: [f64; 3]) {
        if let Some(stroke) = Stroke::new(self.lens, ends, width_px) {
            self.push(PrimitiveForm::Stroke(stroke), rgb, 1.0);
        }
    }

    fn curve(&mut self, curve: &Curve) {
        let points: Vec<DVec3> = curve.points.iter().map(|&point| self.lens.place(point)).collect();
        let line = if curve.smooth {
            let spans = points.len() - usize::from(!curve.closed);
            let parts = (PARTS / spans.max(1)).clamp(PARTS_OF_SPAN[0], PARTS_OF_SPAN[1]);
            catmull_rom(&points, curve.closed, parts)
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
        for &corners in &*mesh.triangles {
            let [a, b, c] = corners.map(|corner| places[corner as usize]);
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            let kept = Lens::clip_triangle([a, b, c]);
            for i in 2..kept.len() {
                let part = [kept[0], kept[i - 1], kept[i]];
                if let Some(triangle) = Triangle::new(self.lens, part, normal) {
                    self.push(PrimitiveForm::Triangle(triangle), mesh.rgb, mesh.opacity);
                }
            }
        }
    }

    fn text(&mut self, text: &Text) {
        let place = self.lens.place(text.at);
        if place.z < NEAR_MM {
            return;
        }
        let height_px = text.height_px.unwrap_or_else(|| usual_height_px(self.lens.size_px.y));
        let style = Style { height_px, rgb: text.rgb, rank: Rank::Scene, shown_mm: None };
        self.typesetter.set(&text.text, self.lens.pixel(place), place.z, style, &mut self.primitives);
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
