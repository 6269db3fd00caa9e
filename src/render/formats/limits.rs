//! Size limits of images and meshes, checked before anything of that size is allocated.

use super::error::SceneError;
use std::path::Path;

/// Largest width and height of an image, px.
pub const MAX_SIDE: usize = 16_384;

/// Largest number of pixels of an image: 1 GiB of radiance.
pub const MAX_PIXELS: usize = 1 << 26;

/// Largest number of vertices of a mesh.
pub const MAX_VERTICES: usize = 1 << 24;

/// Largest number of triangles of a mesh, and of faces in its file. The BVH build takes about 3 GiB at this limit.
pub const MAX_TRIANGLES: usize = 1 << 24;

/// Largest number of channels of an EXR file, over all layers. Renderers write dozens.
pub(crate) const MAX_EXR_CHANNELS: usize = 256;

/// Accepts sides of 1 to [`MAX_SIDE`] px and at most [`MAX_PIXELS`] pixels.
pub(crate) fn check_size(path: &Path, width: u64, height: u64) -> Result<(), SceneError> {
    let side = 1..=MAX_SIDE as u64;
    // The product cannot overflow, because both sides are within their limits.
    if side.contains(&width) && side.contains(&height) && width * height <= MAX_PIXELS as u64 {
        return Ok(());
    }
    Err(SceneError::Size { path: path.to_owned(), width, height })
}

/// Returns the limits for the `image` crate, with room for 4 channels of 16 bits and the decoder's own rows.
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
    fn sizes_are_accepted_up_to_the_limits() {
        let path = Path::new("x");
        for (width, height) in [(1, 1), (16_384, 1), (1, 16_384), (8_192, 8_192), (16_384, 4_096)] {
            check_size(path, width, height).unwrap();
        }
        for (width, height) in [(0, 1), (1, 0), (16_385, 1), (8_193, 8_192), (u64::MAX, u64::MAX)] {
            assert!(check_size(path, width, height).is_err());
        }
    }
}
