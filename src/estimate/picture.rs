//! Pictures for the network, and their copies beside the depth maps.

use super::error::EstimateError;
use glasshouse_line::Transfer;
use glasshouse_line::color::SrgbEncoder;
use image::RgbImage;
use render::formats::NamedBytes;
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

/// Removes a file, if it exists.
pub(super) fn remove(path: &Path) -> Result<(), EstimateError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(EstimateError::Remove { path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}

/// Makes `to` the same file as `from`, or a copy where the file system has no links. Replaces another file.
pub(super) fn link(from: &Path, to: &Path) -> Result<(), EstimateError> {
    // Both may be one file, by links or because the folder of depth maps is that of the pictures: it must not be removed.
    if to.canonicalize().is_ok_and(|to| from.canonicalize().is_ok_and(|from| from == to)) {
        return Ok(());
    }
    remove(to)?;
    let failed = |source| EstimateError::Link { from: from.to_owned(), to: to.to_owned(), source };
    if std::fs::hard_link(from, to).is_ok() {
        return Ok(());
    }
    let bytes = render::input_file::read(from).map_err(failed)?;
    Ok(render::atomic_file::write(to, &bytes)?)
}
