//! The denoiser on noise whose mean is known.

use super::*;

const SIZE: [u32; 2] = [96, 80];

/// A repeatable number in -0.5..0.5 of a pixel, a pass and a channel.
fn noise(key: u32) -> f32 {
    let mut x = key.wrapping_mul(0x9E37_79B9) ^ 0x85EB_CA6B;
    for _ in 0..3 {
        x = (x ^ (x >> 16)).wrapping_mul(0x7FEB_352D);
    }
    (x >> 8) as f32 / 16_777_216.0 - 0.5
}

/// A picture of a ball beside nothing: light is half guided, half a pattern that no guide has.
fn picture(passes: u32, hidden: f32) -> (NoisyPicture, Vec<[f32; 3]>) {
    let (mut all, mut odd, mut guides, mut truth) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for i in 0..SIZE[0] * SIZE[1] {
        let (x, y) = ((i % SIZE[0]) as f32 / 40.0 - 1.2, (i / SIZE[0]) as f32 / 40.0 - 1.0);
        let height = 0.8 - x * x - y * y;
        if height < 0.0 {
            [&mut all, &mut odd].into_iter().for_each(|sums| sums.push([0.0; 4]));
            guides.push(Guide::default());
            truth.push([0.0; 3]);
            continue;
        }
        let normal = [x, y, height.sqrt()].map(|part| part / 0.8f32.sqrt());
        let albedo = if x > 0.0 { [0.9, 0.5, 0.3] } else { [0.2, 0.4, 0.8] };
        let facing = (0.6 * normal[2] + 0.5 * normal[0] + 0.4).max(0.0);
        let light = albedo.map(|channel| channel * facing * 0.5);
        let shadow = 1.0 - hidden * (0.5 + 0.5 * (9.0 * x).sin() * (7.0 * y).cos());
        let value = light.map(|channel| channel * shadow);
        guides.push(Guide {
            albedo,
            coverage: 1.0,
            normal,
            distance_mm: 500.0 - 50.0 * normal[2],
            light,
            shadowed: light,
            ..Guide::default()
        });
        let sum = |first: u32, step: usize| {
            let mut sum = [0f32, 0.0, 0.0, 0.0];
            for pass in (first..passes).step_by(step) {
                for channel in 0..3 {
                    let spread = 2.0 * noise((i * 1024 + pass) * 4 + channel as u32);
                    sum[channel] += value[channel] * (1.0 + spread);
                }
                sum[3] += 1.0;
            }
            sum
        };
        all.push(sum(0, 1));
        odd.push(sum(1, 2));
        truth.push(value);
    }
    (NoisyPicture { size_px: SIZE, passes, all, odd, guides }, truth)
}

fn rms(found: &[[f32; 4]], truth: &[[f32; 3]]) -> f64 {
    let squares =
        found.iter().zip(truth).flat_map(|(a, b)| (0..3).map(move |i| f64::from(a[i] - b[i]).powi(2)));
    (squares.sum::<f64>() / (3 * truth.len()) as f64).sqrt()
}

fn errors(passes: u32, hidden: f32) -> [f64; 2] {
    let (noisy, truth) = picture(passes, hidden);
    let raw: Vec<[f32; 4]> = noisy.all.iter().map(|sum| sum.map(|part| part / passes as f32)).collect();
    [rms(&raw, &truth), rms(&denoised(&noisy), &truth)]
}

/// Invariant: The denoiser removes noise that its guides explain, never adds much, and converges with the
/// passes.
#[test]
fn noise_falls_and_more_passes_still_help() {
    // All of the light follows the guides: at least as good as sixteen times the passes.
    let [raw, denoised] = errors(16, 0.0);
    assert!(denoised < raw / 4.0, "{raw} to {denoised}");
    // A pattern that no guide has: less noise at first, and no blur that stays.
    let mut before = f64::INFINITY;
    for passes in [4, 16, 64, 256, 1024] {
        let [raw, denoised] = errors(passes, 0.6);
        assert!(denoised < 1.1 * raw, "{passes} passes: {raw} to {denoised}");
        assert!(denoised < 0.85 * before, "{passes} passes: {before} to {denoised}");
        before = denoised;
    }
}

#[test]
fn nothing_stays_nothing_and_threads_change_no_bit() {
    let (noisy, _) = picture(8, 0.3);
    let bits = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| denoised(&noisy));
        found.into_iter().map(|pixel| pixel.map(f32::to_bits)).collect::<Vec<_>>()
    };
    let one = bits(1);
    assert!(one == bits(3), "the number of threads shows");
    for (guide, pixel) in noisy.guides.iter().zip(&one) {
        assert!(guide.coverage > 0.0 || *pixel == [0; 4], "{pixel:?} beside the ball");
    }
}
