//! Numbers in lanes, so that a ray caster is written once and runs in several widths: sixteen or
//! eight lanes of 32 bits for speed, and one lane of 64 bits as the truth that these are compared with.
//!
//! Every operation is a plain one of IEEE 754, in the order in which it is written: no fused
//! multiply-add, no estimates. Lanes of 32 bits therefore give the same bits on every processor,
//! whatever its vector instructions and their number; [`dispatch`] takes the widest. This crate knows no volumes and
//! no pictures. Its `unsafe` is in `gather` alone, which reads many places of a slice after one
//! check of all.
//!
//! Everything is inlined: code between [`dispatch`] and an operation has to be marked
//! `#[inline(always)]`, or it is compiled without the processor's vector instructions.

#![expect(clippy::inline_always, reason = "a call would leave the vector instructions of the caller")]

#[cfg(test)]
mod tests;

mod eight;
#[cfg(target_arch = "x86_64")]
mod gather;
mod one;
#[cfg(target_arch = "x86_64")]
mod sixteen;
mod triple;
mod wide;

pub use eight::{Eight, EightLanes};
pub use one::{One, OneLane};
#[cfg(target_arch = "x86_64")]
pub use sixteen::{Sixteen, SixteenLanes};
pub use triple::Triple;

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// Most lanes of a vector.
pub const MOST_LANES: usize = 16;

/// A width: makes vectors, and reads memory into them.
pub trait Lanes: Copy {
    /// Lanes of a vector.
    const COUNT: usize;
    /// The number type of one lane.
    type Scalar: Copy + Into<f64> + Add<Output = Self::Scalar>;
    /// A vector of numbers.
    type Real: Real<Scalar = Self::Scalar, Mask = Self::Mask>;
    /// A truth for each lane.
    type Mask: Mask;
    /// A place in memory for each lane.
    type Index: Copy;

    /// A number, rounded to the lane's width.
    fn scalar(self, number: f64) -> Self::Scalar;
    /// The number in every lane, rounded to the lane's width.
    fn splat(self, number: f64) -> Self::Real;
    /// A number for each lane, by the lane's number from 0 on.
    fn by_lane(self, number: impl FnMut(usize) -> f64) -> Self::Real;
    /// Reads the first lanes of a slice, which has at least as many numbers.
    fn load(self, numbers: &[Self::Scalar]) -> Self::Real;
    /// True in the lanes before the given number.
    fn first(self, count: usize) -> Self::Mask;
    /// True in the lanes whose bits are set, the first lowest.
    fn mask(self, bits: u32) -> Self::Mask;

    /// Places of cells of a three-dimensional array, x fastest: `at` holds whole numbers from 0 on.
    fn places(self, at: Triple<Self::Real>, strides: [i32; 2]) -> Self::Index;
    /// Places from whole numbers below 2^24.
    fn place(self, at: Self::Real) -> Self::Index;

    /// The numbers at these places.
    ///
    /// # Panics
    /// When a place is outside; the other reads likewise.
    fn bytes(self, bytes: &[u8], at: Self::Index) -> Self::Real;
    /// The numbers at these places, read one after the other.
    fn numbers<T: Copy + Into<f32>>(self, numbers: &[T], at: Self::Index) -> Self::Real;
    /// The numbers at distances from these places, and those behind them.
    fn short_pairs<const N: usize>(
        self,
        numbers: &[i16],
        at: Self::Index,
        distances: [i32; N],
    ) -> [[Self::Real; 2]; N];
    /// The numbers at distances from these places, and the three behind each.
    fn short_quads<const N: usize>(
        self,
        numbers: &[i16],
        at: Self::Index,
        distances: [i32; N],
    ) -> [[Self::Real; 4]; N];
    /// The numbers at these places, and those behind them.
    fn real_pairs(self, numbers: &[f32], at: Self::Index) -> [Self::Real; 2];
    /// The entries at these places, and those behind them.
    fn entry_pairs(self, table: &[[f32; 4]], at: Self::Index) -> [[Self::Real; 4]; 2];
    /// The entries at these places.
    fn entries(self, table: &[[f32; 4]], at: Self::Index) -> [Self::Real; 4];

    /// Moves the chosen lanes to the front, in their order. The lanes behind them are undefined.
    fn gathered(self, numbers: Self::Real, chosen: Self::Mask) -> Self::Real;
    /// Moves the first lanes to the chosen ones, in their order: the inverse of `gathered`. The other
    /// lanes are 0.
    fn spread(self, numbers: Self::Real, chosen: Self::Mask) -> Self::Real;
    /// For each lane the number in the lane that it names; places are below the number of lanes.
    fn permuted(self, numbers: Self::Real, lanes: Self::Index) -> Self::Real;

    /// Runs code, out of line where the compiler finds that it pays, with the instructions of this
    /// width: code that is long, or is called from several places. A closure is marked
    /// `#[inline(always)]`.
    fn apart<R>(self, run: impl FnOnce() -> R) -> R;
}

/// A number in each lane.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// The number type of one lane.
    type Scalar: Copy;
    /// The outcome of a comparison.
    type Mask: Mask;

    /// The smaller number of each lane.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// The larger number of each lane.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// Without its sign.
    #[must_use]
    fn abs(self) -> Self;
    /// The whole number at or below.
    #[must_use]
    fn floor(self) -> Self;
    /// The whole number at or above.
    #[must_use]
    fn ceil(self) -> Self;
    /// The nearest whole number; of two, the even one.
    #[must_use]
    fn round(self) -> Self;
    /// The square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// The logarithm to base 2 of a number above 0.
    #[must_use]
    fn log2(self) -> Self;
    /// 2 to the power of a number; from -126 to 126 in lanes of 32 bits.
    #[must_use]
    fn exp2(self) -> Self;
    /// Lanes where it is smaller.
    fn lt(self, other: Self) -> Self::Mask;
    /// Lanes where it is not larger.
    fn le(self, other: Self) -> Self::Mask;
    /// This where the mask holds, and the other elsewhere.
    #[must_use]
    fn or_where_not(self, mask: Self::Mask, other: Self) -> Self;
    /// Writes the lanes to the front of a slice, which has room for them.
    fn store(self, to: &mut [Self::Scalar]);

    /// A number above 0 to a power.
    #[inline(always)]
    #[must_use]
    fn pow(self, exponent: Self) -> Self {
        (self.log2() * exponent).exp2()
    }
    /// From this to another, by a share of the way.
    #[inline(always)]
    #[must_use]
    fn lerp(self, to: Self, share: Self) -> Self {
        self + (to - self) * share
    }
    /// Between two bounds.
    #[inline(always)]
    #[must_use]
    fn clamped(self, low: Self, high: Self) -> Self {
        self.max(low).min(high)
    }
}

/// A truth for each lane.
pub trait Mask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {
    /// Whether any lane is true.
    fn any(self) -> bool;
    /// A bit for each lane, the first lowest.
    fn bits(self) -> u32;
}

/// Code that runs in any width. An implementation is marked `#[inline(always)]`.
pub trait Kernel {
    /// The result.
    type Output;
    /// Runs it in a width.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// The sets of vector instructions that this processor has and this crate is compiled for, widest
/// last.
#[must_use]
pub fn levels() -> Vec<Level> {
    let mut levels = Vec::new();
    #[cfg(target_arch = "x86_64")]
    {
        use fearless_simd::Level;
        let level = Level::new();
        levels.extend(level.as_sse2().map(|token| ("sse2", Level::Sse2(token))));
        levels.extend(level.as_sse4_2().map(|token| ("sse4.2", Level::Sse4_2(token))));
        levels.extend(level.as_avx2().map(|token| ("avx2", Level::Avx2(token))));
        levels.extend(level.as_avx512().map(|token| ("avx512", Level::Avx512(token))));
    }
    #[cfg(not(target_arch = "x86_64"))]
    levels.push(("native", fearless_simd::Level::new()));
    levels.into_iter().map(|(name, level)| Level { name, level }).collect()
}

/// A set of vector instructions.
#[derive(Clone, Copy, Debug)]
pub struct Level {
    name: &'static str,
    level: fearless_simd::Level,
}

impl Level {
    /// The widest set of this processor.
    #[must_use]
    pub fn widest() -> Self {
        levels().pop().expect("every processor has a set")
    }

    /// Its name, such as `avx2`.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.name
    }
}

/// Runs a kernel with the vector instructions of a level: in sixteen lanes of 32 bits by AVX-512, in
/// eight by others.
#[inline]
pub fn dispatch<K: Kernel>(level: Level, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        use fearless_simd::Simd as _;
        match level.level {
            fearless_simd::Level::Avx512(avx512) => avx512.vectorize(
                #[inline(always)]
                || kernel.run(SixteenLanes(avx512)),
            ),
            fearless_simd::Level::Avx2(avx2) => avx2.vectorize(
                #[inline(always)]
                || kernel.run(EightLanes(avx2)),
            ),
            fearless_simd::Level::Sse4_2(sse4_2) => sse4_2.vectorize(
                #[inline(always)]
                || kernel.run(EightLanes(sse4_2)),
            ),
            fearless_simd::Level::Sse2(sse2) => sse2.vectorize(
                #[inline(always)]
                || kernel.run(EightLanes(sse2)),
            ),
            _ => unreachable!("every such processor has SSE2"),
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        fearless_simd::dispatch!(level.level, simd => kernel.run(EightLanes(simd)))
    }
}
