//! Adapters through which [`compose`] scores trained networks on a run's tuples.

use super::inference::LEAST_PX;
use super::separator::Separator;
use super::source::{Base, ExampleError, TupleSource};
use super::srgb_planes::bytes_of_planes;
use super::work_size::WorkSize;
use compose::{Given, Method, Subject, Unmade, Unread, WithTruth};
use image::RgbImage;

/// Provides inputs and transmissions as 8-bit pictures.
impl Subject for TupleSource {
    fn count(&self) -> usize {
        self.lines.len()
    }

    fn name(&self, index: usize) -> String {
        self.lines[index].id.to_string()
    }

    fn read(&self, index: usize) -> Result<WithTruth, Unread> {
        let missing = |text: &str| Err(Unread::Missing(text.to_owned()));
        let example = match Self::read(self, index)? {
            Some(Base::Example(example)) => example,
            Some(Base::Photographs { .. } | Base::Linear(_)) => {
                return Err(Unread::Unreadable("it is not a tuple".to_owned()));
            }
            None if self.is_in_quarantine(index)? => {
                return missing("its scene is in quarantine; `glasshouse retry` takes it out");
            }
            None => return missing("it has no tuple yet; `glasshouse work` renders it"),
        };
        let picture = |planes: &[f32]| {
            let (width, height) = (example.columns as u32, example.rows as u32);
            RgbImage::from_raw(width, height, bytes_of_planes(planes))
                .ok_or_else(|| Unread::Unreadable("it has fewer pixels than its film".to_owned()))
        };
        Ok(WithTruth { input: picture(&example.input)?, truth: picture(&example.transmission)? })
    }

    fn is_aligned(&self) -> bool {
        true
    }
}

impl From<ExampleError> for Unread {
    fn from(error: ExampleError) -> Self {
        match error {
            ExampleError::Store(error) => Self::Fatal(error.0),
            ExampleError::Damaged { .. } | ExampleError::Unusable { .. } => {
                Self::Unreadable(error.to_string())
            }
            ExampleError::None(_) | ExampleError::Stopped => Self::Fatal(error.into()),
        }
    }
}

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
