//! The median of a square window, for several pixels at a time.
//!
//! By forgetful selection: of half the window and two more, the smallest and the largest cannot be
//! the median; they go, the next value comes, until three are left. The same exchanges whatever the
//! values are, so that a row of pixels goes through them side by side in vector registers.

use rayon::prelude::*;

use super::padded::Padded;

/// Pixels that are worked on side by side.
const LANES: usize = 8;

type Lanes = [f32; LANES];

/// The median over `SIDE` x `SIDE` pixels, `COUNT` in all, of values in rows of `width`.
pub(super) fn median<const SIDE: usize, const COUNT: usize>(values: &[f32], width: usize) -> Vec<f32> {
    const { assert!(SIDE * SIDE == COUNT && SIDE % 2 == 1, "an odd square window") };
    let padded = Padded::new(values, width, SIDE / 2, LANES);
    let mut filtered = vec![0.0; values.len()];
    filtered.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        for (group, out) in line.chunks_mut(LANES).enumerate() {
            let mut window = [[0.0; LANES]; COUNT];
            for (at, lanes) in window.iter_mut().enumerate() {
                let column = group * LANES + at % SIDE;
                lanes.copy_from_slice(padded.run(column, row + at / SIDE, LANES));
            }
            out.copy_from_slice(&middle(&mut window)[..out.len()]);
        }
    });
    filtered
}

/// The median of each lane. Shuffles the window.
fn middle<const COUNT: usize>(window: &mut [Lanes; COUNT]) -> Lanes {
    let first_to_come = COUNT / 2 + 2;
    for next in first_to_come..COUNT {
        // One came and two went for each before it.
        let kept = 2 * first_to_come - next;
        move_extremes_out(&mut window[..kept]);
        window[0] = window[next];
    }
    move_extremes_out(&mut window[..3]);
    window[1]
}

/// Moves the smallest value to the front and the largest to the end.
#[inline]
fn move_extremes_out(values: &mut [Lanes]) {
    let last = values.len() - 1;
    for i in 0..values.len() / 2 {
        exchange(values, i, last - i);
    }
    for i in 1..values.len().div_ceil(2) {
        exchange(values, 0, i);
    }
    for i in values.len() / 2..last {
        exchange(values, i, last);
    }
}

/// Puts the smaller of two values first, in every lane.
#[inline]
fn exchange(values: &mut [Lanes], first: usize, second: usize) {
    let (a, b) = (values[first], values[second]);
    for lane in 0..LANES {
        let in_order = a[lane] <= b[lane];
        values[first][lane] = if in_order { a[lane] } else { b[lane] };
        values[second][lane] = if in_order { b[lane] } else { a[lane] };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exchanges that sort every order of zeros and ones find the median of all values (the
    /// zero-one principle).
    #[test]
    fn the_middle_of_every_pattern_of_nine_is_right() {
        for pattern in 0u32..1 << 9 {
            let bit = |at: usize| if pattern >> at & 1 == 1 { 1.0 } else { 0.0 };
            let mut window: [Lanes; 9] = std::array::from_fn(|at| [bit(at); LANES]);
            let expected = if pattern.count_ones() > 4 { 1.0 } else { 0.0 };
            assert_eq!(middle(&mut window), [expected; LANES], "{pattern:#b}");
        }
    }
}
