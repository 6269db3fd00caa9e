//! Pixels as network inputs: sRGB-coded, clamped to [0, 1], planar.

use super::example::Planes;
use compose::srgb_code;

/// Splits linear pixels into planes of sRGB codes.
pub fn planes_of_linear(pixels: &[[f32; 3]]) -> Planes {
    let mut planes = vec![0.0; 3 * pixels.len()];
    for (channel, plane) in planes.chunks_exact_mut(pixels.len().max(1)).enumerate() {
        for (out, pixel) in plane.iter_mut().zip(pixels) {
            *out = srgb_code(pixel[channel]);
        }
    }
    planes
}

/// Splits 8-bit sRGB pixels, R G B R G B, into planes.
pub fn planes_of_bytes(bytes: &[u8]) -> Planes {
    let pixels = bytes.len() / 3;
    let mut planes = vec![0.0; 3 * pixels];
    for (channel, plane) in planes.chunks_exact_mut(pixels.max(1)).enumerate() {
        for (out, pixel) in plane.iter_mut().zip(bytes.chunks_exact(3)) {
            *out = f32::from(pixel[channel]) / 255.0;
        }
    }
    planes
}

/// Inverts [`planes_of_bytes`]; clamps and rounds the values.
pub fn bytes_of_planes(planes: &[f32]) -> Vec<u8> {
    let pixels = planes.len() / 3;
    let mut bytes = vec![0; 3 * pixels];
    for (channel, plane) in planes.chunks_exact(pixels.max(1)).enumerate() {
        for (out, value) in bytes.chunks_exact_mut(3).zip(plane) {
            out[channel] = (value.clamp(0.0, 1.0) * 255.0).round() as u8;
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::f16;
    use glasshouse_line::color::{SrgbEncoder, linear_to_srgb, srgb_to_linear};

    #[test]
    fn codes_equal_those_of_the_png_files() {
        let encoder = SrgbEncoder::new();
        let linear: Vec<[f32; 3]> = (0..=255u8)
            .map(|code| [srgb_to_linear(code), f16::from_f32(srgb_to_linear(code)).to_f32(), 1.5])
            .collect();
        let planes = planes_of_linear(&linear);
        let bytes = bytes_of_planes(&planes);
        for (k, pixel) in linear.iter().enumerate() {
            assert!((planes[k] - k as f32 / 255.0).abs() < 1e-6, "{k}");
            assert_eq!(planes[256 + k], linear_to_srgb(pixel[1]) as f32);
            assert_eq!(bytes[3 * k], encoder.encode(pixel[0]));
            assert_eq!(bytes[3 * k + 2], 255);
        }
        assert_eq!(bytes_of_planes(&planes_of_bytes(&bytes)), bytes);
    }

    #[test]
    fn negative_zero_is_black() {
        assert_eq!(planes_of_linear(&[[-0.0, 0.0, -1.0]]), [0.0; 3]);
    }
}
