//! The common part of eight and sixteen lanes of 32 bits: everything but reads of all places at once.
//!
//! [`wide`] makes the types of a width. Its module adds the reads (`bytes_at_once` and others), which
//! are `None` where the level has no instructions for them: then the places are read in turn.

/// Bits of the mantissa of a number of 32 bits.
pub(crate) const MANTISSA_BITS: u32 = 23;
/// The bits of 1.
pub(crate) const ONE: i32 = 0x3f80_0000;
/// The bits of the square root of one half.
pub(crate) const HALF_ROOT: i32 = 0x3f35_04f3;

/// The values at each place.
#[inline(always)]
pub(crate) fn each<T, const N: usize>(at: [i32; N], read: impl Fn(usize) -> T) -> [T; N] {
    std::array::from_fn(
        #[inline(always)]
        |lane| read(at[lane] as usize),
    )
}

macro_rules! operators {
    ($real:ident: $($operator:ident $method:ident),*) => {$(
        impl<S: Simd> std::ops::$operator for $real<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(std::ops::$operator::$method(self.0, other.0))
            }
        }
    )*};
}
pub(crate) use operators;

/// The types of a width, and their operations.
macro_rules! wide {
    ($lanes:ident, $real:ident, $mask:ident: $count:literal $name:literal, $floats:ident, $ints:ident, $masks:ident) => {
        #[doc = concat!("The width of ", $name, " lanes of 32 bits, by the vector instructions of `S`.")]
        #[derive(Clone, Copy, Debug)]
        pub struct $lanes<S>(pub(crate) S);

        #[doc = concat!($name, " numbers of 32 bits.")]
        #[derive(Clone, Copy, Debug)]
        pub struct $real<S: Simd>($floats<S>);

        #[doc = concat!($name, " truths.")]
        #[derive(Clone, Copy, Debug)]
        pub struct $mask<S: Simd>($masks<S>);

        crate::wide::operators!($real: Add add, Sub sub, Mul mul, Div div);

        impl<S: Simd> std::ops::Neg for $real<S> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self(-self.0)
            }
        }

        impl<S: Simd> std::ops::BitAnd for $mask<S> {
            type Output = Self;
            #[inline(always)]
            fn bitand(self, other: Self) -> Self {
                Self(self.0 & other.0)
            }
        }

        impl<S: Simd> std::ops::BitOr for $mask<S> {
            type Output = Self;
            #[inline(always)]
            fn bitor(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }
        }

        impl<S: Simd> std::ops::Not for $mask<S> {
            type Output = Self;
            #[inline(always)]
            fn not(self) -> Self {
                Self(!self.0)
            }
        }

        impl<S: Simd> Mask for $mask<S> {
            #[inline(always)]
            fn any(self) -> bool {
                self.0.any_true()
            }
            #[inline(always)]
            fn bits(self) -> u32 {
                self.0.to_bitmask() as u32
            }
        }

        impl<S: Simd> Real for $real<S> {
            type Scalar = f32;
            type Mask = $mask<S>;

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

            /// By the series of the inverse hyperbolic tangent over a mantissa from sqrt(1/2) to
            /// sqrt(2).
            #[inline(always)]
            fn log2(self) -> Self {
                let bits: $ints<S> = self.0.bitcast();
                let exponent = (bits - HALF_ROOT) >> MANTISSA_BITS;
                let mantissa: $floats<S> = (bits - (exponent << MANTISSA_BITS)).bitcast();
                let s = (mantissa - 1.0) / (mantissa + 1.0);
                let squared = s * s;
                let sum = squared * (1.0 / 9.0) + 1.0 / 7.0;
                let sum = (sum * squared + 1.0 / 5.0) * squared + 1.0 / 3.0;
                let sum = sum * squared + 1.0;
                Self($floats::float_from(exponent) + s * sum * (2.0 * std::f32::consts::LOG2_E))
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
                let whole: $ints<S> = whole.to_int();
                let power: $floats<S> = ((whole << MANTISSA_BITS) + ONE).bitcast();
                Self(sum * power)
            }

            #[inline(always)]
            fn lt(self, other: Self) -> $mask<S> {
                $mask(self.0.simd_lt(other.0))
            }
            #[inline(always)]
            fn le(self, other: Self) -> $mask<S> {
                $mask(self.0.simd_le(other.0))
            }
            #[inline(always)]
            fn or_where_not(self, mask: $mask<S>, other: Self) -> Self {
                Self(mask.0.select(self.0, other.0))
            }
            #[inline(always)]
            fn store(self, to: &mut [f32]) {
                self.0.store_slice(&mut to[..$count]);
            }
        }

        impl<S: Simd> $lanes<S> {
            /// Two numbers of 16 bits from each place on, the first in the low half.
            #[inline(always)]
            fn pairs_in_turn(self, numbers: &[i16], at: $ints<S>) -> $ints<S> {
                let pairs = each(
                    at.to_array(),
                    #[inline(always)]
                    |at| {
                        let both = &numbers[at..at + 2];
                        i32::from(both[0] as u16) | i32::from(both[1]) << 16
                    },
                );
                $ints::load_array(self.0, pairs)
            }

            /// Pairs of 16 bits, one behind the other in each lane, as numbers.
            #[inline(always)]
            fn unpacked(pairs: $ints<S>) -> [$real<S>; 2] {
                let (low, high) = ((pairs << 16) >> 16, pairs >> 16);
                [$real($floats::float_from(low)), $real($floats::float_from(high))]
            }

            /// The entries at these places and those behind them.
            #[inline(always)]
            fn entries_from<const N: usize>(self, table: &[[f32; 4]], at: $ints<S>) -> [[$real<S>; 4]; N] {
                let (numbers, at) = (table.as_flattened(), at * 4);
                if let Some(entries) = self.entries_at_once(numbers, at) {
                    return entries;
                }
                let mut entries = [[$real($floats::splat(self.0, 0.0)); 4]; N];
                for (i, number) in entries.as_flattened_mut().iter_mut().enumerate() {
                    *number = self.numbers(numbers, at + i as i32);
                }
                entries
            }
        }

        impl<S: Simd> Lanes for $lanes<S> {
            const COUNT: usize = $count;
            type Scalar = f32;
            type Real = $real<S>;
            type Mask = $mask<S>;
            type Index = $ints<S>;

            #[inline(always)]
            fn scalar(self, number: f64) -> f32 {
                number as f32
            }
            #[inline(always)]
            fn splat(self, number: f64) -> $real<S> {
                $real($floats::splat(self.0, number as f32))
            }
            #[inline(always)]
            fn by_lane(self, mut number: impl FnMut(usize) -> f64) -> $real<S> {
                $real($floats::from_fn(self.0, |lane| number(lane) as f32))
            }
            #[inline(always)]
            fn load(self, numbers: &[f32]) -> $real<S> {
                $real($floats::from_slice(self.0, &numbers[..$count]))
            }
            #[inline(always)]
            fn first(self, count: usize) -> $mask<S> {
                self.mask((1 << count.min($count)) - 1)
            }
            #[inline(always)]
            fn mask(self, bits: u32) -> $mask<S> {
                $mask($masks::from_bitmask(self.0, bits.into()))
            }
            #[inline(always)]
            fn places(self, Triple([x, y, z]): Triple<$real<S>>, [row, layer]: [i32; 2]) -> $ints<S> {
                let [x, y, z]: [$ints<S>; 3] = [x.0.to_int(), y.0.to_int(), z.0.to_int()];
                x + y * row + z * layer
            }
            #[inline(always)]
            fn place(self, at: $real<S>) -> $ints<S> {
                at.0.to_int()
            }
            #[inline(always)]
            fn bytes(self, bytes: &[u8], at: $ints<S>) -> $real<S> {
                if let Some(numbers) = self.bytes_at_once(bytes, at) {
                    return $real($floats::float_from(numbers));
                }
                let numbers = each(
                    at.to_array(),
                    #[inline(always)]
                    |at| i32::from(bytes[at]),
                );
                $real($floats::float_from($ints::load_array(self.0, numbers)))
            }
            #[inline(always)]
            fn numbers<T: Copy + Into<f32>>(self, numbers: &[T], at: $ints<S>) -> $real<S> {
                let numbers = each(
                    at.to_array(),
                    #[inline(always)]
                    |at| numbers[at].into(),
                );
                $real($floats::load_array(self.0, numbers))
            }
            #[inline(always)]
            fn short_pairs<const N: usize>(
                self,
                numbers: &[i16],
                at: $ints<S>,
                distances: [i32; N],
            ) -> [[$real<S>; 2]; N] {
                let mut pairs = [[$real($floats::splat(self.0, 0.0)); 2]; N];
                if let Some(both) = self.pairs_at_once(numbers, at, distances) {
                    for (pair, both) in pairs.iter_mut().zip(both) {
                        *pair = Self::unpacked(both);
                    }
                    return pairs;
                }
                for (pair, distance) in pairs.iter_mut().zip(distances) {
                    *pair = Self::unpacked(self.pairs_in_turn(numbers, at + distance));
                }
                pairs
            }
            #[inline(always)]
            fn short_quads<const N: usize>(
                self,
                numbers: &[i16],
                at: $ints<S>,
                distances: [i32; N],
            ) -> [[$real<S>; 4]; N] {
                if let Some(quads) = self.quads_at_once(numbers, at, distances) {
                    return quads;
                }
                let mut quads = [[$real($floats::splat(self.0, 0.0)); 4]; N];
                for (quad, distance) in quads.iter_mut().zip(distances) {
                    let [first, second] = Self::unpacked(self.pairs_in_turn(numbers, at + distance));
                    let [third, fourth] = Self::unpacked(self.pairs_in_turn(numbers, at + distance + 2));
                    *quad = [first, second, third, fourth];
                }
                quads
            }
            #[inline(always)]
            fn real_pairs(self, numbers: &[f32], at: $ints<S>) -> [$real<S>; 2] {
                if let Some(pairs) = self.reals_at_once(numbers, at) {
                    return pairs;
                }
                [self.numbers(numbers, at), self.numbers(numbers, at + 1)]
            }
            #[inline(always)]
            fn entry_pairs(self, table: &[[f32; 4]], at: $ints<S>) -> [[$real<S>; 4]; 2] {
                self.entries_from(table, at)
            }
            #[inline(always)]
            fn entries(self, table: &[[f32; 4]], at: $ints<S>) -> [$real<S>; 4] {
                let [entries] = self.entries_from(table, at);
                entries
            }
            #[inline(always)]
            fn gathered(self, numbers: $real<S>, chosen: $mask<S>) -> $real<S> {
                $real(numbers.0.compress(chosen.0))
            }
            #[inline(always)]
            fn spread(self, numbers: $real<S>, chosen: $mask<S>) -> $real<S> {
                $real(numbers.0.expand(chosen.0))
            }
            #[inline(always)]
            fn permuted(self, numbers: $real<S>, lanes: $ints<S>) -> $real<S> {
                if let Some(permuted) = self.permuted_at_once(numbers, lanes) {
                    return permuted;
                }
                let (numbers, lanes) = (numbers.0.to_array(), lanes.to_array());
                let mut permuted = [0.0; $count];
                for lane in 0..$count {
                    permuted[lane] = numbers[lanes[lane] as usize % $count];
                }
                $real($floats::load_array(self.0, permuted))
            }
            #[inline(always)]
            fn apart<R>(self, run: impl FnOnce() -> R) -> R {
                self.0.vectorize(run)
            }
        }
    };
}
pub(crate) use wide;

/// The reads of a width without instructions for all places at once.
#[cfg(not(target_arch = "x86_64"))]
macro_rules! in_turn {
    ($lanes:ident, $real:ident, $ints:ident) => {
        impl<S: Simd> $lanes<S> {
            #[inline(always)]
            fn bytes_at_once(self, _: &[u8], _: $ints<S>) -> Option<$ints<S>> {
                None
            }
            #[inline(always)]
            fn pairs_at_once<const N: usize>(
                self,
                _: &[i16],
                _: $ints<S>,
                _: [i32; N],
            ) -> Option<[$ints<S>; N]> {
                None
            }
            #[inline(always)]
            fn quads_at_once<const N: usize>(
                self,
                _: &[i16],
                _: $ints<S>,
                _: [i32; N],
            ) -> Option<[[$real<S>; 4]; N]> {
                None
            }
            #[inline(always)]
            fn reals_at_once(self, _: &[f32], _: $ints<S>) -> Option<[$real<S>; 2]> {
                None
            }
            #[inline(always)]
            fn permuted_at_once(self, _: $real<S>, _: $ints<S>) -> Option<$real<S>> {
                None
            }
            #[inline(always)]
            fn entries_at_once<const N: usize>(self, _: &[f32], _: $ints<S>) -> Option<[[$real<S>; 4]; N]> {
                None
            }
        }
    };
}
#[cfg(not(target_arch = "x86_64"))]
pub(crate) use in_turn;
