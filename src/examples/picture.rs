//! Pictures as planes of sRGB codes.

use super::example::Planes;
use super::srgb_planes::{bytes_of_planes, planes_of_bytes};
use image::RgbImage;

/// A planar image of sRGB codes.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub rows: usize,
    pub columns: usize,
    pub planes: Planes,
}

impl Picture {
    pub fn to_rgb(&self) -> RgbImage {
        let (width, height) = (self.columns as u32, self.rows as u32);
        let mut picture = RgbImage::new(width, height);
        picture.copy_from_slice(&bytes_of_planes(&self.planes));
        picture
    }

    pub fn from_rgb(picture: &RgbImage) -> Self {
        Self {
            rows: picture.height() as usize,
            columns: picture.width() as usize,
            planes: planes_of_bytes(picture.as_raw()),
        }
    }
}
