//! Anaglyphs for red-cyan glasses: the left view through the red glass, the right one through the
//! cyan one.
//!
//! By least squares in the space of perceived colours: E. Dubois, *A projection method to generate
//! anaglyph stereo images*, IEEE ICASSP 2001, with his matrices for a CRT's red-cyan glasses. They
//! hold for linear light, so sRGB's curve is taken off before and put on after.

use std::sync::LazyLock;

/// Red, green and blue of the anaglyph by red, green and blue of the left view.
const LEFT: [[f32; 3]; 3] = [
    [0.4561, 0.500_484, 0.176_381],
    [-0.040_082_2, -0.037_824_6, -0.015_758_9],
    [-0.015_216_1, -0.020_597_1, -0.005_468_56],
];
/// The same by the right view.
const RIGHT: [[f32; 3]; 3] = [
    [-0.043_470_6, -0.087_938_8, -0.001_555_29],
    [0.378_476, 0.733_64, -0.018_450_3],
    [-0.072_152_7, -0.112_961, 1.2264],
];

/// Both views in one picture, pixel by pixel, with the length of the shorter one.
#[must_use]
pub fn anaglyph(left: &[[u8; 3]], right: &[[u8; 3]]) -> Vec<[u8; 3]> {
    left.iter().zip(right).map(|(&left, &right)| mixed(left, right)).collect()
}

fn mixed(left: [u8; 3], right: [u8; 3]) -> [u8; 3] {
    let [left, right] = [left, right].map(|rgb| rgb.map(|byte| LINEAR[usize::from(byte)]));
    let dot = |row: [f32; 3], rgb: [f32; 3]| row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2];
    std::array::from_fn(|channel| to_srgb(dot(LEFT[channel], left) + dot(RIGHT[channel], right)))
}

/// Linear light of each sRGB byte (IEC 61966-2-1).
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|byte| {
        let value = byte as f32 / 255.0;
        if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    })
});

/// The sRGB byte of a linear intensity, clipped to the displayable range: the nearest entry of the
/// table.
fn to_srgb(light: f32) -> u8 {
    let above = LINEAR.partition_point(|entry| *entry < light).clamp(1, 255);
    let (low, high) = (LINEAR[above - 1], LINEAR[above]);
    (if light - low < high - light { above - 1 } else { above }) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greys_stay_and_each_glass_takes_its_own_view() {
        for grey in [0, 1, 60, 128, 200, 255] {
            // Each row of both matrices sums to 1 within 1e-4.
            let [mixed] = anaglyph(&[[grey; 3]], &[[grey; 3]])[..] else { panic!("one pixel") };
            assert!(mixed.iter().all(|byte| byte.abs_diff(grey) <= 1), "{mixed:?} for {grey}");
        }
        let white_left = anaglyph(&[[255; 3]], &[[0; 3]])[0];
        let white_right = anaglyph(&[[0; 3]], &[[255; 3]])[0];
        assert_eq!((white_left, white_right), ([255, 0, 0], [0, 255, 255]));
    }

    #[test]
    fn every_byte_of_light_comes_back() {
        for byte in 0..=255u8 {
            assert_eq!(to_srgb(LINEAR[usize::from(byte)]), byte);
        }
        assert_eq!([-1.0, 2.0].map(to_srgb), [0, 255]);
    }
}
