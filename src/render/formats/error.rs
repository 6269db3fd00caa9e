//! Errors in the files of a photograph, panorama or mesh, and in its parameters.

use super::icc::ColorError;
use glasshouse_line::LineError;
use std::path::PathBuf;

/// An invalid file or parameter. The scene is quarantined with this text.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error("{} is empty; write or fetch it again", path.display())]
    Empty { path: PathBuf },
    /// A file with a format that is unknown, or not allowed for its role.
    #[error("{} is {found}; give {expected}", path.display())]
    Format { path: PathBuf, found: String, expected: &'static str },
    #[error("cannot read {} as {format}: {source}; write or fetch it again", path.display())]
    Unreadable {
        path: PathBuf,
        /// Format according to the magic bytes.
        format: &'static str,
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    #[error(
        "{} has {width}x{height} pixels; give an image with 1 to {max_side} per side and at most {max_pixels} in total",
        path.display(),
        max_side = super::limits::MAX_SIDE,
        max_pixels = super::limits::MAX_PIXELS
    )]
    Size { path: PathBuf, width: u64, height: u64 },
    /// A readable file with wrong channels, element type or array shape.
    #[error("{} holds {found}; give {expected}", path.display())]
    Layout { path: PathBuf, found: String, expected: &'static str },
    #[error(
        "mask {} has {width}x{height} pixels, but depth {} has {depth_width}x{depth_height}; give a mask of the depth's size, or none",
        path.display(),
        depth_path.display()
    )]
    MaskSize {
        path: PathBuf,
        width: usize,
        height: usize,
        depth_path: PathBuf,
        depth_width: usize,
        depth_height: usize,
    },
    /// A colour image whose codes have a meaning that cannot be converted.
    #[error("{} cannot be used: {source}", path.display())]
    Color { path: PathBuf, source: ColorError },
    /// A depth image, a mask or intrinsics that fit the stored rows of a turned colour image, not the upright image.
    #[error(
        "{} is stored with {}x{} pixels, and its EXIF orientation {exif_orientation} turns it to {}x{}; {what} has {}x{}, which fits only the stored rows: turn it upright, or set \"orientation\": \"stored\" beside \"color\"",
        path.display(), stored_px[0], stored_px[1], upright_px[0], upright_px[1], px[0], px[1]
    )]
    Turned {
        /// Path of the colour image.
        path: PathBuf,
        /// EXIF orientation of the colour image, 5 to 8.
        exif_orientation: u8,
        stored_px: [usize; 2],
        upright_px: [usize; 2],
        /// The other file, or the key of the intrinsics.
        what: String,
        /// Size that does not fit.
        px: [usize; 2],
    },
    /// A colour image with NaN, infinite or negative values after `transfer` and `exposure`.
    #[error(
        "{} has {count} pixels with NaN, infinite or negative radiance, the first at column {x}, row {y}; repair the file, or lower the exposure",
        path.display()
    )]
    Radiance {
        path: PathBuf,
        /// Number of pixels with at least one such channel.
        count: usize,
        x: usize,
        y: usize,
    },
    #[error(
        "{} has no valid pixel with a finite depth above 0; check depth_unit_m and the mask, or leave this photograph out",
        path.display()
    )]
    NoDepth { path: PathBuf },
    /// A depth image with depths that have no normal `f32` inverse.
    #[error(
        "{} has {count} pixels too near or too far to calculate with, the first with {z_m:e} m at column {x}, row {y}; check depth_unit_m, or mask them out",
        path.display()
    )]
    DepthRange {
        path: PathBuf,
        count: usize,
        /// Depth of the first such pixel in reading order (in a panorama, along the ray).
        z_m: f64,
        x: usize,
        y: usize,
    },
    /// An invalid vertex, triangle, face or element of a mesh.
    #[error("{}: {what} {problem}; {remedy}", path.display())]
    Element { path: PathBuf, what: String, problem: String, remedy: &'static str },
    #[error("{}: {source}: correct the manifest", path.display())]
    Parameter { path: PathBuf, source: LineError },
}
