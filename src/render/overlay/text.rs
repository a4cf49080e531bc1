//! Text: glyphs as small pictures of sample points, and where the glyphs of a line go.
//!
//! Every glyph stands on whole pixels, so that one picture of it serves all its places. Around its
//! ink lies a rim in a contrasting colour, so that it is read over anything. A text has one depth,
//! rim included: displays that shift pixels by their depth keep it in one piece.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use glam::DVec2;

use super::font::{CAPITAL, glyph};
use super::layers::{FULL, Rank, SAMPLE_POINTS};
use super::shape::{HALF_DIAGONAL, Primitive, PrimitiveForm};

/// Where nothing says how high capitals are: this share of the picture's height, within limits, px.
const USUAL_SHARE: f64 = 1.0 / 27.0;

/// Half the width of a stroke and the width of the rim, in parts of the height of capitals, and
/// their least, px.
const HALF_STROKE: (f64, f64) = (0.062, 0.65);
const RIM: (f64, f64) = (0.1, 1.5);

/// From a colour of this brightness on, the rim is dark.
const BRIGHT: f64 = 0.45;

/// Heights of capitals, px.
pub(super) const HEIGHTS_PX: [u32; 2] = [12, 96];

/// The height of capitals for a picture of this height.
pub(super) fn usual_height_px(picture_px: f64) -> u32 {
    let [low, high] = HEIGHTS_PX.map(f64::from);
    (picture_px * USUAL_SHARE).round().clamp(low, high) as u32
}

/// Height of the capitals of labels in a picture of this height where nothing says otherwise, px.
#[must_use]
pub fn label_height_px(picture_px: u32) -> u32 {
    usual_height_px(f64::from(picture_px))
}

/// Width of the strokes of words in capitals of this height, px.
#[must_use]
pub fn label_stroke_px(height_px: u32) -> f64 {
    2.0 * (HALF_STROKE.0 * f64::from(height_px)).max(HALF_STROKE.1)
}

/// Covered sample points of a glyph's pixels, ink and rim apart.
#[derive(Debug)]
pub(super) struct Bitmap {
    /// Its upper left corner, from the pen on the baseline, px.
    left: i32,
    top: i32,
    width: u32,
    ink: Vec<u16>,
    rim: Vec<u16>,
}

/// A glyph in a picture: its ink or its rim.
#[derive(Clone, Debug)]
pub(super) struct GlyphMask {
    bitmap: Arc<Bitmap>,
    is_ink: bool,
    /// The pen, px.
    pen: [i32; 2],
    pub(super) depth_mm: f64,
}

/// How a line of text looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    pub(super) height_px: u32,
    /// Display-referred sRGB, 0..1.
    pub(super) rgb: [f64; 3],
    pub(super) rank: Rank,
    /// As in [`Primitive`].
    pub(super) shown_mm: Option<f64>,
}

/// Pictures of glyphs, by character and height.
type Bitmaps = HashMap<(char, u32), Arc<Bitmap>>;

/// Cached glyph pictures of earlier drawings. A glyph depends only on its key, so all drawings can
/// share the cache.
static KNOWN: LazyLock<Mutex<Bitmaps>> = LazyLock::new(Mutex::default);

/// So many are kept: those of a few heights of texts, 14 MB at the most.
const MOST_KNOWN: usize = 256;

/// The glyphs' pictures that one drawing needs.
#[derive(Debug, Default)]
pub(super) struct Typesetter {
    known: Bitmaps,
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

impl Typesetter {
    /// Width of a line from its first ink to its last, and its height, px, without the rim.
    pub(super) fn size_px(text: &str, height_px: u32) -> DVec2 {
        let scale = f64::from(height_px) / CAPITAL;
        let width: f64 = text.chars().map(|character| glyph(character).advance).sum();
        DVec2::new(width * scale, f64::from(height_px))
    }

    /// Puts a line around a pixel: its middle there, as far as whole pixels allow. Ink comes before
    /// all rims.
    pub(super) fn set(
        &mut self,
        text: &str,
        middle: DVec2,
        depth_mm: f64,
        style: Style,
        out: &mut Vec<Primitive>,
    ) {
        if middle.abs().max_element() > 1e6 {
            return; // far outside of any picture
        }
        let Style { height_px, rgb, rank, shown_mm } = style;
        let scale = f64::from(height_px) / CAPITAL;
        let size = Self::size_px(text, height_px);
        let gap = (glyph('H').advance - glyph('H').width()) * scale;
        let start = middle.x - (size.x - gap) / 2.0;
        let baseline = (middle.y + size.y / 2.0).round() as i32;
        for is_ink in [true, false] {
            let rgb = if is_ink { rgb } else { contrast(rgb) }.map(|channel| (channel * 255.0) as f32);
            let mut x = start;
            for character in text.chars() {
                let bitmap = self.bitmap(character, height_px);
                if bitmap.width > 0 {
                    let stamp = GlyphMask { bitmap, is_ink, pen: [x.round() as i32, baseline], depth_mm };
                    out.push(Primitive {
                        shape: PrimitiveForm::Stamp(stamp),
                        rgb,
                        opacity: 1.0,
                        rank,
                        shown_mm,
                    });
                }
                x += glyph(character).advance * scale;
            }
        }
    }

    fn bitmap(&mut self, character: char, height_px: u32) -> Arc<Bitmap> {
        let key = (character, height_px);
        let made = self.known.entry(key).or_insert_with(|| {
            let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
            if known.len() >= MOST_KNOWN && !known.contains_key(&key) {
                known.clear();
            }
            Arc::clone(known.entry(key).or_insert_with(|| Arc::new(Bitmap::new(character, height_px))))
        });
        Arc::clone(made)
    }
}

/// Dark around bright colours, bright around dark ones.
pub(super) fn contrast([r, g, b]: [f64; 3]) -> [f64; 3] {
    let brightness = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    if brightness >= BRIGHT { [0.04; 3] } else { [0.96; 3] }
}

impl Bitmap {
    fn new(character: char, height_px: u32) -> Self {
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

    #[test]
    fn a_line_stands_around_its_middle() {
        let mut out = Vec::new();
        let style = Style { height_px: 24, rgb: [1.0; 3], rank: Rank::Scene, shown_mm: None };
        Typesetter::default().set("Nasion", DVec2::new(200.0, 100.0), 50.0, style, &mut out);
        assert_eq!(out.len(), 12, "ink and rim of six letters");
        let bounds = out.iter().map(Primitive::bounds);
        let all = bounds.reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]);
        let [left, top, right, bottom] = all.unwrap();
        assert!(((left + right) / 2.0 - 200.0).abs() < 2.0 && (right - left) > 80.0, "{left} to {right}");
        assert!(((top + bottom) / 2.0 - 100.0).abs() < 2.0, "{top} to {bottom}");
    }
}
