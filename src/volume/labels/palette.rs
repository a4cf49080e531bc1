//! Colours for segments whose file names none.

/// Hues go round by the golden ratio, so that labels next to each other differ; three steps of
/// lightness and strength tell apart those whose hues come close. Display-referred sRGB, 0..1.
pub(super) fn color(label: u16) -> [f64; 3] {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let hue = (f64::from(label) * GOLDEN + 0.97).fract();
    let (saturation, value) = [(0.62, 0.92), (0.45, 0.98), (0.75, 0.78)][usize::from(label) % 3];
    // From hue, saturation and value: each channel is a trapezium around its own hue.
    let channel = |shift: f64| {
        let distance = ((hue * 6.0 + shift).rem_euclid(6.0) - 3.0).abs() - 1.0;
        value * (1.0 - saturation * (1.0 - distance.clamp(0.0, 1.0)))
    };
    [channel(0.0), channel(4.0), channel(2.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_labels_have_colours_that_can_be_told_apart() {
        for label in 1..120u16 {
            let colors = [color(label), color(label + 1)];
            assert!(colors.iter().flatten().all(|channel| (0.0..=1.0).contains(channel)), "{colors:?}");
            let apart: f64 = (0..3).map(|c| (colors[0][c] - colors[1][c]).abs()).sum();
            assert!(apart > 0.3, "{label}: {colors:?}");
        }
    }
}
