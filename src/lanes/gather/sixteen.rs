//! Sixteen places at once, by AVX-512.
//!
//! Its gather instruction takes a tenth less than sixteen reads and the shuffles that join them. Its time
//! is that of its lanes, so numbers that lie side by side are read together, in lanes of 64 bits.

use std::arch::x86_64::{
    __m256i, __m512, __m512i, _mm512_and_si512, _mm512_castsi512_ps, _mm512_castsi512_si256,
    _mm512_cmplt_epi32_mask, _mm512_extracti64x4_epi64, _mm512_i32gather_epi32, _mm512_i32gather_epi64,
    _mm512_i32gather_ps, _mm512_min_epi32, _mm512_permutex2var_epi32, _mm512_set1_epi32, _mm512_setr_epi32,
    _mm512_slli_epi32, _mm512_srlv_epi32, _mm512_sub_epi32,
};

use fearless_simd::Avx512;

use super::Plain;

/// Places of a slice around which its numbers can be read.
#[derive(Clone, Copy)]
pub(crate) struct WideReach<'a, T> {
    /// Shows that the processor has the instructions.
    _avx512: Avx512,
    numbers: &'a [T],
    at: __m512i,
    /// The first and the last number around each place that may be read.
    lowest: i32,
    highest: i32,
}

impl<'a, T: Plain> WideReach<'a, T> {
    /// Holds the numbers from `lowest` to `highest` around all places against the slice.
    ///
    /// # Panics
    /// When one is outside.
    #[inline(always)]
    pub(crate) fn new(avx512: Avx512, numbers: &'a [T], at: __m512i, lowest: i32, highest: i32) -> Self {
        let (lowest, highest) = (lowest.min(0), highest.max(0));
        let count = i32::try_from(numbers.len()).unwrap_or(i32::MAX);
        let end = count.saturating_sub(highest);
        assert!(are_within(avx512, at, lowest.saturating_neg(), end), "a place is outside the slice");
        Self { _avx512: avx512, numbers, at, lowest, highest }
    }

    /// The address of the number at a distance from the start of the slice.
    ///
    /// # Panics
    /// When one of the values at that distance from the places is beyond the reach.
    #[inline(always)]
    fn address(&self, distance: i32, values: i32) -> *const T {
        assert!(self.lowest <= distance && distance + values - 1 <= self.highest, "beyond the reach");
        self.numbers.as_ptr().wrapping_offset(distance as isize)
    }
}

impl WideReach<'_, u8> {
    /// The numbers at the places; `None` in a slice of fewer than four.
    #[inline(always)]
    pub(crate) fn bytes(&self, avx512: Avx512) -> Option<__m512i> {
        // Four bytes are read for each: the last four for places behind their first.
        let last =
            i32::try_from(self.numbers.len()).unwrap_or(i32::MAX).checked_sub(4).filter(|&last| last >= 0)?;
        let start = at_most(avx512, self.at, last);
        // SAFETY: `new` has found that no place is negative, and four bytes from the last start on are
        // inside the slice. The token shows that the processor has the instruction.
        let words = unsafe { _mm512_i32gather_epi32::<1>(start, self.numbers.as_ptr().cast()) };
        Some(bytes_of(avx512, words, start, self.at))
    }
}

impl WideReach<'_, i16> {
    /// The two numbers at a distance, one behind the other.
    #[inline(always)]
    pub(crate) fn pairs(&self, distance: i32) -> __m512i {
        let address = self.address(distance, 2);
        // SAFETY: `new` has found the numbers from the lowest to the highest distance around each place
        // inside the slice, and those that are read are between them. The token shows that the
        // processor has the instruction.
        unsafe { _mm512_i32gather_epi32::<2>(self.at, address.cast()) }
    }

    /// The four numbers at a distance, as two pairs.
    #[inline(always)]
    pub(crate) fn quads(&self, avx512: Avx512, distance: i32) -> [__m512i; 2] {
        let address = self.address(distance, 4);
        let [low, high] = halves(avx512, self.at);
        // SAFETY: as of `pairs`.
        let rows = unsafe {
            [
                _mm512_i32gather_epi64::<2>(low, address.cast()),
                _mm512_i32gather_epi64::<2>(high, address.cast()),
            ]
        };
        columns(avx512, rows)
    }
}

impl WideReach<'_, f32> {
    /// The two numbers at a distance.
    #[inline(always)]
    pub(crate) fn pairs(&self, avx512: Avx512, distance: i32) -> [__m512; 2] {
        let address = self.address(distance, 2);
        let [low, high] = halves(avx512, self.at);
        // SAFETY: as of `pairs` of 16 bits.
        let rows = unsafe {
            [
                _mm512_i32gather_epi64::<4>(low, address.cast()),
                _mm512_i32gather_epi64::<4>(high, address.cast()),
            ]
        };
        let [first, second] = columns(avx512, rows);
        [as_reals(avx512, first), as_reals(avx512, second)]
    }

    /// The numbers at a distance.
    #[inline(always)]
    pub(crate) fn reals(&self, distance: i32) -> __m512 {
        let address = self.address(distance, 1);
        // SAFETY: as of `pairs`.
        unsafe { _mm512_i32gather_ps::<4>(self.at, address) }
    }
}

fearless_simd::kernel!(
    /// Whether no place is below `first`, and all are below `end`.
    #[inline(always)]
    fn are_within(avx512: Avx512, at: __m512i, first: i32, end: i32) -> bool {
        let below = _mm512_cmplt_epi32_mask(at, _mm512_set1_epi32(first));
        below == 0 && _mm512_cmplt_epi32_mask(at, _mm512_set1_epi32(end)) == u16::MAX
    }
);

fearless_simd::kernel!(
    /// Places, and the last one for those behind it.
    #[inline(always)]
    fn at_most(avx512: Avx512, at: __m512i, last: i32) -> __m512i {
        _mm512_min_epi32(at, _mm512_set1_epi32(last))
    }
);

fearless_simd::kernel!(
    /// The bytes at these places, of words that start at others.
    #[inline(always)]
    fn bytes_of(avx512: Avx512, words: __m512i, start: __m512i, at: __m512i) -> __m512i {
        let bits = _mm512_slli_epi32::<3>(_mm512_sub_epi32(at, start));
        _mm512_and_si512(_mm512_srlv_epi32(words, bits), _mm512_set1_epi32(0xff))
    }
);

fearless_simd::kernel!(
    /// The first eight lanes, and the others.
    #[inline(always)]
    fn halves(avx512: Avx512, lanes: __m512i) -> [__m256i; 2] {
        [_mm512_castsi512_si256(lanes), _mm512_extracti64x4_epi64::<1>(lanes)]
    }
);

fearless_simd::kernel!(
    /// The first and the second 32 bits of sixteen lanes of 64 bits.
    #[inline(always)]
    fn columns(avx512: Avx512, rows: [__m512i; 2]) -> [__m512i; 2] {
        let first = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
        let second = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
        let [low, high] = rows;
        [_mm512_permutex2var_epi32(low, first, high), _mm512_permutex2var_epi32(low, second, high)]
    }
);

fearless_simd::kernel!(
    #[inline(always)]
    fn as_reals(avx512: Avx512, bits: __m512i) -> __m512 {
        _mm512_castsi512_ps(bits)
    }
);
