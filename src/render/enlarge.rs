//! Enlarging a picture: frames under a budget are enlarged before overlays are drawn.
//!
//! Colour and coverage are interpolated bilinearly between the centres of pixels. Depth is that of
//! the nearest pixel: a mean of two depths would hang in the air between two surfaces, where
//! neither a display nor a pick may look.

use rayon::prelude::*;

use super::frame::{BackLayer, RenderedFrame};

/// The frame with `size_px` pixels.
pub(super) fn enlarged(frame: RenderedFrame, size_px: [u32; 2]) -> RenderedFrame {
    let from = frame.size_px;
    let back = frame.back.map(|back| BackLayer {
        color_rgba: colors(&back.color_rgba, from, size_px),
        depth_mm: nearest(&back.depth_mm, from, size_px),
    });
    RenderedFrame {
        color_rgba: colors(&frame.color_rgba, from, size_px),
        depth_mm: nearest(&frame.depth_mm, from, size_px),
        size_px,
        back,
        ..frame
    }
}

/// The neighbours of a place along the smaller side, and the share of the second in 256ths.
#[derive(Clone, Copy)]
struct Neighbours {
    first: usize,
    second: usize,
    share: u32,
}

impl Neighbours {
    /// For every place along the larger side.
    fn all(from: u32, to: u32) -> Vec<Self> {
        let last = from as usize - 1;
        let ratio = f64::from(from) / f64::from(to);
        let place = |at: u32| {
            let x = ((f64::from(at) + 0.5) * ratio - 0.5).max(0.0);
            let first = (x as usize).min(last);
            Self { first, second: (first + 1).min(last), share: ((x - first as f64) * 256.0).round() as u32 }
        };
        (0..to).map(place).collect()
    }

    /// The mean of two values, 256 times as large.
    fn mix(self, first: u32, second: u32) -> u32 {
        first * (256 - self.share) + second * self.share
    }
}

fn colors(pixels: &[[u8; 4]], from: [u32; 2], to: [u32; 2]) -> Vec<[u8; 4]> {
    let width = from[0] as usize;
    let (columns, rows) = (Neighbours::all(from[0], to[0]), Neighbours::all(from[1], to[1]));
    let mut enlarged = vec![[0; 4]; columns.len() * rows.len()];
    enlarged.par_chunks_mut(columns.len()).zip(&rows).for_each(|(out, row)| {
        let (above, below) = (&pixels[row.first * width..][..width], &pixels[row.second * width..][..width]);
        let between: Vec<[u32; 4]> = above
            .iter()
            .zip(below)
            .map(|(a, b)| [0, 1, 2, 3].map(|channel| row.mix(a[channel].into(), b[channel].into())))
            .collect();
        for (pixel, column) in out.iter_mut().zip(&columns) {
            let (left, right) = (between[column.first], between[column.second]);
            *pixel = [0, 1, 2, 3].map(|i| ((column.mix(left[i], right[i]) + (1 << 15)) >> 16) as u8);
        }
    });
    enlarged
}

fn nearest(depths: &[f32], from: [u32; 2], to: [u32; 2]) -> Vec<f32> {
    let width = from[0] as usize;
    // The pixel that the centre lies in.
    let place = |at: u32, axis: usize| {
        ((2 * u64::from(at) + 1) * u64::from(from[axis]) / (2 * u64::from(to[axis]))) as usize
    };
    let columns: Vec<usize> = (0..to[0]).map(|x| place(x, 0)).collect();
    let row = |y: u32| {
        let row = &depths[place(y, 1) * width..][..width];
        columns.iter().map(move |&x| row[x])
    };
    (0..to[1]).flat_map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_interpolated_between_centres_and_kept_at_the_edges() {
        let pixels = [[0, 0, 0, 255], [100, 200, 40, 255]];
        let wide = colors(&pixels, [2, 1], [4, 1]);
        assert_eq!(wide, [[0, 0, 0, 255], [25, 50, 10, 255], [75, 150, 30, 255], [100, 200, 40, 255]]);
        assert_eq!(colors(&pixels, [2, 1], [2, 3])[4..], pixels, "rows are copies where there is one");
        assert_eq!(colors(&pixels, [1, 2], [1, 2]), pixels, "the same size is the same picture");
    }

    #[test]
    fn depths_are_never_mixed() {
        let depths = [1.0, f32::INFINITY, 3.0, 4.0, 5.0, 6.0];
        let larger = nearest(&depths, [3, 2], [7, 5]);
        assert_eq!(larger.len(), 35);
        assert!(larger.iter().all(|depth| depths.contains(depth)));
        assert_eq!(
            larger[..7],
            [1.0, 1.0, f32::INFINITY, f32::INFINITY, f32::INFINITY, 3.0, 3.0],
            "by the centres of pixels"
        );
        assert_eq!(larger[28..], [4.0, 4.0, 5.0, 5.0, 5.0, 6.0, 6.0]);
        assert_eq!(nearest(&depths, [3, 2], [3, 2]), depths);
    }
}
