//! The layer behind a picture: what the views beside it show and the picture does not.
//!
//! A view that is made of a picture has holes where a nearer surface moves away from a farther one. The
//! rendered views beside the picture show the content of these holes. It belongs to the farther surface
//! beside the hole, so it gets the disparity of that surface, and the place that it has in the picture
//! by that disparity. All other pixels of the layer are copies of the picture. They move together with
//! the picture and never appear in a hole. A view farther to the side can have holes that the rendered
//! views do not show: these are filled as without a layer.

use std::ops::Range;

use rayon::prelude::*;

use super::rows::SideView;
use super::side_size_px;
use crate::views::{LinePiece, Parallax, Span, cut, is_one_surface, place};

/// A layer behind a picture, in rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HiddenLayer {
    /// Red, green, blue and coverage.
    pub color: Vec<[u8; 4]>,
    /// 0 (far) to 255.
    pub disparity: Vec<u8>,
}

/// The layer behind a picture with these disparities (0 far to 255), from two views beside it.
///
/// # Panics
/// When the pictures do not fill their sizes.
#[must_use]
pub fn hidden_layer(
    size_px: [u32; 2],
    color: &[[u8; 4]],
    disparity: &[u8],
    sides: &[SideView<'_>; 2],
    parallax: &Parallax,
) -> HiddenLayer {
    let [width, height] = size_px.map(|side| side as usize);
    let [columns, rows] = side_size_px(size_px).map(|side| side as usize);
    assert_eq!([color.len(), disparity.len()], [width * height; 2], "the picture");
    for side in sides {
        assert_eq!(side.color.len(), columns * rows, "a view");
    }
    let shifts = sides.map(|side| parallax.shifts(side.eye, size_px[0]));
    let mut layer = HiddenLayer { color: color.to_vec(), disparity: disparity.to_vec() };
    let lines = layer.color.par_chunks_exact_mut(width).zip(layer.disparity.par_chunks_exact_mut(width));
    lines.enumerate().for_each_init(Scratch::default, |scratch, (y, (color_behind, behind))| {
        let front = Line { color: &color[y * width..][..width], disparity: &disparity[y * width..][..width] };
        for (side, shifts) in sides.iter().zip(&shifts) {
            let row = |y: usize| &side.color[y.min(rows - 1) * columns..][..columns];
            let view = ViewLine { above: row(y / 2), below: row(y.div_ceil(2)) };
            for hole in scratch.holes(front.disparity, shifts) {
                for (at, color) in hole.seen(&front, &view, shifts) {
                    color_behind[at] = color;
                    behind[at] = front.disparity[hole.far];
                }
            }
        }
    });
    layer
}

/// A row of the picture.
struct Line<'a> {
    color: &'a [[u8; 4]],
    disparity: &'a [u8],
}

/// A part of a view's row that the picture does not show.
struct Hole {
    /// Its ends, 1/4096 pixel.
    ends: [i32; 2],
    /// The pixel of the picture beside it, on its farther side.
    far: usize,
}

impl Hole {
    /// The pixels of the view whose middles it contains.
    fn pixels(&self, width: usize) -> Range<usize> {
        let [first, end] = self.ends.map(|end| {
            let pixel = (end + Parallax::UNIT / 2).div_euclid(Parallax::UNIT);
            usize::try_from(pixel).unwrap_or(0).min(width)
        });
        first..end.max(first)
    }

    /// What a view shows in the hole: for each of its pixels the column of the picture that it comes
    /// from, and its colour. Columns that a nearer surface does not cover are left out.
    fn seen(
        &self,
        front: &Line<'_>,
        view: &ViewLine<'_>,
        shifts: &[i32; 256],
    ) -> impl Iterator<Item = (usize, [u8; 4])> {
        let far = front.disparity[self.far];
        let shift = shifts[usize::from(far)];
        let pixels = self.pixels(front.disparity.len());
        pixels.clone().filter_map(move |x| {
            let place = (x as i32 * Parallax::UNIT - shift + Parallax::UNIT / 2).div_euclid(Parallax::UNIT);
            let at = usize::try_from(place).ok()?;
            let is_hidden = front.disparity.get(at).is_some_and(|disparity| *disparity > far);
            is_hidden.then(|| (at, view.color(x, &pixels, front.color[self.far])))
        })
    }
}

/// Buffers of a row.
#[derive(Default)]
struct Scratch {
    spans: Vec<Span>,
    active: Vec<Span>,
    pieces: Vec<LinePiece>,
}

impl Scratch {
    /// The holes in a view that is made of a row with these disparities. Holes at the border of the
    /// picture are left out: they have no surface on one side.
    fn holes(&mut self, disparity: &[u8], shifts: &[i32; 256]) -> impl Iterator<Item = Hole> {
        self.pieces.clear();
        if !is_one_surface(disparity, shifts) {
            place(disparity, shifts, &mut self.spans);
            cut(&self.spans, &mut self.active, disparity.len(), &mut self.pieces);
        }
        self.pieces.windows(3).filter_map(|pieces| {
            let [before, hole, behind] = pieces else { return None };
            let (Some(left), None, Some(right)) = (before.pixel, hole.pixel, behind.pixel) else {
                return None;
            };
            let far = if disparity[left] <= disparity[right] { left } else { right };
            Some(Hole { ends: [before.to, hole.to], far })
        })
    }
}

/// The rows of a view just above and below a row of the picture. Both are the same one where the view
/// has a row at that height.
struct ViewLine<'a> {
    above: &'a [[u8; 4]],
    below: &'a [[u8; 4]],
}

impl ViewLine<'_> {
    /// The colour of a pixel in a hole: the mean of the rays on its left and right, without rays outside
    /// of the hole. Of both rows, the one that is more like the colour of the hole's farther side counts;
    /// their mean would blur horizontal edges.
    fn color(&self, x: usize, hole: &Range<usize>, likely: [u8; 4]) -> [u8; 4] {
        let [left, right] = [x / 2, x.div_ceil(2)];
        let left = if 2 * left < hole.start { right } else { left };
        let right = if 2 * right < hole.end { right } else { left };
        let [above, below] = [self.above, self.below].map(|row| {
            let [left, right] = [left, right].map(|at| row[at.min(row.len() - 1)]);
            std::array::from_fn(|channel| u8::midpoint(left[channel], right[channel]))
        });
        if difference(above, likely) <= difference(below, likely) { above } else { below }
    }
}

/// The difference of two colours, summed over the channels.
fn difference(a: [u8; 4], b: [u8; 4]) -> u16 {
    (0..3).map(|channel| u16::from(a[channel].abs_diff(b[channel]))).sum()
}
