//! Scores of a training's networks on validation images.

use candle_core::{Error, Result};
use compose::psnr_colour_db;
use examples::Picture;
use examples::bytes_of_planes;
use glasshouse_line::color::srgb_to_linear;
use plan::Stage;

/// Largest PSNR of a picture in the mean, dB. It keeps the mean finite when pictures are equal.
const MOST_DB: f64 = 100.0;

/// The result of a check.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Validated {
    /// Mean PSNR of the 8-bit outputs, dB; `None` without usable images.
    pub psnr_db: Option<f64>,
    /// Light of T* over light of I, as the ratio of their means over all images; `None` without images, for black images
    /// and for BT-net. A reflection only adds light, so a ratio above 1 is an alarm.
    pub light_ratio: Option<f64>,
}

/// Sums over the images of a check.
#[derive(Default)]
pub(super) struct Validation {
    images: u32,
    psnr_db: f64,
    /// Sums of the images' mean light, of the inputs and of the outputs.
    light: [f64; 2],
}

impl Validation {
    pub(super) fn add(&mut self, input: &Picture, made: &Picture, truth: &Picture) -> Result<()> {
        // The PSNR of equal pictures is infinite.
        let psnr_db = psnr_colour_db(&made.to_rgb(), &truth.to_rgb()).map_err(Error::wrap)?;
        self.psnr_db += psnr_db.min(MOST_DB);
        self.images += 1;
        for (sum, picture) in self.light.iter_mut().zip([input, made]) {
            *sum += mean_light(picture);
        }
        Ok(())
    }

    pub(super) fn result(&self, stage: Stage) -> Validated {
        let [given, made] = self.light;
        let has_ratio = stage == Stage::Separation && given > 0.0;
        Validated {
            psnr_db: (self.images > 0).then(|| self.psnr_db / f64::from(self.images)),
            light_ratio: has_ratio.then(|| made / given),
        }
    }
}

/// Computes the mean linear light of a picture's 8-bit codes, over pixels and channels.
fn mean_light(picture: &Picture) -> f64 {
    let bytes = bytes_of_planes(&picture.planes);
    let sum: f64 = bytes.iter().map(|code| f64::from(srgb_to_linear(*code))).sum();
    sum / bytes.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ratio_of_light_is_that_of_the_means() {
        let picture = |code: f32| Picture { rows: 2, columns: 2, planes: vec![code; 12] };
        let mut validation = Validation::default();
        assert_eq!(validation.result(Stage::Separation), Validated::default());
        validation.add(&picture(1.0), &picture(0.0), &picture(0.0)).unwrap();
        validation.add(&picture(0.0), &picture(1.0), &picture(0.0)).unwrap();
        validation.add(&picture(1.0), &picture(1.0), &picture(1.0)).unwrap();
        let found = validation.result(Stage::Separation);
        assert_eq!(found.light_ratio, Some(1.0));
        assert!((found.psnr_db.unwrap() - 200.0 / 3.0).abs() < 1e-9);
        assert_eq!(validation.result(Stage::Backtrack).light_ratio, None);
    }
}
