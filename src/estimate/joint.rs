//! Depth at the size of its picture, whose edges follow the picture's edges.
//!
//! Joint bilateral upsampling (Kopf et al., ACM Transactions on Graphics 26(3), 2007): a pixel takes
//! the mean of the coarse values around it, weighted by distance and by likeness of colour.

use image::RgbImage;
use rayon::prelude::*;

use crate::closeness::Closeness;

/// Coarse pixels to each side that count.
const RADIUS: i32 = 2;
/// Standard deviation of the weight by distance, coarse pixels.
const DISTANCE: f32 = 0.9;
/// Standard deviation of the weight by colour, bytes (root of the summed squares of three channels).
const COLOR: f32 = 18.0;
/// Weight of a coarse value of any colour: where no colour is like the pixel's, distance decides.
const LEAST: f32 = 1e-3;

/// Coarse closeness at the size of `picture`. `small` is the picture at the coarse size.
pub(crate) fn upsampled(coarse: &Closeness, small: &RgbImage, picture: &RgbImage) -> Vec<f32> {
    let (width, height) = picture.dimensions();
    let [coarse_width, coarse_height] = coarse.size_px();
    let scale = [coarse_width as f32 / width as f32, coarse_height as f32 / height as f32];
    let likeness = likeness_table();
    let mut values = vec![0.0; width as usize * height as usize];
    values.par_chunks_exact_mut(width as usize).enumerate().for_each(|(y, row)| {
        let at_y = (y as f32 + 0.5) * scale[1];
        for (x, value) in row.iter_mut().enumerate() {
            let at = [(x as f32 + 0.5) * scale[0], at_y];
            *value = joint_mean(coarse, small, at, picture.get_pixel(x as u32, y as u32).0, &likeness);
        }
    });
    values
}

/// The weight of colours by a sixteenth of their squared distance.
fn likeness_table() -> Vec<f32> {
    let last = 3 * 255 * 255 / 16;
    (0..=last).map(|step| (-(step as f32 * 16.0) / (2.0 * COLOR * COLOR)).exp().max(LEAST)).collect()
}

/// The mean around `at` (coarse pixels) for a pixel of this colour.
fn joint_mean(coarse: &Closeness, small: &RgbImage, at: [f32; 2], color: [u8; 3], likeness: &[f32]) -> f32 {
    let [width, height] = coarse.size_px().map(|side| side as i32);
    let centre = at.map(|place| place.floor() as i32);
    let weights = |axis: usize| {
        std::array::from_fn::<f32, { 2 * RADIUS as usize + 1 }, _>(|step| {
            let place = (centre[axis] - RADIUS) as f32 + step as f32 + 0.5;
            (-(place - at[axis]).powi(2) / (2.0 * DISTANCE * DISTANCE)).exp()
        })
    };
    let [across, down] = [weights(0), weights(1)];
    let (mut sum, mut total) = (0.0, 0.0);
    for (row, by_row) in down.iter().enumerate() {
        let y = (centre[1] - RADIUS + row as i32).clamp(0, height - 1);
        for (column, by_column) in across.iter().enumerate() {
            let x = (centre[0] - RADIUS + column as i32).clamp(0, width - 1);
            let other = small.get_pixel(x as u32, y as u32).0;
            let apart: i32 =
                (0..3).map(|channel| (i32::from(color[channel]) - i32::from(other[channel])).pow(2)).sum();
            let weight = by_row * by_column * likeness[apart as usize / 16];
            sum += weight * coarse.values()[(y * width + x) as usize];
            total += weight;
        }
    }
    sum / total
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture whose left part is dark, and coarse depth that is blurred over three pixels.
    #[test]
    fn edges_of_depth_follow_edges_of_colour() {
        let edge_px = 37;
        let picture =
            RgbImage::from_fn(64, 32, |x, _| image::Rgb(if x < edge_px { [20; 3] } else { [200; 3] }));
        let small = image::imageops::resize(&picture, 16, 8, image::imageops::FilterType::Triangle);
        let ramp = |x: i32| ((x as f32 + 0.5 - 9.25) / 3.0 + 0.5).clamp(0.0, 1.0);
        let coarse = Closeness::new([16, 8], (0..128).map(|index| ramp(index % 16)).collect()).unwrap();
        let joint = upsampled(&coarse, &small, &picture);
        let row = &joint[16 * 64..17 * 64];
        let step = row[edge_px as usize] - row[edge_px as usize - 1];
        assert!(step > 0.35, "the step at the edge of colour is {step}");
        let plain = (ramp(9) - ramp(8)) / 4.0;
        assert!(plain < 0.1, "without the filter it is {plain}");
    }

    #[test]
    fn depth_of_one_colour_is_only_smoothed() {
        let picture = RgbImage::from_pixel(40, 24, image::Rgb([90, 80, 70]));
        let small = RgbImage::from_pixel(10, 6, image::Rgb([90, 80, 70]));
        let coarse =
            Closeness::new([10, 6], (0..60).map(|index| (index % 10) as f32 / 9.0).collect()).unwrap();
        for (index, value) in upsampled(&coarse, &small, &picture).iter().enumerate() {
            let x = (index % 40) as f32 + 0.5;
            let plain = (x / 4.0 - 0.5) / 9.0; // a ramp across the picture
            if (10.0..30.0).contains(&x) {
                assert!((value - plain).abs() < 0.02, "{value} at column {x}, not {plain}");
            }
        }
    }
}
