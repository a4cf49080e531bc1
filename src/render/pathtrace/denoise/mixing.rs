//! The share of the noisy picture in the denoised one.
//!
//! The error of a fit is estimated by the half of the passes that it did not see: the square of their
//! difference is the error of the fit and the noise of the half, which the difference between the
//! halves measures. Estimates are means over windows.

use super::features::Pixel;

/// Pixels from the middle of a window to its sides; windows are applied twice.
const RADIUS: usize = 8;
/// Shares below this are within the noise of their estimate.
const UNCERTAIN: f32 = 0.1;

/// The share of the noisy picture at each pixel, 0 to 1: the one with the least expected error.
pub(super) fn noisy_shares(pixels: &[Pixel], fitted: &[[[f32; 3]; 2]], width: usize) -> Vec<f32> {
    let estimates: Vec<[f32; 2]> =
        pixels.iter().zip(fitted).map(|(pixel, halves)| squares(pixel, halves)).collect();
    let [of_fit, of_noise] = [0, 1].map(|which| {
        let values: Vec<f32> = estimates.iter().map(|estimate| estimate[which]).collect();
        smoothed(&smoothed(&values, width), width)
    });
    let share = |(fit, noise): (f32, f32)| {
        let fit = fit.max(0.0);
        let best = fit / (fit + noise).max(f32::MIN_POSITIVE);
        ((best - UNCERTAIN) / (1.0 - UNCERTAIN)).clamp(0.0, 1.0)
    };
    of_fit.into_iter().zip(of_noise).map(share).collect()
}

/// Estimates of the squared errors of the fit and of the noisy picture.
fn squares(pixel: &Pixel, halves: &[[f32; 3]; 2]) -> [f32; 2] {
    let (mut of_fit, mut of_noise) = (0.0, 0.0);
    for channel in 0..3 {
        let [even, odd] = [0, 1].map(|half| pixel.targets[half * 3 + channel] * pixel.coverage);
        let [fit_even, fit_odd] = halves.map(|half| half[channel]);
        let noise = (even - odd).powi(2);
        let crossed = ((fit_even - odd).powi(2) + (fit_odd - even).powi(2)) / 2.0;
        // The mean of both fits has half of their variance.
        of_fit += crossed - noise / 2.0 - (fit_even - fit_odd).powi(2) / 4.0;
        of_noise += noise / 4.0;
    }
    [of_fit, of_noise]
}

/// Means over square windows, which end at the edges of the picture.
fn smoothed(values: &[f32], width: usize) -> Vec<f32> {
    let height = values.len() / width.max(1);
    let along_rows = means(values, [width, height], [1, width]);
    means(&along_rows, [height, width], [width, 1])
}

/// Means over runs of pixels along lines: `count` pixels of a line are a stride apart, and so are lines.
fn means(values: &[f32], [count, lines]: [usize; 2], [stride, line_stride]: [usize; 2]) -> Vec<f32> {
    let mut means = vec![0f32; values.len()];
    for line in 0..lines {
        let at = |index: usize| line * line_stride + index * stride;
        let mut sum: f64 = (0..RADIUS.min(count)).map(|index| f64::from(values[at(index)])).sum();
        for index in 0..count {
            if index + RADIUS < count {
                sum += f64::from(values[at(index + RADIUS)]);
            }
            let held = (index + RADIUS + 1).min(count) - index.saturating_sub(RADIUS);
            means[at(index)] = (sum / held as f64) as f32;
            if let Some(leaving) = index.checked_sub(RADIUS) {
                sum -= f64::from(values[at(leaving)]);
            }
        }
    }
    means
}
