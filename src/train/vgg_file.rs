//! The feature network of the settings: none, or VGG-19 with random weights or torchvision's weights from a file.

use super::vgg::{Vgg, VggError};
use candle_core::{Device, Tensor};
use plan::{FeatureSource, TrainSettings};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Errors of loading the feature network.
#[derive(Debug, thiserror::Error)]
pub enum FeaturesError {
    #[error("these networks use features of a VGG-19 from a file: name it with --features FILE")]
    NoFile,
    #[error("cannot read {}: {source}; check the path", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{} holds no usable VGG-19: {source}", path.display())]
    Weights { path: PathBuf, source: VggError },
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
}

/// The feature network, and the digest of its file.
#[derive(Default)]
pub struct Features {
    /// `None` for networks that use only colours.
    pub vgg: Option<Vgg>,
    /// BLAKE3 of the weights file, if the features use one.
    pub blake3: Option<String>,
}

impl Features {
    /// Loads the feature network of `settings`. `file` holds its weights, if the settings need a file.
    pub fn load(
        settings: &TrainSettings,
        file: Option<&Path>,
        device: &Device,
    ) -> Result<Self, FeaturesError> {
        let divisor = settings.vgg_divisor;
        match settings.features {
            FeatureSource::None => Ok(Self::default()),
            FeatureSource::Random => {
                Ok(Self { vgg: Some(Vgg::random(settings.seed, divisor, device)?), blake3: None })
            }
            FeatureSource::File => {
                let path = file.ok_or(FeaturesError::NoFile)?;
                let bytes = render::input_file::read(path)
                    .map_err(|source| FeaturesError::Read { path: path.to_owned(), source })?;
                let vgg = weights(path, &bytes)
                    .map_err(VggError::from)
                    .and_then(|weights| Vgg::new(&weights, divisor, device))
                    .map_err(|source| FeaturesError::Weights { path: path.to_owned(), source })?;
                Ok(Self { vgg: Some(vgg), blake3: Some(blake3::hash(&bytes).to_hex().to_string()) })
            }
        }
    }
}

fn weights(path: &Path, bytes: &[u8]) -> Result<HashMap<String, Tensor>, candle_core::Error> {
    if path.extension().is_some_and(|ending| ending == "safetensors") {
        return candle_core::safetensors::load_buffer(bytes, &Device::Cpu);
    }
    let tensors = candle_core::pickle::read_all(path)?;
    Ok(tensors.into_iter().collect())
}
