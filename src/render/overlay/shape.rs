//! Strokes and triangles, already in view and in pixels, and the pixels that they cover.
//!
//! Shade is of a headlight: the share [`AMBIENT`] from everywhere and the rest by the cosine
//! between surface and ray.

use glam::{DVec2, DVec3};

use super::layers::{FULL, SAMPLE_POINTS};
use super::lens::Lens;

/// Share of light that does not depend on the slope of a surface.
const AMBIENT: f64 = 0.35;

/// From a pixel's centre to its corner, px.
pub(super) const HALF_DIAGONAL: f64 = 0.708;

/// A shape's part of one pixel: sample points, view depth in mm, and share of its colour.
pub(super) struct PixelCover {
    pub(super) points: u16,
    pub(super) depth_mm: f64,
    pub(super) light: f64,
}

/// Whole pixels that a stretch touches, within limits.
pub(super) fn pixels(low: f64, high: f64, [first, end]: [u32; 2]) -> [u32; 2] {
    let clamp = |value: f64| value.clamp(f64::from(first), f64::from(end));
    [whole(clamp(low)), whole_up(clamp(high))]
}

/// The whole part of a number of pixels. The standard library's roundings are calls on x86-64.
pub(super) fn whole(px: f64) -> u32 {
    px as u32
}

/// The next whole number of pixels.
pub(super) fn whole_up(px: f64) -> u32 {
    whole(px) + u32::from(f64::from(whole(px)) < px)
}

pub(super) fn light(facing: f64) -> f64 {
    AMBIENT + (1.0 - AMBIENT) * facing
}

/// The sample points of the pixel at `corner` for which `is_inside` holds.
fn points_where(corner: DVec2, is_inside: impl Fn(DVec2) -> bool) -> u16 {
    let mut points = 0;
    for (i, point) in SAMPLE_POINTS.into_iter().enumerate() {
        points |= u16::from(is_inside(corner + point)) << i;
    }
    points
}

/// A straight line of constant width with round ends. It is as thick as wide: its depth is half its
/// width nearer than that of its axis, so that a line on a surface is seen.
#[derive(Clone, Debug)]
pub(super) struct Stroke {
    ends: [DVec2; 2],
    slopes: [f64; 2],
    pub(super) half_width: f64,
}

impl Stroke {
    /// The line between two places in view; `None` where it is behind the near plane.
    pub(super) fn new(lens: &Lens, ends: [DVec3; 2], width_px: f64) -> Option<Self> {
        let ends = Lens::clip_segment(ends[0], ends[1])?;
        let nearer = |place: DVec3| {
            let thick = lens.mm_per_px(place.z) * width_px / 2.0;
            lens.slope((place.z - thick).max(place.z / 2.0))
        };
        Some(Self {
            ends: ends.map(|end| lens.pixel(end)),
            slopes: ends.map(nearer),
            half_width: width_px / 2.0,
        })
    }

    /// The line between two pixels, with the depth of each.
    pub(super) fn flat(lens: &Lens, ends: [DVec2; 2], depths_mm: [f64; 2], width_px: f64) -> Self {
        Self { ends, slopes: depths_mm.map(|mm| lens.slope(mm)), half_width: width_px / 2.0 }
    }

    pub(super) fn bounds(&self) -> [f64; 4] {
        let [a, b] = self.ends;
        let (low, high) = (a.min(b) - self.half_width, a.max(b) + self.half_width);
        [low.x, low.y, high.x, high.y]
    }

    pub(super) fn span(&self, row: f64) -> [f64; 2] {
        let [a, b] = self.ends;
        let margin = self.half_width + 1.0;
        let along = b - a;
        let shares = if along.y.abs() < 1e-9 {
            [0.0, 1.0]
        } else {
            [row - margin, row + 1.0 + margin].map(|y| ((y - a.y) / along.y).clamp(0.0, 1.0))
        };
        let [p, q] = shares.map(|share| a.x + along.x * share);
        [p.min(q) - margin, p.max(q) + margin]
    }

    /// The nearest point of the axis, as a share of the way, and its distance, px.
    fn nearest(&self, pixel: DVec2) -> (f64, f64) {
        let [a, b] = self.ends;
        let along = b - a;
        let square = along.length_squared();
        let share = if square > 0.0 { ((pixel - a).dot(along) / square).clamp(0.0, 1.0) } else { 0.0 };
        (share, pixel.distance(a + along * share))
    }

    pub(super) fn cover(&self, lens: &Lens, corner: DVec2) -> Option<PixelCover> {
        let (share, distance) = self.nearest(corner + 0.5);
        let points = if distance + HALF_DIAGONAL <= self.half_width {
            FULL
        } else if distance - HALF_DIAGONAL > self.half_width {
            0
        } else {
            points_where(corner, |pixel| self.nearest(pixel).1 <= self.half_width)
        };
        let [a, b] = self.slopes;
        let depth_mm = lens.depth_mm(a + (b - a) * share);
        (points != 0).then_some(PixelCover { points, depth_mm, light: 1.0 })
    }
}

/// A flat triangle, seen from both sides.
#[derive(Clone, Debug)]
pub(super) struct Triangle {
    corners: [DVec2; 3],
    /// Slope at the first corner, and its growth to the right and downwards.
    slope: f64,
    slope_by_px: DVec2,
    slope_range: [f64; 2],
    /// In view; without one it has its full colour.
    normal: Option<DVec3>,
}

impl Triangle {
    /// The triangle between three places in view before the near plane; `None` where it has no area
    /// in the picture.
    pub(super) fn new(lens: &Lens, places: [DVec3; 3], normal: DVec3) -> Option<Self> {
        let slopes = places.map(|place| lens.slope(place.z));
        Self::between(places.map(|place| lens.pixel(place)), slopes, Some(normal))
    }

    /// The triangle between three pixels, with the depth of each, in its full colour.
    pub(super) fn flat(lens: &Lens, corners: [DVec2; 3], depths_mm: [f64; 3]) -> Option<Self> {
        Self::between(corners, depths_mm.map(|mm| lens.slope(mm)), None)
    }

    fn between(mut corners: [DVec2; 3], mut slopes: [f64; 3], normal: Option<DVec3>) -> Option<Self> {
        let mut area = (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]);
        if !area.is_normal() {
            return None;
        }
        if area < 0.0 {
            corners.swap(1, 2);
            slopes.swap(1, 2);
            area = -area;
        }
        let [a, b] = [1, 2].map(|i| (corners[i] - corners[0], slopes[i] - slopes[0]));
        let slope_by_px = DVec2::new(a.1 * b.0.y - b.1 * a.0.y, b.1 * a.0.x - a.1 * b.0.x) / area;
        let slope_range = [slopes[0].min(slopes[1]).min(slopes[2]), slopes[0].max(slopes[1]).max(slopes[2])];
        Some(Self { corners, slope: slopes[0], slope_by_px, slope_range, normal })
    }

    pub(super) fn bounds(&self) -> [f64; 4] {
        let [a, b, c] = self.corners;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        [low.x, low.y, high.x, high.y]
    }

    pub(super) fn span(&self, row: f64) -> [f64; 2] {
        let mut span = [f64::INFINITY, f64::NEG_INFINITY];
        for (i, &a) in self.corners.iter().enumerate() {
            let b = self.corners[(i + 1) % 3];
            let along = b - a;
            let share = |y: f64| if along.y == 0.0 { 0.0 } else { ((y - a.y) / along.y).clamp(0.0, 1.0) };
            let touches = a.y.min(b.y) <= row + 1.0 && a.y.max(b.y) >= row;
            let ends =
                if along.y == 0.0 { [a.x, b.x] } else { [row, row + 1.0].map(|y| a.x + along.x * share(y)) };
            for x in ends.into_iter().filter(|_| touches) {
                span = [span[0].min(x), span[1].max(x)];
            }
        }
        [span[0] - 1e-6, span[1] + 1e-6]
    }

    /// Twice the area between an edge and a pixel, positive inside, and whether points on the edge
    /// itself are inside: they belong to one of two triangles that share it.
    fn edge(&self, i: usize, pixel: DVec2) -> (f64, bool) {
        let (a, b) = (self.corners[i], self.corners[(i + 1) % 3]);
        let along = b - a;
        // Computed from the same end whatever the direction, so that both triangles get the same
        // number.
        let first = if (a.x, a.y) < (b.x, b.y) { a } else { b };
        let owns = along.y < 0.0 || (along.y == 0.0 && along.x > 0.0);
        (along.perp_dot(pixel - first), owns)
    }

    pub(super) fn cover(&self, lens: &Lens, corner: DVec2) -> Option<PixelCover> {
        let center = corner + 0.5;
        let reach = |i: usize| {
            let along = self.corners[(i + 1) % 3] - self.corners[i];
            0.5 * (along.x.abs() + along.y.abs())
        };
        let is_inside = |i: usize, pixel: DVec2| {
            let (area, owns) = self.edge(i, pixel);
            area > 0.0 || (area == 0.0 && owns)
        };
        let mut is_full = true;
        for i in 0..3 {
            let (area, _) = self.edge(i, center);
            if area < -reach(i) {
                return None;
            }
            is_full &= area > reach(i);
        }
        let inside = |pixel: DVec2| (0..3).all(|i| is_inside(i, pixel));
        let points = if is_full { FULL } else { points_where(corner, inside) };
        let slope = self.slope + self.slope_by_px.dot(center - self.corners[0]);
        let depth_mm = lens.depth_mm(slope.clamp(self.slope_range[0], self.slope_range[1]));
        let ray = if lens.is_perspective { lens.across(center).extend(1.0).normalize() } else { DVec3::Z };
        let light = self.normal.map_or(1.0, |normal| light(normal.dot(ray).abs().min(1.0)));
        (points != 0).then_some(PixelCover { points, depth_mm, light })
    }
}
