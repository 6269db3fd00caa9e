//! Reads pictures as upright 8-bit sRGB, with the reader of a scene's colour images.

use super::EvaluateError;
use image::RgbImage;
use render::formats::{NamedBytes, Photo, decode_srgb_picture};
use std::path::Path;

/// Reads a PNG or JPEG file; the ending of its name does not matter. See [`decode_picture`].
pub fn read_picture(path: &Path) -> Result<RgbImage, EvaluateError> {
    let bytes = render::input_file::read(path)
        .map_err(|source| EvaluateError::Read { path: path.to_owned(), source })?;
    decode_picture(path, bytes)
}

/// Reads a PNG or JPEG file that a program changes and writes again; the pixels are those of [`decode_picture`].
pub fn read_photo(path: &Path) -> Result<Photo, EvaluateError> {
    let bytes = render::input_file::read(path)
        .map_err(|source| EvaluateError::Read { path: path.to_owned(), source })?;
    let photo = Photo::decode(&NamedBytes { path: path.to_owned(), bytes })?;
    if !photo.picture.is_opaque {
        return Err(EvaluateError::Transparent { path: path.to_owned() });
    }
    Ok(photo)
}

/// Decodes the bytes of a PNG or JPEG file; `path` appears in messages.
///
/// Applies the EXIF orientation and converts other colour spaces to sRGB. Rounds 16-bit samples to 8 bits, expands grey
/// to three equal channels, drops an opaque alpha channel and rejects any other alpha channel.
pub fn decode_picture(path: &Path, bytes: Vec<u8>) -> Result<RgbImage, EvaluateError> {
    let picture = decode_srgb_picture(&NamedBytes { path: path.to_owned(), bytes })?;
    if !picture.is_opaque {
        return Err(EvaluateError::Transparent { path: path.to_owned() });
    }
    let (width, height) = (picture.width as u32, picture.height as u32);
    let image = RgbImage::from_raw(width, height, picture.rgb);
    Ok(image.expect("the reader returns all pixels"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ExtendedColorType, ImageEncoder, Rgb};

    fn png(pixels: &[u8], width: u32, height: u32, color: ExtendedColorType) -> Vec<u8> {
        let mut bytes = Vec::new();
        image::codecs::png::PngEncoder::new(&mut bytes)
            .write_image(pixels, width, height, color)
            .unwrap();
        bytes
    }

    fn wide(samples: &[u16]) -> Vec<u8> {
        samples.iter().flat_map(|v| v.to_ne_bytes()).collect()
    }

    fn decode(bytes: &[u8]) -> Result<RgbImage, EvaluateError> {
        decode_picture(Path::new("a.png"), bytes.to_vec())
    }

    /// Makes a JPEG of 16 x 8 px, with a red left half, a blue right half and this EXIF orientation.
    fn turned_jpeg(orientation: Option<u8>) -> Vec<u8> {
        let picture =
            RgbImage::from_fn(16, 8, |x, _| Rgb(if x < 8 { [220, 20, 20] } else { [20, 20, 220] }));
        let mut bytes = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
            .write_image(&picture, 16, 8, ExtendedColorType::Rgb8)
            .unwrap();
        if let Some(orientation) = orientation {
            // One entry of a little-endian TIFF directory: tag 0x112, one 16-bit number.
            let mut segment = b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0".to_vec();
            segment.extend(b"\x12\x01\x03\0\x01\0\0\0");
            segment.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
            bytes.splice(2..2, segment);
        }
        bytes
    }

    #[test]
    fn the_exif_orientation_is_applied() {
        let is_red = |image: &RgbImage, x, y| image.get_pixel(x, y)[0] > 128;
        let plain = decode(&turned_jpeg(None)).unwrap();
        assert!(plain.dimensions() == (16, 8) && is_red(&plain, 0, 4));
        assert_eq!(decode(&turned_jpeg(Some(1))).unwrap(), plain);
        // 3 is half a turn, 6 a quarter turn clockwise (left becomes top), and 8 a quarter turn counterclockwise.
        let half = decode(&turned_jpeg(Some(3))).unwrap();
        assert!(half.dimensions() == (16, 8) && !is_red(&half, 0, 4));
        let clockwise = decode(&turned_jpeg(Some(6))).unwrap();
        assert!(clockwise.dimensions() == (8, 16) && is_red(&clockwise, 4, 0));
        let other = decode(&turned_jpeg(Some(8))).unwrap();
        assert!(other.dimensions() == (8, 16) && !is_red(&other, 4, 0));
        assert_eq!(decode(&turned_jpeg(Some(99))).unwrap(), plain);
    }

    #[test]
    fn other_samples_become_8_bit_rgb() {
        let grey = decode(&png(&[7, 200], 2, 1, ExtendedColorType::L8)).unwrap();
        assert_eq!(grey.as_raw(), &[7, 7, 7, 200, 200, 200]);
        let samples = wide(&[0, 128, 129, 65535, 65407, 65406]);
        let rounded = decode(&png(&samples, 2, 1, ExtendedColorType::Rgb16)).unwrap();
        assert_eq!(rounded.as_raw(), &[0, 0, 1, 255, 255, 254]);
        let samples = wide(&[257 * 30, 65535]);
        let grey = decode(&png(&samples, 1, 1, ExtendedColorType::La16)).unwrap();
        assert_eq!(grey.as_raw(), &[30; 3]);
    }

    #[test]
    fn transparent_pictures_are_refused() {
        let opaque = png(&[1, 2, 3, 255], 1, 1, ExtendedColorType::Rgba8);
        assert_eq!(decode(&opaque).unwrap().as_raw(), &[1, 2, 3]);
        let error = decode(&png(&[1, 2, 3, 254], 1, 1, ExtendedColorType::Rgba8)).unwrap_err();
        assert!(error.to_string().contains("flatten it onto a background"), "{error}");
    }

    #[test]
    fn errors_name_damaged_files() {
        let mut cut = turned_jpeg(None);
        cut.truncate(cut.len() - 20);
        let mut huge = png(&[0; 3], 1, 1, ExtendedColorType::Rgb8);
        huge[16..20].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff]);
        for bytes in [&cut[..], &huge, b"GIF89a", b"", b"\x89PNG\r\n\x1a\n"] {
            let error = decode(bytes).unwrap_err().to_string();
            assert!(error.contains("a.png"), "{error}");
        }
        let error = read_picture(Path::new("no/such.png")).unwrap_err();
        assert!(matches!(error, EvaluateError::Read { .. }), "{error}");
    }
}
