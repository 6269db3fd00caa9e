//! The weights of new networks, for trainers of other programs.

use super::learner::Learner;
use super::vgg::Vgg;
use candle_core::{Result, Tensor};
use plan::{FeatureSource, Stage, TrainSettings};
use std::collections::BTreeMap;

/// Returns the weights with which a stage's training begins, by their names in a checkpoint; with random features also those
/// of the VGG-19, by torchvision's names.
pub fn initial_weights(stage: Stage, settings: &TrainSettings) -> Result<BTreeMap<String, Tensor>> {
    let vgg = match settings.features {
        FeatureSource::None => None,
        // The weights of a file change no initial weight of the networks, only their widths do.
        FeatureSource::Random | FeatureSource::File => {
            Some(Vgg::random(settings.seed, settings.vgg_divisor)?)
        }
    };
    let mut weights = BTreeMap::new();
    if let (FeatureSource::Random, Some(vgg)) = (settings.features, &vgg) {
        weights.extend(vgg.weights().map(|(name, tensor)| (name, tensor.clone())));
    }
    weights.extend(Learner::new(stage, settings, vgg)?.model());
    Ok(weights)
}
