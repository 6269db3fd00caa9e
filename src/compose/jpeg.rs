//! Rounding to 8 bits, and the losses of JPEG.

use glasshouse_line::Subsampling;
use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
use image::{ExtendedColorType, ImageDecoder, ImageResult};
use jpeg_encoder::{ColorType, Encoder, EncodingError, SamplingFactor};
use std::io::Cursor;

/// Returns the codes of square planes as 8-bit RGB. Codes must lie in [0, 1].
pub(crate) fn to_rgb8(planes: &[f32]) -> Vec<u8> {
    let pixels = planes.len() / 3;
    let mut bytes = vec![0; planes.len()];
    for (channel, plane) in planes.chunks_exact(pixels.max(1)).enumerate() {
        for (out, code) in bytes.chunks_exact_mut(3).zip(plane) {
            // Adding a half before the truncation rounds numbers that are not negative.
            out[channel] = (code * 255.0 + 0.5) as u8;
        }
    }
    bytes
}

/// Inverts [`to_rgb8`].
pub(crate) fn of_rgb8(bytes: &[u8], planes: &mut [f32]) {
    let pixels = planes.len() / 3;
    for (channel, plane) in planes.chunks_exact_mut(pixels.max(1)).enumerate() {
        for (out, pixel) in plane.iter_mut().zip(bytes.chunks_exact(3)) {
            *out = f32::from(pixel[channel]) / 255.0;
        }
    }
}

/// Encodes a picture of a size, px, as baseline JPEG with a quality from 1 to 100.
pub(crate) fn encode_jpeg(
    rgb: &[u8],
    [width, height]: [usize; 2],
    quality: u8,
    subsampling: Subsampling,
) -> Result<Vec<u8>, EncodingError> {
    let side = |px: usize| u16::try_from(px).expect("a film has at most 16,384 px a side");
    let mut file = Vec::with_capacity(rgb.len() / 4);
    let mut encoder = Encoder::new(&mut file, quality);
    encoder.set_sampling_factor(match subsampling {
        Subsampling::Full => SamplingFactor::F_1_1,
        Subsampling::HalfColumns => SamplingFactor::F_2_1,
        Subsampling::Half => SamplingFactor::F_2_2,
    });
    encoder.encode(rgb, side(width), side(height), ColorType::Rgb)?;
    Ok(file)
}

/// Decodes a JPEG to 8-bit RGB.
pub(crate) fn decode_jpeg(file: &[u8]) -> ImageResult<Vec<u8>> {
    let decoder = JpegDecoder::new(Cursor::new(file))?;
    let mut decoded = vec![0; decoder.total_bytes() as usize];
    decoder.read_image(&mut decoded)?;
    Ok(decoded)
}

/// Encodes and decodes a square picture of `side` px at a quality from 1 to 100.
pub(crate) fn through_jpeg(rgb: &[u8], side: usize, quality: u8) -> ImageResult<Vec<u8>> {
    let mut file = Vec::with_capacity(rgb.len() / 4);
    let mut encoder = JpegEncoder::new_with_quality(&mut file, quality);
    encoder.encode(rgb, side as u32, side as u32, ExtendedColorType::Rgb8)?;
    decode_jpeg(&file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::psnr_colour_db;
    use image::RgbImage;

    #[test]
    fn worse_qualities_lose_more() {
        let picture = RgbImage::from_fn(40, 40, |x, y| {
            image::Rgb([x * 6, y * 6, (x * y) % 256].map(|v| v as u8))
        });
        let loss = |quality| {
            let bytes = through_jpeg(picture.as_raw(), 40, quality).unwrap();
            let made = RgbImage::from_raw(40, 40, bytes).unwrap();
            psnr_colour_db(&made, &picture).unwrap()
        };
        let [worst, middle, best] = [10, 60, 98].map(loss);
        assert!(worst < middle - 3.0 && middle < best - 3.0, "{worst} {middle} {best}");
    }

    #[test]
    fn bytes_are_rounded_codes() {
        let planes: Vec<f32> = (0..12).map(|k| k as f32 / 11.0).collect();
        let bytes = to_rgb8(&planes);
        assert_eq!(bytes[..3], [0, 93, 185]);
        let mut back = vec![0.0; 12];
        of_rgb8(&bytes, &mut back);
        assert!(planes.iter().zip(&back).all(|(a, b)| (a - b).abs() <= 0.5 / 255.0 + 1e-6));
        assert_eq!(to_rgb8(&back), bytes);
    }
}
