//! A camera's curve from linear light to codes, as a table with linear interpolation.
//!
//! ```text
//! parametric  code(v) = c + k (3 c^2 - 2 c^3 - c)      c = sRGB(v)^gamma
//! filmic      code(v) = sRGB(h(e v) / h(e))            h(x) = (x (A x + C B) + D E) / (x (A x + B) + D F) - E / F
//! ```
//!
//! h is Hable's curve of the game Uncharted 2 ("Filmic tonemapping operators", filmicworlds.com, 2010).

use glasshouse_line::Tone;
use glasshouse_line::color::linear_to_srgb;
use std::sync::LazyLock;

/// Bits of a value's mantissa that choose its node: the table has 256 nodes per factor of two.
const NODE_BITS: u32 = 8;
/// Bits of the mantissa between two nodes.
const BETWEEN_BITS: u32 = 23 - NODE_BITS;
/// The least node is 2^-16; the curve is straight below it.
const LEAST: f32 = 1.0 / 65_536.0;
const FIRST: u32 = LEAST.to_bits() >> BETWEEN_BITS;
const NODE_COUNT: usize = (16 << NODE_BITS) + 1;

/// sRGB codes of the nodes.
static SRGB: LazyLock<Vec<f32>> =
    LazyLock::new(|| (0..NODE_COUNT).map(|k| linear_to_srgb(node(k)) as f32).collect());

/// Makes the table that is otherwise made at its first use.
pub(crate) fn prepare() {
    LazyLock::force(&SRGB);
}

fn node(k: usize) -> f32 {
    f32::from_bits((FIRST + k as u32) << BETWEEN_BITS)
}

fn hable(x: f64) -> f64 {
    let [a, b, c, d, e, f] = [0.15, 0.50, 0.10, 0.20, 0.02, 0.30];
    (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f
}

/// A curve from linear values to codes, both from 0 to 1. It rises everywhere, and maps 0 to 0 and 1 to 1.
///
/// Codes differ from the formula by less than 1e-6, or by less than 4e-3 gamma below a linear value of 2^-16 (a
/// twentieth of an 8-bit step for sRGB itself).
#[derive(Clone, Debug)]
pub(crate) struct Curve {
    /// Codes of the nodes; the last one is repeated.
    codes: Vec<f32>,
}

impl Curve {
    /// Makes the table of `gamma` and of the weight k of the S-shaped part; 1 and 0 give sRGB.
    pub(crate) fn new(gamma: f64, s_curve: f64) -> Self {
        let mut codes = SRGB.clone();
        if (gamma, s_curve) != (1.0, 0.0) {
            for code in &mut codes {
                let c = libm::pow(f64::from(*code), gamma);
                *code = (c + s_curve * (c * c * (3.0 - 2.0 * c) - c)) as f32;
            }
        }
        codes.push(1.0);
        Self { codes }
    }

    /// Makes the table of a camera's curve.
    pub(crate) fn of(tone: Tone) -> Self {
        match tone {
            Tone::Srgb => Self::new(1.0, 0.0),
            Tone::Parametric { gamma, s_curve } => Self::new(gamma, s_curve),
            Tone::Filmic { exposure } => {
                let code = |value: f32| {
                    let light = hable(exposure * f64::from(value)) / hable(exposure);
                    linear_to_srgb(light as f32) as f32
                };
                Self { codes: (0..NODE_COUNT).map(|k| code(node(k))).chain([1.0]).collect() }
            }
        }
    }

    /// Returns the code of a linear value, clamped to [0, 1].
    pub(crate) fn code(&self, value: f32) -> f32 {
        let value = value.clamp(0.0, 1.0);
        let bits = value.max(LEAST).to_bits();
        let node = ((bits >> BETWEEN_BITS) - FIRST) as usize;
        let between = (bits & ((1 << BETWEEN_BITS) - 1)) as f32 / (1 << BETWEEN_BITS) as f32;
        let (low, high) = (self.codes[node], self.codes[node + 1]);
        (low + (high - low) * between) * (value * 65_536.0).min(1.0)
    }

    /// Codes all values.
    pub(crate) fn apply(&self, values: &mut [f32]) {
        for value in values {
            *value = self.code(*value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Stream;

    #[test]
    fn codes_are_near_the_formula_and_rise() {
        let mut stream = Stream::new(4, "curve");
        for (gamma, k) in [(1.0, 0.0), (0.75, 0.35), (1.4, -0.25)] {
            let curve = Curve::new(gamma, k);
            let exact = |value: f32| {
                let c = libm::pow(linear_to_srgb(value), gamma);
                c + k * (c * c * (3.0 - 2.0 * c) - c)
            };
            let mut values: Vec<f32> =
                (0..20_000).map(|_| stream.log_uniform([1e-7, 1.0]) as f32).collect();
            values.extend([0.0, LEAST, 0.0031308, 1.0]);
            values.sort_by(f32::total_cmp);
            let mut last = 0.0;
            for value in values {
                let code = curve.code(value);
                let error = (f64::from(code) - exact(value)).abs();
                let allowed = if value < LEAST { exact(LEAST) } else { 1e-6 };
                assert!(error < allowed, "{gamma} {k} {value}: {error}");
                assert!(code >= last, "{value}");
                last = code;
            }
            assert_eq!([-1.0, 0.0, 1.0, 9.0].map(|v| curve.code(v)), [0.0, 0.0, 1.0, 1.0]);
        }
    }

    #[test]
    fn filmic_curves_rise_and_compress_highlights() {
        for exposure in [0.01, 0.5, 3.0, 100.0] {
            let curve = Curve::of(Tone::Filmic { exposure });
            let codes: Vec<f32> = (0..=4000).map(|k| curve.code(k as f32 / 4000.0)).collect();
            assert!(codes.windows(2).all(|pair| pair[0] <= pair[1]), "{exposure}");
            assert_eq!((codes[0], codes[4000]), (0.0, 1.0));
        }
        // A grey of 0.18 against a white of 11.2 times 1, as published: h(0.18) / h(11.2) with an exposure of 11.2.
        let curve = Curve::of(Tone::Filmic { exposure: 11.2 });
        let value = 0.18 / 11.2;
        let expected = linear_to_srgb((0.048_663_3 / 0.725_129) as f32);
        assert!(
            (f64::from(curve.code(value as f32)) - expected).abs() < 1e-4,
            "{}",
            curve.code(value as f32)
        );
    }
}
