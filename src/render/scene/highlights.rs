//! An inverse tone curve for the radiance of clipped highlights.
//!
//! A camera stores radiance above white as white. With v a pixel's largest linear channel, a = `above` and M = `to`,
//! values v > a become
//!
//! ```text
//! f(v) = v + (M - 1) ((v - a) / (1 - a))^2
//! ```
//!
//! so that f(a) = a, f'(a) = 1, f(1) = M, and f rises everywhere. All three channels are multiplied by f(v) / v, which
//! keeps hue and saturation. The curve is a guess, because the clipped radiance is lost. Banterle et al., "Inverse tone
//! mapping" (GRAPHITE 2006), expand the range in a similar way.

use glasshouse_line::Highlights;

/// Computes f(v) of the largest linear channel `v`.
fn expanded(curve: Highlights, v: f64) -> f64 {
    if v <= curve.above {
        return v;
    }
    let s = (v - curve.above) / (1.0 - curve.above);
    v + (curve.to - 1.0) * s * s
}

/// Expands linear pixels in place, then multiplies red, green and blue by `scale`.
pub(super) fn expand(pixels: &mut [[f32; 4]], curve: Highlights, scale: [f64; 3]) {
    for pixel in pixels {
        let v = f64::from(pixel[0].max(pixel[1]).max(pixel[2]));
        // Up to `above`, the gain is exactly 1, so that the curve changes no bit.
        let gain = if v > curve.above { expanded(curve, v) / v } else { 1.0 };
        for (channel, factor) in pixel.iter_mut().zip(scale) {
            *channel = (f64::from(*channel) * (gain * factor)) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CURVE: Highlights = Highlights { above: 0.9, to: 8.0 };

    #[test]
    fn values_match_the_closed_form() {
        assert_eq!(expanded(CURVE, 0.5), 0.5);
        assert_eq!(expanded(CURVE, 0.9), 0.9);
        assert!((expanded(CURVE, 1.0) - 8.0).abs() < 1e-14);
        // Halfway between `above` and 1: 0.95 + 7/4.
        assert!((expanded(CURVE, 0.95) - 2.7).abs() < 1e-14);
        let flat = Highlights { above: 0.0, to: 1.0 };
        assert_eq!(expanded(flat, 0.3), 0.3);
    }

    #[test]
    fn hue_is_kept_and_dark_pixels_keep_their_bits() {
        let dark = [0.9, 0.1, 0.333_333_34, 0.0];
        let mut pixels = [dark, [1.0, 0.5, 0.25, 0.0]];
        let curve = Highlights { above: f64::from(dark[0]), to: 8.0 };
        expand(&mut pixels, curve, [1.0; 3]);
        assert_eq!(pixels[0].map(f32::to_bits), dark.map(f32::to_bits));
        assert_eq!(pixels[1], [8.0, 4.0, 2.0, 0.0]);
        expand(&mut pixels[..1], curve, [0.0, 2.0, 1.0]);
        assert_eq!(pixels[0], [0.0, 0.2, dark[2], 0.0]);
    }

    proptest! {
        #[test]
        fn the_curve_rises_and_has_no_kink(above in 0.0f64..0.99, to in 1.0f64..100.0, v in 0.0f64..1.0) {
            let curve = Highlights { above, to };
            let h = 1e-7;
            prop_assert!(expanded(curve, v + h) > expanded(curve, v));
            // C1: the slopes on both sides of a point differ by at most h times the second derivative.
            let bend = 2.0 * (to - 1.0) / (1.0 - above).powi(2);
            for at in [above, v] {
                let left = (expanded(curve, at) - expanded(curve, at - h)) / h;
                let right = (expanded(curve, at + h) - expanded(curve, at)) / h;
                prop_assert!((right - left).abs() <= bend * h * 1.01 + 1e-5, "{left} {right}");
            }
            let slope = (expanded(curve, above) - expanded(curve, above - h)) / h;
            prop_assert!((slope - 1.0).abs() < 1e-5);
        }
    }
}
