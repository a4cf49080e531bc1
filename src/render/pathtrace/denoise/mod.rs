//! Removes the noise of a path-traced picture.
//!
//! What it is: a local regression. In a window around each pixel, light is fitted as a linear
//! function of guides without noise: albedo, normal, distance, and light with and without shadows,
//! which the stage `guides.wgsl` computes for the same camera. The fits of all windows that hold a
//! pixel are averaged, as in the guided filter (He, Sun and Tang, TPAMI 2013). Two halves of the
//! passes are fitted separately: where a fit predicts the other half worse than noise explains, the
//! noisy picture is mixed in (after Rousselle, Manzi and Zwicker, CGF 2013), so that more passes always
//! converge.
//!
//! What it is not: a network, or an estimate without bias. The same sums and guides give the same
//! bytes, whatever the number of threads. Light is linear, 1 is white; lengths in pixels and mm.

mod features;
mod mixing;
mod noisy;
mod regression;

use self::features::Pixel;
pub(super) use self::noisy::{Guide, NoisyPicture};
use crate::request::RenderRequest;
use relief_volume::linear_from_srgb;

/// Coverage below which pixels stay as they are: the guides miss slivers of an edge.
const LEAST_COVERAGE: f32 = 0.05;

/// Linear red, green, blue and coverage without noise.
pub(super) fn denoised(noisy: &NoisyPicture) -> Vec<[f32; 4]> {
    let width = noisy.size_px[0] as usize;
    let pixels = features::pixels(noisy);
    let fitted = regression::fitted(&pixels, width);
    let shares = mixing::noisy_shares(&pixels, &fitted, width);
    let mixed = |((pixel, halves), noisy_share): ((&Pixel, &[[f32; 3]; 2]), f32)| {
        let [r, g, b] = [0, 1, 2].map(|channel| {
            let fit = (halves[0][channel] + halves[1][channel]) / 2.0;
            mix(fit, pixel.noisy[channel], noisy_share)
        });
        [r, g, b, mix(pixel.coverage, pixel.noisy[3], noisy_share)]
    };
    pixels
        .iter()
        .zip(&fitted)
        .zip(shares)
        .map(|((pixel, halves), share)| match pixel.coverage < LEAST_COVERAGE {
            true => pixel.noisy,
            false => mixed(((pixel, halves), share)),
        })
        .collect()
}

fn mix(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

/// Display-referred bytes of linear light over the background, as `pathtrace.wgsl` writes them.
pub(super) fn display_referred(linear: &[[f32; 4]], request: &RenderRequest) -> Vec<[u8; 4]> {
    let background = request.background_rgb.map(|channel| linear_from_srgb(channel) as f32);
    let exposure = request.path_trace.exposure as f32;
    let byte = |unit: f32| (unit.clamp(0.0, 1.0) * 255.0).round() as u8;
    let pixel = |&[r, g, b, coverage]: &[f32; 4]| {
        let over = |light: f32, behind: f32| byte(srgb(light * exposure + (1.0 - coverage) * behind));
        let [behind_r, behind_g, behind_b] = background;
        [over(r, behind_r), over(g, behind_g), over(b, behind_b), byte(coverage)]
    };
    linear.iter().map(pixel).collect()
}

/// sRGB's transfer function (IEC 61966-2-1), values clamped to 0..1.
fn srgb(linear: f32) -> f32 {
    let x = linear.clamp(0.0, 1.0);
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests;
