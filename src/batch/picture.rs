//! Pictures among the outputs.

use std::io::Cursor;

use image::{DynamicImage, ImageReader, Limits, RgbImage};

use super::sink::Sink;
use relief_display::MAX_FRAME_SIDE_PX;

/// Largest picture that is read, bytes.
pub(super) const LARGEST_PICTURE: u64 = 1 << 30;

const CHANNELS: usize = 3;

/// A picture among the outputs; `None` if none can be read.
pub(super) fn open(out: &Sink, name: &str) -> Option<DynamicImage> {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_FRAME_SIDE_PX);
    limits.max_image_height = Some(MAX_FRAME_SIDE_PX);
    let file = Cursor::new(out.read(name, LARGEST_PICTURE).ok()??);
    let mut reader = ImageReader::new(file).with_guessed_format().ok()?;
    reader.limits(limits);
    reader.decode().ok()
}

/// A picture of another size: each pixel is the mean of those that it covers, at least of one.
///
/// The thumbnails of crate `image` take ten times as long, which was a tenth of a batch.
pub(super) fn shrunk(picture: &RgbImage, [width, height]: [u32; 2]) -> RgbImage {
    let covered = |index: u32, count: u32, of: u32| {
        let edge = |index: u32| (u64::from(index) * u64::from(of) / u64::from(count)) as usize;
        edge(index)..edge(index + 1).max(edge(index) + 1)
    };
    let row_bytes = CHANNELS * picture.width() as usize;
    let mut small = RgbImage::new(width, height);
    let mut sums = vec![0u32; row_bytes];
    for row in 0..height {
        let rows = covered(row, height, picture.height());
        sums.fill(0);
        for bytes in picture.as_raw()[rows.start * row_bytes..rows.end * row_bytes].chunks_exact(row_bytes) {
            sums.iter_mut().zip(bytes).for_each(|(sum, byte)| *sum += u32::from(*byte));
        }
        for column in 0..width {
            let columns = covered(column, width, picture.width());
            let count = (rows.len() * columns.len()) as u32;
            let pixel = small.get_pixel_mut(column, row);
            for (channel, mean) in pixel.0.iter_mut().enumerate() {
                let sum: u32 = columns.clone().map(|column| sums[CHANNELS * column + channel]).sum();
                *mean = ((sum + count / 2) / count) as u8;
            }
        }
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_pixel_is_the_mean_of_those_that_it_covers() {
        let picture = RgbImage::from_fn(5, 4, |x, y| image::Rgb([(40 * x) as u8, (60 * y) as u8, 7]));
        // Columns 0 and 1, then 2 to 4; rows 0 and 1, then 2 and 3.
        let expected = [[20, 30, 7], [120, 30, 7], [20, 150, 7], [120, 150, 7]];
        assert_eq!(shrunk(&picture, [2, 2]).into_raw(), expected.concat());
    }

    #[test]
    fn a_picture_that_is_too_small_repeats_its_pixels() {
        let picture = RgbImage::from_fn(2, 1, |x, _| image::Rgb([x as u8; 3]));
        assert_eq!(shrunk(&picture, [4, 2]).into_raw(), [[0u8; 6], [1; 6], [0; 6], [1; 6]].concat());
    }
}
