//! Primitives, already in view and in pixels: balls, strokes, triangles and glyphs, each with a
//! colour, an opacity and a rank.
//!
//! Each is drawn row by row. Coverage is counted at the sample points of `layers`; a pixel's depth
//! and shade are those at its centre, or at the primitive's nearest part where the centre is
//! outside.

use glam::DVec2;

use super::ball::Ball;
use super::glyph_mask::GlyphMask;
use super::layers::{Band, Fragment, Rank};
use super::lens::Lens;
use super::shape::{PixelCover, Stroke, Triangle, pixels};

/// Something to draw.
#[derive(Clone, Debug)]
pub(super) struct Primitive {
    pub(super) shape: PrimitiveForm,
    /// Display-referred sRGB, 0..255.
    pub(super) rgb: [f32; 3],
    pub(super) opacity: f32,
    pub(super) rank: Rank,
    /// A view depth for all of its pixels; by default each has its own.
    pub(super) shown_mm: Option<f64>,
}

/// Its form.
#[derive(Clone, Debug)]
pub(super) enum PrimitiveForm {
    Ball(Ball),
    Stroke(Stroke),
    Triangle(Triangle),
    Stamp(GlyphMask),
}

impl Primitive {
    /// View depth of the front of a ball, mm; `None` for other forms.
    pub(super) fn front_of_ball_mm(&self) -> Option<f64> {
        match &self.shape {
            PrimitiveForm::Ball(ball) => Some(ball.nearest_mm()),
            _ => None,
        }
    }

    /// The box that contains all its pixels: left, top, right, bottom.
    pub(super) fn bounds(&self) -> [f64; 4] {
        match &self.shape {
            PrimitiveForm::Ball(ball) => ball.bounds,
            PrimitiveForm::Stroke(stroke) => stroke.bounds(),
            PrimitiveForm::Triangle(triangle) => triangle.bounds(),
            PrimitiveForm::Stamp(stamp) => stamp.bounds(),
        }
    }

    /// The approximate number of pixels of a box of that size to look at.
    pub(super) fn work_px(&self, width: f64, height: f64) -> f64 {
        match &self.shape {
            PrimitiveForm::Ball(_) | PrimitiveForm::Triangle(_) | PrimitiveForm::Stamp(_) => width * height,
            PrimitiveForm::Stroke(stroke) => {
                (width + height) * (2.0 * stroke.half_width + 3.0).min(width).max(1.0)
            }
        }
    }

    /// Draws the part in the band.
    pub(super) fn draw(&self, lens: &Lens, band: &mut Band<'_>) {
        match &self.shape {
            PrimitiveForm::Ball(ball) => {
                ball.draw(lens, band, (self.rank, self.nearest_mm()), |cover| self.fragment(cover));
            }
            PrimitiveForm::Stamp(stamp) => self.draw_stamp(stamp, band),
            PrimitiveForm::Stroke(stroke) => {
                self.draw_pixels(band, |row| stroke.span(row), |corner| stroke.cover(lens, corner));
            }
            PrimitiveForm::Triangle(triangle) => {
                self.draw_pixels(band, |row| triangle.span(row), |corner| triangle.cover(lens, corner));
            }
        }
    }

    /// Draws the part in the band, pixel by pixel. One function gives the extent of a shape in a
    /// row, the other its part of the pixel with this upper left corner.
    fn draw_pixels(
        &self,
        band: &mut Band<'_>,
        span: impl Fn(f64) -> [f64; 2],
        cover: impl Fn(DVec2) -> Option<PixelCover>,
    ) {
        let [_, top, _, bottom] = self.bounds();
        let [first, end] = pixels(top, bottom, band.rows);
        for row in first..end {
            let [left, right] = span(f64::from(row));
            let [first, end] = pixels(left, right, [0, band.width]);
            for column in first..end {
                if let Some(cover) = cover(DVec2::new(f64::from(column), f64::from(row))) {
                    band.add(column, row, self.fragment(&cover));
                }
            }
        }
    }

    /// As [`Primitive::draw`] for a glyph, row by row of its picture.
    fn draw_stamp(&self, stamp: &GlyphMask, band: &mut Band<'_>) {
        let [left, top, right, bottom] = stamp.bounds();
        let ([first, end], [from, to]) =
            (pixels(top, bottom, band.rows), pixels(left, right, [0, band.width]));
        let nearest = (self.rank, self.nearest_mm());
        let fragment = self.fragment(&PixelCover { points: 0, depth_mm: stamp.depth_mm, light: 1.0 });
        for row in first..end {
            for (column, &points) in (from..to).zip(stamp.points(row, from)) {
                if points != 0 && !band.are_hidden(row, [column, column + 1], nearest) {
                    band.add(column, row, Fragment { points, ..fragment });
                }
            }
        }
    }

    /// No part of it is nearer, mm of view depth.
    pub(super) fn nearest_mm(&self) -> f32 {
        match &self.shape {
            _ if self.rank == Rank::Instrument => f32::NEG_INFINITY,
            // A little less, against rounding.
            PrimitiveForm::Ball(ball) => (ball.nearest_mm() - 1e-3) as f32,
            PrimitiveForm::Stamp(stamp) => stamp.depth_mm as f32,
            PrimitiveForm::Stroke(_) | PrimitiveForm::Triangle(_) => f32::NEG_INFINITY,
        }
    }

    pub(super) fn fragment(&self, cover: &PixelCover) -> Fragment {
        Fragment {
            rgb: self.rgb.map(|channel| channel * cover.light as f32),
            opacity: self.opacity,
            depth_mm: cover.depth_mm as f32,
            shown_mm: self.shown_mm.unwrap_or(cover.depth_mm) as f32,
            points: cover.points,
            rank: self.rank,
        }
    }
}
