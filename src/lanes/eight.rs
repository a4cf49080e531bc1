//! Eight lanes of 32 bits. With AVX2, all places of a slice are compared with its length at once.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m256, __m256i, _mm256_permutevar8x32_ps};

use fearless_simd::prelude::*;
use fearless_simd::{f32x8, i32x8, mask32x8};

#[cfg(target_arch = "x86_64")]
use crate::gather::{Reach, ends};
use crate::wide::{HALF_ROOT, MANTISSA_BITS, ONE, each, wide};
use crate::{Lanes, Mask, Real, Triple};

wide!(EightLanes, Eight, EightMask: 8 "Eight", f32x8, i32x8, mask32x8);

#[cfg(target_arch = "x86_64")]
impl<S: Simd> EightLanes<S> {
    #[inline(always)]
    fn bytes_at_once(self, bytes: &[u8], at: i32x8<S>) -> Option<i32x8<S>> {
        let avx2 = self.0.level().as_avx2()?;
        Some(i32x8::load_array(self.0, Reach::new(avx2, bytes, at.to_array(), 0, 0).bytes()))
    }

    #[inline(always)]
    fn pairs_at_once<const N: usize>(
        self,
        numbers: &[i16],
        at: i32x8<S>,
        distances: [i32; N],
    ) -> Option<[i32x8<S>; N]> {
        let avx2 = self.0.level().as_avx2()?;
        let (lowest, highest) = ends(distances);
        let reach = Reach::new(avx2, numbers, at.to_array(), lowest, highest.saturating_add(1));
        let mut pairs = [i32x8::splat(self.0, 0); N];
        for (pair, distance) in pairs.iter_mut().zip(distances) {
            *pair = i32x8::load_array(self.0, reach.pairs(distance));
        }
        Some(pairs)
    }

    #[inline(always)]
    fn quads_at_once<const N: usize>(
        self,
        numbers: &[i16],
        at: i32x8<S>,
        distances: [i32; N],
    ) -> Option<[[Eight<S>; 4]; N]> {
        let avx2 = self.0.level().as_avx2()?;
        let (lowest, highest) = ends(distances);
        let reach = Reach::new(avx2, numbers, at.to_array(), lowest, highest.saturating_add(3));
        let mut quads = [[Eight(f32x8::splat(self.0, 0.0)); 4]; N];
        for (quad, distance) in quads.iter_mut().zip(distances) {
            let [a, b, c, d] = reach.quads(avx2, distance);
            *quad = [self.of_ints(a), self.of_ints(b), self.of_ints(c), self.of_ints(d)];
        }
        Some(quads)
    }

    #[inline(always)]
    fn reals_at_once(self, numbers: &[f32], at: i32x8<S>) -> Option<[Eight<S>; 2]> {
        let avx2 = self.0.level().as_avx2()?;
        let [low, high] = Reach::new(avx2, numbers, at.to_array(), 0, 1).pairs_from(avx2);
        Some([Eight(low.simd_into(self.0)), Eight(high.simd_into(self.0))])
    }

    #[inline(always)]
    fn permuted_at_once(self, numbers: Eight<S>, lanes: i32x8<S>) -> Option<Eight<S>> {
        let avx2 = self.0.level().as_avx2()?;
        Some(Eight(permuted(avx2, numbers.0.into(), lanes.into()).simd_into(self.0)))
    }

    #[inline(always)]
    fn entries_at_once<const N: usize>(self, numbers: &[f32], at: i32x8<S>) -> Option<[[Eight<S>; 4]; N]> {
        let avx2 = self.0.level().as_avx2()?;
        let reach = Reach::new(avx2, numbers, at.to_array(), 0, 4 * N as i32 - 1);
        let mut entries = [[Eight(f32x8::splat(self.0, 0.0)); 4]; N];
        for (i, entry) in entries.iter_mut().enumerate() {
            let [a, b, c, d] = reach.quads_at(avx2, 4 * i as i32);
            *entry = [
                Eight(a.simd_into(self.0)),
                Eight(b.simd_into(self.0)),
                Eight(c.simd_into(self.0)),
                Eight(d.simd_into(self.0)),
            ];
        }
        Some(entries)
    }

    #[inline(always)]
    fn of_ints(self, numbers: __m256i) -> Eight<S> {
        let numbers: i32x8<S> = numbers.simd_into(self.0);
        Eight(f32x8::float_from(numbers))
    }
}

#[cfg(not(target_arch = "x86_64"))]
crate::wide::in_turn!(EightLanes, Eight, i32x8);

#[cfg(target_arch = "x86_64")]
fearless_simd::kernel!(
    /// For each lane the number in the lane that it names.
    #[inline(always)]
    fn permuted(avx2: Avx2, numbers: __m256, lanes: __m256i) -> __m256 {
        _mm256_permutevar8x32_ps(numbers, lanes)
    }
);
