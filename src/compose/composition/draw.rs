//! The numbers of one example, drawn from the settings' distributions.

use super::mixture::DrawnZhang;
use super::settings::{Camera, Composition, Exposure, LogNormal, Strength, TargetLight};
use super::texture::DrawnTexture;
use crate::random::Stream;
use glasshouse_line::Sensor;

/// The numbers of one example.
#[derive(Clone, Debug, PartialEq)]
pub struct Draw {
    /// True if the reflection comes from another tuple.
    pub is_other: bool,
    pub strength: DrawnStrength,
    /// Factors of red, green and blue for all layers.
    pub white_balance: [f64; 3],
    /// Factors for the reflection alone.
    pub reflection_white_balance: [f64; 3],
    /// Side of the front's crop over the example's side.
    pub front_scale: f64,
    /// Side of another tuple's crop over the example's side.
    pub reflection_scale: f64,
    pub target_light: TargetLight,
    /// `None` for the exposure of the front's tuple.
    pub exposure: Option<DrawnExposure>,
    /// Factor of the transmission in a mixture.
    pub transmitted: f64,
    /// Standard deviation of a mixture's blur, px.
    pub mixture_blur_px: f64,
    /// Further numbers of Zhang's mixtures.
    pub zhang: DrawnZhang,
    /// Seed of the mask of the part that the reflection covers; `None` for the whole picture.
    pub cover: Option<u64>,
    /// Standard deviation of the blur of a rendered reflection, px; 0 for none.
    pub rough_px: f64,
    /// Textures of the surfaces; `None` for none.
    pub texture: Option<DrawnTexture>,
    /// `None` for layers coded in sRGB.
    pub camera: Option<DrawnCamera>,
    /// A calibrated sensor in place of `camera`: [`Draw::with_sensor`].
    pub sensor: Option<DrawnSensor>,
}

/// Mean luminance of the reflection over that of the front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DrawnStrength {
    /// That of the reflection's tuple.
    OfTuple,
    /// 0 for no reflection.
    Ratio(f64),
}

/// An exposure by a percentile of the input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnExposure {
    /// Percentile, from 0 to 100.
    pub percentile: f64,
    /// Place of the level among the levels that the front's mean allows, from 0 to 1.
    pub place: f64,
    /// Range of levels.
    pub level: [f64; 2],
    /// Range of the front's mean luminance.
    pub front_mean: [f64; 2],
}

/// The camera of one example.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawnCamera {
    /// Standard deviation of the blur, px; 0 for none.
    pub blur_px: f64,
    /// Variance of shot noise over the linear value.
    pub shot_noise: f64,
    /// Standard deviation of read noise.
    pub read_noise: f64,
    /// Exponent of the codes.
    pub gamma: f64,
    /// Weight of the S-shaped curve.
    pub s_curve: f64,
    /// `None` without JPEG.
    pub jpeg_quality: Option<u8>,
}

/// The sensor of one example.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnSensor {
    pub sensor: Sensor,
    /// Seed of its noise.
    pub seed: u64,
}

impl Draw {
    /// Draws an example's numbers. Settings must be valid.
    pub fn new(settings: &Composition, stream: &mut Stream) -> Self {
        let mut factors = |sigma: f64| [(); 3].map(|()| libm::exp(sigma * stream.normal()));
        let white_balance = factors(settings.white_balance);
        let reflection_white_balance = factors(settings.reflection_white_balance);
        let is_other = stream.unit() <= settings.other_share;
        let front_scale = stream.uniform(settings.front_scale);
        let reflection_scale = stream.uniform(settings.reflection_scale);
        let [percentile_place, place] = [stream.unit(), stream.unit()];
        let exposure = match &settings.exposure {
            Exposure::OfTuple => None,
            Exposure::Percentile(exposure) => Some(DrawnExposure {
                percentile: within(exposure.percentile, percentile_place),
                place,
                level: exposure.level,
                front_mean: exposure.front_mean,
            }),
        };
        let transmitted = stream.uniform(settings.mixture.transmitted);
        let mixture_blur_px = stream.uniform(settings.mixture.blur_px);
        let camera = DrawnCamera::new(&settings.camera, stream);
        let is_none = stream.unit() <= settings.none_share;
        let strength = match &settings.strength {
            _ if is_none => DrawnStrength::Ratio(0.0),
            Strength::OfTuple => DrawnStrength::OfTuple,
            Strength::LogNormal(strength) => DrawnStrength::Ratio(strength.draw(stream)),
            Strength::Quantiles(values) => DrawnStrength::Ratio(quantile(values, stream.unit())),
        };
        // The stream's numbers above are those of earlier versions.
        let zhang = DrawnZhang {
            attenuation: stream.uniform([1.08, 1.18]),
            vignette: [(); 2].map(|()| stream.unit()),
        };
        let is_partial = stream.unit() <= settings.partial_cover;
        let cover = stream.bits();
        let is_rough = stream.unit() <= settings.rough;
        let rough_px = stream.log_uniform(settings.rough_px);
        let is_textured = stream.unit() <= settings.textured;
        let texture = DrawnTexture { seed: stream.bits(), sigma: settings.texture_sigma };
        Self {
            is_other,
            strength,
            white_balance,
            reflection_white_balance,
            front_scale,
            reflection_scale,
            target_light: settings.target_light,
            exposure,
            transmitted,
            mixture_blur_px,
            zhang,
            cover: is_partial.then_some(cover),
            rough_px: if is_rough { rough_px } else { 0.0 },
            texture: is_textured.then_some(texture),
            camera: settings.camera.enabled.then_some(camera),
            sensor: None,
        }
    }

    /// Replaces the simple camera. Crops grow by the sensor's scale, so that photographs show the same part of the tuple.
    #[must_use]
    pub fn with_sensor(mut self, sensor: Sensor, seed: u64) -> Self {
        self.camera = None;
        self.front_scale /= sensor.scale;
        self.reflection_scale /= sensor.scale;
        self.sensor = Some(DrawnSensor { sensor, seed });
        self
    }
    /// True if an example of one tuple and of crops of its own size has the tuple's bits.
    pub(super) fn changes_nothing(&self) -> bool {
        let factors = self.white_balance.iter().chain(&self.reflection_white_balance);
        !self.is_other
            && self.strength == DrawnStrength::OfTuple
            && factors.copied().all(|factor| factor == 1.0)
            && self.target_light == TargetLight::WithoutPane
            && self.exposure.is_none()
            && self.cover.is_none()
            && self.rough_px == 0.0
            && self.texture.is_none()
            && self.camera.is_none()
            && self.sensor.is_none()
    }
}

impl DrawnCamera {
    /// Takes the same number of values from the stream for all settings.
    fn new(settings: &Camera, stream: &mut Stream) -> Self {
        let has_blur = stream.unit() <= settings.blur_share;
        let blur_px = stream.uniform(settings.blur_px);
        let shot_noise = stream.log_uniform(settings.shot_noise);
        let read_noise = stream.log_uniform(settings.read_noise);
        let gamma = libm::exp(settings.gamma_sigma * stream.normal());
        let s_curve = stream.uniform(settings.s_curve);
        let has_jpeg = stream.unit() <= settings.jpeg_share;
        let [low, high] = settings.jpeg_quality;
        let quality = low + stream.below(usize::from(high - low) + 1) as u8;
        Self {
            blur_px: if has_blur { blur_px } else { 0.0 },
            shot_noise,
            read_noise,
            gamma,
            s_curve,
            jpeg_quality: has_jpeg.then_some(quality),
        }
    }
}

impl LogNormal {
    /// Draws until a value lies in the range, which holds a hundredth of the distribution or more.
    fn draw(&self, stream: &mut Stream) -> f64 {
        let [low, high] = self.range;
        loop {
            let value = self.median * libm::exp(self.sigma * stream.normal());
            if (low..=high).contains(&value) {
                return value;
            }
        }
    }
}

/// Returns the value of a probability from 0 to 1, given two or more values at evenly spaced probabilities.
fn quantile(values: &[f64], probability: f64) -> f64 {
    let place = probability * (values.len() - 1) as f64;
    let first = (place as usize).min(values.len() - 2);
    within([values[first], values[first + 1]], place - first as f64)
}

/// Returns the number at a place, from 0 to 1, of a range.
fn within([low, high]: [f64; 2], place: f64) -> f64 {
    (low + (high - low) * place).clamp(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: usize = 20_000;

    fn draws(settings: &Composition) -> Vec<Draw> {
        let draw = |k: usize| Draw::new(settings, &mut Stream::new(9, &format!("draw {k}")));
        (0..COUNT).map(draw).collect()
    }

    fn share(draws: &[Draw], is: impl Fn(&Draw) -> bool) -> f64 {
        draws.iter().filter(|draw| is(draw)).count() as f64 / draws.len() as f64
    }

    /// Asserts that quantiles of the values are those of a distribution function, within four standard errors.
    fn assert_distribution(mut values: Vec<f64>, quantile: impl Fn(f64) -> f64, what: &str) {
        values.sort_by(f64::total_cmp);
        let margin = 2.0 / (values.len() as f64).sqrt();
        for p in [0.1, 0.25, 0.5, 0.75, 0.9] {
            let found = values[(p * values.len() as f64) as usize];
            let [low, high] = [quantile(p - margin), quantile(p + margin)];
            assert!((low..=high).contains(&found), "{what} at {p}: {found} of {low} to {high}");
        }
    }

    fn uniform([low, high]: [f64; 2]) -> impl Fn(f64) -> f64 {
        move |p| low + (high - low) * p
    }

    fn log_uniform([low, high]: [f64; 2]) -> impl Fn(f64) -> f64 {
        move |p| low * libm::pow(high / low, p)
    }

    #[test]
    fn numbers_have_the_distributions_of_the_settings() {
        let settings = Composition::default();
        let draws = draws(&settings);
        let near = |found: f64, expected: f64| (found - expected).abs() < 0.012;
        assert!(near(share(&draws, |d| d.is_other), 0.8));
        assert!(near(share(&draws, |d| d.strength == DrawnStrength::Ratio(0.0)), 0.05));
        let of = |value: &dyn Fn(&Draw) -> f64| draws.iter().map(value).collect::<Vec<f64>>();
        assert_distribution(of(&|d| d.reflection_scale), uniform([1.0, 2.0]), "scale");
        assert!(draws.iter().all(|d| d.front_scale == 1.0));
        let exposure = |d: &Draw| d.exposure.unwrap();
        assert_distribution(of(&|d| exposure(d).percentile), uniform([93.0, 99.8]), "percentile");
        assert_distribution(of(&|d| exposure(d).place), uniform([0.0, 1.0]), "place");
        assert_distribution(of(&|d| d.transmitted), uniform([0.8, 1.0]), "transmitted");
        assert_distribution(of(&|d| d.mixture_blur_px), uniform([0.5, 5.0]), "mixture's blur");
        assert_distribution(of(&|d| d.zhang.attenuation), uniform([1.08, 1.18]), "attenuation");
        assert_distribution(of(&|d| d.zhang.vignette[1]), uniform([0.0, 1.0]), "vignette");
        let camera = |d: &Draw| d.camera.unwrap();
        assert_distribution(of(&|d| camera(d).shot_noise), log_uniform([1e-5, 1e-3]), "shot");
        assert_distribution(of(&|d| camera(d).read_noise), log_uniform([1e-4, 4e-3]), "read");
        assert_distribution(of(&|d| camera(d).s_curve), uniform([-0.25, 0.35]), "s_curve");
        assert!(near(share(&draws, |d| camera(d).blur_px > 0.0), 0.5));
        let blurs = of(&|d| camera(d).blur_px).into_iter().filter(|px| *px > 0.0);
        assert_distribution(blurs.collect(), uniform([0.0, 0.7]), "blur");
        assert!(near(share(&draws, |d| camera(d).jpeg_quality.is_some()), 0.7));
        let qualities = draws.iter().filter_map(|d| camera(d).jpeg_quality).map(f64::from);
        let qualities: Vec<f64> = qualities.collect();
        assert!(qualities.contains(&60.0) && qualities.contains(&98.0));
        assert_distribution(qualities, |p| (60.0 + 39.0 * p).floor(), "quality");
        for (sigma, logs) in [
            (0.08, of(&|d| libm::log(d.white_balance[1]))),
            (0.15, of(&|d| libm::log(d.reflection_white_balance[2]))),
            (0.12, of(&|d| libm::log(camera(d).gamma))),
        ] {
            let mean = logs.iter().sum::<f64>() / COUNT as f64;
            let deviation = (logs.iter().map(|v| v * v).sum::<f64>() / COUNT as f64).sqrt();
            assert!(mean.abs() < 0.03 * sigma && (deviation / sigma - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn strengths_are_log_normal_and_cut() {
        let strengths: Vec<f64> = draws(&Composition::default())
            .iter()
            .filter_map(|d| match d.strength {
                DrawnStrength::Ratio(ratio) if ratio > 0.0 => Some(ratio),
                _ => None,
            })
            .collect();
        assert!(strengths.iter().all(|s| (0.03..=1.5).contains(s)));
        // The distribution function of the cut distribution, inverted by bisection.
        let below = |value: f64| {
            let z = libm::log(value / 0.4) * std::f64::consts::FRAC_1_SQRT_2;
            0.5 * libm::erfc(-z)
        };
        let quantile = |p: f64| {
            let wanted = below(0.03) + p * (below(1.5) - below(0.03));
            let mut range = [0.03, 1.5];
            for _ in 0..50 {
                let middle = 0.5 * (range[0] + range[1]);
                range[usize::from(below(middle) > wanted)] = middle;
            }
            range[0]
        };
        assert_distribution(strengths, quantile, "strength");
    }

    #[test]
    fn strengths_have_the_given_quantiles() {
        let strength = Strength::Quantiles(vec![0.02, 0.1, 0.4, 1.2]);
        let settings = Composition { strength, none_share: 0.0, ..Composition::default() };
        let ratio = |d: &Draw| match d.strength {
            DrawnStrength::Ratio(ratio) => ratio,
            DrawnStrength::OfTuple => f64::NAN,
        };
        let expected = |p: f64| match 3.0 * p {
            p if p < 1.0 => 0.02 + 0.08 * p,
            p if p < 2.0 => 0.1 + 0.3 * (p - 1.0),
            p => 0.4 + 0.8 * (p - 2.0),
        };
        assert_distribution(draws(&settings).iter().map(ratio).collect(), expected, "strength");
        assert_eq!((quantile(&[0.5, 2.0], 0.0), quantile(&[0.5, 2.0], 1.0)), (0.5, 2.0));
    }

    #[test]
    fn numbers_that_are_off_change_nothing() {
        assert!(draws(&Composition::off()).iter().all(Draw::changes_nothing));
        let changed = share(&draws(&Composition::default()), |d| !d.changes_nothing());
        assert_eq!(changed, 1.0);
        // A switch does not change the other numbers.
        let settings = Composition::default();
        let mut without = settings.clone();
        without.camera.enabled = false;
        (without.partial_cover, without.rough, without.textured) = (0.5, 0.5, 0.5);
        let switched = draws(&without);
        assert!((share(&switched, |d| d.cover.is_some()) - 0.5).abs() < 0.012);
        let rough = switched.iter().map(|d| d.rough_px).filter(|px| *px > 0.0);
        assert_distribution(rough.collect(), log_uniform([0.5, 6.0]), "rough");
        assert!((share(&switched, |d| d.texture.is_some()) - 0.5).abs() < 0.012);
        for (mut a, mut b) in draws(&settings).into_iter().zip(switched).take(100) {
            a.camera = None;
            (b.cover, b.rough_px, b.texture) = (None, 0.0, None);
            assert_eq!(a, b);
        }
    }
}
