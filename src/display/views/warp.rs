//! Depth-image-based rendering: the place of every pixel in a view, occlusion, and the filling of
//! holes.
//!
//! Each row is a line of surfaces. A pixel is an interval of one colour that moves by its
//! disparity's shift. Neighbours whose disparities differ by at most [`SURFACE_STEP`] are one
//! surface and share the edge between them, so slopes have no cracks. The nearest surface hides the
//! others. A pixel of the view is the exact mean over its width: edges are as smooth as their
//! coverage, and a shift by whole pixels copies bytes.
//!
//! A hole takes the background layer, where there is one. Otherwise it takes the colour of the
//! farther of its two sides, or of hidden pixels between them: foreground is never smeared into it.
//! The pixel beside an edge is often mixed with the foreground, so the colour of the next pixel is
//! used. It also replaces the mixed pixel as the hole opens, which would otherwise remain as a
//! ghost of the edge.
//!
//! Places are whole numbers of 1/4096 pixel, so that the bytes are the same everywhere, and a
//! mirrored picture has mirrored views.

use rayon::prelude::*;

use super::parallax::Parallax;
use super::pictures::{Views, check_layers};
use crate::layout::DecodedLayer;
use crate::layout::error::LayoutError;

/// A pixel's width.
pub(super) const UNIT: i32 = Parallax::UNIT;
/// Disparities of neighbours on one surface differ by at most this, as in the depth filter's edges.
const SURFACE_STEP: u8 = 4;

/// Makes views of a picture and its disparity: on the processor, or on a graphics card with the
/// same bytes.
pub trait Synthesize: std::fmt::Debug + Send + Sync {
    /// As [`synthesize`].
    ///
    /// # Errors
    /// As [`synthesize`].
    fn views(
        &self,
        size_px: [u32; 2],
        front: &DecodedLayer,
        back: Option<&DecodedLayer>,
        parallax: &Parallax,
        eyes: &[f64],
    ) -> Result<Views, LayoutError>;
}

/// Makes views on all threads of the processor.
#[derive(Clone, Copy, Debug, Default)]
pub struct ProcessorViews;

impl Synthesize for ProcessorViews {
    fn views(
        &self,
        size_px: [u32; 2],
        front: &DecodedLayer,
        back: Option<&DecodedLayer>,
        parallax: &Parallax,
        eyes: &[f64],
    ) -> Result<Views, LayoutError> {
        synthesize(size_px, front, back, parallax, eyes)
    }
}

/// The views of a picture and its disparity for these eyes, from left to right. The background
/// layer fills holes.
///
/// # Errors
/// When a layer does not fill the size, or there are no views or too many.
pub fn synthesize(
    size_px: [u32; 2],
    front: &DecodedLayer,
    back: Option<&DecodedLayer>,
    parallax: &Parallax,
    eyes: &[f64],
) -> Result<Views, LayoutError> {
    check_layers(size_px, front, back, eyes.len())?;
    let width = size_px[0] as usize;
    let shifts = eyes.iter().map(|&eye| parallax.shifts(eye, size_px[0]));
    Views::new(size_px, shifts.map(|shifts| view(width, front, back, &shifts)).collect())
}

fn view(
    width: usize,
    front: &DecodedLayer,
    back: Option<&DecodedLayer>,
    shifts: &[i32; 256],
) -> Vec<[u8; 3]> {
    let mut picture = vec![[0; 3]; front.color.len()];
    picture.par_chunks_exact_mut(width).enumerate().for_each_init(Scratch::default, |scratch, (y, out)| {
        let back = back.map(|back| Row::of(back, y, width));
        scratch.draw(shifts, &Row::of(front, y, width), back.as_ref(), out);
    });
    picture
}

/// One line of a layer.
#[derive(Clone, Copy)]
pub(super) struct Row<'a> {
    pub(super) color: &'a [[u8; 3]],
    pub(super) disparity: &'a [u8],
}

impl<'a> Row<'a> {
    pub(super) fn of(layer: &'a DecodedLayer, y: usize, width: usize) -> Self {
        Self { color: &layer.color[y * width..][..width], disparity: &layer.disparity[y * width..][..width] }
    }

    /// The first and the last of the farthest pixels from one pixel to another, in that direction;
    /// equal where only one is farthest.
    fn farthest_between(&self, left: usize, right: usize) -> [usize; 2] {
        let [from, to] = [left.min(right), left.max(right)];
        let least = self.disparity[from..=to].iter().min().copied().unwrap_or_default();
        let is_least = |pixel: &usize| self.disparity[*pixel] == least;
        let [first, last] = [(from..=to).find(is_least), (from..=to).rev().find(is_least)];
        let [first, last] = [first.unwrap_or(left), last.unwrap_or(right)];
        if left <= right { [first, last] } else { [last, first] }
    }

    /// The next pixel of the same surface, away from a hole beside it, since edges of depth are one
    /// pixel wide; the pixel itself where there is no next one.
    fn inwards(&self, pixel: usize, side: Side) -> usize {
        let next = if side == Side::Left { pixel.checked_sub(1) } else { Some(pixel + 1) };
        let step = |next: usize| self.disparity.get(next).map(|d| d.abs_diff(self.disparity[pixel]));
        next.filter(|next| step(*next).is_some_and(|step| step <= SURFACE_STEP)).unwrap_or(pixel)
    }
}

/// The place of a pixel in the view.
#[derive(Clone, Copy)]
pub(crate) struct Span {
    from: i32,
    to: i32,
    pixel: usize,
    disparity: u8,
}

/// A part of the view's line, from the end of the one before it, that shows one pixel; a hole shows
/// none.
#[derive(Clone, Copy)]
pub(crate) struct LinePiece {
    pub(crate) to: i32,
    pub(crate) pixel: Option<usize>,
}

/// Buffers of a line, reused from line to line.
#[derive(Default)]
struct Scratch {
    spans: Vec<Span>,
    active: Vec<Span>,
    front: Vec<LinePiece>,
    back: Vec<LinePiece>,
    /// Twice the colours times the width that they cover, for each pixel of the view.
    sums: Vec<[i32; 3]>,
}

impl Scratch {
    fn draw(&mut self, shifts: &[i32; 256], front: &Row<'_>, back: Option<&Row<'_>>, out: &mut [[u8; 3]]) {
        let Self { spans, active, front: pieces, back: behind, sums } = self;
        place(front.disparity, shifts, spans);
        cut(spans, active, front.color.len(), pieces);
        behind.clear();
        if let Some(back) = back {
            place(back.disparity, shifts, spans);
            cut(spans, active, back.color.len(), behind);
        }
        sums.clear();
        sums.resize(out.len(), [0; 3]);
        let mut from = 0;
        for (i, piece) in pieces.iter().enumerate() {
            match piece.pixel {
                Some(pixel) => paint(sums, from, piece.to, front.color[pixel].map(|c| 2 * i32::from(c))),
                None => {
                    let filling = filling(pieces, i, front);
                    fill(sums, [from, piece.to], filling.twice, behind, back);
                    clean(sums, pieces, i, piece.to - from, &filling, front);
                }
            }
            from = piece.to;
        }
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = sum.map(rounded);
        }
    }
}

/// The mean of a pixel. One with holes on both sides gives way to both, which can leave the range.
fn rounded(sum: i32) -> u8 {
    ((sum + UNIT) / (2 * UNIT)).clamp(0, 255) as u8
}

/// Whether neighbours with these disparities are one surface.
fn is_joined(a: u8, b: u8, shifts: &[i32; 256]) -> bool {
    let [shift, other] = [a, b].map(|disparity| shifts[usize::from(disparity)]);
    a.abs_diff(b) <= SURFACE_STEP && (shift - other).abs() < UNIT
}

/// Whether a line is one surface, which opens no holes in a view.
pub(crate) fn is_one_surface(disparity: &[u8], shifts: &[i32; 256]) -> bool {
    disparity.windows(2).all(|pair| is_joined(pair[0], pair[1], shifts))
}

/// The pixels of a line where the view has them, by their left ends.
pub(crate) fn place(disparity: &[u8], shifts: &[i32; 256], spans: &mut Vec<Span>) {
    spans.clear();
    let shift = |i: usize| shifts[usize::from(disparity[i])];
    let joined = |i: usize, j: usize| is_joined(disparity[i], disparity[j], shifts);
    let last = disparity.len() - 1;
    for (pixel, &disparity) in disparity.iter().enumerate() {
        let own = shift(pixel);
        let middle = |other: usize| if joined(pixel, other) { (own + shift(other)) / 2 } else { own };
        let left = if pixel > 0 { middle(pixel - 1) } else { own };
        let right = if pixel < last { middle(pixel + 1) } else { own };
        let at = pixel as i32 * UNIT;
        spans.push(Span { from: at + left, to: at + UNIT + right, pixel, disparity });
    }
    // Spans are in order except at edges of depth, so a sort that uses order is fast. It is stable:
    // of equal spans, the pixel on the left comes first.
    spans.sort_by_key(|span| span.from);
}

/// The visible parts of the spans within a line of `width` pixels: always the nearest span.
pub(crate) fn cut(spans: &[Span], active: &mut Vec<Span>, width: usize, pieces: &mut Vec<LinePiece>) {
    pieces.clear();
    active.clear();
    let end = width as i32 * UNIT;
    let (mut x, mut next) = (0, 0);
    while x < end {
        active.retain(|span| span.to > x);
        if active.is_empty()
            && let Some(alone) = alone(spans, next, x)
        {
            x = alone.to.min(end);
            pieces.push(LinePiece { to: x, pixel: Some(alone.pixel) });
            next += 1;
            continue;
        }
        while let Some(span) = spans.get(next).filter(|span| span.from <= x) {
            active.extend((span.to > x).then_some(*span));
            next += 1;
        }
        let coming = spans.get(next).map_or(end, |span| span.from.min(end));
        let nearest = active.iter().max_by_key(|span| span.disparity);
        x = nearest.map_or(coming, |span| span.to.min(coming));
        pieces.push(LinePiece { to: x, pixel: nearest.map(|span| span.pixel) });
    }
}

/// The next span, if it begins at or before `x` and no other span overlaps it, as is usual.
fn alone(spans: &[Span], next: usize, x: i32) -> Option<&Span> {
    let span = spans.get(next).filter(|span| span.from <= x && x < span.to)?;
    spans.get(next + 1).is_none_or(|other| span.to <= other.from).then_some(span)
}

/// The content of a hole without a background layer.
struct Filling {
    /// Twice its colour.
    twice: [i32; 3],
    /// The pixel beside it whose colour gives way to the filling, and on which side it is.
    mixed: Option<(usize, Side)>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

/// The filling of a hole: the surface of its farther side, or the hidden pixels between its sides
/// where they are farther; the mean of two pixels at equal depth.
fn filling(pieces: &[LinePiece], hole: usize, row: &Row<'_>) -> Filling {
    let left = pieces[..hole].iter().rev().find_map(|piece| piece.pixel);
    let right = pieces[hole + 1..].iter().find_map(|piece| piece.pixel);
    let twice = |pixel: usize| row.color[pixel].map(|channel| 2 * i32::from(channel));
    let plain = |pixel: usize| Filling { twice: twice(pixel), mixed: None };
    let of_side = |pixel: usize, side: Side| {
        let inner = row.inwards(pixel, side);
        Filling { twice: twice(inner), mixed: (inner != pixel).then_some((pixel, side)) }
    };
    match (left, right) {
        (Some(left), Some(right)) => match row.farthest_between(left, right) {
            [one, other] if one == left && other != right => of_side(left, Side::Left),
            [one, other] if other == right && one != left => of_side(right, Side::Right),
            [one, other] => {
                let [one, other] = [twice(one), twice(other)];
                Filling {
                    twice: std::array::from_fn(|channel| (one[channel] + other[channel]) / 2),
                    mixed: None,
                }
            }
        },
        // The edge of the picture, where nothing is mixed.
        (Some(pixel), None) | (None, Some(pixel)) => plain(pixel),
        // Everything has moved out of the line.
        (None, None) => Filling { twice: [0; 3], mixed: None },
    }
}

/// Lets the mixed pixel beside a hole give way to the filling, the more the wider the hole is, up
/// to a pixel.
fn clean(
    sums: &mut [[i32; 3]],
    pieces: &[LinePiece],
    hole: usize,
    width: i32,
    filling: &Filling,
    row: &Row<'_>,
) {
    let Some((pixel, side)) = filling.mixed else { return };
    let share = width.min(UNIT);
    let own = row.color[pixel].map(|channel| 2 * i32::from(channel));
    let change: [i32; 3] =
        std::array::from_fn(|channel| (filling.twice[channel] - own[channel]) * share / UNIT);
    let shows = |at: &usize| pieces[*at].pixel == Some(pixel);
    let mut repaint = |at: usize| {
        let from = if at > 0 { pieces[at - 1].to } else { 0 };
        paint(sums, from, pieces[at].to, change);
    };
    match side {
        Side::Left => (0..hole).rev().take_while(shows).for_each(&mut repaint),
        Side::Right => (hole + 1..pieces.len()).take_while(shows).for_each(&mut repaint),
    }
}

/// Fills a hole with the background layer, and with a colour where that has a hole too.
fn fill(
    sums: &mut [[i32; 3]],
    [from, to]: [i32; 2],
    color: [i32; 3],
    behind: &[LinePiece],
    back: Option<&Row<'_>>,
) {
    let Some(back) = back else { return paint(sums, from, to, color) };
    let first = behind.partition_point(|piece| piece.to <= from);
    let mut x = from;
    for piece in &behind[first..] {
        let color = piece.pixel.map_or(color, |pixel| back.color[pixel].map(|c| 2 * i32::from(c)));
        paint(sums, x, piece.to.min(to), color);
        x = piece.to;
        if x >= to {
            break;
        }
    }
}

/// Adds twice a colour to the pixels that a part of the line covers.
fn paint(sums: &mut [[i32; 3]], from: i32, to: i32, twice: [i32; 3]) {
    let mut x = from;
    while x < to {
        let pixel = x / UNIT;
        let until = ((pixel + 1) * UNIT).min(to);
        let sum = &mut sums[pixel as usize];
        for (sum, channel) in sum.iter_mut().zip(twice) {
            *sum += channel * (until - x);
        }
        x = until;
    }
}
