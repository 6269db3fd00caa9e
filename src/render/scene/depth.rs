//! Decodes depth images to metres, and converts distances along rays to distances along the optical axis.

use crate::formats::PictureSize;
use crate::formats::error::SceneError;
use crate::formats::files::{FileFormat, NamedBytes};
use crate::formats::npy::{Axes, NpyHead, NpyImage};
use crate::formats::npy_header::Element;
use crate::formats::raster::{self, Raster, Samples};
use crate::formats::{exr_raster, pfm, tiff_depth};
use glasshouse_line::{DepthKind, Intrinsics, Orientation};

const FORMATS: &str = "a .npy, .npz, grey PNG, grey PNM, PFM, TIFF or EXR depth image";
const NPY: &str = "(H,W), (H,W,1) or (1,H,W) of numbers";

/// A depth image with the holes of its file.
pub(super) struct Depth {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Size of the image in its file.
    pub(super) size: PictureSize,
    /// Depths row by row, in `f64` because the focus is calculated from them.
    pub(super) z_m: Vec<f64>,
}

/// Returns the file's format. Refuses JPEG and Radiance HDR, which alter depths.
fn format(file: &NamedBytes) -> Result<FileFormat, SceneError> {
    let refuse = |found: &str| Err(file.wrong_format(found.to_owned(), FORMATS));
    match file.format(FORMATS)? {
        FileFormat::Hdr => refuse("a Radiance HDR, which rounds depths"),
        FileFormat::Jpeg => refuse("JPEG, which alters depths"),
        format => Ok(format),
    }
}

fn check_layout(file: &NamedBytes, channels: usize, rescaled: bool) -> Result<(), SceneError> {
    if channels != 1 {
        let found = format!("{channels} channels");
        return Err(file.wrong_layout(found, "one grey channel of 8 or 16 bits"));
    }
    if rescaled {
        let found = "codes of a range other than 0..=255 or 0..=65535".to_owned();
        return Err(file.wrong_layout(found, "8- or 16-bit grey with the whole range"));
    }
    Ok(())
}

/// Reads the size from the header of a file of `length` bytes; `file` may hold only the beginning.
pub(super) fn size(file: &NamedBytes, length: u64) -> Result<PictureSize, SceneError> {
    let (size, channels, rescaled) = match format(file)? {
        FileFormat::Npy => {
            let head = NpyHead::parse(file, length, Axes::Single, NPY)?;
            check_element(file, head.element())?;
            return Ok(PictureSize::plain([head.width, head.height]));
        }
        FileFormat::Exr => return exr_raster::depth_size(file).map(PictureSize::plain),
        FileFormat::Tiff => return tiff_depth::size(file),
        FileFormat::Pfm => {
            let head = pfm::head(file, length)?;
            (PictureSize::plain([head.width, head.height]), head.channels, false)
        }
        format => {
            let head = raster::head(file, format)?;
            (head.size(), head.channels, head.rescaled)
        }
    };
    check_layout(file, channels, rescaled)?;
    Ok(size)
}

/// How the values of a depth file become depths.
#[derive(Clone, Copy)]
pub(super) struct DepthCodes {
    /// Metres per unit.
    pub(super) unit_m: f64,
    /// Value that means "no depth".
    pub(super) none_code: Option<f64>,
}

impl DepthCodes {
    /// Depths in metres, without a code for "no depth".
    pub(super) const PLAIN: Self = Self { unit_m: 1.0, none_code: None };

    /// Returns the depth of a value, m; NaN, which is a hole in every kind of depth, for the code of none.
    fn depth_m(self, value: f64) -> f64 {
        if self.none_code == Some(value) { f64::NAN } else { value * self.unit_m }
    }
}

/// Decodes a depth image.
pub(super) fn decode(
    file: &NamedBytes,
    orientation: Orientation,
    codes: DepthCodes,
) -> Result<Depth, SceneError> {
    let raster = match format(file)? {
        FileFormat::Npy => return decode_npy(file, codes),
        FileFormat::Exr => exr_raster::decode_depth(file)?,
        FileFormat::Tiff => tiff_depth::decode(file)?,
        FileFormat::Pfm => pfm::decode(file)?,
        format => raster::decode(file, format)?,
    };
    check_layout(file, raster.channels, raster.rescaled)?;
    let size = raster.size();
    let raster = raster.read_as(orientation);
    let Raster { width, height, .. } = raster;
    let z_m = match raster.samples {
        Samples::U8(values) => values.iter().map(|&v| codes.depth_m(v.into())).collect(),
        Samples::U16(values) => values.iter().map(|&v| codes.depth_m(v.into())).collect(),
        Samples::F32(values) => values.iter().map(|&v| codes.depth_m(v.into())).collect(),
    };
    Ok(Depth { width, height, size, z_m })
}

fn check_element(file: &NamedBytes, element: Element) -> Result<(), SceneError> {
    if element == Element::Bool {
        return Err(file.wrong_layout("booleans".to_owned(), NPY));
    }
    Ok(())
}

fn decode_npy(file: &NamedBytes, codes: DepthCodes) -> Result<Depth, SceneError> {
    let image = NpyImage::parse(file, Axes::Single, NPY)?;
    check_element(file, image.element)?;
    Ok(Depth {
        width: image.width,
        height: image.height,
        size: PictureSize::plain([image.width, image.height]),
        z_m: image.values(|value| codes.depth_m(value)),
    })
}

impl Depth {
    /// Converts distances along the rays to distances along the axis, if `kind` is [`DepthKind::Distance`].
    /// `intrinsics` are in pixels of this image.
    pub(super) fn project(&mut self, kind: DepthKind, intrinsics: &Intrinsics) {
        if kind != DepthKind::Distance {
            return;
        }
        for (row, depths_m) in self.z_m.chunks_exact_mut(self.width).enumerate() {
            for (column, depth_m) in depths_m.iter_mut().enumerate() {
                *depth_m /= secant(intrinsics, column, row);
            }
        }
    }
}

/// Returns the ratio of the distance along the ray of a pixel to the distance along the axis.
pub(super) fn secant(intrinsics: &Intrinsics, column: usize, row: usize) -> f64 {
    let x = (column as f64 + 0.5 - intrinsics.cx) / intrinsics.fx;
    let y = (row as f64 + 0.5 - intrinsics.cy) / intrinsics.fy;
    (1.0 + x * x + y * y).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::npy::tests::npy;
    use crate::formats::raster::tests::{jpeg, png};
    use image::ExtendedColorType as Png;

    fn decode(file: &NamedBytes, unit_m: f64) -> Result<Depth, SceneError> {
        let codes = DepthCodes { unit_m, none_code: None };
        super::decode(file, Orientation::Upright, codes)
    }

    #[test]
    fn png_values_are_only_multiplied_by_the_unit() {
        let codes = [0u16, 1500, 65535, 7];
        let depth = decode(&png(bytemuck::cast_slice(&codes), 2, 2, Png::L16), 0.001).unwrap();
        assert_eq!((depth.width, depth.height), (2, 2));
        assert_eq!(depth.z_m, [0.0, 1.5, 65.535, 0.007]);
        assert_eq!(decode(&png(&[3, 4], 1, 2, Png::L8), 0.5).unwrap().z_m, [1.5, 2.0]);
        let gray = |text: &[u8]| NamedBytes { path: "a.pgm".into(), bytes: text.to_vec() };
        let depth = decode(&gray(b"P5 2 1 65535 \x01\x02\x03\x04"), 1.0).unwrap();
        assert_eq!(depth.z_m, [258.0, 772.0]);
        let error = decode(&gray(b"P5 2 1 1000 \x01\x02\x03\x04"), 1.0).err().unwrap();
        assert!(error.to_string().contains("codes of a range"), "{error}");
    }

    #[test]
    fn the_code_of_none_is_a_hole() {
        let codes = DepthCodes { unit_m: 0.001, none_code: Some(65535.0) };
        let words = [1500u16, 65535, 65534];
        let wide = png(bytemuck::cast_slice(&words), 3, 1, Png::L16);
        let data: Vec<u8> = words.iter().flat_map(|v| f32::from(*v).to_le_bytes()).collect();
        for file in [wide, npy("<f4", false, "(1, 3)", &data)] {
            let z_m = super::decode(&file, Orientation::Upright, codes).unwrap().z_m;
            assert!(z_m[0] == 1.5 && z_m[1].is_nan() && z_m[2] == 65.534, "{z_m:?}");
        }
    }

    #[test]
    fn files_without_depth_are_refused() {
        let message = |file: &NamedBytes| decode(file, 1.0).err().unwrap().to_string();
        assert!(message(&png(&[1, 2, 3], 1, 1, Png::Rgb8)).contains("3 channels"));
        assert!(message(&jpeg(&[0; 192], 8, 8)).contains("JPEG"));
        assert!(message(&npy("|b1", false, "(1, 1)", &[1])).contains("booleans"));
    }

    #[test]
    fn distances_along_rays_become_z() {
        let data: Vec<u8> = [5.0f64; 4].iter().flat_map(|value| value.to_le_bytes()).collect();
        let mut depth = decode(&npy("<f8", false, "(1, 4)", &data), 1.0).unwrap();
        let intrinsics = Intrinsics { fx: 1.5, fy: 0.25, cx: 1.5, cy: 0.5, size: None };
        depth.project(DepthKind::Z, &intrinsics);
        assert_eq!(depth.z_m, [5.0; 4]);
        depth.project(DepthKind::Distance, &intrinsics);
        // Column 1 is on the axis; column 3 has x = 4/3, a 3-4-5 triangle.
        assert_eq!(depth.z_m[1], 5.0);
        assert!((depth.z_m[3] - 3.0).abs() < 1e-15);
        assert_eq!(depth.z_m[0], depth.z_m[2]);
    }
}
