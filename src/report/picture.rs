//! Pictures that are part of the page, as data URIs.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngDecoder, PngEncoder};
use image::{ExtendedColorType, ImageDecoder, ImageEncoder, Limits, RgbImage, imageops};
use maud::{Markup, html};
use std::io::Cursor;

pub(super) const QUALITY: u8 = 90;
/// Length of a PNG, relative to the JPEG's, above which the JPEG replaces it.
pub(super) const MUCH_SMALLER: usize = 2;

/// Decodes a PNG of exactly `size` px. Any other size is an error before the pixels are decoded.
pub(super) fn decode_png(bytes: &[u8], size: [u32; 2]) -> Result<RgbImage, String> {
    decode(bytes, size, |found| {
        (found != size).then(|| format!("px, but its film has {} x {}", size[0], size[1]))
    })
}

/// Decodes a PNG of at most `most` px a side.
pub(super) fn decode_png_within(bytes: &[u8], most: u32) -> Result<RgbImage, String> {
    decode(bytes, [most; 2], |found| {
        (found.into_iter().max() > Some(most)).then(|| format!("px, more than {most} a side"))
    })
}

/// Decodes a PNG unless `refuse` returns a reason to reject its size.
fn decode(
    bytes: &[u8],
    most: [u32; 2],
    refuse: impl Fn([u32; 2]) -> Option<String>,
) -> Result<RgbImage, String> {
    let mut limits = Limits::default();
    // Allows four channels of 16 bits, and the decoder's own rows.
    limits.max_alloc = Some(u64::from(most[0]) * u64::from(most[1]) * 8 + (64 << 20));
    let failed = |e: image::ImageError| e.to_string();
    let decoder = PngDecoder::with_limits(Cursor::new(bytes), limits).map_err(failed)?;
    let (width, height) = decoder.dimensions();
    if let Some(reason) = refuse([width, height]) {
        return Err(format!("it has {width} x {height} {reason}"));
    }
    Ok(image::DynamicImage::from_decoder(decoder).map_err(failed)?.into_rgb8())
}

/// Scales the picture down to at most `most` px a side.
pub(super) fn shrunk(picture: RgbImage, most: u32) -> RgbImage {
    let (width, height) = picture.dimensions();
    let longest = width.max(height);
    if longest <= most {
        return picture;
    }
    let side = |side: u32| (u64::from(side) * u64::from(most) / u64::from(longest)).max(1) as u32;
    imageops::thumbnail(&picture, side(width), side(height))
}

/// Encodes an `<img>`: a PNG, or a JPEG if that is much smaller.
pub(super) fn img(picture: &RgbImage, alt: &str) -> Result<Markup, String> {
    let png = png(picture)?;
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY)
        .encode_image(picture)
        .map_err(|e| e.to_string())?;
    let is_smaller = jpeg.len() * MUCH_SMALLER < png.len();
    let (kind, bytes) = if is_smaller { ("jpeg", jpeg) } else { ("png", png) };
    Ok(tag(picture, alt, kind, &bytes))
}

/// Encodes an `<img>` with exact pixels.
pub(super) fn exact_img(picture: &RgbImage, alt: &str) -> Result<Markup, String> {
    Ok(tag(picture, alt, "png", &png(picture)?))
}

fn tag(picture: &RgbImage, alt: &str, kind: &str, bytes: &[u8]) -> Markup {
    let source = format!("data:image/{kind};base64,{}", STANDARD.encode(bytes));
    html! { img alt=(alt) width=(picture.width()) height=(picture.height()) src=(source); }
}

fn png(picture: &RgbImage) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Default, FilterType::Adaptive)
        .write_image(picture.as_raw(), picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .map_err(|e| e.to_string())?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_another_size_are_refused() {
        let picture = RgbImage::from_fn(8, 6, |x, y| image::Rgb([x as u8 * 30, y as u8 * 40, 7]));
        let bytes = png(&picture).unwrap();
        assert_eq!(decode_png(&bytes, [8, 6]).unwrap(), picture);
        let error = decode_png(&bytes, [8, 7]).unwrap_err();
        assert!(error.contains("8 x 6 px"), "{error}");
        decode_png(&bytes[..bytes.len() / 2], [8, 6]).unwrap_err();
        assert_eq!(decode_png_within(&bytes, 8).unwrap(), picture);
        decode_png_within(&bytes, 7).unwrap_err();
        assert_eq!(shrunk(picture.clone(), 8), picture);
        assert_eq!(shrunk(picture, 4).dimensions(), (4, 3));
        let thin = RgbImage::new(1000, 2);
        assert_eq!(shrunk(thin, 100).dimensions(), (100, 1));
    }

    #[test]
    fn a_header_that_claims_a_huge_picture_is_refused() {
        let mut bytes = png(&RgbImage::new(4, 4)).unwrap();
        // Changes width and height in IHDR. The wrong checksum or the size makes the decoder fail before it allocates.
        bytes[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
        decode_png(&bytes, [4, 4]).unwrap_err();
    }

    #[test]
    fn pictures_that_compress_badly_become_jpegs() {
        let flat = RgbImage::from_pixel(64, 64, image::Rgb([9, 9, 9]));
        let text = |tag: Result<Markup, String>| tag.unwrap().into_string();
        assert!(text(img(&flat, "a")).contains("image/png"));
        let waves = RgbImage::from_fn(128, 128, |x, y| {
            let wave = |f: f64| (libm::sin(f64::from(x * y) * f * 1e-3) * 90.0 + 120.0) as u8;
            image::Rgb([wave(1.0), wave(1.3), wave(1.7)])
        });
        let tag = text(img(&waves, "b"));
        assert!(tag.contains("image/jpeg") && tag.contains("width=\"128\""));
        assert!(text(exact_img(&waves, "b")).contains("image/png"));
    }
}
