//! One lane of 64 bits.

use crate::{Lanes, Mask, Real, Triple};

/// The width of one lane of 64 bits.
#[derive(Clone, Copy, Debug)]
pub struct OneLane;

/// A number of 64 bits.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct One(pub f64);

macro_rules! operators {
    ($($operator:ident $method:ident),*) => {$(
        impl std::ops::$operator for One {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(std::ops::$operator::$method(self.0, other.0))
            }
        }
    )*};
}
operators!(Add add, Sub sub, Mul mul, Div div);

impl std::ops::Neg for One {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Real for One {
    type Scalar = f64;
    type Mask = bool;

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
    #[inline(always)]
    fn log2(self) -> Self {
        Self(self.0.log2())
    }
    #[inline(always)]
    fn exp2(self) -> Self {
        Self(self.0.exp2())
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self.0 < other.0
    }
    #[inline(always)]
    fn le(self, other: Self) -> bool {
        self.0 <= other.0
    }
    #[inline(always)]
    fn or_where_not(self, mask: bool, other: Self) -> Self {
        if mask { self } else { other }
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[0] = self.0;
    }
}

impl Mask for bool {
    #[inline(always)]
    fn any(self) -> bool {
        self
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        self.into()
    }
}

impl Lanes for OneLane {
    const COUNT: usize = 1;
    type Scalar = f64;
    type Real = One;
    type Mask = bool;
    type Index = usize;

    #[inline(always)]
    fn scalar(self, number: f64) -> f64 {
        number
    }
    #[inline(always)]
    fn splat(self, number: f64) -> One {
        One(number)
    }
    #[inline(always)]
    fn by_lane(self, mut number: impl FnMut(usize) -> f64) -> One {
        One(number(0))
    }
    #[inline(always)]
    fn load(self, numbers: &[f64]) -> One {
        One(numbers[0])
    }
    #[inline(always)]
    fn first(self, count: usize) -> bool {
        count > 0
    }
    #[inline(always)]
    fn mask(self, bits: u32) -> bool {
        bits & 1 == 1
    }
    #[inline(always)]
    fn places(self, Triple([x, y, z]): Triple<One>, [row, layer]: [i32; 2]) -> usize {
        x.0 as usize + y.0 as usize * row as usize + z.0 as usize * layer as usize
    }
    #[inline(always)]
    fn place(self, at: One) -> usize {
        at.0 as usize
    }
    #[inline(always)]
    fn bytes(self, bytes: &[u8], at: usize) -> One {
        One(bytes[at].into())
    }
    #[inline(always)]
    fn numbers<T: Copy + Into<f32>>(self, numbers: &[T], at: usize) -> One {
        One(numbers[at].into().into())
    }
    #[inline(always)]
    fn short_pairs<const N: usize>(self, numbers: &[i16], at: usize, distances: [i32; N]) -> [[One; 2]; N] {
        distances.map(|distance| {
            let first = at.wrapping_add_signed(distance as isize);
            [0, 1].map(|beside| One(numbers[first + beside].into()))
        })
    }
    #[inline(always)]
    fn short_quads<const N: usize>(self, numbers: &[i16], at: usize, distances: [i32; N]) -> [[One; 4]; N] {
        distances.map(|distance| {
            let first = at.wrapping_add_signed(distance as isize);
            [0, 1, 2, 3].map(|beside| One(numbers[first + beside].into()))
        })
    }
    #[inline(always)]
    fn real_pairs(self, numbers: &[f32], at: usize) -> [One; 2] {
        [0, 1].map(|beside| One(numbers[at + beside].into()))
    }
    #[inline(always)]
    fn entry_pairs(self, table: &[[f32; 4]], at: usize) -> [[One; 4]; 2] {
        [self.entries(table, at), self.entries(table, at + 1)]
    }
    #[inline(always)]
    fn entries(self, table: &[[f32; 4]], at: usize) -> [One; 4] {
        table[at].map(|number| One(number.into()))
    }
    #[inline(always)]
    fn gathered(self, numbers: One, _chosen: bool) -> One {
        numbers
    }
    #[inline(always)]
    fn spread(self, numbers: One, chosen: bool) -> One {
        if chosen { numbers } else { One(0.0) }
    }
    #[inline(always)]
    fn permuted(self, numbers: One, _lanes: usize) -> One {
        numbers
    }
    fn apart<R>(self, run: impl FnOnce() -> R) -> R {
        run()
    }
}
