//! Pixels as the regression sees them: light and guides of one collision, and its weight.

use super::noisy::{Guide, NoisyPicture};

/// Number of guides of a pixel.
pub(super) const FEATURES: usize = 13;
/// Number of fitted values: red, green and blue of each half of the passes.
pub(super) const TARGETS: usize = 6;

/// Lengths are divided by this, mm: features need about the same extent.
const DISTANCE_UNIT_MM: f32 = 100.0;
/// Guides of less coverage show background.
const NOTHING: f32 = 1e-3;

/// One pixel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pixel {
    /// Share of the paths that collide: the weight of the pixel in a window.
    pub(super) coverage: f32,
    /// Guides of a path that collides.
    pub(super) features: [f32; FEATURES],
    /// Light of a path that collides, by the even and by the odd passes.
    pub(super) targets: [f32; TARGETS],
    /// Linear light and coverage of all passes.
    pub(super) noisy: [f32; 4],
}

/// The pixels of a picture, rows from the top.
pub(super) fn pixels(noisy: &NoisyPicture) -> Vec<Pixel> {
    let odd_passes = noisy.passes / 2;
    let even_passes = noisy.passes - odd_passes;
    let pixel = |((all, odd), guide): ((&[f32; 4], &[f32; 4]), &Guide)| {
        let mean = all.map(|sum| sum / noisy.passes as f32);
        if guide.coverage < NOTHING {
            return Pixel { noisy: mean, ..Pixel::default() };
        }
        // A single pass has no halves.
        let halves = match odd_passes {
            0 => [mean; 2],
            _ => [
                std::array::from_fn(|i| (all[i] - odd[i]) / even_passes as f32),
                odd.map(|sum| sum / odd_passes as f32),
            ],
        };
        let per_collision = 1.0 / guide.coverage;
        Pixel {
            coverage: guide.coverage,
            features: features(guide).map(|feature| feature * per_collision),
            targets: std::array::from_fn(|i| halves[i / 3][i % 3] * per_collision),
            noisy: mean,
        }
    };
    noisy.all.iter().zip(&noisy.odd).zip(&noisy.guides).map(pixel).collect()
}

fn features(guide: &Guide) -> [f32; FEATURES] {
    let parts = [guide.shadowed, guide.light, guide.albedo, guide.normal];
    std::array::from_fn(|i| match i {
        0..12 => parts[i / 3][i % 3],
        _ => guide.distance_mm / DISTANCE_UNIT_MM,
    })
}
