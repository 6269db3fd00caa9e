//! Decodes masks, which mark the measured pixels of depth images.

use crate::formats::PictureSize;
use crate::formats::error::SceneError;
use crate::formats::files::{FileFormat, NamedBytes};
use crate::formats::npy::{Axes, NpyHead, NpyImage};
use crate::formats::raster::{self, Samples};
use glasshouse_line::Orientation;

const FORMATS: &str = "a .npy, .npz, PNG or PNM mask";
const NPY: &str = "(H,W), (H,W,1) or (1,H,W) of numbers or booleans";

/// Validity of each pixel.
#[derive(Debug)]
pub(super) struct Mask {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Size of the image in its file.
    pub(super) size: PictureSize,
    /// True for valid pixels, row by row.
    pub(super) valid: Vec<bool>,
}

/// Returns the file's format. Refuses JPEG, EXR, PFM and Radiance HDR.
fn format(file: &NamedBytes) -> Result<FileFormat, SceneError> {
    match file.format(FORMATS)? {
        format @ (FileFormat::Jpeg | FileFormat::Exr | FileFormat::Pfm | FileFormat::Hdr) => {
            Err(file.wrong_format(format.name().to_owned(), FORMATS))
        }
        format => Ok(format),
    }
}

/// Reads the size from the header of a file of `length` bytes; `file` may hold only the beginning.
pub(super) fn size(file: &NamedBytes, length: u64) -> Result<PictureSize, SceneError> {
    let format = format(file)?;
    if format == FileFormat::Npy {
        let head = NpyHead::parse(file, length, Axes::Single, NPY)?;
        return Ok(PictureSize::plain([head.width, head.height]));
    }
    Ok(raster::head(file, format)?.size())
}

/// Decodes a mask. Valid pixels have a value other than 0 and NaN (`.npy`), or a colour channel above 0 (PNG, PNM).
/// Ignores alpha.
pub(super) fn decode(file: &NamedBytes, orientation: Orientation) -> Result<Mask, SceneError> {
    let raster = match format(file)? {
        FileFormat::Npy => {
            let image = NpyImage::parse(file, Axes::Single, NPY)?;
            let (width, height) = (image.width, image.height);
            let size = PictureSize::plain([width, height]);
            return Ok(Mask { width, height, size, valid: image.nonzero() });
        }
        format => raster::decode(file, format)?,
    };
    let size = raster.size();
    let raster = raster.read_as(orientation);
    // 1 and 2 channels are grey, 3 and 4 are RGB.
    let color_channels = if raster.channels < 3 { 1 } else { 3 };
    let valid = match &raster.samples {
        Samples::U8(codes) => any_above_0(codes, raster.channels, color_channels),
        Samples::U16(codes) => any_above_0(codes, raster.channels, color_channels),
        Samples::F32(_) => unreachable!("PNG and PNM hold integers"),
    };
    Ok(Mask { width: raster.width, height: raster.height, size, valid })
}

fn any_above_0<T: Copy + Default + PartialEq>(
    codes: &[T],
    channels: usize,
    color_channels: usize,
) -> Vec<bool> {
    codes
        .chunks_exact(channels)
        .map(|pixel| pixel[..color_channels].iter().any(|&code| code != T::default()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::npy::tests::npy;
    use crate::formats::raster::tests::{jpeg, png};
    use image::ExtendedColorType as Png;

    fn decode(file: &NamedBytes) -> Result<Mask, SceneError> {
        super::decode(file, Orientation::Upright)
    }

    fn valid(file: &NamedBytes) -> Vec<bool> {
        decode(file).unwrap().valid
    }

    #[test]
    fn npy_of_any_type_is_a_mask() {
        assert_eq!(valid(&npy("|b1", false, "(1, 3)", &[0, 1, 1])), [false, true, true]);
        let floats: Vec<u8> =
            [0.0f32, -0.0, f32::NAN, -1.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        assert_eq!(valid(&npy("<f4", false, "(4, 1, 1)", &floats)), [false, false, false, true]);
        let wide: Vec<u8> = [0u64, 1 << 63].iter().flat_map(|value| value.to_be_bytes()).collect();
        assert_eq!(valid(&npy(">u8", false, "(1, 2)", &wide)), [false, true]);
    }

    #[test]
    fn png_ignores_alpha() {
        assert_eq!(valid(&png(&[0, 1], 2, 1, Png::L8)), [false, true]);
        assert_eq!(valid(&png(&[0, 255, 1, 0], 2, 1, Png::La8)), [false, true]);
        assert_eq!(valid(&png(&[0, 0, 0, 9, 0, 0, 1, 0], 2, 1, Png::Rgba8)), [false, true]);
        let error = decode(&jpeg(&[0; 192], 8, 8)).unwrap_err().to_string();
        assert!(error.contains("is JPEG; give a .npy, .npz, PNG or PNM mask"), "{error}");
    }
}
