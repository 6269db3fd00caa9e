//! Adapters through which [`compose`] scores trained networks.

use super::inference::LEAST_PX;
use super::separator::Separator;
use super::work_size::WorkSize;
use compose::{Given, Method, Unmade};
use image::RgbImage;

/// Networks that process whole pictures, or pictures in tiles.
pub struct Tiled<'a> {
    pub separator: &'a Separator,
    /// Side of the overlapping tiles of larger pictures, px; `None` for whole pictures.
    pub tile_px: Option<u32>,
}

impl Method for Tiled<'_> {
    fn least_px(&self) -> u32 {
        LEAST_PX as u32
    }

    fn make(&self, given: &Given) -> Result<RgbImage, Unmade> {
        let work = WorkSize { longest_px: None, tile_px: self.tile_px };
        let made = self.separator.separate(given.input, work);
        Ok(made.map_err(|error| Unmade::Fatal(error.into()))?.transmission)
    }
}
