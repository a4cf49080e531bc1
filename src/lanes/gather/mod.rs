//! Numbers from many places of a slice: the one place with `unsafe`.
//!
//! All places are compared with the slice's length at once, before the first read.

#![allow(unsafe_code)]

mod eight;
mod sixteen;

pub(crate) use eight::Reach;
pub(crate) use sixteen::WideReach;

use std::arch::x86_64::__m128;

/// A value without invalid bits.
pub(crate) trait Plain: Copy {}
impl Plain for u8 {}
impl Plain for i16 {}
impl Plain for i32 {}
impl Plain for i64 {}
impl Plain for f32 {}
impl Plain for __m128 {}

/// The lowest and the highest distance.
#[inline(always)]
pub(crate) fn ends<const N: usize>(distances: [i32; N]) -> (i32, i32) {
    let (mut lowest, mut highest) = (i32::MAX, i32::MIN);
    for distance in distances {
        (lowest, highest) = (lowest.min(distance), highest.max(distance));
    }
    (lowest, highest)
}
