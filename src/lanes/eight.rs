//! Eight lanes of 32 bits.

use fearless_simd::prelude::*;
use fearless_simd::{f32x8, i32x8, mask32x8};

#[cfg(target_arch = "x86_64")]
use crate::gather::Reach;
use crate::{Lanes, Mask, Real, Triple};

/// The width of eight lanes of 32 bits, by the vector instructions of `S`.
#[derive(Clone, Copy, Debug)]
pub struct EightLanes<S>(pub(crate) S);

/// Eight numbers of 32 bits.
#[derive(Clone, Copy, Debug)]
pub struct Eight<S: Simd>(f32x8<S>);

/// Eight truths.
#[derive(Clone, Copy, Debug)]
pub struct EightMask<S: Simd>(mask32x8<S>);

macro_rules! operators {
    ($($operator:ident $method:ident),*) => {$(
        impl<S: Simd> std::ops::$operator for Eight<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(std::ops::$operator::$method(self.0, other.0))
            }
        }
    )*};
}
operators!(Add add, Sub sub, Mul mul, Div div);

impl<S: Simd> std::ops::Neg for Eight<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl<S: Simd> std::ops::BitAnd for EightMask<S> {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl<S: Simd> std::ops::BitOr for EightMask<S> {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl<S: Simd> std::ops::Not for EightMask<S> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl<S: Simd> Mask for EightMask<S> {
    #[inline(always)]
    fn any(self) -> bool {
        self.0.any_true()
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        self.0.to_bitmask() as u32
    }
}

/// Bits of the mantissa of a number of 32 bits.
const MANTISSA_BITS: u32 = 23;
/// The bits of 1.
const ONE: i32 = 0x3f80_0000;
/// The bits of the square root of one half.
const HALF_ROOT: i32 = 0x3f35_04f3;

impl<S: Simd> Real for Eight<S> {
    type Scalar = f32;
    type Mask = EightMask<S>;

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.floor())
    }
    #[inline(always)]
    fn ceil(self) -> Self {
        Self(self.0.ceil())
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self(self.0.round_ties_even())
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    /// By the series of the inverse hyperbolic tangent over a mantissa from sqrt(1/2) to sqrt(2).
    #[inline(always)]
    fn log2(self) -> Self {
        let bits: i32x8<S> = self.0.bitcast();
        let exponent = (bits - HALF_ROOT) >> MANTISSA_BITS;
        let mantissa: f32x8<S> = (bits - (exponent << MANTISSA_BITS)).bitcast();
        let s = (mantissa - 1.0) / (mantissa + 1.0);
        let squared = s * s;
        let sum = squared * (1.0 / 9.0) + 1.0 / 7.0;
        let sum = (sum * squared + 1.0 / 5.0) * squared + 1.0 / 3.0;
        let sum = sum * squared + 1.0;
        Self(f32x8::float_from(exponent) + s * sum * (2.0 * std::f32::consts::LOG2_E))
    }

    /// By the series of the exponential function over the fractional part.
    #[inline(always)]
    fn exp2(self) -> Self {
        let exponent = self.0.max(-126.0).min(126.0);
        let whole = exponent.round_ties_even();
        let rest = (exponent - whole) * std::f32::consts::LN_2;
        let sum = rest * (1.0 / 5040.0) + 1.0 / 720.0;
        let sum = (sum * rest + 1.0 / 120.0) * rest + 1.0 / 24.0;
        let sum = (sum * rest + 1.0 / 6.0) * rest + 0.5;
        let sum = (sum * rest + 1.0) * rest + 1.0;
        let whole: i32x8<S> = whole.to_int();
        let power: f32x8<S> = ((whole << MANTISSA_BITS) + ONE).bitcast();
        Self(sum * power)
    }

    #[inline(always)]
    fn lt(self, other: Self) -> EightMask<S> {
        EightMask(self.0.simd_lt(other.0))
    }
    #[inline(always)]
    fn le(self, other: Self) -> EightMask<S> {
        EightMask(self.0.simd_le(other.0))
    }
    #[inline(always)]
    fn or_where_not(self, mask: EightMask<S>, other: Self) -> Self {
        Self(mask.0.select(self.0, other.0))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        self.0.store_slice(&mut to[..8]);
    }
}

/// An expression of the place of each lane, written eight times: a loop or a call would leave the
/// vector instructions of the caller.
macro_rules! each {
    ($at:expr, |$place:ident| $value:expr) => {{
        let [a, b, c, d, e, f, g, h] = $at.to_array();
        [
            each!(@one a, $place, $value),
            each!(@one b, $place, $value),
            each!(@one c, $place, $value),
            each!(@one d, $place, $value),
            each!(@one e, $place, $value),
            each!(@one f, $place, $value),
            each!(@one g, $place, $value),
            each!(@one h, $place, $value),
        ]
    }};
    (@one $lane:ident, $place:ident, $value:expr) => {{
        let $place = $lane as usize;
        $value
    }};
}

impl<S: Simd> EightLanes<S> {
    #[inline(always)]
    fn of_each(self, numbers: [i32; 8]) -> i32x8<S> {
        i32x8::load_array(self.0, numbers)
    }

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn ints(self, numbers: std::arch::x86_64::__m256i) -> i32x8<S> {
        numbers.simd_into(self.0)
    }

    /// The numbers at these places and those behind them, four from each.
    #[inline(always)]
    fn quads<const N: usize>(self, table: &[[f32; 4]], at: i32x8<S>) -> [[Eight<S>; 4]; N] {
        let numbers = table.as_flattened();
        let at = at * 4;
        let mut quads = [[Eight(f32x8::splat(self.0, 0.0)); 4]; N];
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.0.level().as_avx2() {
            let reach = Reach::new(avx2, numbers, at.to_array(), 0, 4 * N as i32 - 1);
            for (i, quad) in quads.iter_mut().enumerate() {
                let [a, b, c, d] = reach.quads_at(avx2, 4 * i as i32);
                *quad = [
                    Eight(a.simd_into(self.0)),
                    Eight(b.simd_into(self.0)),
                    Eight(c.simd_into(self.0)),
                    Eight(d.simd_into(self.0)),
                ];
            }
            return quads;
        }
        for (i, number) in quads.as_flattened_mut().iter_mut().enumerate() {
            *number = self.reals(numbers, at + i as i32);
        }
        quads
    }

    #[inline(always)]
    fn reals(self, numbers: &[f32], at: i32x8<S>) -> Eight<S> {
        Eight(f32x8::load_array(self.0, each!(at, |at| numbers[at])))
    }

    /// Eight pairs of 16 bits, one behind the other in each lane, as numbers.
    #[inline(always)]
    fn unpacked(self, pairs: i32x8<S>) -> [Eight<S>; 2] {
        let (low, high) = ((pairs << 16) >> 16, pairs >> 16);
        [Eight(f32x8::float_from(low)), Eight(f32x8::float_from(high))]
    }
}

/// The lowest and the highest distance.
#[inline(always)]
fn ends<const N: usize>(distances: [i32; N]) -> (i32, i32) {
    let (mut lowest, mut highest) = (i32::MAX, i32::MIN);
    for distance in distances {
        (lowest, highest) = (lowest.min(distance), highest.max(distance));
    }
    (lowest, highest)
}

/// Two numbers of 16 bits as one of 32, the first in the low half.
#[inline(always)]
fn pair(numbers: &[i16], at: usize) -> i32 {
    let both = &numbers[at..at + 2];
    i32::from(both[0] as u16) | i32::from(both[1]) << 16
}

impl<S: Simd> Lanes for EightLanes<S> {
    const COUNT: usize = 8;
    type Scalar = f32;
    type Real = Eight<S>;
    type Mask = EightMask<S>;
    type Index = i32x8<S>;

    #[inline(always)]
    fn scalar(self, number: f64) -> f32 {
        number as f32
    }
    #[inline(always)]
    fn splat(self, number: f64) -> Eight<S> {
        Eight(f32x8::splat(self.0, number as f32))
    }
    #[inline(always)]
    fn by_lane(self, mut number: impl FnMut(usize) -> f64) -> Eight<S> {
        Eight(f32x8::from_fn(self.0, |lane| number(lane) as f32))
    }
    #[inline(always)]
    fn load(self, numbers: &[f32]) -> Eight<S> {
        Eight(f32x8::from_slice(self.0, &numbers[..8]))
    }
    #[inline(always)]
    fn chosen(self, numbers: &[f32; 8], places: &[u8]) -> Eight<S> {
        let places = &places[..8];
        let mut chosen = [0.0; 8];
        for lane in 0..8 {
            chosen[lane] = numbers[usize::from(places[lane]) % 8];
        }
        Eight(f32x8::load_array(self.0, chosen))
    }
    #[inline(always)]
    fn first(self, count: usize) -> EightMask<S> {
        EightMask(mask32x8::from_bitmask(self.0, (1 << count.min(8)) - 1))
    }
    #[inline(always)]
    fn places(self, Triple([x, y, z]): Triple<Eight<S>>, [row, layer]: [i32; 2]) -> i32x8<S> {
        let [x, y, z]: [i32x8<S>; 3] = [x.0.to_int(), y.0.to_int(), z.0.to_int()];
        x + y * row + z * layer
    }
    #[inline(always)]
    fn place(self, at: Eight<S>) -> i32x8<S> {
        at.0.to_int()
    }
    #[inline(always)]
    fn bytes(self, bytes: &[u8], at: i32x8<S>) -> Eight<S> {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.0.level().as_avx2() {
            let numbers = Reach::new(avx2, bytes, at.to_array(), 0, 0).bytes();
            return Eight(f32x8::float_from(self.of_each(numbers)));
        }
        Eight(f32x8::float_from(self.of_each(each!(at, |at| i32::from(bytes[at])))))
    }
    #[inline(always)]
    fn numbers<T: Copy + Into<f32>>(self, numbers: &[T], at: i32x8<S>) -> Eight<S> {
        Eight(f32x8::load_array(self.0, each!(at, |at| numbers[at].into())))
    }
    #[inline(always)]
    fn short_pairs<const N: usize>(
        self,
        numbers: &[i16],
        at: i32x8<S>,
        distances: [i32; N],
    ) -> [[Eight<S>; 2]; N] {
        let mut pairs = [[Eight(f32x8::splat(self.0, 0.0)); 2]; N];
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.0.level().as_avx2() {
            let (lowest, highest) = ends(distances);
            let reach = Reach::new(avx2, numbers, at.to_array(), lowest, highest.saturating_add(1));
            for i in 0..N {
                pairs[i] = self.unpacked(self.of_each(reach.pairs(distances[i])));
            }
            return pairs;
        }
        for i in 0..N {
            pairs[i] = self.unpacked(self.of_each(each!(at + distances[i], |at| pair(numbers, at))));
        }
        pairs
    }
    #[inline(always)]
    fn short_quads<const N: usize>(
        self,
        numbers: &[i16],
        at: i32x8<S>,
        distances: [i32; N],
    ) -> [[Eight<S>; 4]; N] {
        let mut quads = [[Eight(f32x8::splat(self.0, 0.0)); 4]; N];
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.0.level().as_avx2() {
            let (lowest, highest) = ends(distances);
            let reach = Reach::new(avx2, numbers, at.to_array(), lowest, highest.saturating_add(3));
            for (quad, distance) in quads.iter_mut().zip(distances) {
                let [a, b, c, d] = reach.quads(avx2, distance);
                *quad = [
                    Eight(f32x8::float_from(self.ints(a))),
                    Eight(f32x8::float_from(self.ints(b))),
                    Eight(f32x8::float_from(self.ints(c))),
                    Eight(f32x8::float_from(self.ints(d))),
                ];
            }
            return quads;
        }
        for i in 0..N {
            let at = at + distances[i];
            let [first, second] = self.unpacked(self.of_each(each!(at, |at| pair(numbers, at))));
            let [third, fourth] = self.unpacked(self.of_each(each!(at + 2, |at| pair(numbers, at))));
            quads[i] = [first, second, third, fourth];
        }
        quads
    }
    #[inline(always)]
    fn real_pairs(self, numbers: &[f32], at: i32x8<S>) -> [Eight<S>; 2] {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.0.level().as_avx2() {
            let [low, high] = Reach::new(avx2, numbers, at.to_array(), 0, 1).pairs_from(avx2);
            return [Eight(low.simd_into(self.0)), Eight(high.simd_into(self.0))];
        }
        [self.reals(numbers, at), self.reals(numbers, at + 1)]
    }
    #[inline(always)]
    fn entry_pairs(self, table: &[[f32; 4]], at: i32x8<S>) -> [[Eight<S>; 4]; 2] {
        self.quads(table, at)
    }
    #[inline(always)]
    fn entries(self, table: &[[f32; 4]], at: i32x8<S>) -> [Eight<S>; 4] {
        let [entries] = self.quads(table, at);
        entries
    }
    #[inline(always)]
    fn gathered(self, numbers: Eight<S>, chosen: EightMask<S>) -> Eight<S> {
        Eight(numbers.0.compress(chosen.0))
    }
    #[inline(always)]
    fn apart<R>(self, run: impl FnOnce() -> R) -> R {
        self.0.vectorize(run)
    }
}
