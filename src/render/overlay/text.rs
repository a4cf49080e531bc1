//! Text: glyphs as small pictures of sample points, and where the glyphs of a line go.
//!
//! Every glyph stands on whole pixels, so that one picture of it serves all its places. Around its
//! ink lies a rim in a contrasting colour, so that it is read over anything. A text has one depth,
//! rim included: displays that shift pixels by their depth keep it in one piece.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock};

use glam::DVec2;
use parking_lot::Mutex;

use super::font::{CAPITAL, glyph};
use super::glyph_mask::{Bitmap, GlyphMask, HALF_STROKE};
use super::layers::{FULL, Rank};
use super::primitive::{Primitive, PrimitiveForm};
use super::shape::pixels;

/// Where nothing says how high capitals are: this share of the picture's height, within limits, px.
const USUAL_SHARE: f64 = 1.0 / 27.0;

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

/// Number of masks in the cache: those of a few heights of text, at most 14 MB.
const MOST_KNOWN: usize = 256;

/// The glyphs' pictures that one drawing needs.
#[derive(Debug, Default)]
pub(super) struct Typesetter {
    known: Bitmaps,
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
            let mut known = KNOWN.lock();
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

/// A line of text as shares of covered pixels, without a rim.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextMask {
    /// Width and height, px.
    pub size_px: [u32; 2],
    /// The covered share of each pixel, 0 to 255; rows from the top.
    pub coverage: Vec<u8>,
}

/// The margin of a [`TextMask`] around capitals of this height, px: room for descenders.
#[must_use]
pub const fn text_margin_px(height_px: u32) -> u32 {
    height_px.div_ceil(2)
}

/// A line of text whose capitals are `height_px` high, in the font of the overlays. The baseline
/// lies [`text_margin_px`] above the lower edge.
#[must_use]
pub fn text_mask(text: &str, height_px: u32) -> TextMask {
    let margin = text_margin_px(height_px);
    let ink = Typesetter::size_px(text, height_px);
    let size_px = [ink.x.ceil() as u32 + 2 * margin, height_px + 2 * margin];
    let [width, height] = size_px;
    let mut glyphs = Vec::new();
    let style = Style { height_px, rgb: [1.0; 3], rank: Rank::Instrument, shown_mm: None };
    let middle = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
    Typesetter::default().set(text, middle, 1.0, style, &mut glyphs);
    let mut coverage = vec![0u8; width as usize * height as usize];
    for glyph in glyphs {
        let PrimitiveForm::Stamp(stamp) = glyph.shape else { continue };
        if !stamp.is_ink {
            continue;
        }
        let [left, top, right, bottom] = stamp.bounds();
        let ([first, end], [from, to]) = (pixels(top, bottom, [0, height]), pixels(left, right, [0, width]));
        for row in first..end {
            for (column, points) in (from..to).zip(stamp.points(row, from)) {
                let share = points.count_ones() * 255 / FULL.count_ones();
                let pixel = &mut coverage[(row * width + column) as usize];
                *pixel = (*pixel).max(share as u8);
            }
        }
    }
    TextMask { size_px, coverage }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn a_mask_holds_the_strokes_of_its_letters() {
        let mask = text_mask("H", 20);
        let [width, height] = mask.size_px.map(|side| side as usize);
        assert_eq!(mask.coverage.len(), width * height);
        // A row above the bar of an H crosses two strokes.
        let row = &mask.coverage[(10 + 4) * width..][..width];
        let strokes = row.windows(2).filter(|pair| pair[0] == 0 && pair[1] > 0).count();
        assert_eq!(strokes, 2, "{row:?}");
        assert!(mask.coverage.contains(&255));
        // Nothing touches the lower edge: descenders fit.
        let line = text_mask("waiting gjpqy,", 60);
        let width = line.size_px[0] as usize;
        assert!(line.coverage[line.coverage.len() - width..].iter().all(|share| *share == 0));
        assert!(text_mask("", 20).coverage.iter().all(|share| *share == 0));
    }
}
