//! Reads PNG and JPEG pictures as upright 8-bit sRGB.

use super::color_space::ColorSpace;
use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::icc::ColorError;
use super::raster::{self, Raster, Samples};
use glasshouse_line::color::SrgbEncoder;

/// A picture of 8-bit sRGB codes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SrgbPicture {
    pub width: usize,
    pub height: usize,
    /// Red, green and blue of each pixel, row by row.
    pub rgb: Vec<u8>,
    /// False if an alpha channel has a value below its maximum.
    pub is_opaque: bool,
}

/// Decodes a PNG or JPEG file; checks and meaning are those of a scene's colour images.
///
/// Applies the EXIF orientation, converts other colour spaces to sRGB (colours outside of its gamut are limited to
/// [0, 1] in each channel), repeats grey in three channels, drops alpha, and rounds 16-bit codes to 8 bits.
pub fn decode_srgb_picture(file: &NamedBytes) -> Result<SrgbPicture, SceneError> {
    let raster = raster::decode(file, picture_format(file)?)?.upright();
    srgb_picture(file, &raster)
}

/// Returns the format of a PNG or JPEG file; fails for other files.
pub(super) fn picture_format(file: &NamedBytes) -> Result<FileFormat, SceneError> {
    const EXPECTED: &str = "a PNG or JPEG picture";
    let format = file.format(EXPECTED)?;
    if matches!(format, FileFormat::Png | FileFormat::Jpeg) {
        Ok(format)
    } else {
        Err(file.wrong_format(format!("a {} file", format.name()), EXPECTED))
    }
}

/// Converts the upright pixels of a PNG or JPEG file.
pub(super) fn srgb_picture(file: &NamedBytes, raster: &Raster) -> Result<SrgbPicture, SceneError> {
    let Raster { width, height, channels, samples, color, .. } = raster;
    let (width, height, channels) = (*width, *height, *channels);
    let failed =
        |source: &ColorError| SceneError::Color { path: file.path.clone(), source: source.clone() };
    let rgb = match (samples, color.as_ref().map_err(failed)?) {
        (_, None) => samples.rgb8(channels),
        (Samples::U8(codes), Some(space)) => converted(codes, channels, space, 255),
        (Samples::U16(codes), Some(space)) => converted(codes, channels, space, 65535),
        (Samples::F32(_), _) => unreachable!("PNG and JPEG hold integers"),
    };
    let is_opaque = match samples {
        Samples::U8(codes) => is_opaque(codes, channels, 255),
        Samples::U16(codes) => is_opaque(codes, channels, 65535),
        Samples::F32(_) => unreachable!("PNG and JPEG hold integers"),
    };
    Ok(SrgbPicture { width, height, rgb, is_opaque })
}

impl Samples {
    /// Returns red, green and blue as 8-bit codes; repeats grey and drops alpha.
    pub(super) fn rgb8(&self, channels: usize) -> Vec<u8> {
        match self {
            Self::U8(codes) => rgb(codes, channels, |c| c),
            Self::U16(codes) => rgb(codes, channels, narrow),
            Self::F32(_) => unreachable!("PNG and JPEG hold integers"),
        }
    }
}

/// Rounds a 16-bit code to 8 bits. The 8-bit code c and the 16-bit code 257 c have the same value.
fn narrow(code: u16) -> u8 {
    ((u32::from(code) + 128) / 257) as u8
}

fn rgb<T: Copy>(codes: &[T], channels: usize, code: impl Fn(T) -> u8) -> Vec<u8> {
    let pixels = codes.chunks_exact(channels);
    match channels {
        1 | 2 => pixels.flat_map(|p| [code(p[0]); 3]).collect(),
        _ => pixels.flat_map(|p| [code(p[0]), code(p[1]), code(p[2])]).collect(),
    }
}

fn is_opaque<T: Copy + Into<u32>>(codes: &[T], channels: usize, max: u32) -> bool {
    channels % 2 == 1 || codes.chunks_exact(channels).all(|p| p[channels - 1].into() == max)
}

/// Converts codes of another colour space to the nearest sRGB codes.
fn converted<T: Copy + Into<usize>>(
    codes: &[T],
    channels: usize,
    space: &ColorSpace,
    max: u16,
) -> Vec<u8> {
    let (tables, encoder) = (space.tables(max), SrgbEncoder::new());
    let color = |r: T, g: T, b: T| {
        let [r, g, b] = [r, g, b].map(Into::into);
        space.rec709([tables[0][r], tables[1][g], tables[2][b]]).map(|v| encoder.encode(v as f32))
    };
    let pixels = codes.chunks_exact(channels);
    match channels {
        1 | 2 => pixels.flat_map(|p| color(p[0], p[0], p[0])).collect(),
        _ => pixels.flat_map(|p| color(p[0], p[1], p[2])).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::raster::tests::png;
    use image::ExtendedColorType;
    use std::path::{Path, PathBuf};

    fn folder() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/formats/icc")
    }

    fn read(name: &str) -> Result<SrgbPicture, SceneError> {
        let path = folder().join(name);
        decode_srgb_picture(&NamedBytes { bytes: std::fs::read(&path).unwrap(), path })
    }

    /// Every picture of `tests/formats/icc/convert.py` is within one 8-bit step of what LittleCMS makes of it (relative
    /// colorimetric), and the profiles change the codes by more.
    #[test]
    fn colours_are_those_of_littlecms() {
        let mut names: Vec<String> = std::fs::read_dir(folder())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter_map(|name| name.strip_suffix(".srgb.png").map(str::to_owned))
            .collect();
        names.sort();
        assert_eq!(names.len(), 19);
        for name in names {
            let expected = read(&format!("{name}.srgb.png")).unwrap();
            let of_jpeg = folder().join(format!("{name}.jpg")).exists();
            let file = format!("{name}.{}", if of_jpeg { "jpg" } else { "png" });
            let found = read(&file).unwrap();
            assert_eq!((found.width, found.height), (expected.width, expected.height), "{name}");
            let most_steps = |codes: &[u8]| {
                let pairs = codes.iter().zip(&expected.rgb);
                pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap()
            };
            let most = most_steps(&found.rgb);
            let bytes = std::fs::read(folder().join(&file)).unwrap();
            let without = most_steps(image::load_from_memory(&bytes).unwrap().into_rgb8().as_raw());
            assert!(most <= 1, "{name}: {most}");
            assert!(without >= 9 || (name == "srgb-table" && without == 0), "{name}: {without}");
        }
    }

    #[test]
    fn colours_that_cannot_be_converted_are_refused_by_name() {
        for (name, words) in [
            ("refused-table.png", "has a table of colours (A2B) in place of curves and primaries"),
            ("refused-short.png", "its ICC profile is damaged"),
            ("refused-grey.png", "its ICC profile is one of grey pictures, but the picture is RGB"),
            ("refused-cmyk.jpg", "it is a CMYK picture with an ICC profile; convert it to sRGB"),
        ] {
            let error = read(name).unwrap_err().to_string();
            assert!(error.contains(words) && error.contains(name), "{error}");
        }
    }

    /// 16-bit codes keep their precision through a conversion, and have the meaning of 8-bit codes.
    #[test]
    fn wide_codes_are_converted_like_narrow_ones() {
        let bytes = std::fs::read(folder().join("p3.png")).unwrap();
        let icc = {
            let mut decoder =
                image::codecs::png::PngDecoder::new(std::io::Cursor::new(&bytes)).unwrap();
            image::ImageDecoder::icc_profile(&mut decoder).unwrap().unwrap()
        };
        let narrow = image::load_from_memory(&bytes).unwrap().into_rgb8();
        let wide: Vec<u16> = narrow.as_raw().iter().map(|code| u16::from(*code) * 257).collect();
        let mut file = Vec::new();
        let mut encoder = image::codecs::png::PngEncoder::new(&mut file);
        image::ImageEncoder::set_icc_profile(&mut encoder, icc).unwrap();
        let (width, height) = narrow.dimensions();
        let color = ExtendedColorType::Rgb16;
        image::ImageEncoder::write_image(
            encoder,
            bytemuck::cast_slice(&wide),
            width,
            height,
            color,
        )
        .unwrap();
        let found =
            decode_srgb_picture(&NamedBytes { path: "wide.png".into(), bytes: file }).unwrap();
        assert_eq!(found, read("p3.png").unwrap());
    }

    #[test]
    fn grey_and_alpha_are_read_as_documented() {
        let picture =
            |pixels: &[u8], color| decode_srgb_picture(&png(pixels, 1, 1, color)).unwrap();
        let grey = picture(&[9], ExtendedColorType::L8);
        assert_eq!((grey.rgb, grey.is_opaque), (vec![9; 3], true));
        assert!(!picture(&[9, 254], ExtendedColorType::La8).is_opaque);
        let clear = picture(&[1, 2, 3, 0], ExtendedColorType::Rgba8);
        assert_eq!((clear.rgb, clear.is_opaque), (vec![1, 2, 3], false));
        assert!(picture(&[1, 2, 3, 255], ExtendedColorType::Rgba8).is_opaque);
        let other = NamedBytes { path: "a.ppm".into(), bytes: b"P6 1 1 255 abc".to_vec() };
        let error = decode_srgb_picture(&other).unwrap_err().to_string();
        assert!(error.contains("give a PNG or JPEG picture"), "{error}");
    }

    #[test]
    fn codes_of_16_bits_are_rounded() {
        for code in 0..=u16::MAX {
            assert_eq!(f64::from(narrow(code)), (f64::from(code) / 257.0).round());
        }
    }
}
