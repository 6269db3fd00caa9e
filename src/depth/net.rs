//! The whole network: a picture to its depth.

use super::config::{Config, PATCH_PX};
use super::encoder::Encoder;
use super::head::Head;
use super::picture::planes;
use super::weights::Weights;
use image::RgbImage;
use train::candle_core::{self, Tensor};
use train::ops::{Sampling, bilinear_at};

/// Error of an estimate.
#[derive(Debug, thiserror::Error)]
pub enum DepthError {
    #[error("the network failed: {0}")]
    Network(#[from] candle_core::Error),
    #[error("the network's depth is not finite: the weights are unusable")]
    NotFinite,
    #[error(
        "it has {width} x {height} px, but pictures more than {MAX_ASPECT} times as long as wide need too much memory: crop it, or leave it out"
    )]
    Thin { width: usize, height: usize },
}

/// Largest ratio of a picture's sides. The network scales the shorter side to 518 px, and its time grows with the square of the
/// longer one: at this ratio, the tokens' attention costs 64 times that of a square picture.
const MAX_ASPECT: usize = 8;

/// Depth of a picture, of its size.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthMap {
    pub width: usize,
    pub height: usize,
    /// Relative inverse depth (larger is nearer), or metres for a metric network; row by row.
    pub values: Vec<f32>,
}

/// Depth Anything V2.
pub struct DepthNet {
    encoder: Encoder,
    head: Head,
    /// Largest depth of a metric network, m.
    metric_m: Option<f64>,
}

impl DepthNet {
    /// Makes a network. `metric_m` is the largest depth of metric weights (20 for rooms, 80 for streets); without it, the
    /// weights are relative ones.
    pub fn new(
        weights: &Weights,
        config: &Config,
        metric_m: Option<f64>,
    ) -> Result<Self, DepthError> {
        Ok(Self {
            encoder: Encoder::new(weights, config)?,
            head: Head::new(weights, config)?,
            metric_m,
        })
    }

    /// Computes the depth (rows, columns) of normalised planes (3, rows, columns), multiples of 14.
    pub(crate) fn forward(&self, planes: &Tensor) -> candle_core::Result<Tensor> {
        let (_, rows, columns) = planes.dims3()?;
        let tokens = self.encoder.forward(planes)?;
        let values = self.head.forward(&tokens, [rows / PATCH_PX, columns / PATCH_PX])?;
        match self.metric_m {
            None => values.relu(),
            Some(most) => (values.neg()?.exp()? + 1.0)?.recip()? * most,
        }
    }

    /// Estimates the depth of a picture of sRGB codes.
    pub fn estimate(&self, picture: RgbImage) -> Result<DepthMap, DepthError> {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        if width.max(height) > MAX_ASPECT * width.min(height) {
            return Err(DepthError::Thin { width, height });
        }
        let small = self.forward(&planes(picture)?)?;
        let whole =
            bilinear_at(&small.unsqueeze(0)?.unsqueeze(0)?, height, width, Sampling::Aligned)?;
        let values = whole.flatten_all()?.to_vec1::<f32>()?;
        if !values.iter().all(|value| value.is_finite()) {
            return Err(DepthError::NotFinite);
        }
        Ok(DepthMap { width, height, values })
    }
}
