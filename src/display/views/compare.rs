//! The difference of two pictures.

/// The peak signal-to-noise ratio of two pictures, dB; infinite for equal ones.
///
/// `10 log10(255² / MSE)` (ITU-T J.340), with the mean squared error over all pixels and the three
/// channels alike, of display-referred values. Compares as many pixels as the shorter one has.
#[must_use]
pub fn psnr_db(a: &[[u8; 3]], b: &[[u8; 3]]) -> f64 {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    let squares: u64 = pairs.map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum();
    let count = a.len().min(b.len()) * 3;
    10.0 * (255.0 * 255.0 * count as f64 / squares as f64).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_errors_have_known_ratios() {
        assert_eq!(psnr_db(&[[1, 2, 3]], &[[1, 2, 3]]), f64::INFINITY);
        assert!(psnr_db(&[[0; 3]; 4], &[[255; 3]; 4]).abs() < 1e-12);
        // One step everywhere: 20 log10(255).
        assert!((psnr_db(&[[9; 3]; 7], &[[10; 3]; 7]) - 48.130_803_6).abs() < 1e-6);
        // One channel of one pixel of four by ten: 100 / 12 in the mean.
        let b = [[10, 0, 0], [0; 3], [0; 3], [0; 3]];
        assert!((psnr_db(&[[0; 3]; 4], &b) - 10.0 * (65025.0 * 12.0 / 100.0f64).log10()).abs() < 1e-9);
    }
}
