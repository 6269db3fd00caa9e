//! A run's tuples as pictures with ground truth, which [`compose`] scores.

use super::source::{Base, ExampleError, TupleSource};
use super::srgb_planes::bytes_of_planes;
use compose::{Subject, Unread, WithTruth};
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
            ExampleError::Damaged { .. } | ExampleError::Export { .. } => {
                Self::Damaged(error.to_string())
            }
            ExampleError::Unusable { .. } => Self::Unreadable(error.to_string()),
            ExampleError::None(_) | ExampleError::Stopped => Self::Fatal(error.into()),
        }
    }
}
