//! Sixteen lanes of 32 bits, by AVX-512: places of a slice are compared with its length and read by an
//! instruction each.

use std::arch::x86_64::{__m512, __m512i, _mm512_permutexvar_ps};

use fearless_simd::prelude::*;
use fearless_simd::{f32x16, i32x16, mask32x16};

use crate::gather::{WideReach, ends};
use crate::wide::{HALF_ROOT, MANTISSA_BITS, ONE, each, wide};
use crate::{Lanes, Mask, Real, Triple};

wide!(SixteenLanes, Sixteen, SixteenMask: 16 "Sixteen", f32x16, i32x16, mask32x16);

impl<S: Simd> SixteenLanes<S> {
    #[inline(always)]
    fn bytes_at_once(self, bytes: &[u8], at: i32x16<S>) -> Option<i32x16<S>> {
        let avx512 = self.0.level().as_avx512()?;
        let numbers = WideReach::new(avx512, bytes, at.into(), 0, 0).bytes(avx512)?;
        Some(numbers.simd_into(self.0))
    }

    #[inline(always)]
    fn pairs_at_once<const N: usize>(
        self,
        numbers: &[i16],
        at: i32x16<S>,
        distances: [i32; N],
    ) -> Option<[i32x16<S>; N]> {
        let avx512 = self.0.level().as_avx512()?;
        let (lowest, highest) = ends(distances);
        let reach = WideReach::new(avx512, numbers, at.into(), lowest, highest.saturating_add(1));
        let mut pairs = [i32x16::splat(self.0, 0); N];
        for (pair, distance) in pairs.iter_mut().zip(distances) {
            *pair = reach.pairs(distance).simd_into(self.0);
        }
        Some(pairs)
    }

    #[inline(always)]
    fn quads_at_once<const N: usize>(
        self,
        numbers: &[i16],
        at: i32x16<S>,
        distances: [i32; N],
    ) -> Option<[[Sixteen<S>; 4]; N]> {
        let avx512 = self.0.level().as_avx512()?;
        let (lowest, highest) = ends(distances);
        let reach = WideReach::new(avx512, numbers, at.into(), lowest, highest.saturating_add(3));
        let mut quads = [[Sixteen(f32x16::splat(self.0, 0.0)); 4]; N];
        for (quad, distance) in quads.iter_mut().zip(distances) {
            let [low, high] = reach.quads(avx512, distance);
            let [first, second] = Self::unpacked(low.simd_into(self.0));
            let [third, fourth] = Self::unpacked(high.simd_into(self.0));
            *quad = [first, second, third, fourth];
        }
        Some(quads)
    }

    #[inline(always)]
    fn reals_at_once(self, numbers: &[f32], at: i32x16<S>) -> Option<[Sixteen<S>; 2]> {
        let avx512 = self.0.level().as_avx512()?;
        let [low, high] = WideReach::new(avx512, numbers, at.into(), 0, 1).pairs(avx512, 0);
        Some([Sixteen(low.simd_into(self.0)), Sixteen(high.simd_into(self.0))])
    }

    #[inline(always)]
    fn permuted_at_once(self, numbers: Sixteen<S>, lanes: i32x16<S>) -> Option<Sixteen<S>> {
        let avx512 = self.0.level().as_avx512()?;
        Some(Sixteen(permuted(avx512, numbers.0.into(), lanes.into()).simd_into(self.0)))
    }

    #[inline(always)]
    fn entries_at_once<const N: usize>(self, numbers: &[f32], at: i32x16<S>) -> Option<[[Sixteen<S>; 4]; N]> {
        let avx512 = self.0.level().as_avx512()?;
        let reach = WideReach::new(avx512, numbers, at.into(), 0, 4 * N as i32 - 1);
        let mut entries = [[Sixteen(f32x16::splat(self.0, 0.0)); 4]; N];
        for (i, entry) in entries.iter_mut().enumerate() {
            let first = 4 * i as i32;
            let [red, green] = reach.pairs(avx512, first);
            // Alone, since many callers need the first three.
            let [blue, last] = [reach.reals(first + 2), reach.reals(first + 3)];
            *entry = [
                Sixteen(red.simd_into(self.0)),
                Sixteen(green.simd_into(self.0)),
                Sixteen(blue.simd_into(self.0)),
                Sixteen(last.simd_into(self.0)),
            ];
        }
        Some(entries)
    }
}

fearless_simd::kernel!(
    /// For each lane the number in the lane that it names.
    #[inline(always)]
    fn permuted(avx512: Avx512, numbers: __m512, lanes: __m512i) -> __m512 {
        _mm512_permutexvar_ps(lanes, numbers)
    }
);
