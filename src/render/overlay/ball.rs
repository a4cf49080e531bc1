//! Balls: outlines and depths, exact in both projections.
//!
//! The rays through a line of sample points lie in a plane, and the intersection of a ball with a
//! plane is a disc. So a ball covers an interval of each line, in closed form (see [`Outline`]).
//! Sixteen roots give the sample points of a whole row of pixels, without a test of each point.
//!
//! Places are in view space as of `lens`, mm; depth is view depth in mm.

use glam::{DVec2, DVec3};

use super::layers::{Band, Fragment, Rank, SAMPLE_POINTS};
use super::lens::{Lens, NEAR_MM};
use super::shape::{PixelCover, light, pixels, whole, whole_up};

/// A ball wholly before the near plane.
#[derive(Clone, Debug)]
pub(super) struct Ball {
    center: DVec3,
    radius_mm: f64,
    outline: Outline,
    /// The box of pixels around its outline.
    pub(super) bounds: [f64; 4],
}

/// An ellipse in the picture: the line at `d` px below its middle has `middle.x + lean d` in its
/// middle and goes `sqrt(half - falling d²)` to both sides of that.
#[derive(Clone, Copy, Debug)]
struct Outline {
    middle: DVec2,
    lean: f64,
    half: f64,
    falling: f64,
}

impl Outline {
    /// The outline of a ball wholly before the near plane.
    fn new(lens: &Lens, center: DVec3, radius_mm: f64) -> Self {
        let (DVec3 { x, y, z }, square, px) = (center, radius_mm * radius_mm, lens.px_across());
        let (y_to_px, x_to_px) = (1.0 / (px.y * px.y), px.x * px.x);
        if !lens.is_perspective {
            let (half, falling) = (square * x_to_px, x_to_px * y_to_px);
            return Self { middle: lens.pixel(center), lean: 0.0, half, falling };
        }
        // Rays are (X, Y, 1). Those of one Y lie in a plane |z Y - y| / sqrt(1 + Y²) away from the
        // centre, and of the disc that the ball has there they meet the interval (x (y Y + z) ±
        // sqrt(power (square (1 + Y²) - (z Y - y)²))) / across.
        let (ahead, across) = (z * z - square, y * y + z * z - square); // above 0: the eye is before the ball
        let power = x * x + across;
        let up = y * z / ahead;
        let middle = lens.pixel(DVec3::new(x * (y * up + z) / across, up, 1.0));
        let scale = power * x_to_px / (across * across);
        let (half, falling) = (scale * square * across / ahead, scale * ahead * y_to_px);
        Self { middle, lean: x * y / across * px.x / px.y, half, falling }
    }
}

impl Ball {
    /// A ball around a place in view; `None` where it is not wholly before the near plane.
    pub(super) fn new(lens: &Lens, center: DVec3, radius_mm: f64) -> Option<Self> {
        if center.z - radius_mm < NEAR_MM {
            return None;
        }
        let low_high = |across: f64| {
            if !lens.is_perspective {
                return [across - radius_mm, across + radius_mm];
            }
            // Tangents from the eye to a circle, in the plane of one picture axis and the viewing
            // direction.
            let square = center.z * center.z - radius_mm * radius_mm;
            let reach = radius_mm * (across * across + square).sqrt();
            [(across * center.z - reach) / square, (across * center.z + reach) / square]
        };
        let ([left, right], [bottom, top]) = (low_high(center.x), low_high(center.y));
        let pixel = |x: f64, y: f64| lens.pixel(DVec3::new(x, y, 1.0));
        let (first, last) = (pixel(left, top), pixel(right, bottom));
        let outline = Outline::new(lens, center, radius_mm);
        Some(Self { center, radius_mm, outline, bounds: [first.x, first.y, last.x, last.y] })
    }

    /// Depth of its nearest point, mm.
    pub(super) fn nearest_mm(&self) -> f64 {
        self.center.z - self.radius_mm
    }

    /// Draws the part in the band, wherever it may be visible.
    ///
    /// `nearest` is the rank of the primitive and the view depth, mm, that no part of it is nearer
    /// than; `fragment` gives a pixel's colour.
    pub(super) fn draw(
        &self,
        lens: &Lens,
        band: &mut Band<'_>,
        nearest: (Rank, f32),
        fragment: impl Fn(&PixelCover) -> Fragment,
    ) {
        let [left, top, right, bottom] = self.bounds;
        let ([first, end], columns) = (pixels(top, bottom, band.rows), pixels(left, right, [0, band.width]));
        let mut points = std::mem::take(&mut band.scratch.points);
        for row in first..end {
            if band.are_hidden(row, columns, nearest) {
                continue;
            }
            let from = self.points_of_row(row, columns, &mut points);
            for (column, &points) in (from..).zip(&points) {
                if points != 0 && !band.are_hidden(row, [column, column + 1], nearest) {
                    let cover = self.cover(lens, DVec2::new(column.into(), row.into()), points);
                    band.add(column, row, fragment(&cover));
                }
            }
        }
        band.scratch.points = points;
    }

    /// The sample points that it covers in the pixels of a row, and the column of the first of
    /// these.
    fn points_of_row(&self, row: u32, columns: [u32; 2], points: &mut Vec<u16>) -> u32 {
        let [least, most] = columns.map(f64::from);
        let Outline { middle, lean, half, falling } = self.outline;
        // For each line of sample points from which column on, and up to before which one.
        let mut spans = [[0u32; 2]; 16];
        for (span, point) in spans.iter_mut().zip(SAMPLE_POINTS) {
            let down = f64::from(row) + point.y - middle.y;
            let rest = half - falling * down * down;
            // Where the line passes by, the span is empty.
            let reach = if rest >= 0.0 { rest.sqrt() } else { -1.0 };
            let at = middle.x + lean * down - point.x;
            let (from, until) = ((at - reach).clamp(least, most), (at + reach + 1.0).clamp(least, most));
            *span = [whole_up(from), whole(until)];
        }
        let (mut first, mut end) = (columns[1], columns[0]);
        for [from, until] in spans.iter().filter(|[from, until]| from < until) {
            (first, end) = (first.min(*from), end.max(*until));
        }
        points.clear();
        points.resize(end.saturating_sub(first) as usize, 0);
        for (i, [from, until]) in spans.into_iter().enumerate().filter(|(_, [from, until])| from < until) {
            points[(from - first) as usize..(until - first) as usize].iter_mut().for_each(|at| *at |= 1 << i);
        }
        first
    }

    /// Depth and light at the middle of a pixel, or at the outline where that is outside.
    fn cover(&self, lens: &Lens, corner: DVec2, points: u16) -> PixelCover {
        let across = lens.across(corner + 0.5);
        let (discriminant, along, square) = if lens.is_perspective {
            let ray = across.extend(1.0);
            let (square, along) = (ray.length_squared(), ray.dot(self.center));
            let power = self.center.length_squared() - self.radius_mm * self.radius_mm;
            (along * along - square * power, along, square)
        } else {
            let off = self.radius_mm * self.radius_mm - across.distance_squared(self.center.truncate());
            (off, self.center.z, 1.0)
        };
        let root = discriminant.max(0.0).sqrt();
        let facing = (root / (self.radius_mm * square.sqrt())).min(1.0);
        PixelCover { points, depth_mm: (along - root) / square, light: light(facing) }
    }
}
