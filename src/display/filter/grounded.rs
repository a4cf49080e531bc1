//! Depth without outliers, with almost transparent pixels behind everything.
//!
//! An almost transparent pixel shows the background. In front of it, it would cover in the views what
//! is behind its own random depth.

use rayon::prelude::*;

use super::median::median;
use super::padded::miss_if_unknown;

/// Coverage below which a pixel is almost transparent: 5 %.
const TRANSPARENT: u8 = 13;

/// View depth (mm, `+inf` for a miss) of a picture of this width, in rows from the top: the median of
/// 3x3 pixels, and a miss where the picture is almost transparent. A single such pixel among others
/// has the farthest depth of its neighbours, so that it is no speck. The fourth byte of a colour is
/// its coverage.
///
/// # Panics
/// When there are not as many depths as colours, or they fill no rows of this width.
#[must_use]
pub fn grounded_depth(width: usize, color: &[[u8; 4]], depth_mm: &[f32]) -> Vec<f32> {
    assert_eq!(color.len(), depth_mm.len(), "a depth for each colour");
    assert!(width > 0 && color.len().is_multiple_of(width), "whole rows");
    let known: Vec<f32> = depth_mm.iter().map(|&mm| miss_if_unknown(mm)).collect();
    let depth = median::<3, 9>(&known, width);
    let height = color.len() / width;
    let is_transparent = |at: usize| color[at][3] < TRANSPARENT;
    let mut grounded = depth.clone();
    grounded.par_chunks_exact_mut(width).enumerate().for_each(|(y, line)| {
        for (x, mm) in line.iter_mut().enumerate().filter(|(x, _)| is_transparent(y * width + x)) {
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let around = rows.flat_map(|row| {
                (x.saturating_sub(1)..(x + 2).min(width)).map(move |column| row * width + column)
            });
            let around = around.filter(|at| *at != y * width + x);
            *mm = if around.clone().any(is_transparent) {
                f32::INFINITY
            } else {
                around.map(|at| depth[at]).reduce(f32::max).unwrap_or(f32::INFINITY)
            };
        }
    });
    grounded
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transparent_pixels_are_far_and_single_ones_as_their_farthest_neighbour() {
        const WIDTH: usize = 8;
        let mut color = vec![[200, 200, 200, 255]; WIDTH * 6];
        let depth: Vec<f32> = (0..color.len()).map(|at| 100.0 + (at % WIDTH) as f32).collect();
        for at in [9, 29, 30] {
            color[at][3] = 12;
        }
        let grounded = grounded_depth(WIDTH, &color, &depth);
        assert_eq!((grounded[9], grounded[29], grounded[30]), (102.0, f32::INFINITY, f32::INFINITY));
        assert!(
            grounded.iter().zip(&depth).enumerate().all(|(at, (a, b))| [9, 29, 30].contains(&at) || a == b)
        );
        assert_eq!(grounded_depth(1, &[[0; 4]], &[5.0]), [f32::INFINITY]);
    }

    #[test]
    fn single_outliers_and_unknown_depths_go() {
        let color = vec![[9, 9, 9, 255]; 25];
        let mut depth = vec![300.0; 25];
        depth[12] = 20.0;
        depth[24] = f32::NAN;
        assert_eq!(grounded_depth(5, &color, &depth), vec![300.0; 25]);
    }
}
