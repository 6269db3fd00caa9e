//! Photographs in the layout of PLACES365: JPEGs by category, and maps of relative inverse depth, like those that depth
//! networks estimate.
//!
//! ```text
//! DIR/data_256/LETTER/CATEGORY[/KIND]/00000001.jpg
//! DIR/depth/LETTER/CATEGORY[/KIND]/00000001.png       16-bit grey, the nearest pixel 65535, the farthest 0
//! ```

use super::camera::places_intrinsics;
use super::diode::SampleError;
use super::listing::{self, Place, SamplePhotograph};
use super::render::{Rgbd, render_through};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use render::atomic_file;
use std::path::{Path, PathBuf};

/// Folder of the photographs below the set's root.
pub const PLACES_COLOR: &str = "data_256";
/// Folder of the depth maps below the set's root.
pub const PLACES_DEPTH: &str = "depth";

/// Quality of JPEG files, 1 to 100.
const JPEG_QUALITY: u8 = 92;

/// A photograph of a procedural set in the layout of PLACES365.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlacesPhotograph {
    /// The photograph in DIODE's numbering.
    pub photograph: SamplePhotograph,
    /// Category as in the official list, such as `bedroom` or `library/indoor`.
    pub category: String,
    /// Number in the category, from 1.
    pub number: u32,
}

impl PlacesPhotograph {
    /// Returns the path of the colour image, relative to the folder [`PLACES_COLOR`].
    pub fn color_path(&self) -> PathBuf {
        self.path("jpg")
    }

    /// Returns the path of the depth map, relative to the folder [`PLACES_DEPTH`].
    pub fn depth_path(&self) -> PathBuf {
        self.path("png")
    }

    /// Returns the paths of both files, relative to the set's root.
    pub fn paths(&self) -> [PathBuf; 2] {
        [
            Path::new(PLACES_DEPTH).join(self.depth_path()),
            Path::new(PLACES_COLOR).join(self.color_path()),
        ]
    }

    fn path(&self, ending: &str) -> PathBuf {
        let (category, number) = (&self.category, self.number);
        let letter = category.get(..1).unwrap_or_default();
        PathBuf::from(format!("{letter}/{category}/{number:08}.{ending}"))
    }
}

/// Returns the photographs of [`listing::listing`], with rooms assigned to the `indoors` categories in turn, and
/// outdoor places to the `outdoors` categories.
///
/// Categories are names of the official list. Panics if a photograph's kind of place has no category.
pub fn places_listing(
    count: usize,
    seed: u64,
    indoors: &[&str],
    outdoors: &[&str],
) -> Vec<PlacesPhotograph> {
    let mut passed = [0, 0];
    let place_of = |photograph: SamplePhotograph| {
        let (categories, passed) = match photograph.place {
            Place::Indoors => (indoors, &mut passed[0]),
            Place::Outdoor => (outdoors, &mut passed[1]),
        };
        let at = *passed;
        *passed += 1;
        PlacesPhotograph {
            photograph,
            category: categories[at % categories.len()].to_owned(),
            number: (at / categories.len()) as u32 + 1,
        }
    };
    listing::listing(count, seed).into_iter().map(place_of).collect()
}

/// Renders `photograph` and writes its two files under `root`, each atomically.
pub fn write_places(
    root: &Path,
    photograph: &PlacesPhotograph,
    width: u32,
    height: u32,
) -> Result<(), SampleError> {
    let intrinsics = places_intrinsics(width, height);
    let rgbd = render_through(&photograph.photograph, &intrinsics, width, height);
    let color_path = root.join(PLACES_COLOR).join(photograph.color_path());
    let depth_path = root.join(PLACES_DEPTH).join(photograph.depth_path());
    let code = |path: &Path, coded: Result<Vec<u8>, image::ImageError>| {
        coded.map_err(|source| SampleError::Code { path: path.to_owned(), source })
    };
    let files = [
        (&depth_path, code(&depth_path, png(&rgbd))?),
        (&color_path, code(&color_path, jpeg(&rgbd))?),
    ];
    for (path, bytes) in files {
        if let Some(folder) = path.parent() {
            atomic_file::create_dir(folder)?;
        }
        atomic_file::write_whole(path, &bytes)?;
    }
    Ok(())
}

fn jpeg(rgbd: &Rgbd) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
        .write_image(&rgbd.rgb, rgbd.width, rgbd.height, ExtendedColorType::Rgb8)
        .map(|()| bytes)
}

/// Maps the picture's range of inverse depth to 0..=65535. Scale and shift are lost, as in the estimates of networks.
fn relative_inverse(inverse_depth_per_m: &[f32]) -> Vec<u16> {
    let least = inverse_depth_per_m.iter().copied().fold(f32::MAX, f32::min);
    let most = inverse_depth_per_m.iter().copied().fold(0.0, f32::max);
    let scale = if most > least { 65535.0 / (most - least) } else { 0.0 };
    let code = |&inverse: &f32| ((inverse - least) * scale + 0.5) as u16;
    inverse_depth_per_m.iter().map(code).collect()
}

fn png(rgbd: &Rgbd) -> Result<Vec<u8>, image::ImageError> {
    let codes = relative_inverse(&rgbd.inverse_depth_per_m);
    let (codes, mut bytes) = (bytemuck::cast_slice(&codes), Vec::new());
    PngEncoder::new(&mut bytes)
        .write_image(codes, rgbd.width, rgbd.height, ExtendedColorType::L16)
        .map(|()| bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_depth_fills_sixteen_bits_unless_it_is_flat() {
        assert_eq!(relative_inverse(&[0.25; 3]), [0; 3]);
        assert_eq!(relative_inverse(&[0.0, 0.5, 1.0]), [0, 32768, 65535]);
    }
}
