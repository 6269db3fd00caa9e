//! Decodes colour images to linear Rec.709 radiance, before any interpolation.

use super::{highlights, transfer};
use crate::formats::PictureSize;
use crate::formats::color_space::ColorSpace;
use crate::formats::error::SceneError;
use crate::formats::files::{FileFormat, NamedBytes};
use crate::formats::npy::{Axes, NpyHead, NpyImage};
use crate::formats::npy_header::Element;
use crate::formats::raster::{self, Raster, Samples};
use crate::formats::{exr_raster, pfm};
use glasshouse_line::{Highlights, Orientation, Transfer};
use std::path::Path;
use std::rc::Rc;

pub(super) const FORMATS: &str =
    "a PNG, JPEG, PNM, EXR, Radiance HDR, PFM, .npy or .npz colour image";
const NPY: &str = "(H,W), (H,W,1), (H,W,3) or (H,W,4) of u1, u2, f2, f4 or f8";

pub(super) struct Color {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Red, green, blue, 0.
    pub(super) radiance: Vec<[f32; 4]>,
    pub(super) max_radiance: f32,
}

/// Decodes a colour image in any of its formats.
///
/// Applies the EXIF orientation, if `orientation` does not exclude it. Grey becomes three equal channels; alpha is ignored, not multiplied in. Integers (except in EXR) are divided by the
/// maximum of their type, and floats are read in single precision; `transfer` applies to both. `scale` multiplies red,
/// green and blue of the result.
pub(super) fn decode(
    file: &NamedBytes,
    orientation: Orientation,
    transfer: Transfer,
    scale: [f64; 3],
) -> Result<Color, SceneError> {
    radiance(&file.path, &decode_samples(file, orientation)?, transfer, scale)
}

/// Decodes the samples of a colour image: the first half of [`decode`], for several exposures of the same image.
pub(super) fn decode_samples(
    file: &NamedBytes,
    orientation: Orientation,
) -> Result<Raster, SceneError> {
    let raster = match file.format(FORMATS)? {
        FileFormat::Exr => exr_raster::decode_color(file)?,
        FileFormat::Npy => decode_npy(file)?,
        FileFormat::Pfm => pfm::decode(file)?,
        format => raster::decode(file, format)?,
    };
    Ok(raster.read_as(orientation))
}

/// Decodes a colour image like [`decode`], upright, with its straight alpha, row by row; `None` without alpha. An error if an
/// alpha is not 0 to 1.
pub(super) fn decode_with_alpha(
    file: &NamedBytes,
    transfer: Transfer,
    scale: [f64; 3],
) -> Result<(Color, Option<Vec<f32>>), SceneError> {
    with_alpha(&file.path, &decode_straight(file)?, transfer, scale)
}

/// Decodes the samples of a picture with straight alpha: the first half of [`decode_with_alpha`].
pub(super) fn decode_straight(file: &NamedBytes) -> Result<Raster, SceneError> {
    let raster = match straight_format(file)? {
        FileFormat::Npy => decode_npy(file)?,
        FileFormat::Pfm => pfm::decode(file)?,
        format => raster::decode(file, format)?,
    };
    Ok(raster.read_as(Orientation::Upright))
}

/// Converts decoded samples to radiance and alpha. `path` is for errors.
pub(super) fn with_alpha(
    path: &Path,
    raster: &Raster,
    transfer: Transfer,
    scale: [f64; 3],
) -> Result<(Color, Option<Vec<f32>>), SceneError> {
    let of = raster.channels;
    let alpha = of.is_multiple_of(2).then(|| -> Vec<f32> {
        match &raster.samples {
            Samples::U8(v) => v.chunks_exact(of).map(|p| f32::from(p[of - 1]) / 255.0).collect(),
            Samples::U16(v) => v.chunks_exact(of).map(|p| f32::from(p[of - 1]) / 65535.0).collect(),
            Samples::F32(v) => v.chunks_exact(of).map(|p| p[of - 1]).collect(),
        }
    });
    let color = radiance(path, raster, transfer, scale)?;
    let is_bad = |alpha: &f32| !(0.0..=1.0).contains(alpha);
    match alpha.iter().flatten().position(is_bad) {
        None => Ok((color, alpha)),
        Some(at) => {
            let (x, y) = (at % color.width, at / color.width);
            let value = alpha.map_or(0.0, |alpha| alpha[at]);
            Err(SceneError::Layout {
                path: path.to_owned(),
                found: format!("an alpha of {value} at ({x} px, {y} px)"),
                expected: "an alpha of 0 to 1",
            })
        }
    }
}

/// Returns the format of a picture with straight alpha; an error for EXR.
pub(super) fn straight_format(file: &NamedBytes) -> Result<FileFormat, SceneError> {
    const FORMATS: &str = "a PNG, JPEG, PNM, Radiance HDR, PFM or .npy picture with straight alpha";
    match file.format(FORMATS)? {
        FileFormat::Exr => {
            let found = "an EXR picture, in which alpha multiplies the colours".to_owned();
            Err(file.wrong_format(found, FORMATS))
        }
        format => Ok(format),
    }
}

/// Converts a decoded image to linear Rec.709 radiance; see [`decode`].
fn radiance(
    path: &Path,
    raster: &Raster,
    transfer: Transfer,
    scale: [f64; 3],
) -> Result<Color, SceneError> {
    let unusable = |source| SceneError::Color { path: path.to_owned(), source };
    let &Raster { width, height, channels, .. } = raster;
    let space = raster.color.as_ref().map_err(|source| unusable(source.clone()))?;
    if let Samples::F32(values) = &raster.samples {
        transfer::check_range(transfer, values).map_err(|found| SceneError::Layout {
            path: path.to_owned(),
            found,
            expected: "colours of 0 to 1 (divide by 255 or 65535), or \"transfer\": \"linear\" if they are linear light",
        })?;
    }
    let radiance = match (&raster.samples, space) {
        (Samples::U8(codes), Some(space)) => {
            converted(codes, channels, space, transfer, scale, 255)
        }
        (Samples::U16(codes), Some(space)) => {
            converted(codes, channels, space, transfer, scale, 65535)
        }
        (Samples::U8(codes), None) => {
            let tables = each(scale, |factor| transfer::table_8(transfer, factor));
            pixels(codes, channels, |code, c| tables[c][code as usize])
        }
        (Samples::U16(codes), None) => {
            let tables = each(scale, |factor| transfer::table_16(transfer, factor));
            pixels(codes, channels, |code, c| tables[c][code as usize])
        }
        (Samples::F32(values), _) => pixels(values, channels, |value, c| {
            (transfer::to_linear(transfer, value as f64) * scale[c]) as f32
        }),
    };
    let max_radiance = max_of_radiance(path, &radiance, width)?;
    Ok(Color { width, height, radiance, max_radiance })
}

/// Converts decoded samples to radiance, and expands clipped highlights by `curve` before `scale`. `path` is for errors.
pub(super) fn expanded(
    path: &Path,
    raster: &Raster,
    transfer: Transfer,
    curve: Option<Highlights>,
    scale: [f64; 3],
) -> Result<Color, SceneError> {
    let Some(curve) = curve else {
        return radiance(path, raster, transfer, scale);
    };
    let mut color = radiance(path, raster, transfer, [1.0; 3])?;
    highlights::expand(&mut color.radiance, curve, scale);
    color.max_radiance = max_of_radiance(path, &color.radiance, color.width)?;
    Ok(color)
}

/// Reads the size from the header of a file of `length` bytes; `file` may hold only the beginning.
pub(super) fn size(file: &NamedBytes, length: u64) -> Result<PictureSize, SceneError> {
    match file.format(FORMATS)? {
        FileFormat::Exr => exr_raster::color_size(file).map(PictureSize::plain),
        FileFormat::Npy => {
            let head = NpyHead::parse(file, length, Axes::Color, NPY)?;
            match head.element() {
                Element::U8 | Element::U16 | Element::F16 | Element::F32 | Element::F64 => {
                    Ok(PictureSize::plain([head.width, head.height]))
                }
                other => Err(wrong_element(file, other)),
            }
        }
        FileFormat::Pfm => {
            let head = pfm::head(file, length)?;
            Ok(PictureSize::plain([head.width, head.height]))
        }
        format => {
            let head = raster::head(file, format)?;
            let size = head.size();
            head.color
                .map(|_| size)
                .map_err(|source| SceneError::Color { path: file.path.clone(), source })
        }
    }
}

fn wrong_element(file: &NamedBytes, element: Element) -> SceneError {
    file.wrong_layout(format!("elements of type {}", element.code()), NPY)
}

fn decode_npy(file: &NamedBytes) -> Result<Raster, SceneError> {
    let image = NpyImage::parse(file, Axes::Color, NPY)?;
    let samples = match image.element {
        Element::U8 => Samples::U8(image.bytes()),
        Element::U16 => Samples::U16(image.words()),
        Element::F16 | Element::F32 | Element::F64 => {
            Samples::F32(image.values(|value| value as f32))
        }
        other => return Err(wrong_element(file, other)),
    };
    Ok(Raster::plain(image.width, image.height, image.channels, samples))
}

/// Makes a table for each channel. Channels with the scale of red share its table.
fn each(scale: [f64; 3], table: impl Fn(f64) -> Vec<f32>) -> [Rc<Vec<f32>>; 3] {
    let red = Rc::new(table(scale[0]));
    let other = |factor: f64| {
        if factor.to_bits() == scale[0].to_bits() {
            Rc::clone(&red)
        } else {
            Rc::new(table(factor))
        }
    };
    let (green, blue) = (other(scale[1]), other(scale[2]));
    [red, green, blue]
}

/// Converts codes of another colour space than sRGB to linear Rec.709, times `scale`. The transfer function `linear`
/// replaces the curves of the space.
fn converted<T: Copy + Into<usize>>(
    codes: &[T],
    channels: usize,
    space: &ColorSpace,
    transfer: Transfer,
    scale: [f64; 3],
    max: u16,
) -> Vec<[f32; 4]> {
    let tables = match transfer {
        Transfer::Srgb => space.tables(max),
        Transfer::Linear => {
            let line = || (0..=max).map(|code| f64::from(code) / f64::from(max)).collect();
            [line(), line(), line()]
        }
    };
    let color = |r: T, g: T, b: T| {
        let [r, g, b] = [r, g, b].map(Into::into);
        let rgb = space.rec709([tables[0][r], tables[1][g], tables[2][b]]);
        [rgb[0] * scale[0], rgb[1] * scale[1], rgb[2] * scale[2], 0.0].map(|v| v as f32)
    };
    match channels {
        1 | 2 => codes.chunks_exact(channels).map(|p| color(p[0], p[0], p[0])).collect(),
        _ => codes.chunks_exact(channels).map(|p| color(p[0], p[1], p[2])).collect(),
    }
}

/// Converts samples to pixels with `linear(sample, channel)`.
fn pixels<T: Copy>(
    samples: &[T],
    channels: usize,
    linear: impl Fn(T, usize) -> f32,
) -> Vec<[f32; 4]> {
    let rgb = |r, g, b| [linear(r, 0), linear(g, 1), linear(b, 2), 0.0];
    let grey = |value: T| rgb(value, value, value);
    match channels {
        1 => samples.iter().map(|&value| grey(value)).collect(),
        2 => samples.as_chunks().0.iter().map(|&[value, _]| grey(value)).collect(),
        3 => samples.as_chunks().0.iter().map(|&[r, g, b]| rgb(r, g, b)).collect(),
        _ => samples.as_chunks().0.iter().map(|&[r, g, b, _]| rgb(r, g, b)).collect(),
    }
}

/// Returns the largest radiance of any channel; an error if a value is NaN, infinite or negative.
fn max_of_radiance(path: &Path, radiance: &[[f32; 4]], width: usize) -> Result<f32, SceneError> {
    let mut max = [0.0f32; 4];
    let mut all_good = true;
    for pixel in radiance {
        for channel in 0..4 {
            // The comparison is false for NaN, too.
            all_good &= pixel[channel] >= 0.0;
            max[channel] =
                if pixel[channel] > max[channel] { pixel[channel] } else { max[channel] };
        }
    }
    let max = max.into_iter().fold(0.0, f32::max);
    if all_good && max < f32::INFINITY {
        return Ok(max);
    }
    let is_bad = |pixel: &[f32; 4]| pixel.iter().any(|value| !(0.0..f32::INFINITY).contains(value));
    let first = radiance.iter().position(is_bad).expect("the loop above found one");
    Err(SceneError::Radiance {
        path: path.to_owned(),
        count: radiance.iter().filter(|pixel| is_bad(pixel)).count(),
        x: first % width,
        y: first / width,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::npy::tests::npy;
    use crate::formats::raster::tests::{jpeg, png};
    use glasshouse_line::Orientation::Upright;
    use image::ExtendedColorType as Png;
    use std::path::PathBuf;

    fn linear(file: &NamedBytes) -> Vec<[f32; 4]> {
        decode(file, Upright, Transfer::Linear, [1.0; 3]).unwrap().radiance
    }

    #[test]
    fn png_of_every_kind_is_decoded() {
        let one = |pixels: &[u8], color| linear(&png(pixels, 1, 1, color))[0];
        let wide = |codes: &[u16], color| linear(&png(bytemuck::cast_slice(codes), 1, 1, color))[0];
        assert_eq!(one(&[51], Png::L8), [0.2, 0.2, 0.2, 0.0]);
        assert_eq!(one(&[51, 7], Png::La8), [0.2, 0.2, 0.2, 0.0]);
        assert_eq!(one(&[0, 51, 255], Png::Rgb8), [0.0, 0.2, 1.0, 0.0]);
        assert_eq!(one(&[0, 51, 255, 0], Png::Rgba8), [0.0, 0.2, 1.0, 0.0]);
        assert_eq!(wide(&[13107], Png::L16), [0.2, 0.2, 0.2, 0.0]);
        assert_eq!(wide(&[13107, 9], Png::La16), [0.2, 0.2, 0.2, 0.0]);
        assert_eq!(wide(&[0, 13107, 65535], Png::Rgb16), [0.0, 0.2, 1.0, 0.0]);
        assert_eq!(wide(&[0, 13107, 65535, 1], Png::Rgba16), [0.0, 0.2, 1.0, 0.0]);
    }

    #[test]
    fn srgb_comes_before_exposure() {
        let file = png(&[188, 188, 255], 1, 1, Png::Rgb8);
        let color = decode(&file, Upright, Transfer::Srgb, [2.0; 3]).unwrap();
        let [r, g, b, zero] = color.radiance[0];
        assert!((r - 1.005773).abs() < 1e-6 && r == g);
        assert_eq!((b, zero, color.max_radiance), (2.0, 0.0, 2.0));
        // The transfer function also applies to a .npy file of floats.
        let file = npy("<f8", false, "(1, 1)", &(188.0f64 / 255.0).to_le_bytes());
        let value = decode(&file, Upright, Transfer::Srgb, [2.0; 3]).unwrap().radiance[0][0];
        assert!((value - r).abs() < 1e-6);
    }

    #[test]
    fn jpeg_and_pnm_are_decoded() {
        for pixel in linear(&jpeg(&[51; 16 * 8 * 3], 16, 8)) {
            assert!((pixel[0] - 0.2).abs() < 0.01 && pixel[3] == 0.0);
        }
        let pnm = |bytes: &[u8]| NamedBytes { path: PathBuf::from("a.ppm"), bytes: bytes.to_vec() };
        assert_eq!(linear(&pnm(b"P6 1 1 255 \x00\x33\xff")), [[0.0, 0.2, 1.0, 0.0]]);
        assert_eq!(linear(&pnm(b"P5\n# x\n1 1\n65535\n\x33\x33"))[0][0], 0.2);
        assert_eq!(linear(&pnm(b"P1 2 1 1 0")), [[0.0; 4], [1.0, 1.0, 1.0, 0.0]]);
        // Codes with a maximum other than that of the type are scaled, too, to the nearest code.
        assert_eq!(linear(&pnm(b"P5 1 1 100 \x14"))[0][0], 0.2);
    }

    #[test]
    fn npy_of_every_kind_is_decoded() {
        assert_eq!(linear(&npy("|u1", false, "(1, 1, 3)", &[0, 51, 255])), [[0.0, 0.2, 1.0, 0.0]]);
        assert_eq!(linear(&npy(">u2", false, "(1, 1, 1)", &[0x33, 0x33]))[0][1], 0.2);
        let floats: Vec<u8> =
            [0.5f32, 2.0, 0.0, 9.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(linear(&npy("<f4", false, "(1, 1, 4)", &floats)), [[0.5, 2.0, 0.0, 0.0]]);
        let refused = npy("<i4", false, "(1, 1)", &[0; 4]);
        assert!(decode(&refused, Upright, Transfer::Linear, [1.0; 3]).is_err());
    }

    #[test]
    fn floats_of_0_to_255_are_no_colours_of_srgb() {
        let data: Vec<u8> = [0.0f32, 128.0, 255.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        for file in [
            npy("<f4", false, "(1, 1, 3)", &data),
            NamedBytes { path: "a.npy".into(), bytes: [&b"PF 1 1 -1\n"[..], &data].concat() },
        ] {
            let error = color_error(&file);
            assert!(error.contains("a.npy holds floats of up to 255"), "{error}");
            assert!(error.contains("divide by 255") && error.contains("linear"), "{error}");
            assert_eq!(linear(&file)[0][2], 255.0);
        }
    }

    #[test]
    fn bad_radiance_is_counted_and_located() {
        let values = [1.0f32, f32::NAN, 0.0, -1.0, f32::INFINITY, 1.0];
        let data: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        for transfer in [Transfer::Linear, Transfer::Srgb] {
            match decode(&npy("<f4", false, "(2, 3)", &data), Upright, transfer, [1.0; 3])
                .err()
                .unwrap()
            {
                SceneError::Radiance { count, x, y, .. } => assert_eq!((count, x, y), (3, 1, 0)),
                other => panic!("{other}"),
            }
        }
        let dark = png(&[0, 255], 2, 1, Png::L8);
        match decode(&dark, Upright, Transfer::Linear, [1e39; 3]).err().unwrap() {
            SceneError::Radiance { count, x, y, .. } => assert_eq!((count, x, y), (1, 1, 0)),
            other => panic!("{other}"),
        }
    }

    #[test]
    fn highlights_change_no_bit_if_missing_or_below_their_start() {
        let codes: Vec<u8> = (0..=255).collect();
        let image = png(&codes, 16, 16, Png::L8);
        let plain = decode(&image, Upright, Transfer::Srgb, [0.7; 3]).unwrap();
        let samples = decode_samples(&image, Upright).unwrap();
        let expand =
            |curve, scale| expanded(&image.path, &samples, Transfer::Srgb, curve, scale).unwrap();
        let off = expand(None, [0.7; 3]);
        let bits = |color: &Color| {
            let values = color.radiance.iter().flatten();
            values.map(|value| value.to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(bits(&off), bits(&plain));
        let curve = Highlights { above: 0.9, to: 8.0 };
        let on = expand(Some(curve), [0.5; 3]);
        assert_eq!(on.max_radiance, 4.0);
        assert_eq!(on.radiance[255], [4.0, 4.0, 4.0, 0.0]);
        // Code 243 is 0.896, 244 is 0.905.
        let half = decode(&image, Upright, Transfer::Srgb, [0.5; 3]).unwrap();
        for code in 0..255 {
            let (on, off) = (on.radiance[code][0], half.radiance[code][0]);
            assert!(if code < 244 { on == off } else { on > off }, "{code}");
        }
    }

    #[test]
    fn radiance_hdr_and_float_maps_are_linear() {
        let file = |bytes: &[u8]| NamedBytes { path: "a".into(), bytes: bytes.to_vec() };
        // Ward's RGBE (Graphics Gems II): mantissa / 256 * 2^(exponent - 128).
        let rgbe = file(
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 1\n\x80\x40\x20\x81\x10\x20\x30\x80",
        );
        let color = decode(&rgbe, Upright, Transfer::Linear, [2.0; 3]).unwrap();
        assert_eq!((color.width, color.height), (1, 2));
        assert_eq!(color.radiance, [[2.0, 1.0, 0.5, 0.0], [0.125, 0.25, 0.375, 0.0]]);
        let map =
            file(&[&b"PF\n1 1\n-1\n"[..], bytemuck::cast_slice(&[1.5f32, 0.25, 40.0])].concat());
        let color = decode(&map, Upright, Transfer::Linear, [1.0; 3]).unwrap();
        assert_eq!(color.radiance, [[1.5, 0.25, 40.0, 0.0]]);
        assert_eq!(color.max_radiance, 40.0);
    }

    /// A picture in another colour space has the radiance of its sRGB twin by LittleCMS, within one 8-bit step. Its
    /// light multiplies the converted values, and `linear` replaces the curve, but not the primaries.
    #[test]
    fn colour_spaces_are_converted_to_rec709() {
        let folder =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/formats/icc");
        let file = |name: &str| NamedBytes {
            path: name.into(),
            bytes: std::fs::read(folder.join(name)).unwrap(),
        };
        let encoder = glasshouse_line::color::SrgbEncoder::new();
        for name in ["p3", "adobe", "grey-table", "grey-lab", "chunk-cicp", "chunk-video"] {
            let scale = [0.5, 2.0, 1.0];
            let (tagged, twin) = (file(&format!("{name}.png")), file(&format!("{name}.srgb.png")));
            let found = decode(&tagged, Upright, Transfer::Srgb, scale).unwrap();
            let expected = decode(&twin, Upright, Transfer::Srgb, scale).unwrap();
            for (a, b) in found.radiance.iter().zip(&expected.radiance) {
                for c in 0..3 {
                    let [a, b] = [a[c], b[c]].map(|v| encoder.encode(v / scale[c] as f32));
                    assert!(a.abs_diff(b) <= 1, "{name} {a} {b}");
                }
                assert_eq!(a[3], 0.0);
            }
        }
        // In `linear`, the codes of Display P3 are linear; white stays white.
        let found = linear(&file("p3.png"));
        let [r, g, b, _] = found[512 - 8 * 8 + 7];
        assert!(r == 1.0 && g == 0.0, "{r} {g} {b}");
        let error = color_error(&file("refused-table.png"));
        assert!(error.contains("refused-table.png cannot be used: its ICC profile"), "{error}");
        // The header suffices to refuse it.
        let refused = file("refused-table.png");
        assert!(size(&refused, refused.bytes.len() as u64).is_err());
    }

    fn color_error(file: &NamedBytes) -> String {
        decode(file, Upright, Transfer::Srgb, [1.0; 3]).err().unwrap().to_string()
    }
}
