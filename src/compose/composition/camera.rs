//! A simple camera: blur, noise, curve, 8 bits and JPEG.

use super::draw::DrawnCamera;
use super::example::{ComposedExample, LinearExample};
use super::noise::add_noise;
use crate::blur::blur;
use crate::curve::Curve;
use crate::jpeg::{of_rgb8, through_jpeg, to_rgb8};
use crate::random::Stream;
use image::ImageResult;

/// Codes all layers in sRGB.
pub(super) fn without_camera(mut linear: LinearExample) -> ComposedExample {
    let curve = Curve::new(1.0, 0.0);
    linear.layers().for_each(|layer| curve.apply(layer));
    linear.coded()
}

impl DrawnCamera {
    /// Photographs the input and the targets. The clean reflection, which no camera sees, is not blurred.
    pub(super) fn develop(
        &self,
        mut linear: LinearExample,
        noise: &mut Stream,
    ) -> ImageResult<ComposedExample> {
        let side = linear.side_px;
        for layer in [&mut linear.input, &mut linear.transmission, &mut linear.glass_reflection] {
            blur(layer, [side; 2], self.blur_px);
        }
        add_noise(&mut linear.input, self.shot_noise as f32, self.read_noise as f32, noise);
        let curve = Curve::new(self.gamma, self.s_curve);
        linear.layers().for_each(|layer| curve.apply(layer));
        let mut bytes = to_rgb8(&linear.input);
        if let Some(quality) = self.jpeg_quality {
            bytes = through_jpeg(&bytes, side, quality)?;
        }
        of_rgb8(&bytes, &mut linear.input);
        Ok(linear.coded())
    }
}
