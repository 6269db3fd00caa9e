//! The sRGB curve (IEC 61966-2-1), its inverse, and a fast encoder to the nearest 8-bit codes.
//!
//! Uses `libm`, because its results are equal on all machines, unlike those of `f64::powf`.

/// An encoder of linear values to the nearest 8-bit IEC 61966-2-1 code. Clamps values to [0, 1].
pub struct SrgbEncoder {
    /// `thresholds[c]`: least linear value with a code above c.
    thresholds: [f32; 255],
    /// Codes at the lower ends of 4,096 equal cells of [0, 1], and at 1.
    start: Vec<u8>,
}

const CELLS: usize = 4096;

/// Returns the linear value of an 8-bit code.
#[inline]
pub fn srgb_to_linear(code: u8) -> f32 {
    decode_srgb(f64::from(code) / 255.0) as f32
}

/// Applies the inverse curve, continued above 1. Negative values stay negative, and NaN stays NaN.
#[inline]
pub fn decode_srgb(coded: f64) -> f64 {
    if coded > 0.04045 { libm::pow((coded + 0.055) / 1.055, 2.4) } else { coded / 12.92 }
}

/// Applies the curve to a linear value, clamped to [0, 1]. The result is a code value in [0, 1].
#[inline]
pub fn linear_to_srgb(value: f32) -> f64 {
    let value = f64::from(value.clamp(0.0, 1.0));
    if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * libm::pow(value, 1.0 / 2.4) - 0.055 }
}

/// Returns the nearest 16-bit IEC 61966-2-1 code of a linear value, clamped to [0, 1]. NaN becomes 0.
#[inline]
pub fn linear_to_srgb16(value: f32) -> u16 {
    (linear_to_srgb(value) * 65_535.0).round() as u16
}

impl SrgbEncoder {
    pub fn new() -> Self {
        let mut thresholds = [0f32; 255];
        for (c, threshold) in thresholds.iter_mut().enumerate() {
            *threshold = decode_srgb((c as f64 + 0.5) / 255.0) as f32;
        }
        let code = |value: f32| thresholds.iter().filter(|&&t| value >= t).count() as u8;
        let start = (0..=CELLS).map(|i| code(i as f32 / CELLS as f32)).collect();
        Self { thresholds, start }
    }

    /// Returns the code of a linear value. NaN becomes 0.
    #[inline]
    pub fn encode(&self, value: f32) -> u8 {
        let value = value.clamp(0.0, 1.0);
        let mut code = usize::from(self.start[(value * CELLS as f32) as usize]);
        while code < 255 && value >= self.thresholds[code] {
            code += 1;
        }
        code as u8
    }
}

impl Default for SrgbEncoder {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decoded_values_match_the_standard() {
        // The expected values are from the standard's formula in exact arithmetic, to 12 digits.
        assert!((decode_srgb(128.0 / 255.0) - 0.215860500114).abs() < 1e-12);
        assert!((decode_srgb(188.0 / 255.0) - 0.502886458033).abs() < 1e-12);
        assert_eq!(decode_srgb(0.0), 0.0);
        assert_eq!(decode_srgb(1.0), 1.0);
        assert!(decode_srgb(f64::NAN).is_nan());
        assert!(decode_srgb(-1.0) < 0.0);
    }

    #[test]
    fn codes_of_16_bits_extend_those_of_8_bits() {
        for (value, code) in [(0.0, 0), (-1.0, 0), (1.0, 65_535), (3.0, 65_535), (f32::NAN, 0)] {
            assert_eq!(linear_to_srgb16(value), code, "{value}");
        }
        // The 8-bit code c and the 16-bit code 257 c stand for the same value.
        for code in 0..=255u8 {
            let linear = srgb_to_linear(code);
            assert_eq!(linear_to_srgb16(linear), u16::from(code) * 257);
        }
    }

    #[test]
    fn codes_are_the_rounded_curve() {
        let encoder = SrgbEncoder::new();
        for i in 0..=100_000 {
            let value = i as f64 / 100_000.0;
            let curve = if value <= 0.003_130_8 {
                12.92 * value
            } else {
                1.055 * libm::pow(value, 1.0 / 2.4) - 0.055
            };
            let exact = curve * 255.0;
            let code = f64::from(encoder.encode(value as f32));
            assert!((code - exact).abs() <= 0.5001, "{value} {code} {exact}");
        }
        assert_eq!(encoder.encode(-1.0), 0);
        assert_eq!(encoder.encode(2.0), 255);
        assert_eq!(encoder.encode(f32::NAN), 0);
        for code in 0..=255u8 {
            assert_eq!(encoder.encode(srgb_to_linear(code)), code);
        }
    }
}
