//! The vectors of x86-64: eight lanes with AVX2 and FMA, sixteen with AVX-512.

use std::arch::is_x86_feature_detected;
use std::arch::x86_64::{
    __m256, __m512, _CMP_NEQ_UQ, _mm_loadu_si128, _mm256_add_ps, _mm256_cmp_ps, _mm256_cvtepi16_epi32,
    _mm256_cvtepi32_ps, _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_loadu_si256, _mm256_max_ps, _mm256_min_ps,
    _mm256_movemask_ps, _mm256_mul_ps, _mm256_set1_ps, _mm256_setzero_ps, _mm256_storeu_ps, _mm512_add_ps,
    _mm512_cmp_ps_mask, _mm512_cvtepi16_epi32, _mm512_cvtepi32_ps, _mm512_fmadd_ps, _mm512_loadu_ps,
    _mm512_max_ps, _mm512_min_ps, _mm512_mul_ps, _mm512_set1_ps, _mm512_setzero_ps, _mm512_storeu_ps,
};

use super::{Anywhere, Job, Simd};

/// Proof of AVX2 and FMA.
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

/// Proof of AVX-512 besides.
#[derive(Clone, Copy)]
pub(super) struct Avx512(());

impl Avx2 {
    pub(super) fn found() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
    }
}

impl Avx512 {
    fn found() -> Option<Self> {
        (Avx2::found().is_some() && is_x86_feature_detected!("avx512f")).then_some(Self(()))
    }
}

pub(super) fn on_widest<J: Job>(job: J) -> J::Answer {
    if let Some(simd) = Avx512::found() {
        // SAFETY: the proof that the processor has what the function is compiled for.
        return unsafe { on_avx512(simd, job) };
    }
    if let Some(simd) = Avx2::found() {
        // SAFETY: as above.
        return unsafe { on_avx2(simd, job) };
    }
    job.run(Anywhere)
}

#[target_feature(enable = "avx2,fma")]
fn on_avx2<J: Job>(simd: Avx2, job: J) -> J::Answer {
    job.run(simd)
}

#[target_feature(enable = "avx512f,avx2,fma")]
fn on_avx512<J: Job>(simd: Avx512, job: J) -> J::Answer {
    job.run(simd)
}

/// The answers on all vectors that this processor has, with their names.
pub(super) fn on_each<J: Job>(job: impl Fn() -> J) -> Vec<(&'static str, J::Answer)> {
    // SAFETY: the proofs, as above.
    let narrow = Avx2::found().map(|simd| ("AVX2", unsafe { on_avx2(simd, job()) }));
    let wide = Avx512::found().map(|simd| ("AVX-512", unsafe { on_avx512(simd, job()) }));
    narrow.into_iter().chain(wide).collect()
}

// SAFETY, of every block below: the value of the type proves that the processor has the instruction, and
// what is read or written lies within a slice that was just cut to the vector's length.

impl Simd for Avx2 {
    type Lanes = __m256;
    const WIDTH: usize = 8;

    #[inline(always)]
    fn splat(self, x: f32) -> __m256 {
        unsafe { _mm256_set1_ps(x) }
    }

    #[inline(always)]
    fn load(self, from: &[f32]) -> __m256 {
        let from = &from[..Self::WIDTH];
        unsafe { _mm256_loadu_ps(from.as_ptr()) }
    }

    #[inline(always)]
    fn load_i16(self, from: &[i16]) -> __m256 {
        let from = &from[..Self::WIDTH];
        unsafe { _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(_mm_loadu_si128(from.as_ptr().cast()))) }
    }

    #[inline(always)]
    fn store(self, lanes: __m256, to: &mut [f32]) {
        let to = &mut to[..Self::WIDTH];
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), lanes) }
    }

    #[inline(always)]
    fn add(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_add_ps(a, b) }
    }

    #[inline(always)]
    fn mul(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_mul_ps(a, b) }
    }

    #[inline(always)]
    fn mul_add(self, a: __m256, b: __m256, c: __m256) -> __m256 {
        unsafe { _mm256_fmadd_ps(a, b, c) }
    }

    #[inline(always)]
    fn max(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_max_ps(a, b) }
    }

    #[inline(always)]
    fn min(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_min_ps(a, b) }
    }

    #[inline(always)]
    fn nonzero(self, lanes: __m256) -> u64 {
        let differs = unsafe { _mm256_cmp_ps::<_CMP_NEQ_UQ>(lanes, _mm256_setzero_ps()) };
        u64::from(unsafe { _mm256_movemask_ps(differs) }.cast_unsigned())
    }
}

impl Simd for Avx512 {
    type Lanes = __m512;
    const WIDTH: usize = 16;

    #[inline(always)]
    fn splat(self, x: f32) -> __m512 {
        unsafe { _mm512_set1_ps(x) }
    }

    #[inline(always)]
    fn load(self, from: &[f32]) -> __m512 {
        let from = &from[..Self::WIDTH];
        unsafe { _mm512_loadu_ps(from.as_ptr()) }
    }

    #[inline(always)]
    fn load_i16(self, from: &[i16]) -> __m512 {
        let from = &from[..Self::WIDTH];
        unsafe { _mm512_cvtepi32_ps(_mm512_cvtepi16_epi32(_mm256_loadu_si256(from.as_ptr().cast()))) }
    }

    #[inline(always)]
    fn store(self, lanes: __m512, to: &mut [f32]) {
        let to = &mut to[..Self::WIDTH];
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), lanes) }
    }

    #[inline(always)]
    fn add(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_add_ps(a, b) }
    }

    #[inline(always)]
    fn mul(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mul_ps(a, b) }
    }

    #[inline(always)]
    fn mul_add(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        unsafe { _mm512_fmadd_ps(a, b, c) }
    }

    #[inline(always)]
    fn max(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_max_ps(a, b) }
    }

    #[inline(always)]
    fn min(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_min_ps(a, b) }
    }

    #[inline(always)]
    fn nonzero(self, lanes: __m512) -> u64 {
        u64::from(unsafe { _mm512_cmp_ps_mask::<_CMP_NEQ_UQ>(lanes, _mm512_setzero_ps()) })
    }
}
