//! Files of photographs in DIODE's layout: a PNG, a depth `.npy`, a mask `.npy`.

use super::listing::SamplePhotograph;
use super::render::{Rgbd, render};
use glasshouse_line::ExrPrecision;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use render::atomic_file::{self, WriteError};
use render::formats::encode_npy;
use std::path::{Path, PathBuf};

/// Reason why a procedural photograph cannot be encoded or written.
#[derive(Debug, thiserror::Error)]
pub enum SampleError {
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error("cannot encode {}: {source}; choose another size", path.display())]
    Code { path: PathBuf, source: image::ImageError },
}

/// The bytes of a photograph's three files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleFiles {
    /// Colour as sRGB in a PNG.
    pub color: Vec<u8>,
    /// Depth along the optical axis, m, as `.npy`.
    pub depth: Vec<u8>,
    /// Mask as `.npy`: 1 where the depth is valid, otherwise 0.
    pub mask: Vec<u8>,
}

/// Renders `photograph` and encodes its three files, without writing them.
pub fn encode(
    photograph: &SamplePhotograph,
    width: u32,
    height: u32,
) -> Result<SampleFiles, SampleError> {
    let rgbd = render(photograph, width, height);
    let color =
        png(&rgbd).map_err(|source| SampleError::Code { path: photograph.color_path(), source })?;
    let [w, h] = [rgbd.width as usize, rgbd.height as usize];
    let valid: Vec<f32> = rgbd.valid.iter().map(|&v| f32::from(u8::from(v))).collect();
    Ok(SampleFiles {
        color,
        depth: encode_npy(&[h, w, 1], &rgbd.depth_m, ExrPrecision::Float),
        mask: encode_npy(&[h, w], &valid, ExrPrecision::Float),
    })
}

/// Renders `photograph` and writes its three files under `root`, each atomically, the colour image last.
pub fn write(
    root: &Path,
    photograph: &SamplePhotograph,
    width: u32,
    height: u32,
) -> Result<(), SampleError> {
    let files = encode(photograph, width, height)?;
    let color_path = root.join(photograph.color_path());
    if let Some(folder) = color_path.parent() {
        atomic_file::create_dir(folder)?;
    }
    atomic_file::write_whole(&root.join(photograph.depth_path()), &files.depth)?;
    atomic_file::write_whole(&root.join(photograph.mask_path()), &files.mask)?;
    atomic_file::write_whole(&color_path, &files.color)?;
    Ok(())
}

fn png(rgbd: &Rgbd) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(&rgbd.rgb, rgbd.width, rgbd.height, ExtendedColorType::Rgb8)
        .map(|()| bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::listing;
    use std::fs;

    #[test]
    fn independent_readers_read_all_three_files() {
        let dir = tempfile::tempdir().unwrap();
        let photograph = &listing(2, 5)[1];
        write(dir.path(), photograph, 64, 48).unwrap();
        assert!(photograph.paths().iter().all(|path| dir.path().join(path).is_file()));
        let rgbd = render(photograph, 64, 48);

        let bytes = fs::read(dir.path().join(photograph.depth_path())).unwrap();
        assert_eq!(bytes.len(), 128 + 64 * 48 * 4);
        let depth = npyz::NpyFile::new(&bytes[..]).unwrap();
        assert_eq!(depth.shape(), [48, 64, 1]);
        assert_eq!(depth.into_vec::<f32>().unwrap(), rgbd.depth_m);

        let bytes = fs::read(dir.path().join(photograph.mask_path())).unwrap();
        let mask = npyz::NpyFile::new(&bytes[..]).unwrap();
        assert_eq!(mask.shape(), [48, 64]);
        let valid: Vec<bool> = mask.into_vec::<f32>().unwrap().iter().map(|&v| v == 1.0).collect();
        assert_eq!(valid, rgbd.valid);

        let color = image::open(dir.path().join(photograph.color_path())).unwrap();
        assert_eq!(color.into_rgb8().into_raw(), rgbd.rgb);
    }
}
