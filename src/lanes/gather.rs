//! Eight loads by one instruction, where a processor has it: the one place with `unsafe`.
//!
//! Loads of eight lanes one by one cost a third of a picture's time. The instruction reads from
//! addresses that it does not check, so the places are compared with the slice before.

#![allow(unsafe_code)]

use std::arch::x86_64::{
    __m256i, _mm256_add_epi32, _mm256_cmpgt_epi32, _mm256_i32gather_epi32, _mm256_movemask_epi8,
    _mm256_or_si256, _mm256_set1_epi32, _mm256_setzero_si256,
};

fearless_simd::kernel!(
    /// Whether all places are below a bound, and none is negative.
    #[inline(always)]
    fn are_within(avx2: Avx2, at: __m256i, bound: i32) -> bool {
        let above = _mm256_cmpgt_epi32(at, _mm256_set1_epi32(bound - 1));
        let below = _mm256_cmpgt_epi32(_mm256_setzero_si256(), at);
        _mm256_movemask_epi8(_mm256_or_si256(above, below)) == 0
    }
);

/// How many places a slice has from which four bytes can be read, in 31 bits.
#[inline(always)]
fn bound<T>(numbers: &[T]) -> i32 {
    let missing = (4usize.div_ceil(size_of::<T>())) - 1;
    i32::try_from(numbers.len().saturating_sub(missing)).unwrap_or(i32::MAX)
}

macro_rules! gather {
    ($(#[$doc:meta])* $name:ident, $number:ty, $scale:literal) => {
        fearless_simd::kernel!(
            $(#[$doc])*
            ///
            /// # Panics
            /// When a place is outside.
            #[inline(always)]
            pub(crate) fn $name(avx2: Avx2, numbers: &[$number], at: __m256i) -> __m256i {
                assert!(are_within(avx2, at, bound(numbers)), "a place is outside the slice");
                // SAFETY: four bytes from every place are inside the slice, by the line before; and
                // the offset in bytes cannot overflow, because the instruction extends it to 64 bits
                // before it is scaled.
                unsafe { _mm256_i32gather_epi32::<$scale>(numbers.as_ptr().cast(), at) }
            }
        );
    };
}

gather!(
    /// Four bytes from each place.
    bytes, u8, 1
);
/// Pairs of numbers around places of which the outermost are inside a slice.
#[derive(Clone, Copy)]
pub(crate) struct Reach<'a> {
    numbers: &'a [i16],
    at: __m256i,
    lowest: i32,
    highest: i32,
}

fearless_simd::kernel!(
    /// Holds the pairs at distances from `lowest` to `highest` of all places against the slice.
    ///
    /// # Panics
    /// When one is outside.
    #[inline(always)]
    pub(crate) fn reach(avx2: Avx2, numbers: &[i16], at: __m256i, lowest: i32, highest: i32) -> Reach<'_> {
        let first = _mm256_add_epi32(at, _mm256_set1_epi32(lowest));
        let room = bound(numbers).saturating_sub(highest.saturating_sub(lowest));
        assert!(are_within(avx2, first, room), "a place is outside the slice");
        Reach { numbers, at, lowest, highest }
    }
);

fearless_simd::kernel!(
    /// The pairs at a distance from the places, one number behind the other.
    ///
    /// # Panics
    /// When the distance is beyond the reach.
    #[inline(always)]
    pub(crate) fn pairs(avx2: Avx2, reach: Reach<'_>, distance: i32) -> __m256i {
        assert!(reach.lowest <= distance && distance <= reach.highest, "beyond the reach");
        let at = _mm256_add_epi32(reach.at, _mm256_set1_epi32(distance));
        // SAFETY: `reach` has found the pairs from the lowest to the highest distance inside the
        // slice, and this distance is between them. The instruction extends places to 64 bits before
        // it scales them.
        unsafe { _mm256_i32gather_epi32::<2>(reach.numbers.as_ptr().cast(), at) }
    }
);

gather!(
    /// The bits of the number at each place.
    reals, f32, 4
);
