//! Sixteen f32 numbers at a time, in the vector instructions of the CPU. Each operation has the same result in each set of
//! instructions, because multiply-adds are fused in all of them.
#![allow(unsafe_code, reason = "vector instructions, and loads and stores through pointers")]

/// Number of numbers.
pub(super) const LANES: usize = 16;

/// A set of instructions. Its functions may only be called on a CPU that has them, and are inlined into callers that are
/// compiled for it. Pointers must be valid for [`LANES`] numbers.
pub(super) trait Lanes {
    type V: Copy;
    /// True if 24 vectors fit in the registers beside the operands, otherwise four.
    const IS_WIDE: bool;
    unsafe fn splat(x: f32) -> Self::V;
    unsafe fn load(from: *const f32) -> Self::V;
    unsafe fn store(to: *mut f32, v: Self::V);
    /// Computes a b + c with one rounding.
    unsafe fn fma(a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// Computes `v` where it is positive or NaN, and `slope v` elsewhere, for slopes from 0 to 1.
    unsafe fn leaky(v: Self::V, slope: f32) -> Self::V;
}

/// Any CPU. Without an instruction for it, a fused multiply-add is slow.
pub(super) struct Plain;

impl Lanes for Plain {
    type V = [f32; LANES];
    const IS_WIDE: bool = false;

    #[inline(always)]
    unsafe fn splat(x: f32) -> Self::V {
        [x; LANES]
    }

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self::V {
        // SAFETY: the caller's pointer is valid for `LANES` numbers.
        unsafe { from.cast::<Self::V>().read_unaligned() }
    }

    #[inline(always)]
    unsafe fn store(to: *mut f32, v: Self::V) {
        // SAFETY: the caller's pointer is valid for `LANES` numbers.
        unsafe { to.cast::<Self::V>().write_unaligned(v) }
    }

    #[inline(always)]
    unsafe fn fma(a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        std::array::from_fn(|lane| libm::fmaf(a[lane], b[lane], c[lane]))
    }

    #[inline(always)]
    unsafe fn leaky(v: Self::V, slope: f32) -> Self::V {
        v.map(|v| if slope * v > v { slope * v } else { v })
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::Lanes;
    use std::arch::x86_64::{
        __m256, __m512, _mm256_fmadd_ps, _mm256_loadu_ps, _mm256_max_ps, _mm256_mul_ps,
        _mm256_set1_ps, _mm256_storeu_ps, _mm512_fmadd_ps, _mm512_loadu_ps, _mm512_max_ps,
        _mm512_mul_ps, _mm512_set1_ps, _mm512_storeu_ps,
    };

    /// AVX-512.
    pub(in super::super) struct Avx512;

    impl Lanes for Avx512 {
        type V = __m512;
        const IS_WIDE: bool = true;

        #[inline(always)]
        unsafe fn splat(x: f32) -> Self::V {
            // SAFETY: the caller's CPU has AVX-512; so in all functions of this trait.
            unsafe { _mm512_set1_ps(x) }
        }

        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self::V {
            // SAFETY: see above; the caller's pointer is valid.
            unsafe { _mm512_loadu_ps(from) }
        }

        #[inline(always)]
        unsafe fn store(to: *mut f32, v: Self::V) {
            // SAFETY: see above; the caller's pointer is valid.
            unsafe { _mm512_storeu_ps(to, v) }
        }

        #[inline(always)]
        unsafe fn fma(a: Self::V, b: Self::V, c: Self::V) -> Self::V {
            // SAFETY: see above.
            unsafe { _mm512_fmadd_ps(a, b, c) }
        }

        #[inline(always)]
        unsafe fn leaky(v: Self::V, slope: f32) -> Self::V {
            // SAFETY: see above. The maximum is its second operand if one is NaN.
            unsafe { _mm512_max_ps(_mm512_mul_ps(_mm512_set1_ps(slope), v), v) }
        }
    }

    /// AVX2 and FMA.
    pub(in super::super) struct Avx2;

    impl Lanes for Avx2 {
        type V = [__m256; 2];
        const IS_WIDE: bool = false;

        #[inline(always)]
        unsafe fn splat(x: f32) -> Self::V {
            // SAFETY: the caller's CPU has AVX2 and FMA; so in all functions of this trait.
            unsafe { [_mm256_set1_ps(x); 2] }
        }

        #[inline(always)]
        unsafe fn load(from: *const f32) -> Self::V {
            // SAFETY: see above; the caller's pointer is valid.
            unsafe { [_mm256_loadu_ps(from), _mm256_loadu_ps(from.add(8))] }
        }

        #[inline(always)]
        unsafe fn store(to: *mut f32, v: Self::V) {
            // SAFETY: see above; the caller's pointer is valid.
            unsafe {
                _mm256_storeu_ps(to, v[0]);
                _mm256_storeu_ps(to.add(8), v[1]);
            }
        }

        #[inline(always)]
        unsafe fn fma(a: Self::V, b: Self::V, c: Self::V) -> Self::V {
            // SAFETY: see above.
            unsafe { [_mm256_fmadd_ps(a[0], b[0], c[0]), _mm256_fmadd_ps(a[1], b[1], c[1])] }
        }

        #[inline(always)]
        unsafe fn leaky(v: Self::V, slope: f32) -> Self::V {
            // SAFETY: see above. The maximum is its second operand if one is NaN.
            let of = |v| unsafe { _mm256_max_ps(_mm256_mul_ps(_mm256_set1_ps(slope), v), v) };
            [of(v[0]), of(v[1])]
        }
    }
}
