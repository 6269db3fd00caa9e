//! Size limits of images and meshes, checked before anything of that size is allocated.

use super::error::SceneError;
use std::path::Path;

/// Most pixels along one side.
pub const MAX_SIDE: usize = 16_384;

/// Most pixels of one image: 1 GiB of radiance.
pub const MAX_PIXELS: usize = 1 << 26;

/// Most vertices of a mesh.
pub const MAX_VERTICES: usize = 1 << 24;

/// Most triangles of a mesh (of its faces, before polygons are divided): about 3 GiB while the boxes are built.
pub const MAX_TRIANGLES: usize = 1 << 24;

/// Most channels of all layers of one EXR file; renderers write some dozens.
pub(crate) const MAX_EXR_CHANNELS: usize = 256;

/// Passes sizes of 1 to [`MAX_SIDE`] a side with at most [`MAX_PIXELS`] pixels.
pub(crate) fn check_size(path: &Path, width: u64, height: u64) -> Result<(), SceneError> {
    let side = 1..=MAX_SIDE as u64;
    // The product cannot overflow once both sides are within theirs.
    if side.contains(&width) && side.contains(&height) && width * height <= MAX_PIXELS as u64 {
        return Ok(());
    }
    Err(SceneError::Size { path: path.to_owned(), width, height })
}

/// The same for the `image` crate, with room for 4 channels of 16 bits and the decoder's own rows.
pub(crate) fn image_limits() -> image::Limits {
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_SIDE as u32);
    limits.max_image_height = Some(MAX_SIDE as u32);
    limits.max_alloc = Some(MAX_PIXELS as u64 * 8 + (64 << 20));
    limits
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_at_the_limits() {
        let path = Path::new("x");
        for (width, height) in [(1, 1), (16_384, 1), (1, 16_384), (8_192, 8_192), (16_384, 4_096)] {
            check_size(path, width, height).unwrap();
        }
        for (width, height) in [(0, 1), (1, 0), (16_385, 1), (8_193, 8_192), (u64::MAX, u64::MAX)] {
            assert!(check_size(path, width, height).is_err());
        }
    }
}
