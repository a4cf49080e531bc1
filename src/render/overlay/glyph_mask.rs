//! The picture of a glyph: the sample points that its ink and its rim cover, pixel by pixel.

use std::sync::Arc;

use glam::DVec2;

use super::font::{CAPITAL, glyph};
use super::layers::{FULL, SAMPLE_POINTS};
use super::shape::HALF_DIAGONAL;

/// Half the width of a stroke and the width of the rim, in parts of the height of capitals, and
/// their least, px.
pub(super) const HALF_STROKE: (f64, f64) = (0.062, 0.65);
const RIM: (f64, f64) = (0.1, 1.5);

/// Covered sample points of a glyph's pixels, ink and rim apart.
#[derive(Debug)]
pub(super) struct Bitmap {
    /// Its upper left corner, from the pen on the baseline, px.
    left: i32,
    top: i32,
    pub(super) width: u32,
    ink: Vec<u16>,
    rim: Vec<u16>,
}

/// A glyph in a picture: its ink or its rim.
#[derive(Clone, Debug)]
pub(super) struct GlyphMask {
    pub(super) bitmap: Arc<Bitmap>,
    pub(super) is_ink: bool,
    /// The pen, px.
    pub(super) pen: [i32; 2],
    pub(super) depth_mm: f64,
}

impl GlyphMask {
    pub(super) fn bounds(&self) -> [f64; 4] {
        let [x, y] = [self.pen[0] + self.bitmap.left, self.pen[1] + self.bitmap.top].map(f64::from);
        let rows = self.bitmap.ink.len() / self.bitmap.width.max(1) as usize;
        [x, y, x + f64::from(self.bitmap.width), y + rows as f64]
    }

    /// The sample points that it covers in a row of pixels from a column on, both within its
    /// bounds.
    pub(super) fn points(&self, row: u32, column: u32) -> &[u16] {
        let Bitmap { left, top, width, ink, rim } = &*self.bitmap;
        let place = |at: u32, first: i32| usize::try_from(i64::from(at) - i64::from(first)).ok();
        let place = place(row, self.pen[1] + top).zip(place(column, self.pen[0] + left));
        let points = if self.is_ink { ink } else { rim };
        let of_row = place.and_then(|(row, column)| {
            let width = *width as usize;
            points.get(row * width..(row + 1) * width)?.get(column..)
        });
        of_row.unwrap_or_default()
    }
}

impl Bitmap {
    pub(super) fn new(character: char, height_px: u32) -> Self {
        let height = f64::from(height_px);
        let size = |(share, least): (f64, f64)| (share * height).max(least);
        let half = size(HALF_STROKE);
        let outer = half + size(RIM);
        let scale = height / CAPITAL;
        let place = |end: DVec2| DVec2::new(end.x, -end.y) * scale;
        let segments: Vec<[DVec2; 2]> =
            glyph(character).segments.iter().map(|ends| ends.map(place)).collect();
        let Some(low) = segments.iter().flatten().copied().reduce(DVec2::min) else {
            return Self { left: 0, top: 0, width: 0, ink: Vec::new(), rim: Vec::new() };
        };
        let high = segments.iter().flatten().copied().fold(low, DVec2::max);
        let (first, last) = ((low - outer).floor(), (high + outer).ceil());
        let size = last - first;
        let (width, rows) = (size.x as u32, size.y as u32);
        let pixels = (0..rows).flat_map(|row| (0..width).map(move |column| [column, row]));
        let covered = pixels.map(|pixel| {
            let corner = first + DVec2::from(pixel.map(f64::from));
            [covered(&segments, corner, half), covered(&segments, corner, outer)]
        });
        let (ink, rim) = covered.map(|[ink, rim]| (ink, rim)).unzip();
        Self { left: first.x as i32, top: first.y as i32, width, ink, rim }
    }
}

/// Sample points of a pixel within a distance of any of the segments.
fn covered(segments: &[[DVec2; 2]], corner: DVec2, reach: f64) -> u16 {
    let mut points = 0;
    for ends in segments {
        let distance = distance(*ends, corner + 0.5);
        if distance + HALF_DIAGONAL <= reach {
            return FULL;
        }
        if distance - HALF_DIAGONAL <= reach {
            for (i, point) in SAMPLE_POINTS.into_iter().enumerate() {
                points |= u16::from(self::distance(*ends, corner + point) <= reach) << i;
            }
        }
    }
    points
}

fn distance([a, b]: [DVec2; 2], point: DVec2) -> f64 {
    let along = b - a;
    let square = along.length_squared();
    let share = if square > 0.0 { ((point - a).dot(along) / square).clamp(0.0, 1.0) } else { 0.0 };
    point.distance(a + along * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capitals_are_as_high_as_asked_for_and_ink_lies_within_the_rim() {
        for height_px in [12, 20, 47, 96] {
            let bitmap = Bitmap::new('H', height_px);
            let rows: Vec<_> = bitmap.ink.chunks(bitmap.width as usize).collect();
            let inked = rows.iter().filter(|row| row.iter().any(|points| *points != 0)).count() as f64;
            let stroke = 2.0 * (0.062 * f64::from(height_px)).max(0.65);
            assert!((inked - f64::from(height_px) - stroke).abs() <= 2.0, "{inked} rows of {height_px}");
            assert!(bitmap.ink.iter().zip(&bitmap.rim).all(|(ink, rim)| ink & !rim == 0));
            let sum = |points: &[u16]| points.iter().map(|points| points.count_ones()).sum::<u32>();
            assert!(sum(&bitmap.rim) > sum(&bitmap.ink) * 3 / 2);
        }
    }
}
