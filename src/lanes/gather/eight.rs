//! Eight places at once, by AVX2.
//!
//! Eight reads with a check each take a third of a picture's time. The processors' own gather
//! instruction takes up to a sixth more than eight reads and the shuffles that join them, or a
//! twentieth less, by the processor.

use std::arch::x86_64::{
    __m128, __m256, __m256i, _mm_set_epi64x, _mm256_castpd_ps, _mm256_castps_pd, _mm256_castsi256_ps,
    _mm256_cmpgt_epi32, _mm256_movemask_epi8, _mm256_or_si256, _mm256_set_m128, _mm256_set_m128i,
    _mm256_set1_epi32, _mm256_setr_epi32, _mm256_shuffle_ps, _mm256_srai_epi32, _mm256_unpackhi_epi16,
    _mm256_unpackhi_pd, _mm256_unpackhi_ps, _mm256_unpacklo_epi16, _mm256_unpacklo_pd, _mm256_unpacklo_ps,
};

use fearless_simd::Avx2;

use super::Plain;

/// Places of a slice around which its numbers can be read.
#[derive(Clone, Copy)]
pub(crate) struct Reach<'a, T> {
    numbers: &'a [T],
    at: [i32; 8],
    /// The first and the last number around each place that may be read.
    lowest: i32,
    highest: i32,
}

impl<'a, T: Copy> Reach<'a, T> {
    /// Holds the numbers from `lowest` to `highest` around all places against the slice.
    ///
    /// # Panics
    /// When one is outside.
    #[inline(always)]
    pub(crate) fn new(avx2: Avx2, numbers: &'a [T], at: [i32; 8], lowest: i32, highest: i32) -> Self {
        let (lowest, highest) = (lowest.min(0), highest.max(0));
        let count = i32::try_from(numbers.len()).unwrap_or(i32::MAX);
        let end = count.saturating_sub(highest);
        assert!(are_within(avx2, at, lowest.saturating_neg(), end), "a place is outside the slice");
        Self { numbers, at, lowest, highest }
    }

    /// The values at a distance from the place of a lane.
    ///
    /// # Panics
    /// When a part of it is beyond the reach.
    #[inline(always)]
    fn read<R: Plain>(&self, lane: usize, distance: i32) -> R {
        let last = distance + (size_of::<R>() / size_of::<T>()) as i32 - 1;
        assert!(self.lowest <= distance && last <= self.highest, "beyond the reach");
        // No place is negative, by `new`.
        let place = self.at[lane] as u32 as usize;
        let address = self.numbers.as_ptr().wrapping_offset(distance as isize).wrapping_add(place);
        // SAFETY: `new` has found the numbers from the lowest to the highest distance around the
        // place inside the slice, and those that are read are between them. Any bits are an `R`.
        unsafe { address.cast::<R>().read_unaligned() }
    }

    #[inline(always)]
    fn each<R: Plain>(&self, distance: i32) -> [R; 8] {
        std::array::from_fn(
            #[inline(always)]
            |lane| self.read(lane, distance),
        )
    }
}

impl Reach<'_, u8> {
    /// The numbers at the places.
    #[inline(always)]
    pub(crate) fn bytes(&self) -> [i32; 8] {
        self.each::<u8>(0).map(i32::from)
    }
}

impl Reach<'_, i16> {
    /// The two numbers at a distance, one behind the other.
    #[inline(always)]
    pub(crate) fn pairs(&self, distance: i32) -> [i32; 8] {
        self.each(distance)
    }

    /// The four numbers at a distance.
    #[inline(always)]
    pub(crate) fn quads(&self, avx2: Avx2, distance: i32) -> [__m256i; 4] {
        short_columns(avx2, self.each(distance))
    }
}

impl Reach<'_, f32> {
    /// The two numbers from the places on.
    #[inline(always)]
    pub(crate) fn pairs_from(&self, avx2: Avx2) -> [__m256; 2] {
        pair_columns(avx2, self.each(0))
    }

    /// The four numbers at a distance.
    #[inline(always)]
    pub(crate) fn quads_at(&self, avx2: Avx2, distance: i32) -> [__m256; 4] {
        quad_columns(avx2, self.each(distance))
    }
}

fearless_simd::kernel!(
    /// Whether no place is below `first`, and all are below `end`.
    #[inline(always)]
    fn are_within(avx2: Avx2, at: [i32; 8], first: i32, end: i32) -> bool {
        let [a, b, c, d, e, f, g, h] = at;
        let at = _mm256_setr_epi32(a, b, c, d, e, f, g, h);
        let above = _mm256_cmpgt_epi32(at, _mm256_set1_epi32(end - 1));
        let below = _mm256_cmpgt_epi32(_mm256_set1_epi32(first), at);
        _mm256_movemask_epi8(_mm256_or_si256(above, below)) == 0
    }
);

fearless_simd::kernel!(
    /// Eight rows of four numbers of 16 bits as columns of 32 bits.
    #[inline(always)]
    fn short_columns(avx2: Avx2, rows: [i64; 8]) -> [__m256i; 4] {
        let [a, b, c, d, e, f, g, h] = rows;
        let even = _mm256_set_m128i(_mm_set_epi64x(f, e), _mm_set_epi64x(b, a));
        let odd = _mm256_set_m128i(_mm_set_epi64x(h, g), _mm_set_epi64x(d, c));
        // Rows 0 and 2, 1 and 3 of each half are interleaved; then all four.
        let (first, second) = (_mm256_unpacklo_epi16(even, odd), _mm256_unpackhi_epi16(even, odd));
        let (low, high) = (_mm256_unpacklo_epi16(first, second), _mm256_unpackhi_epi16(first, second));
        [
            _mm256_srai_epi32::<16>(_mm256_unpacklo_epi16(low, low)),
            _mm256_srai_epi32::<16>(_mm256_unpackhi_epi16(low, low)),
            _mm256_srai_epi32::<16>(_mm256_unpacklo_epi16(high, high)),
            _mm256_srai_epi32::<16>(_mm256_unpackhi_epi16(high, high)),
        ]
    }
);

fearless_simd::kernel!(
    /// Eight rows of two numbers, each row as the bits of one, as columns.
    #[inline(always)]
    fn pair_columns(avx2: Avx2, rows: [i64; 8]) -> [__m256; 2] {
        let [a, b, c, d, e, f, g, h] = rows;
        let even = _mm256_set_m128i(_mm_set_epi64x(f, e), _mm_set_epi64x(b, a));
        let odd = _mm256_set_m128i(_mm_set_epi64x(h, g), _mm_set_epi64x(d, c));
        let (even, odd) = (_mm256_castsi256_ps(even), _mm256_castsi256_ps(odd));
        [_mm256_shuffle_ps::<0b10_00_10_00>(even, odd), _mm256_shuffle_ps::<0b11_01_11_01>(even, odd)]
    }
);

fearless_simd::kernel!(
    /// Eight rows of four numbers as columns.
    #[inline(always)]
    fn quad_columns(avx2: Avx2, rows: [__m128; 8]) -> [__m256; 4] {
        let [a, b, c, d, e, f, g, h] = rows;
        let (a, b) = (_mm256_set_m128(e, a), _mm256_set_m128(f, b));
        let (c, d) = (_mm256_set_m128(g, c), _mm256_set_m128(h, d));
        let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
        let (ab_behind, cd_behind) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
        let pairs = [ab, cd, ab_behind, cd_behind];
        let [ab, cd, ab_behind, cd_behind] = pairs.map(|pair| _mm256_castps_pd(pair));
        [
            _mm256_castpd_ps(_mm256_unpacklo_pd(ab, cd)),
            _mm256_castpd_ps(_mm256_unpackhi_pd(ab, cd)),
            _mm256_castpd_ps(_mm256_unpacklo_pd(ab_behind, cd_behind)),
            _mm256_castpd_ps(_mm256_unpackhi_pd(ab_behind, cd_behind)),
        ]
    }
);
