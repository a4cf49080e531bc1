//! Every width against plain arithmetic, on every level; and which places are refused.

use super::*;

/// Numbers through an operation.
struct Through<F> {
    numbers: [f32; MOST_LANES],
    operation: F,
}

/// An operation on a number of any width.
trait Operation {
    fn apply<L: Lanes>(self, lanes: L, number: L::Real) -> L::Real;
}

impl<F: Operation + Copy> Kernel for Through<F> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Vec<f64> {
        let mut results = vec![lanes.scalar(0.0); MOST_LANES];
        for (at, results) in results.chunks_mut(L::COUNT).enumerate() {
            let number = lanes.by_lane(|lane| self.numbers[at * L::COUNT + lane].into());
            self.operation.apply(lanes, number).store(results);
        }
        results.into_iter().map(Into::into).collect()
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
fn spread(low: f32, high: f32) -> Vec<[f32; MOST_LANES]> {
    let at = |i: usize| low + (high - low) * (i as f32 / 4095.0);
    (0..4096 / MOST_LANES).map(|n| std::array::from_fn(|lane| at(MOST_LANES * n + lane))).collect()
}

/// The largest difference between an operation on all levels and the truth, and whether all levels
/// gave the same bits.
fn largest_difference<F: Operation + Copy>(
    operation: F,
    numbers: &[[f32; MOST_LANES]],
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
    let one = Through { numbers: [0.3; MOST_LANES], operation: Power(7.0) }.run(OneLane);
    assert!((one[0] - f64::from(0.3f32).powf(7.0)).abs() < 1e-15);
}

/// The number of lanes.
struct Count;

impl Kernel for Count {
    type Output = usize;
    #[inline(always)]
    fn run<L: Lanes>(self, _lanes: L) -> usize {
        L::COUNT
    }
}

#[test]
fn avx512_has_sixteen_lanes_and_others_have_eight() {
    for level in levels() {
        let expected = if level.name() == "avx512" { 16 } else { 8 };
        assert_eq!(dispatch(level, Count), expected, "{}", level.name());
    }
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
                let mut stored = [lanes.scalar(0.0); MOST_LANES];
                number.store(&mut stored);
                results.extend(stored.into_iter().take(L::COUNT).map(Into::into));
            }
        }
        results
    }
}

#[test]
fn pairs_are_the_numbers_around_their_places() {
    let numbers: Vec<i16> = (0..60).map(|i| (i - 20) * 800).collect();
    for level in levels() {
        let read = dispatch(level, Pairs { numbers: &numbers, at: 5.0, distances: [-5, 26] });
        let lanes = dispatch(level, Count);
        let expected = [0, 1, 31, 32].into_iter().flat_map(|first| (0..lanes).map(move |lane| first + lane));
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
        let last = 39 - dispatch(level, Count) as i32;
        assert!(!is_refused(0.0, [0, last]), "{}: the last pair is inside", level.name());
        assert!(is_refused(0.0, [0, last + 1]), "{}: half of the last pair is outside", level.name());
        assert!(is_refused(0.0, [-1, 0]), "{}: before the first", level.name());
        assert!(is_refused(0.0, [0, i32::MAX]), "{}: far behind", level.name());
        assert!(is_refused(0.0, [i32::MIN, i32::MAX]), "{}: everything", level.name());
        assert!(is_refused(1e9, [0, 0]) && is_refused(-1e9, [0, 0]), "{}: far off", level.name());
    }
    let empty = Pairs { numbers: &[], at: 0.0, distances: [0, 0] };
    let read = || dispatch(Level::widest(), empty);
    assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).is_err());
}

/// Reads of one kind at places in a row.
struct Reads {
    kind: Kind,
    at: f64,
    length: usize,
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    Bytes,
    ShortQuads,
    RealPairs,
    Entries,
    EntryPairs,
}

impl Kind {
    const ALL: [Self; 5] = [Self::Bytes, Self::ShortQuads, Self::RealPairs, Self::Entries, Self::EntryPairs];

    /// The numbers that are read from a place, and their number of components.
    fn numbers(self) -> (std::ops::Range<i32>, usize) {
        match self {
            Self::Bytes => (0..1, 1),
            Self::ShortQuads => (-3..5, 1),
            Self::RealPairs => (0..2, 1),
            Self::Entries => (0..1, 4),
            Self::EntryPairs => (0..2, 4),
        }
    }
}

/// The number at a place: all are different.
fn number_at(place: usize) -> u8 {
    (place * 37 + 11) as u8
}

impl Kernel for Reads {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Vec<f64> {
        let at = lanes.place(lanes.by_lane(|lane| self.at + lane as f64));
        let places = 0..self.length;
        let reals: Vec<f32> = places.clone().map(|place| number_at(place).into()).collect();
        let entry = |place: usize| [0, 1, 2, 3].map(|channel| f32::from(number_at(4 * place + channel)));
        let read: Vec<L::Real> = match self.kind {
            Kind::Bytes => vec![lanes.bytes(&places.map(number_at).collect::<Vec<u8>>(), at)],
            Kind::ShortQuads => {
                let numbers: Vec<i16> = places.map(|place| -i16::from(number_at(place))).collect();
                lanes.short_quads(&numbers, at, [-3, 1]).concat()
            }
            Kind::RealPairs => lanes.real_pairs(&reals, at).to_vec(),
            Kind::Entries => lanes.entries(&places.map(entry).collect::<Vec<_>>(), at).to_vec(),
            Kind::EntryPairs => lanes.entry_pairs(&places.map(entry).collect::<Vec<_>>(), at).concat(),
        };
        let mut all = Vec::new();
        for numbers in read {
            let mut stored = [lanes.scalar(0.0); MOST_LANES];
            numbers.store(&mut stored);
            all.extend(stored.into_iter().take(L::COUNT).map(Into::into));
        }
        all
    }
}

#[test]
fn every_read_has_the_numbers_of_its_places() {
    for kind in Kind::ALL {
        let (numbers, components) = kind.numbers();
        let sign = if matches!(kind, Kind::ShortQuads) { -1.0 } else { 1.0 };
        let expected = |lanes: usize| -> Vec<f64> {
            let columns = numbers.clone().flat_map(|number| (0..components).map(move |part| (number, part)));
            let place = |lane: usize, number: i32| (9 + lane).strict_add_signed(number as isize);
            let of_lanes = |(number, part)| {
                (0..lanes).map(move |lane| number_at(components * place(lane, number) + part))
            };
            columns.flat_map(of_lanes).map(|number| sign * f64::from(number)).collect()
        };
        let reads = || Reads { kind, at: 9.0, length: 40 };
        assert_eq!(reads().run(OneLane), expected(1), "{kind:?}, one lane");
        for level in levels() {
            assert_eq!(
                dispatch(level, reads()),
                expected(dispatch(level, Count)),
                "{kind:?}, {}",
                level.name()
            );
        }
    }
}

/// Invariant: No lane reads memory outside the slice that it was given, whatever it reads.
#[test]
fn every_read_outside_is_refused() {
    let of_kind = |kind: Kind| levels().into_iter().map(move |level| (kind, level));
    for (kind, level) in Kind::ALL.into_iter().flat_map(of_kind) {
        let (numbers, _) = kind.numbers();
        let is_refused = |at: f64| {
            let read = || dispatch(level, Reads { kind, at, length: 40 });
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)).is_err()
        };
        let lanes = dispatch(level, Count) as i32;
        let (first, last) = (f64::from(-numbers.start), f64::from(41 - lanes - numbers.end));
        let name = level.name();
        assert!(!is_refused(first) && !is_refused(last), "{kind:?}, {name}: the ends are inside");
        assert!(is_refused(first - 1.0) || first == 0.0, "{kind:?}, {name}: before the first");
        assert!(is_refused(last + 1.0), "{kind:?}, {name}: behind the last");
        assert!(is_refused(1e9) && is_refused(-1e9), "{kind:?}, {name}: far off");
    }
}

/// Reads the bytes of a slice, from its start again after its end.
struct Turns<'a>(&'a [u8]);

impl Kernel for Turns<'_> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Vec<f64> {
        let at = lanes.place(lanes.by_lane(|lane| (lane % self.0.len()) as f64));
        let mut stored = [lanes.scalar(0.0); MOST_LANES];
        lanes.bytes(self.0, at).store(&mut stored);
        stored.into_iter().take(L::COUNT).map(Into::into).collect()
    }
}

#[test]
fn bytes_of_short_slices_are_read_too() {
    for (level, length) in levels().into_iter().flat_map(|level| (1..9).map(move |length| (level, length))) {
        let bytes: Vec<u8> = (0..length).map(number_at).collect();
        let expected: Vec<f64> =
            (0..dispatch(level, Count)).map(|lane| bytes[lane % length].into()).collect();
        assert_eq!(dispatch(level, Turns(&bytes)), expected, "{length} bytes, {}", level.name());
    }
}

/// Moves numbers between lanes: the lanes of some bits to the front, the front to these lanes, and each
/// to the mirrored lane.
struct Moves(u32);

impl Kernel for Moves {
    type Output = [Vec<f64>; 3];
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Self::Output {
        let numbers = lanes.by_lane(|lane| f64::from(number_at(lane)));
        let mirrored = lanes.place(lanes.by_lane(|lane| (L::COUNT - 1 - lane) as f64));
        let chosen = lanes.mask(self.0);
        assert_eq!(chosen.bits(), self.0);
        let moved = [
            lanes.gathered(numbers, chosen),
            lanes.spread(numbers, chosen),
            lanes.permuted(numbers, mirrored),
        ];
        moved.map(
            #[inline(always)]
            |moved| {
                let mut stored = [lanes.scalar(0.0); MOST_LANES];
                moved.store(&mut stored);
                stored.into_iter().take(L::COUNT).map(Into::into).collect()
            },
        )
    }
}

#[test]
fn numbers_move_to_the_lanes_of_their_places() {
    let check = |name: &str, lanes: usize, run: &dyn Fn(Moves) -> [Vec<f64>; 3]| {
        let number = |lane: usize| f64::from(number_at(lane));
        for bits in (0..1u32 << lanes).step_by(if lanes == 16 { 37 } else { 1 }) {
            let [gathered, spread, mirrored] = run(Moves(bits));
            let chosen: Vec<usize> = (0..lanes).filter(|lane| bits >> lane & 1 == 1).collect();
            let expected: Vec<f64> = chosen.iter().map(|&lane| number(lane)).collect();
            assert_eq!(gathered[..chosen.len()], expected, "{name}, {bits:b}");
            let mut expected = vec![0.0; lanes];
            (0..).zip(&chosen).for_each(|(from, &to)| expected[to] = number(from));
            assert_eq!(spread, expected, "{name}, {bits:b}");
            assert_eq!(mirrored, (0..lanes).rev().map(number).collect::<Vec<_>>(), "{name}");
        }
    };
    check("one lane", 1, &|moves| moves.run(OneLane));
    for level in levels() {
        check(level.name(), dispatch(level, Count), &|moves| dispatch(level, moves));
    }
}
