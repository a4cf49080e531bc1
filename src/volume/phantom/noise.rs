//! Deterministic noise: hashes of lattice points, smooth gradient noise, the grain of a CT image.
//!
//! Every value is a function of position and seed only, so threads can make voxels in any order. It
//! is not cryptographically random.

use glam::{IVec3, Vec3};

/// 64 well-mixed bits of a lattice point (finaliser of SplitMix64).
fn hash(cell: IVec3, seed: u64) -> u64 {
    let [x, y, z] = cell.to_array().map(|v| u64::from(v as u32));
    let mut bits = seed
        .wrapping_add(x.wrapping_mul(0x9e37_79b9_7f4a_7c15))
        .wrapping_add(y.wrapping_mul(0xc2b2_ae3d_27d4_eb4f))
        .wrapping_add(z.wrapping_mul(0x1656_67b1_9e37_79f9));
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// Smooth noise of zero mean, about -1..1, with features of about one unit (Perlin's improved
/// noise).
pub(super) fn gradient_noise(p: Vec3, seed: u64) -> f32 {
    let floor = p.floor();
    let (cell, f) = (floor.as_ivec3(), p - floor);
    let fade = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let corner = |x: i32, y: i32, z: i32| {
        let offset = IVec3::new(x, y, z);
        along_an_edge(hash(cell + offset, seed), f - offset.as_vec3())
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    let row = |y: i32, z: i32| mix(corner(0, y, z), corner(1, y, z), fade.x);
    let plane = |z: i32| mix(row(0, z), row(1, z), fade.y);
    mix(plane(0), plane(1), fade.z)
}

/// Product with one of the twelve directions to the edges of a cube.
fn along_an_edge(bits: u64, d: Vec3) -> f32 {
    let (u, v) = match (bits >> 2) % 3 {
        0 => (d.x, d.y),
        1 => (d.y, d.z),
        _ => (d.z, d.x),
    };
    (if bits & 1 == 0 { u } else { -u }) + (if bits & 2 == 0 { v } else { -v })
}

/// Three independent noises: a displacement for warping a domain.
pub(super) fn vector_noise(p: Vec3, seed: u64) -> Vec3 {
    Vec3::new(
        gradient_noise(p, seed),
        gradient_noise(p + 31.7, seed ^ 0xa5a5),
        gradient_noise(p - 17.3, seed ^ 0x5a5a_0000),
    )
}

/// Distances, in units of the lattice, to the nearest and second nearest of points scattered one to
/// a cell (Worley).
pub(super) fn cell_distances(p: Vec3, seed: u64) -> (f32, f32) {
    let cell = p.floor().as_ivec3();
    let (mut first, mut second) = (f32::MAX, f32::MAX);
    for n in 0..27 {
        let neighbour = cell + IVec3::new(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
        let bits = hash(neighbour, seed);
        let jitter = Vec3::new(unit(bits), unit(bits >> 16), unit(bits >> 32));
        let distance = (neighbour.as_vec3() + jitter).distance_squared(p);
        if distance < first {
            (first, second) = (distance, first);
        } else if distance < second {
            second = distance;
        }
    }
    (first.sqrt(), second.sqrt())
}

/// The low 16 bits as 0..1.
fn unit(bits: u64) -> f32 {
    (bits & 0xffff) as f32 / 65_536.0
}

/// The grain of one slice: normal to a good approximation, mean 0, deviation 1, correlated between
/// neighbours in the slice as the reconstruction of a CT leaves it.
pub(super) fn grain(width: usize, height: usize, slice: usize, seed: u64) -> Vec<f32> {
    /// Weights of the neighbours along one axis, and the factor that makes their squares sum to 1.
    const SIDE: f32 = 0.22;
    const CENTER: f32 = 1.0 - 2.0 * SIDE;
    let norm = 1.0 / (CENTER * CENTER + 2.0 * SIDE * SIDE);
    let white = |x: usize, y: usize| normal(hash(IVec3::new(x as i32, y as i32, slice as i32), seed));
    let rows: Vec<f32> = (0..height + 2)
        .flat_map(|y| {
            let row: Vec<f32> = (0..width + 2).map(|x| white(x, y)).collect();
            row.windows(3).map(|w| SIDE * (w[0] + w[2]) + CENTER * w[1]).collect::<Vec<_>>()
        })
        .collect();
    let row = |y: usize| &rows[y * width..(y + 1) * width];
    (0..height)
        .flat_map(|y| {
            let (above, here, below) = (row(y), row(y + 1), row(y + 2));
            (0..width).map(move |x| norm * (SIDE * (above[x] + below[x]) + CENTER * here[x]))
        })
        .collect()
}

/// Sum of four uniform numbers, scaled to deviation 1.
fn normal(bits: u64) -> f32 {
    let sum = unit(bits) + unit(bits >> 16) + unit(bits >> 32) + unit(bits >> 48);
    (sum - 2.0) * 1.732_050_8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grain_has_mean_zero_deviation_one_and_correlated_neighbours() {
        let (width, height) = (200, 200);
        let grain = grain(width, height, 3, 5);
        let mean = grain.iter().sum::<f32>() / grain.len() as f32;
        let variance = grain.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / grain.len() as f32;
        let neighbours = grain.windows(2).map(|w| w[0] * w[1]).sum::<f32>() / grain.len() as f32;
        // Three deviations of the mean of 200 x 200 values that a kernel of weight 2.4 has
        // correlated.
        assert!(mean.abs() < 0.037 && (variance - 1.0).abs() < 0.03, "mean {mean}, variance {variance}");
        assert!((0.4..0.8).contains(&neighbours), "correlation {neighbours}");
    }

    #[test]
    fn gradient_noise_is_continuous_across_cells_and_depends_on_the_seed() {
        let below = gradient_noise(Vec3::new(1.999_99, 0.3, 0.7), 1);
        let above = gradient_noise(Vec3::new(2.000_01, 0.3, 0.7), 1);
        assert!((below - above).abs() < 1e-3);
        let other = gradient_noise(Vec3::new(1.5, 0.3, 0.7), 2);
        assert!((gradient_noise(Vec3::new(1.5, 0.3, 0.7), 1) - other).abs() > 1e-3);
    }
}
