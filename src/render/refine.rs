//! Views that are warped from a rendered one, and cast again where the warp is wrong.
//!
//! A few blocks of the view, evenly spread, are cast first. Their difference from the warp says
//! where else it is wrong: the error of a block is estimated from its neighbours that are cast and
//! from its contrast, because a wrong shift shows where colours change. The blocks with the largest
//! estimates are cast next, in rounds; each round uses the errors that the rounds before it found.
//! The budget counts blocks, not time, so that equal pictures get equal views on every machine.
//!
//! Spaces: blocks of [`BLOCK_PX`] pixels, rows from the top. Errors and contrasts are mean squared
//! differences of the bytes of a pixel.

use rayon::prelude::*;

use super::chosen::{BLOCK_PX, ChosenBlocks};
use super::frame::RenderedFrame;

/// Distance between blocks that are cast first, in columns and in rows of blocks.
const SPREAD: usize = 5;
/// Rounds after the first.
const ROUNDS: u32 = 2;
/// Weight of errors without regard to contrast, beside those by contrast.
const FLAT_SHARE: f32 = 0.3;

/// A warped view, its blocks that are cast so far, and their errors.
#[derive(Clone, Debug)]
pub struct Refinement {
    size_px: [u32; 2],
    view: Vec<[u8; 3]>,
    /// The contrast of each block of the warped view.
    contrasts: Vec<f32>,
    /// The error of each block that is cast; 0 elsewhere.
    errors: Vec<f32>,
    is_cast: Vec<bool>,
    /// Blocks that may be cast after the first ones.
    budget: usize,
    round: u32,
}

impl Refinement {
    /// The share that makes both eyes of a pair cost less than half a picture beside the one that they
    /// are made of.
    pub const USUAL_SHARE: f64 = 0.1;

    /// Refines a view of `made_of`'s size, warped from that picture, by casting about this share of
    /// the blocks that show anything.
    ///
    /// # Panics
    /// When the view is not of that size.
    #[must_use]
    pub fn new(view: Vec<[u8; 3]>, made_of: &RenderedFrame, share: f64) -> Self {
        let size_px = made_of.size_px;
        assert_eq!(view.len(), made_of.color_rgba.len(), "a view has the size of its picture");
        let blocks = ChosenBlocks::grid(size_px).iter().product();
        let shows = per_block(size_px, |at| f32::from(u8::from(made_of.depth_mm[at].is_finite())));
        let visible = |at: &usize| shows[*at] > 0.0;
        let spread = (0..blocks).filter(|at| is_spread(size_px, *at)).filter(visible).count();
        let all = (share.clamp(0.0, 1.0) * (0..blocks).filter(visible).count() as f64).round() as usize;
        Self {
            contrasts: contrasts(size_px, &view),
            size_px,
            view,
            errors: vec![0.0; blocks],
            is_cast: vec![false; blocks],
            budget: all.saturating_sub(spread),
            round: 0,
        }
    }

    /// The blocks to cast next; `None` when the view is done.
    #[must_use]
    pub fn next_blocks(&self) -> Option<ChosenBlocks> {
        let [columns, _] = ChosenBlocks::grid(self.size_px);
        if self.round == 0 {
            let is_spread = |column, row| is_spread(self.size_px, row * columns + column);
            return Some(ChosenBlocks::where_each(self.size_px, is_spread));
        }
        let rounds_left = (ROUNDS + 1).checked_sub(self.round).filter(|left| *left > 0)?;
        let worst = self.worst(self.budget.div_ceil(rounds_left as usize));
        (!worst.is_empty()).then(|| {
            let mut chosen = vec![false; self.is_cast.len()];
            worst.into_iter().for_each(|at| chosen[at] = true);
            ChosenBlocks::where_each(self.size_px, |column, row| chosen[row * columns + column])
        })
    }

    /// Takes the pixels of these blocks from the picture of the view's own camera, or all of them
    /// where that is whole.
    pub fn take(&mut self, blocks: &ChosenBlocks, cast: &RenderedFrame) {
        let color = |at: usize| [0, 1, 2].map(|channel| cast.color_rgba[at][channel]);
        if !cast.is_partial {
            self.view = (0..self.view.len()).map(color).collect();
            self.round = ROUNDS + 1;
            return;
        }
        let chosen = || blocks.flags().iter().enumerate().filter(|(_, chosen)| **chosen).map(|(at, _)| at);
        for block in chosen() {
            self.errors[block] = mean(self.size_px, block, |at| squared(self.view[at], color(at)));
            self.is_cast[block] = true;
            for at in pixels(self.size_px, block) {
                self.view[at] = color(at);
            }
        }
        if self.round > 0 {
            self.budget = self.budget.saturating_sub(chosen().count());
        }
        self.round += 1;
    }

    /// The view: red, green, blue in rows from the top.
    #[must_use]
    pub fn into_view(self) -> Vec<[u8; 3]> {
        self.view
    }

    /// The blocks, at most `count`, with the largest estimated errors above zero.
    fn worst(&self, count: usize) -> Vec<usize> {
        let columns = ChosenBlocks::grid(self.size_px)[0];
        let where_cast = |values: &[f32]| {
            let kept: Vec<f32> = values
                .iter()
                .zip(&self.is_cast)
                .map(|(value, cast)| if *cast { *value } else { 0.0 })
                .collect();
            blurred(columns, &kept)
        };
        let [errors, contrasts] = [&self.errors, &self.contrasts].map(|values| where_cast(values));
        let counts = where_cast(&vec![1.0; self.is_cast.len()]);
        let estimate = |at: usize| {
            let by_contrast = self.contrasts[at] * errors[at] / (contrasts[at] + 1.0);
            by_contrast + FLAT_SHARE * errors[at] / counts[at].max(1e-6)
        };
        let open = (0..self.is_cast.len()).filter(|at| !self.is_cast[*at]);
        let mut found: Vec<(f32, usize)> =
            open.map(|at| (estimate(at), at)).filter(|(error, _)| *error > 0.0).collect();
        // Blocks of equal estimates go by their place.
        let order = |a: &(f32, usize), b: &(f32, usize)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
        if count < found.len() {
            found.select_nth_unstable_by(count, order);
            found.truncate(count);
        }
        found.into_iter().map(|(_, at)| at).collect()
    }
}

/// Whether a block is one of those that are cast first: every second row of them is moved by half.
fn is_spread(size_px: [u32; 2], at: usize) -> bool {
    let columns = ChosenBlocks::grid(size_px)[0];
    let [column, row] = [at % columns, at / columns];
    let moved = if (row / SPREAD).is_multiple_of(2) { 0 } else { SPREAD / 2 };
    row.is_multiple_of(SPREAD) && (column + moved).is_multiple_of(SPREAD)
}

/// The places of a block's pixels in the picture.
fn pixels([width, height]: [u32; 2], block: usize) -> impl Iterator<Item = usize> + Clone {
    let columns = width.div_ceil(BLOCK_PX[0]) as usize;
    let [left, top] = [(block % columns) as u32 * BLOCK_PX[0], (block / columns) as u32 * BLOCK_PX[1]];
    let [right, end] = [(left + BLOCK_PX[0]).min(width), (top + BLOCK_PX[1]).min(height)];
    (top..end).flat_map(move |y| (left..right).map(move |x| (y * width + x) as usize))
}

/// The mean of a value of pixels over a block.
fn mean(size_px: [u32; 2], block: usize, value: impl Fn(usize) -> f32) -> f32 {
    let pixels = pixels(size_px, block);
    pixels.clone().map(value).sum::<f32>() / pixels.count() as f32
}

/// The mean over each block.
fn per_block(size_px: [u32; 2], value: impl Fn(usize) -> f32 + Sync) -> Vec<f32> {
    let blocks: usize = ChosenBlocks::grid(size_px).iter().product();
    (0..blocks).into_par_iter().map(|block| mean(size_px, block, &value)).collect()
}

/// The differences of neighbours along a row, around each block.
fn contrasts(size_px: [u32; 2], view: &[[u8; 3]]) -> Vec<f32> {
    let width = size_px[0] as usize;
    let steps = per_block(size_px, |at| {
        let [left, right] =
            [at - usize::from(!at.is_multiple_of(width)), at + usize::from(at % width + 1 < width)];
        squared(view[left], view[right]) / 4.0
    });
    let columns = ChosenBlocks::grid(size_px)[0];
    let around = |at: usize| {
        let [left, right] =
            [at - usize::from(!at.is_multiple_of(columns)), at + usize::from(at % columns + 1 < columns)];
        (steps[left] + 2.0 * steps[at] + steps[right]) / 4.0
    };
    (0..steps.len()).map(around).collect()
}

/// A sum over each block's neighbours up to two blocks away, by binomial weights.
fn blurred(columns: usize, values: &[f32]) -> Vec<f32> {
    const WEIGHTS: [f32; 5] = [1.0, 4.0, 6.0, 4.0, 1.0];
    let mut across = Vec::with_capacity(values.len());
    let mut padded = vec![0.0; columns + 4];
    for row in values.chunks_exact(columns) {
        padded[2..columns + 2].copy_from_slice(row);
        across
            .extend(padded.windows(5).map(|near| near.iter().zip(WEIGHTS).map(|(v, w)| v * w).sum::<f32>()));
    }
    let rows: Vec<&[f32]> = across.chunks_exact(columns).collect();
    let mut sums = vec![0.0; values.len()];
    for (row, sums) in sums.chunks_exact_mut(columns).enumerate() {
        for (near, weight) in (row.saturating_sub(2)..).zip(&WEIGHTS[2_usize.saturating_sub(row)..]) {
            let Some(values) = rows.get(near) else { break };
            sums.iter_mut().zip(*values).for_each(|(sum, value)| *sum += weight * value);
        }
    }
    sums
}

fn squared(a: [u8; 3], b: [u8; 3]) -> f32 {
    (0..3).map(|channel| f32::from(a[channel]) - f32::from(b[channel])).map(|d| d * d).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Timings;
    use relief_base::{DepthLimits, Point, Vector};
    use relief_volume::{Camera, Projection};

    const SIZE_PX: [u32; 2] = [161, 91];

    fn frame(color: impl Fn(u32, u32) -> u8, is_partial: bool) -> RenderedFrame {
        let [width, height] = SIZE_PX;
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let projection = Projection::Orthographic { height_mm: 100.0 };
        let (eye, look_at) = (Point::new(0.0, -500.0, 0.0), Point::new(0.0, 0.0, 0.0));
        RenderedFrame {
            size_px: SIZE_PX,
            color_rgba: pixels.map(|(x, y)| [color(x, y), 20, 30, 255]).collect(),
            depth_mm: vec![500.0; (width * height) as usize],
            display_mm: None,
            back: None,
            camera: Camera::new(eye, look_at, Vector::new(0.0, 0.0, 1.0), projection).unwrap(),
            limits: DepthLimits::new(400.0, 600.0).unwrap(),
            nearest_ball_mm: None,
            is_partial,
            timings: Timings::default(),
        }
    }

    /// A plate of 24 x 18 pixels with stripes, which the warp has left a pixel aside.
    fn plate(x: u32, y: u32) -> u8 {
        let is_plate = (60..84).contains(&x) && (40..58).contains(&y);
        if is_plate { if x.is_multiple_of(3) { 250 } else { 90 } } else { 60 }
    }

    fn warped() -> (RenderedFrame, Vec<[u8; 3]>) {
        let made_of = frame(|x, y| plate(x + 1, y), false);
        let view = made_of.color_rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
        (made_of, view)
    }

    fn wrong(view: &[[u8; 3]]) -> usize {
        let truth = frame(plate, false);
        view.iter().zip(&truth.color_rgba).filter(|(a, b)| a[0] != b[0]).count()
    }

    #[test]
    fn blocks_are_cast_where_the_warp_is_wrong_and_no_more_than_the_share() {
        let (made_of, view) = warped();
        let before = wrong(&view);
        let mut refinement = Refinement::new(view, &made_of, 0.1);
        let blocks: usize = ChosenBlocks::grid(SIZE_PX).iter().product();
        let mut cast = 0;
        while let Some(next) = refinement.next_blocks() {
            cast += next.flags().iter().filter(|chosen| **chosen).count();
            refinement.take(&next, &frame(plate, true));
        }
        assert!(cast as f64 <= 0.1 * blocks as f64 + 1.0, "{cast} of {blocks} blocks");
        let after = wrong(&refinement.into_view());
        assert!(before > 200 && after * 10 < before, "{before} pixels were wrong, {after} are");
    }

    #[test]
    fn a_view_that_is_right_is_done_after_the_first_blocks() {
        let truth = frame(plate, false);
        let view: Vec<[u8; 3]> = truth.color_rgba.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
        let mut refinement = Refinement::new(view.clone(), &truth, 0.1);
        let first = refinement.next_blocks().unwrap();
        let cast = first.flags().iter().filter(|cast| **cast).count();
        let share = cast as f64 / first.flags().len() as f64;
        assert!((0.03..0.05).contains(&share), "{share}");
        refinement.take(&first, &frame(plate, true));
        assert!(refinement.next_blocks().is_none());
        assert_eq!(refinement.into_view(), view);
    }

    #[test]
    fn a_whole_picture_is_taken_whole() {
        let (made_of, view) = warped();
        let mut refinement = Refinement::new(view, &made_of, 0.1);
        let first = refinement.next_blocks().unwrap();
        refinement.take(&first, &frame(plate, false));
        assert!(refinement.next_blocks().is_none());
        assert_eq!(wrong(&refinement.into_view()), 0);
    }

    #[test]
    fn every_block_has_one_that_is_cast_first_within_two_but_at_the_edges() {
        let [columns, rows] = ChosenBlocks::grid([800, 400]);
        let spread: Vec<f32> =
            (0..columns * rows).map(|at| f32::from(u8::from(is_spread([800, 400], at)))).collect();
        let sums = blurred(columns, &spread);
        let inside = |at: &usize| (3..columns - 3).contains(&(at % columns)) && at / columns < rows - 3;
        assert!((0..sums.len()).filter(inside).all(|at| sums[at] > 0.0));
        // The weights of a single block add up to those of both directions.
        let mut one = vec![0.0; columns * rows];
        one[5 * columns + 7] = 1.0;
        let sums = blurred(columns, &one);
        assert_eq!((sums[5 * columns + 7], sums[4 * columns + 8], sums[3 * columns + 9]), (36.0, 16.0, 1.0));
        assert_eq!(sums.iter().sum::<f32>(), 256.0);
    }
}
