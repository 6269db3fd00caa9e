//! VGG-19 from where the user says.

use super::exit_code::{Exit, Failure};
use super::output::Output;
use anyhow::{Context, anyhow};
use plan::{FeatureSource, TrainSettings};
use std::collections::HashMap;
use std::path::Path;
use train::Vgg;
use train::candle_core::{Device, Tensor};

/// The feature network, and the digest of its file.
pub(super) struct Features {
    pub(super) vgg: Option<Vgg>,
    pub(super) blake3: Option<String>,
}

/// What the settings ask for. `typed` is the file, or `none` or `random`, if it was said.
pub(super) fn features(
    settings: &TrainSettings,
    typed: Option<&str>,
    device: &Device,
    output: &Output,
) -> Result<Features, Failure> {
    let invalid = |e: anyhow::Error| Failure::new(Exit::InvalidInput, e);
    match settings.features {
        FeatureSource::None => Ok(Features {
            vgg: None,
            blake3: None,
        }),
        FeatureSource::Random => {
            let vgg = Vgg::random(settings.seed, settings.vgg_divisor, device)
                .map_err(|e| invalid(e.into()))?;
            Ok(Features {
                vgg: Some(vgg),
                blake3: None,
            })
        }
        FeatureSource::File => {
            let path = typed.filter(|t| !["none", "random"].contains(t)).ok_or_else(|| {
                invalid(anyhow!(
                    "these networks see features of a VGG-19 from a file: give it with --features FILE"
                ))
            })?;
            let path = Path::new(path);
            let bytes = std::fs::read(path)
                .with_context(|| format!("cannot read {}; check the path", path.display()))
                .map_err(invalid)?;
            let blake3 = blake3::hash(&bytes).to_hex().to_string();
            let what = || format!("{} holds no VGG-19 that can be used", path.display());
            let weights = weights(path, &bytes).with_context(what).map_err(invalid)?;
            let vgg = Vgg::new(&weights, settings.vgg_divisor, device)
                .with_context(what)
                .map_err(invalid)?;
            output.note(&format!("VGG-19 from {}, BLAKE3 {blake3}", path.display()));
            Ok(Features {
                vgg: Some(vgg),
                blake3: Some(blake3),
            })
        }
    }
}

fn weights(
    path: &Path,
    bytes: &[u8],
) -> Result<HashMap<String, Tensor>, train::candle_core::Error> {
    if path
        .extension()
        .is_some_and(|ending| ending == "safetensors")
    {
        return train::candle_core::safetensors::load_buffer(bytes, &Device::Cpu);
    }
    let tensors = train::candle_core::pickle::read_all(path)?;
    Ok(tensors.into_iter().collect())
}
