//! A shot: a camera with the decisions that it took for one mixture.

use super::demosaic::demosaic;
use super::developing::Development;
use super::exposing::{expose, raw_values};
use super::matrix::{Matrix, inverse, scaled};
use crate::blur::blurred;
use crate::composition::brightest;
use glasshouse_line::Sensor;
use render::merge::metered_factor;
use render::trace::Isa;

/// A camera in front of a mixture: the sensor, the factor of the light, and the development.
#[derive(Clone, Debug)]
pub struct Shot<'a> {
    sensor: &'a Sensor,
    size_px: [usize; 2],
    photograph_px: [usize; 2],
    factor: f64,
    /// From linear sRGB of the layers to the raw values of red, green and blue photosites.
    to_raw: [[f32; 3]; 3],
    development: Development,
    isa: Isa,
}

impl<'a> Shot<'a> {
    /// Meters an input: linear light, three planes of width x height values.
    pub fn new(sensor: &'a Sensor, input: &[f32], size_px: [usize; 2]) -> Self {
        Self::with_factor(sensor, size_px, metered_factor(sensor.exposure, brightest(input)))
    }

    /// Makes a shot whose factor of the light is given.
    pub fn with_factor(sensor: &'a Sensor, size_px: [usize; 2], factor: f64) -> Self {
        let to_camera: Matrix = inverse(&sensor.colour_matrix);
        let factors = sensor.white_balance.map(|gain| factor / gain);
        Self {
            sensor,
            size_px,
            photograph_px: size_px
                .map(|side| ((side as f64 * sensor.scale).round() as usize).max(1)),
            factor,
            to_raw: scaled(&to_camera, factors),
            development: Development::new(sensor),
            isa: Isa::detect(),
        }
    }

    /// Sets the instruction set. All yield the same bits.
    #[must_use]
    pub fn with_isa(self, isa: Isa) -> Self {
        Self { isa, ..self }
    }

    /// Returns the factor of the light.
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// Returns the sensor.
    pub fn sensor(&self) -> &'a Sensor {
        self.sensor
    }

    /// Returns the size of the film: width and height, px.
    pub fn film_px(&self) -> [usize; 2] {
        self.size_px
    }

    /// Returns the size of the photographs: width and height, px.
    pub fn photograph_px(&self) -> [usize; 2] {
        self.photograph_px
    }

    /// Sets the size of the photographs, px, which must not exceed the film's.
    #[must_use]
    pub(crate) fn resized(self, photograph_px: [usize; 2]) -> Self {
        Self { photograph_px, ..self }
    }

    /// Exposes the sensor to a mixture. Returns the numbers of its converter, row by row.
    pub fn expose(&self, mixture: &[f32], seed: u64) -> Vec<u16> {
        self.expose_light(&self.light_of_photosites(mixture), seed)
    }

    /// Exposes the sensor to the light of its photosites, as raw values without noise.
    pub fn expose_light(&self, light: &[f32], seed: u64) -> Vec<u16> {
        expose(light, self.size_px[0], self.sensor, seed, self.isa)
    }

    /// Develops the numbers of a sensor. Returns codes from 0 to 1, three planes of [`Self::photograph_px`].
    pub fn develop(&self, numbers: &[u16]) -> Vec<f32> {
        self.developed(&raw_values(numbers, self.sensor))
    }

    /// Photographs a layer without noise and without a converter. Returns codes like [`Self::develop`].
    pub fn noiseless(&self, layer: &[f32]) -> Vec<f32> {
        self.developed(&self.light_of_photosites(layer))
    }

    fn developed(&self, raw: &[f32]) -> Vec<f32> {
        let mut planes = self.demosaic(raw);
        self.render(&mut planes);
        self.finish(planes)
    }

    /// Interpolates the colours of raw values: three planes of the film's size.
    pub fn demosaic(&self, raw: &[f32]) -> Vec<f32> {
        demosaic(raw, self.size_px, self.sensor.mosaic, self.isa)
    }

    /// Turns raw planes into codes: white balance, colour matrix and tone curve.
    pub fn render(&self, planes: &mut [f32]) {
        self.development.apply(planes);
    }

    /// Scales and sharpens codes of the film's size.
    pub fn finish(&self, planes: Vec<f32>) -> Vec<f32> {
        self.development.finish(planes, self.size_px, self.photograph_px)
    }

    /// Returns the light of the photosites, as raw values without noise. A colour outside the camera's range has no light,
    /// not a negative one.
    pub fn light_of_photosites(&self, planes: &[f32]) -> Vec<f32> {
        let [width, height] = self.size_px;
        let soft =
            (self.sensor.blur_px > 0.0).then(|| blurred(planes, self.size_px, self.sensor.blur_px));
        let planes = soft.as_deref().unwrap_or(planes);
        let [red, green, blue] = [0, 1, 2].map(|c| &planes[c * width * height..][..width * height]);
        let mut raw = vec![0.0; width * height];
        for (y, out) in raw.chunks_exact_mut(width).enumerate() {
            let [red, green, blue] = [red, green, blue].map(|plane| &plane[y * width..][..width]);
            let factors = [0, 1].map(|x| self.to_raw[self.sensor.mosaic.channel(y, x)]);
            for (x, out) in out.iter_mut().enumerate() {
                let [r, g, b] = factors[x % 2];
                *out = (r * red[x] + g * green[x] + b * blue[x]).max(0.0);
            }
        }
        raw
    }
}
