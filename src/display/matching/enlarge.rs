//! The disparity of every pixel, from that of every second pixel of every second row.
//!
//! A pixel has the mean of the four places around it. Near places of a like colour weigh most.

use rayon::prelude::*;

/// The factor of a weight for each step by which colours differ, summed over the channels: exp(-1/60).
const FADE: f32 = 0.983_471_46;
/// The weight at the distance of half a place, and of a whole one.
const NEAR: [f32; 2] = [0.606_530_66, 0.367_879_44]; // exp(-1/2), exp(-1)
/// The disparities of a picture.
pub(super) fn enlarge(size_px: [u32; 2], color: &[[u8; 4]], sparse: &[f32]) -> Vec<f32> {
    let [width, height] = size_px.map(|side| side as usize);
    let columns = width.div_ceil(2);
    let rows = height.div_ceil(2);
    let mut fades = [1.0; 766];
    (1..fades.len()).for_each(|sum| fades[sum] = fades[sum - 1] * FADE);
    // The places beside a coordinate, and the weights of their distances.
    let beside = |at: usize, count: usize| {
        let place = at / 2;
        let weights = if at.is_multiple_of(2) { [1.0, NEAR[1]] } else { [NEAR[0]; 2] };
        ([place, (place + 1).min(count - 1)], weights)
    };
    let mut out = vec![0.0; width * height];
    out.par_chunks_exact_mut(width).enumerate().for_each(|(y, out)| {
        let (near_rows, row_weights) = beside(y, rows);
        for (x, out) in out.iter_mut().enumerate() {
            let own = color[y * width + x];
            let (near_columns, column_weights) = beside(x, columns);
            let [mut sum, mut weights] = [0.0, 0.0];
            for (row, row_weight) in near_rows.into_iter().zip(row_weights) {
                for (column, column_weight) in near_columns.into_iter().zip(column_weights) {
                    let other = color[2 * row * width + 2 * column];
                    let difference: u16 =
                        (0..3).map(|channel| u16::from(own[channel].abs_diff(other[channel]))).sum();
                    let weight = row_weight * column_weight * fades[usize::from(difference)];
                    sum += weight * sparse[row * columns + column];
                    weights += weight;
                }
            }
            *out = sum / weights;
        }
    });
    out
}
