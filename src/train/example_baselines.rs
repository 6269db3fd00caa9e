//! The baselines of a training: a factor and a veil rule, fitted to its first examples. A network must beat both.

use compose::{Baselines, Subject, Unread, WithTruth, fit_baselines};
use examples::Example;
use examples::ExampleSampler;
use examples::bytes_of_planes;
use image::RgbImage;
use std::sync::atomic::AtomicBool;

/// Number of examples of a fit.
const EXAMPLES: usize = 64;

/// Examples as 8-bit pictures with their truths.
struct Examples(Vec<Example>);

impl Subject for Examples {
    fn count(&self) -> usize {
        self.0.len()
    }

    fn name(&self, index: usize) -> String {
        format!("example {index}")
    }

    fn read(&self, index: usize) -> Result<WithTruth, Unread> {
        let example = &self.0[index];
        let picture = |planes: &[f32]| {
            let (width, height) = (example.columns as u32, example.rows as u32);
            RgbImage::from_raw(width, height, bytes_of_planes(planes))
                .ok_or_else(|| Unread::Unreadable("it has fewer pixels than its size".to_owned()))
        };
        Ok(WithTruth { input: picture(&example.input)?, truth: picture(&example.transmission)? })
    }

    fn is_aligned(&self) -> bool {
        true
    }
}

/// Fits the baselines to the examples of the first steps of a training, with the given number of examples per step.
/// Returns `None` if the examples cannot be read, or if the fit fails: training does not depend on the baselines, and
/// reports such examples itself.
pub(super) fn baselines(sampler: &ExampleSampler, batch: usize) -> Option<Baselines> {
    let mut examples = Vec::new();
    for step in 0..EXAMPLES.div_ceil(batch) as u64 {
        examples.extend(sampler.examples(step).ok()?);
    }
    examples.truncate(EXAMPLES);
    let place = "the examples of the training".to_owned();
    fit_baselines(&Examples(examples), place, &AtomicBool::new(false)).ok()?.0
}
