//! Both widths against plain arithmetic, on every level; and what gathers refuse.

use super::*;

/// Eight numbers at a time through an operation.
struct Through<F> {
    numbers: [f32; 8],
    operation: F,
}

/// An operation on a number of any width.
trait Operation {
    fn apply<L: Lanes>(self, lanes: L, number: L::Real) -> L::Real;
}

impl<F: Operation> Kernel for Through<F> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Vec<f64> {
        let number = lanes.by_lane(|lane| self.numbers[lane].into());
        let mut results = vec![lanes.scalar(0.0); 8];
        self.operation.apply(lanes, number).store(&mut results);
        results.into_iter().take(L::COUNT).map(Into::into).collect()
    }
}

#[derive(Clone, Copy)]
struct Log2;
#[derive(Clone, Copy)]
struct Exp2;
#[derive(Clone, Copy)]
struct Power(f64);

impl Operation for Log2 {
    #[inline(always)]
    fn apply<L: Lanes>(self, _lanes: L, number: L::Real) -> L::Real {
        number.log2()
    }
}

impl Operation for Exp2 {
    #[inline(always)]
    fn apply<L: Lanes>(self, _lanes: L, number: L::Real) -> L::Real {
        number.exp2()
    }
}

impl Operation for Power {
    #[inline(always)]
    fn apply<L: Lanes>(self, lanes: L, number: L::Real) -> L::Real {
        number.pow(lanes.splat(self.0))
    }
}

/// Numbers that are spread evenly between two.
fn spread(low: f32, high: f32) -> Vec<[f32; 8]> {
    let at = |i: usize| low + (high - low) * (i as f32 / 4095.0);
    (0..512).map(|eight| std::array::from_fn(|lane| at(8 * eight + lane))).collect()
}

/// The largest difference between an operation on all levels and the truth, and whether all levels
/// gave the same bits.
fn largest_difference<F: Operation + Copy>(
    operation: F,
    numbers: &[[f32; 8]],
    truth: impl Fn(f64) -> f64,
) -> f64 {
    let mut largest = 0f64;
    for &numbers in numbers {
        let on_levels: Vec<Vec<f64>> =
            levels().into_iter().map(|level| dispatch(level, Through { numbers, operation })).collect();
        assert!(on_levels.windows(2).all(|pair| pair[0] == pair[1]), "levels differ at {numbers:?}");
        for (result, number) in on_levels[0].iter().zip(numbers) {
            largest = largest.max((result - truth(number.into())).abs());
        }
    }
    largest
}

#[test]
fn logarithms_and_powers_are_those_of_the_standard_library() {
    assert!(largest_difference(Log2, &spread(1e-6, 4.0), f64::log2) < 2e-6);
    assert!(largest_difference(Exp2, &spread(-20.0, 0.0), f64::exp2) < 2e-7);
    for exponent in [1.0, 8.0, 32.0, 1000.0] {
        let apart = largest_difference(Power(exponent), &spread(0.0, 1.0), |x| x.powf(exponent));
        assert!(apart < 4e-5, "{exponent}: {apart}");
    }
    let one = Through { numbers: [0.3; 8], operation: Power(7.0) }.run(OneLane);
    assert!((one[0] - f64::from(0.3f32).powf(7.0)).abs() < 1e-15);
}

/// Reads pairs of numbers around a place.
struct Pairs<'a> {
    numbers: &'a [i16],
    at: f64,
    distances: [i32; 2],
}

impl Kernel for Pairs<'_> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Vec<f64> {
        let at = lanes.place(lanes.by_lane(|lane| self.at + lane as f64));
        let mut results = Vec::new();
        for [first, second] in lanes.short_pairs(self.numbers, at, self.distances) {
            for number in [first, second] {
                let mut stored = [lanes.scalar(0.0); 8];
                number.store(&mut stored);
                results.extend(stored.into_iter().take(L::COUNT).map(Into::into));
            }
        }
        results
    }
}

#[test]
fn pairs_are_the_numbers_around_their_places() {
    let numbers: Vec<i16> = (0..40).map(|i| (i - 20) * 1600).collect();
    for level in levels() {
        let read = dispatch(level, Pairs { numbers: &numbers, at: 5.0, distances: [-5, 26] });
        let expected = [0, 1, 31, 32].into_iter().flat_map(|first| (0..8).map(move |lane| first + lane));
        let expected: Vec<f64> = expected.map(|at| f64::from(numbers[at])).collect();
        assert_eq!(read, expected, "{}", level.name());
    }
}

/// Invariant: No lane reads memory outside the slice that it was given.
#[test]
fn places_outside_are_refused() {
    let numbers = vec![7i16; 40];
    for level in levels() {
        let is_refused = |at: f64, distances: [i32; 2]| {
            let read = || dispatch(level, Pairs { numbers: &numbers, at, distances });
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).is_err()
        };
        assert!(!is_refused(0.0, [0, 31]), "{}: the last pair is inside", level.name());
        assert!(is_refused(0.0, [0, 32]), "{}: half of the last pair is outside", level.name());
        assert!(is_refused(0.0, [-1, 0]), "{}: before the first", level.name());
        assert!(is_refused(0.0, [0, i32::MAX]), "{}: far behind", level.name());
        assert!(is_refused(0.0, [i32::MIN, i32::MAX]), "{}: everything", level.name());
        assert!(is_refused(1e9, [0, 0]) && is_refused(-1e9, [0, 0]), "{}: far off", level.name());
    }
    let empty = Pairs { numbers: &[], at: 0.0, distances: [0, 0] };
    let read = || dispatch(Level::widest(), empty);
    assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).is_err());
}
