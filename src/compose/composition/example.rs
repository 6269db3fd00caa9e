//! One example: a F_i + b R~_j in linear light, its exposure, and its targets.

use super::Cut;
use super::camera::without_camera;
use super::code::srgb_code;
use super::cover::cover;
use super::draw::{Draw, DrawnStrength};
use super::layers::{LinearTuple, channel_means, luminance, multiply_planes};
use super::mixture::{add_codes, blur_codes};
use super::settings::TargetLight;
use crate::blur::blur;
use crate::random::Stream;
use image::ImageResult;

/// A crop of a tuple.
#[derive(Clone, Copy, Debug)]
pub struct Side<'a> {
    pub tuple: &'a LinearTuple,
    pub cut: Cut,
}

/// Front and reflection of an example.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layering {
    /// The front through the pane, F_i, and the pane's reflection, R~_j.
    Rendered,
    /// Two transmissions without a pane: a share of T_i, and a blurred T_j.
    LinearMixture,
    /// The same, less what exceeds white, times a vignette: the mixing of Zhang, Ng and Chen (CVPR 2018).
    ZhangMixture,
    /// Two transmissions whose codes are blurred, reduced by what exceeds white, and added: the mixing of CEILNet (Fan
    /// et al., ICCV 2017).
    CeilnetMixture,
}

impl Layering {
    /// True if examples have no pane: their front is a share of T_i, and another tuple's T_j is their reflection.
    pub fn is_mixture(self) -> bool {
        self != Self::Rendered
    }
}

/// Linear layers of an example: square, three planes each. Input and targets have the same factors.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearExample {
    pub side_px: usize,
    pub input: Vec<f32>,
    pub transmission: Vec<f32>,
    /// The part of the input that is reflection.
    pub glass_reflection: Vec<f32>,
    pub clean_reflection: Option<Vec<f32>>,
    /// Mean luminance of the reflection over that of the front, before a partial cover and before the mixing of Zhang or
    /// CEILNet change the reflection; 0 for a black front.
    pub strength: f64,
}

/// An example for training: codes from 0 to 1 of square layers, three planes each.
#[derive(Clone, Debug, PartialEq)]
pub struct ComposedExample {
    pub side_px: usize,
    pub input: Vec<f32>,
    pub transmission: Vec<f32>,
    pub glass_reflection: Vec<f32>,
    pub clean_reflection: Option<Vec<f32>>,
}

impl LinearExample {
    pub(super) fn layers(&mut self) -> impl Iterator<Item = &mut Vec<f32>> {
        let layers = [&mut self.input, &mut self.transmission, &mut self.glass_reflection];
        layers.into_iter().chain(self.clean_reflection.as_mut())
    }

    /// Takes over layers that are codes already.
    pub(super) fn coded(self) -> ComposedExample {
        ComposedExample {
            side_px: self.side_px,
            input: self.input,
            transmission: self.transmission,
            glass_reflection: self.glass_reflection,
            clean_reflection: self.clean_reflection,
        }
    }
}

impl Draw {
    /// Composes an example of `side_px` px and photographs it. `noise` is the stream of the sensor's noise. Without
    /// `other`, the reflection is that of the front's tuple, at the same place. If nothing is drawn, the example is the
    /// tuple's crop, bit for bit. Fails only if JPEG does.
    pub fn example(
        &self,
        layering: Layering,
        front: Side,
        other: Option<Side>,
        side_px: usize,
        noise: &mut Stream,
    ) -> ImageResult<ComposedExample> {
        if layering == Layering::Rendered
            && other.is_none()
            && front.cut.size == side_px
            && self.changes_nothing()
        {
            return Ok(front.stored());
        }
        if let Some(sensor) = &self.sensor {
            let crop_px = front.cut.size.min(other.map_or(usize::MAX, |side| side.cut.size));
            let film_px = sensor.film_px(side_px, crop_px);
            let linear = self.linear(layering, front, other, film_px);
            return sensor.develop(linear, side_px, self.exposure.is_none());
        }
        let linear = self.linear(layering, front, other, side_px);
        match &self.camera {
            None => Ok(without_camera(linear)),
            Some(camera) => camera.develop(linear, noise),
        }
    }

    /// Composes an example before the camera. See [`Self::example`].
    pub fn linear(
        &self,
        layering: Layering,
        front: Side,
        other: Option<Side>,
        side_px: usize,
    ) -> LinearExample {
        let mut transmission = front.layer(&front.tuple.transmission, side_px);
        let back = other.unwrap_or(front);
        let (mut ahead, mut reflection, mut clean) = if layering == Layering::Rendered {
            let clean = back.tuple.clean_reflection.as_ref();
            let clean = clean.map(|layer| back.layer(layer, side_px));
            let reflection = back.layer(&back.tuple.glass_reflection, side_px);
            (front.tuple.crop_front(front.cut, side_px), reflection, clean)
        } else {
            let share = self.transmitted as f32;
            let ahead = transmission.iter().map(|value| value * share).collect();
            let clean = back.layer(&back.tuple.transmission, side_px);
            (ahead, clean.clone(), Some(clean))
        };
        if let Some(texture) = &self.texture {
            texture.multiply("front", &mut transmission, Some(&mut ahead), side_px);
            texture.multiply("reflection", &mut reflection, clean.as_mut(), side_px);
        }
        match layering {
            Layering::Rendered => blur(&mut reflection, [side_px; 2], self.rough_px),
            Layering::CeilnetMixture => blur_codes(&mut reflection, |codes| {
                blur(codes, [side_px; 2], self.mixture_blur_px);
            }),
            _ => blur(&mut reflection, [side_px; 2], self.mixture_blur_px),
        }
        // The tuple's own reflection, if it is not blurred, is 0 already where its pane does not reach.
        let needs_coverage = other.is_some() || self.rough_px > 0.0;
        if let Some(coverage) = front.tuple.coverage.as_ref().filter(|_| needs_coverage) {
            let coverage = front.layer(coverage, side_px);
            for planes in [Some(&mut reflection), clean.as_mut()].into_iter().flatten() {
                multiply_planes(planes, &coverage);
            }
        }
        let means = [channel_means(&ahead), channel_means(&reflection)];
        if self.target_light == TargetLight::ThroughPane {
            let light = luminance(channel_means(&transmission));
            // A black target stays black.
            let factor = if light > 0.0 { luminance(means[0]) / light } else { 0.0 };
            scale(&mut transmission, [factor; 3]);
        }
        let [factors, reflection_factors] = self.factors(means, other.map(|side| side.tuple));
        scale(&mut ahead, factors);
        scale(&mut transmission, factors);
        scale(&mut reflection, reflection_factors);
        if let Some(clean) = &mut clean {
            scale(clean, reflection_factors);
        }
        if let Some(seed) = self.cover {
            let cover = cover(seed, side_px);
            for planes in [Some(&mut reflection), clean.as_mut()].into_iter().flatten() {
                multiply_planes(planes, &cover);
            }
        }
        match layering {
            Layering::ZhangMixture => self.zhang.darken(&ahead, &mut reflection, side_px),
            Layering::CeilnetMixture => add_codes(&ahead, &mut reflection),
            Layering::Rendered | Layering::LinearMixture => {}
        }
        let mut input = ahead;
        input.iter_mut().zip(&reflection).for_each(|(value, reflected)| *value += reflected);
        let [front_mean, reflected_mean] = [
            luminance(product(means[0], factors)),
            luminance(product(means[1], reflection_factors)),
        ];
        let mut example = LinearExample {
            side_px,
            strength: if front_mean > 0.0 { reflected_mean / front_mean } else { 0.0 },
            input,
            transmission,
            glass_reflection: reflection,
            clean_reflection: clean,
        };
        if let Some(exposure) = &self.exposure {
            let factor = exposure.factor(&example.input, front_mean);
            example.layers().for_each(|layer| scale(layer, [factor; 3]));
        }
        example
    }

    /// Returns the factors of the front's channels and of the reflection's, given the means of both. `other` is the
    /// reflection's tuple; `None` if it is the front's tuple too.
    fn factors(
        &self,
        [ahead, reflection]: [[f64; 3]; 2],
        other: Option<&LinearTuple>,
    ) -> [[f64; 3]; 2] {
        let balance = self.white_balance;
        let back_balance = product(balance, self.reflection_white_balance);
        let strength = match (self.strength, other) {
            (DrawnStrength::OfTuple, None) => return [balance, back_balance],
            (DrawnStrength::OfTuple, Some(other)) => other.strength(),
            (DrawnStrength::Ratio(ratio), _) => ratio,
        };
        let [front, back] =
            [luminance(product(balance, ahead)), luminance(product(back_balance, reflection))];
        // A black reflection stays black, and a black front has no reflection.
        let factor = if back > 0.0 { strength * front.max(0.0) / back } else { 0.0 };
        [balance, back_balance.map(|value| value * factor)]
    }
}

impl Side<'_> {
    fn layer(&self, layer: &super::Layer, side_px: usize) -> Vec<f32> {
        self.tuple.crop(layer, self.cut, side_px)
    }

    /// Codes the stored layers in sRGB.
    fn stored(&self) -> ComposedExample {
        let coded = |layer: &super::Layer| {
            let mut planes = self.layer(layer, self.cut.size);
            for value in &mut planes {
                *value = srgb_code(*value);
            }
            planes
        };
        ComposedExample {
            side_px: self.cut.size,
            input: coded(&self.tuple.input),
            transmission: coded(&self.tuple.transmission),
            glass_reflection: coded(&self.tuple.glass_reflection),
            clean_reflection: self.tuple.clean_reflection.as_ref().map(coded),
        }
    }
}

fn product(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|channel| a[channel] * b[channel])
}

/// Multiplies three planes by one factor each.
fn scale(planes: &mut [f32], factors: [f64; 3]) {
    let pixels = (planes.len() / 3).max(1);
    for (plane, factor) in planes.chunks_exact_mut(pixels).zip(factors) {
        let factor = factor as f32;
        if factor != 1.0 {
            for value in plane {
                *value *= factor;
            }
        }
    }
}
