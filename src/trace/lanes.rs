//! Sixteen numbers at a time, in portable code that the compiler turns into vector instructions.
//!
//! Plain multiply and add only: a fused multiply-add rounds once instead of twice, so its bits would differ
//! between instruction sets. `max` and `min` are written as the comparisons that SSE's `maxps` and `minps` are.

/// Rays that are traced together.
pub(crate) const LANES: usize = 16;

/// One number for each of sixteen rays.
pub(crate) type Lane = [f32; LANES];

/// The larger one; `b` if either is not a number.
#[inline(always)]
pub(crate) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller one; `b` if either is not a number.
#[inline(always)]
pub(crate) fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Largest magnitude that [`floor`] takes; whatever is beyond is pulled in.
const FLOOR_LIMIT: f32 = 1.0e9;

/// `x` rounded down, as a float and as an integer, without SSE4.1. Not-a-number becomes `-1e9`.
#[inline(always)]
#[allow(
    unsafe_code,
    reason = "a saturating cast costs four instructions a lane in the hottest loop"
)]
pub(crate) fn floor(x: f32) -> (f32, i32) {
    let x = min(max(x, -FLOOR_LIMIT), FLOOR_LIMIT);
    // SAFETY: `x` is a number within +-1e9 (`max` maps not-a-number to the bound), inside i32's range.
    let truncated = unsafe { x.to_int_unchecked::<i32>() };
    let down = i32::from(truncated as f32 > x);
    let whole = truncated - down;
    (whole as f32, whole)
}

/// sin and cos of `x` in [-pi/4, pi/4]; Taylor series, absolute error below 6e-8.
#[inline(always)]
pub(crate) fn sin_cos_octant(x: f32) -> (f32, f32) {
    let y = x * x;
    let sin = x
        * (1.0
            - y * (1.0 / 6.0)
                * (1.0 - y * (1.0 / 20.0) * (1.0 - y * (1.0 / 42.0) * (1.0 - y * (1.0 / 72.0)))));
    let cos = 1.0
        - y * 0.5 * (1.0 - y * (1.0 / 12.0) * (1.0 - y * (1.0 / 30.0) * (1.0 - y * (1.0 / 56.0))));
    (sin, cos)
}

/// e to the power of `-x`, for `x >= 0`; relative error below 2e-7 for results above 1e-37, 0 below.
#[inline(always)]
pub(crate) fn exp_neg(x: f32) -> f32 {
    // 2^(-whole) * e^(-rest), rest in [0, ln 2): Cody and Waite's split of ln 2 keeps the rest exact.
    let x = min(x, 87.0);
    let (whole, power) = floor(x * std::f32::consts::LOG2_E);
    let rest = (x - whole * 0.693_359_4) + whole * 2.121_944_4e-4;
    let r = rest;
    // Taylor series about 0 of e^-r to the ninth power, in Horner's form.
    let e = 1.0
        - r * (1.0
            - r * 0.5
                * (1.0
                    - r * (1.0 / 3.0)
                        * (1.0
                            - r * 0.25
                                * (1.0
                                    - r * 0.2
                                        * (1.0
                                            - r * (1.0 / 6.0)
                                                * (1.0 - r * (1.0 / 7.0) * (1.0 - r * 0.125)))))));
    e * f32::from_bits(((127 - power) as u32) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_stay_within_their_stated_errors() {
        for i in 0..=20_000 {
            let x = (i as f32 / 10_000.0 - 1.0) * std::f32::consts::FRAC_PI_4;
            let (sin, cos) = sin_cos_octant(x);
            assert!((f64::from(sin) - libm::sin(f64::from(x))).abs() < 1.2e-7);
            assert!((f64::from(cos) - libm::cos(f64::from(x))).abs() < 1.2e-7);
            let t = i as f32 / 250.0;
            let exact = libm::exp(-f64::from(t));
            let error = (f64::from(exp_neg(t)) - exact).abs() / exact;
            assert!(error < 4e-7, "{t} {error}");
        }
        assert_eq!(exp_neg(0.0), 1.0);
        assert!(exp_neg(1e9) < 2e-38);
    }

    #[test]
    fn floor_is_floor() {
        for x in [-2.5, -2.0, -0.0, 0.0, 0.999, 7.0, -1e-30] {
            assert_eq!(floor(x).0, x.floor());
            assert_eq!(floor(x).1, x.floor() as i32);
        }
        assert_eq!(floor(f32::NAN).1, -1_000_000_000);
        assert_eq!(floor(f32::INFINITY).1, 1_000_000_000);
    }
}
