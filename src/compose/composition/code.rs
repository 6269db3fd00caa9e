//! sRGB codes of stored values, as the networks of earlier versions saw them.

use exr::prelude::f16;
use glasshouse_line::color::linear_to_srgb;
use std::sync::LazyLock;

/// sRGB codes of all half floats from 0 to 1, indexed by their bits. Tuples store half floats.
static OF_HALVES: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let one = f16::ONE.to_bits();
    (0..=one).map(|bits| linear_to_srgb(f16::from_bits(bits).to_f32()) as f32).collect()
});

/// Makes the table that is otherwise made at its first use.
pub(crate) fn prepare() {
    LazyLock::force(&OF_HALVES);
}

/// Returns the sRGB code of a linear value, clamped to [0, 1]: `linear_to_srgb` as f32, from a table for half floats.
pub fn srgb_code(value: f32) -> f32 {
    // The sum turns -0, which has the bits of no index, into 0.
    let value = value.clamp(0.0, 1.0) + 0.0;
    let half = f16::from_f32(value);
    if half.to_f32() == value {
        return OF_HALVES.get(usize::from(half.to_bits())).copied().unwrap_or(1.0);
    }
    linear_to_srgb(value) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_those_of_the_curve() {
        for value in [0.0, 6e-8, 0.0031308, 0.1, 0.25, 0.999, 1.0, 1.5] {
            assert_eq!(srgb_code(value), linear_to_srgb(value) as f32, "{value}");
        }
        assert_eq!([-0.0, -1.0].map(|v| srgb_code(v).to_bits()), [0; 2]);
    }
}
