//! Axes of plots: round values between two limits, and their text.

/// Round values between two limits, about `count` of them.
pub(super) fn ticks(low: f64, high: f64, count: f64) -> Vec<f64> {
    let rough = (high - low) / count;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|times| times * power).into_iter().find(|step| *step >= rough);
    let step = step.unwrap_or(rough);
    let (first, last) = ((low / step).ceil() as i32, (high / step).floor() as i32);
    (first..=last).map(|at| f64::from(at) * step).collect()
}

/// A number with as many decimals as its neighbours need.
pub(super) fn number(value: f64, step: f64) -> String {
    let decimals = (-step.log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(-10.0, 10.0, 4.0), [-10.0, -5.0, 0.0, 5.0, 10.0]);
        assert_eq!(ticks(-0.3, 0.3, 3.0), [-0.2, 0.0, 0.2]);
        assert_eq!([number(0.2, 0.2), number(5.0, 5.0), number(0.01, 0.01)], ["0.2", "5", "0.01"]);
    }
}
