//! A calibrated sensor in place of the simple camera.

use super::draw::DrawnSensor;
use super::example::{ComposedExample, LinearExample};
use crate::camera::Shot;
use crate::curve::Curve;
use crate::jpeg::{decode_jpeg, encode_jpeg, of_rgb8, to_rgb8};
use image::error::{EncodingError, ImageFormatHint};
use image::{ImageError, ImageFormat, ImageResult};

impl DrawnSensor {
    /// Returns the side of the film for a photograph of `side_px`. The smallest crop, `crop_px`, bounds it.
    pub(super) fn film_px(&self, side_px: usize, crop_px: usize) -> usize {
        let wanted = (side_px as f64 / self.sensor.scale).round() as usize;
        wanted.min(crop_px).max(side_px)
    }

    /// Photographs an example, whose photograph has a side of `side_px` px. The sensor meters the input if `is_metered`. The clean
    /// reflection, which no camera sees, passes the exposure and the curve alone.
    pub(super) fn develop(
        &self,
        linear: LinearExample,
        side_px: usize,
        is_metered: bool,
    ) -> ImageResult<ComposedExample> {
        let mut example = self.before_jpeg(linear, side_px, is_metered);
        let (quality, subsampling) = (self.sensor.jpeg_quality, self.sensor.jpeg_subsampling);
        let rgb = to_rgb8(&example.input);
        let jpeg = encode_jpeg(&rgb, [side_px; 2], quality, subsampling).map_err(|e| {
            let hint = ImageFormatHint::Exact(ImageFormat::Jpeg);
            ImageError::Encoding(EncodingError::new(hint, e))
        })?;
        of_rgb8(&decode_jpeg(&jpeg)?, &mut example.input);
        Ok(example)
    }

    /// As [`super::Draw::example`] with a sensor, without rounding to 8 bits and JPEG.
    pub fn before_jpeg(
        &self,
        linear: LinearExample,
        side_px: usize,
        is_metered: bool,
    ) -> ComposedExample {
        let (sensor, film) = (&self.sensor, [linear.side_px; 2]);
        let shot = if is_metered {
            Shot::new(sensor, &linear.input, film)
        } else {
            Shot::with_factor(sensor, film, 1.0)
        };
        let shot = shot.resized([side_px; 2]);
        let clean_reflection = linear.clean_reflection.map(|mut planes| {
            let factor = shot.factor() as f32;
            for value in &mut planes {
                *value *= factor;
            }
            Curve::of(sensor.tone).apply(&mut planes);
            shot.finish(planes)
        });
        ComposedExample {
            side_px,
            input: shot.develop(&shot.expose(&linear.input, self.seed)),
            transmission: shot.noiseless(&linear.transmission),
            glass_reflection: shot.noiseless(&linear.glass_reflection),
            clean_reflection,
        }
    }
}
