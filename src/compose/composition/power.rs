//! Codes of the recipes that mix pictures in codes: v^(1/2.2) of linear light, from tables.
//!
//! A power has no white: codes of twice the light are the codes times one factor, before and after a blur.

use std::sync::LazyLock;

const GAMMA: f64 = 2.2;

/// Codes of linear light.
pub(super) static CODE: LazyLock<Power> = LazyLock::new(|| Power::new(1.0 / GAMMA));
/// Linear light of codes.
pub(super) static LIGHT: LazyLock<Power> = LazyLock::new(|| Power::new(GAMMA));

/// Makes the tables that are otherwise made at their first use.
pub(crate) fn prepare() {
    LazyLock::force(&CODE);
    LazyLock::force(&LIGHT);
}

/// Bits of a value's mantissa that choose its node.
const NODE_BITS: u32 = 10;
const BETWEEN_BITS: u32 = 23 - NODE_BITS;

/// A power of numbers from 0, within 1e-6 of the result.
pub(super) struct Power {
    /// Powers of evenly spaced numbers from 1 to 2.
    mantissas: Vec<f32>,
    /// Powers of 2^-127 to 2^127; 0 in place of the first, because its numbers are 0 or below 1.2e-38.
    exponents: Vec<f32>,
}

impl Power {
    fn new(power: f64) -> Self {
        let node = |k: u32| libm::pow(1.0 + f64::from(k) / f64::from(1 << NODE_BITS), power) as f32;
        let exponent = |e: u32| libm::exp2(power * (f64::from(e) - 127.0)) as f32;
        let exponents = std::iter::once(0.0).chain((1..255).map(exponent)).collect();
        Self { mantissas: (0..=1 << NODE_BITS).map(node).collect(), exponents }
    }

    /// Returns the power of a finite number; 0 for a negative one.
    pub(super) fn of(&self, value: f32) -> f32 {
        let bits = value.max(0.0).to_bits();
        let mantissa = bits & 0x007f_ffff;
        let node = (mantissa >> BETWEEN_BITS) as usize;
        let between = (mantissa & ((1 << BETWEEN_BITS) - 1)) as f32 / (1 << BETWEEN_BITS) as f32;
        let (low, high) = (self.mantissas[node], self.mantissas[node + 1]);
        (low + (high - low) * between) * self.exponents[(bits >> 23 & 0xff) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Stream;

    #[test]
    fn powers_are_near_the_formula() {
        let mut stream = Stream::new(3, "power");
        for _ in 0..20_000 {
            let value = stream.log_uniform([1e-8, 1e4]) as f32;
            for (table, power) in [(&*CODE, 1.0 / 2.2), (&*LIGHT, 2.2)] {
                let exact = libm::pow(f64::from(value), power);
                let found = f64::from(table.of(value));
                assert!((found - exact).abs() < 1e-6 * exact, "{value}^{power}: {found}");
            }
        }
        for table in [&*CODE, &*LIGHT] {
            assert_eq!([-1.0, -0.0, 0.0, 1.0].map(|v| table.of(v)), [0.0, 0.0, 0.0, 1.0]);
        }
    }
}
