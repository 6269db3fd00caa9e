//! Pictures for the network, and their copies beside the depth maps.

use super::error::EstimateError;
use image::RgbImage;
use render::color::SrgbEncoder;
use render::formats::NamedBytes;
use render::line::Transfer;
use render::scene::decode_linear_image;
use std::path::Path;

/// Reads a picture as upright sRGB codes. Linear light is coded and clipped. An error is a text for the user.
pub(super) fn read_rgb(path: &Path, transfer: Transfer) -> Result<RgbImage, String> {
    if transfer == Transfer::Srgb {
        return compose::read_picture(path).map_err(|e| e.to_string());
    }
    let bytes = render::input_file::read(path).map_err(|e| e.to_string())?;
    let file = NamedBytes { path: path.to_owned(), bytes };
    let (width, height, pixels) = decode_linear_image(&file).map_err(|e| e.to_string())?;
    let encoder = SrgbEncoder::new();
    let codes = pixels.as_flattened().iter().map(|value| encoder.encode(*value)).collect();
    RgbImage::from_raw(width as u32, height as u32, codes)
        .ok_or_else(|| "its size is too large".to_owned())
}

/// Makes `to` the same file as `from`, or a copy where the file system has no links. Keeps a file that exists.
pub(super) fn link(from: &Path, to: &Path) -> Result<(), EstimateError> {
    if to.exists() || std::fs::hard_link(from, to).is_ok() {
        return Ok(());
    }
    let failed = |source| EstimateError::Link { from: from.to_owned(), to: to.to_owned(), source };
    let bytes = render::input_file::read(from).map_err(failed)?;
    Ok(render::atomic_file::write(to, &bytes)?)
}
