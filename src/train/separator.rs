//! Applies the networks of a checkpoint to pictures.

use super::checkpoint::Checkpoint;
use super::inference::Networks;
use super::learner::Learner;
use super::separation_net::SeparationNet;
use super::vgg::Vgg;
use super::work_size::{WorkSize, changed, difference_of_light, enlarged};
use candle_core::Result;
use compose::{shrink_to, shrunk_size_px};
use examples::Picture;
use image::RgbImage;
use plan::{SettingError, Stage, TrainSettings};
use std::path::PathBuf;

/// Errors of loading the networks of a checkpoint.
#[derive(Debug, thiserror::Error)]
pub enum SeparatorError {
    #[error(
        "{} belongs to the backtrack stage and holds BT-net alone; use a checkpoint of the separation stage",
        path.display()
    )]
    NoSeparation { path: PathBuf },
    #[error(
        "{} was trained with VGG-19 weights of BLAKE3 {expected}, but the given weights have {found}; use the same weights as in training",
        path.display()
    )]
    OtherFeatures {
        path: PathBuf,
        /// Digest of the VGG weights used in training, or `none`.
        expected: String,
        /// Digest of the VGG weights given now, or `none`.
        found: String,
    },
    #[error("the settings of {} are damaged: {source}", path.display())]
    Settings { path: PathBuf, source: SettingError },
    #[error("the networks of {} do not fit its settings: {source}; use another checkpoint", path.display())]
    Weights { path: PathBuf, source: candle_core::Error },
    #[error("the networks of {} cannot separate a picture: {source}; use another checkpoint", path.display())]
    Networks { path: PathBuf, source: candle_core::Error },
}

/// SP-net, BT-net and their feature network.
pub struct Separator {
    /// Folder of the checkpoint.
    path: PathBuf,
    learner: Learner,
}

impl Separator {
    /// Loads a checkpoint of the separation stage. `vgg` is the feature network that its settings require; `vgg_blake3`
    /// is the digest of the weights file, if the features come from a file.
    pub fn new(
        checkpoint: &Checkpoint,
        vgg: Option<Vgg>,
        vgg_blake3: Option<&str>,
    ) -> std::result::Result<Self, SeparatorError> {
        let state = &checkpoint.state;
        let path = || checkpoint.path.clone();
        if state.stage == Stage::Backtrack {
            return Err(SeparatorError::NoSeparation { path: path() });
        }
        let expected = state.origin.vgg_blake3.as_deref();
        if expected != vgg_blake3 {
            let digest = |of: Option<&str>| of.unwrap_or("none").to_owned();
            return Err(SeparatorError::OtherFeatures {
                path: path(),
                expected: digest(expected),
                found: digest(vgg_blake3),
            });
        }
        let settings = TrainSettings {
            // Inference needs no discriminator, and the model holds the running means.
            adversarial_weight: 0.0,
            ema: 0.0,
            ..state.settings.clone()
        };
        settings.validate().map_err(|source| SeparatorError::Settings { path: path(), source })?;
        let learner = Learner::new(state.stage, &settings, vgg);
        let learner = learner.and_then(|mut learner| {
            learner.set_model(&checkpoint.model, "")?;
            Ok(learner)
        });
        match learner {
            Ok(learner) => Ok(Self { path: path(), learner }),
            Err(source) => Err(SeparatorError::Weights { path: path(), source }),
        }
    }

    pub fn networks(&self) -> Networks<'_> {
        self.learner.networks()
    }

    /// True if the checkpoint has a BT-net, so that separations have R*.
    pub fn has_backtrack(&self) -> bool {
        self.networks().backtrack.is_some()
    }

    /// Computes the layers of a picture. Networks process a picture that is larger than `work.longest_px` at that size;
    /// T* is then the picture plus their enlarged change, and R~* and R* are enlarged.
    pub fn separate(
        &self,
        picture: &RgbImage,
        work: WorkSize,
    ) -> std::result::Result<Separation, SeparatorError> {
        self.by_networks(picture, work)
            .map_err(|source| SeparatorError::Networks { path: self.path.clone(), source })
    }

    fn by_networks(&self, picture: &RgbImage, work: WorkSize) -> Result<Separation> {
        let networks = self.networks();
        let size = picture.dimensions().into();
        let is_whole = work.longest_px.is_none_or(|px| shrunk_size_px(size, px) == size);
        let small = match work.longest_px.filter(|_| !is_whole) {
            Some(px) => Picture::from_rgb(&shrink_to(picture.clone(), px)),
            None => Picture::from_rgb(picture),
        };
        let at_size = |made: &Picture| if is_whole { made.to_rgb() } else { enlarged(made, size) };
        let tile_px = work.tile_px.map_or(usize::MAX, |px| px as usize);
        let [mut t, r] = networks.separate(&small, tile_px)?;
        let clean_reflection = match networks.backtrack {
            Some(_) => Some(at_size(&networks.track_back(&r, tile_px)?)),
            None => None,
        };
        let transmission = if is_whole {
            t.to_rgb()
        } else {
            t.planes.iter_mut().zip(&small.planes).for_each(|(t, i)| *t -= i);
            changed(picture, &t)
        };
        let has_transmission_alone =
            networks.separation.is_some_and(SeparationNet::has_transmission_alone);
        let glass_reflection = if has_transmission_alone {
            difference_of_light(picture, &transmission)
        } else {
            at_size(&r)
        };
        Ok(Separation { transmission, glass_reflection, clean_reflection })
    }
}

/// The layers of a picture, of its size.
#[derive(Clone, Debug, PartialEq)]
pub struct Separation {
    /// T*.
    pub transmission: RgbImage,
    /// R~*; the difference of light between the picture and T* if the network has T* alone.
    pub glass_reflection: RgbImage,
    /// R*; `None` without BT-net.
    pub clean_reflection: Option<RgbImage>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{FeatureSource, Origin, Past, write_checkpoint};

    fn settings() -> TrainSettings {
        TrainSettings {
            width: 4,
            discriminator_width: 2,
            features: FeatureSource::Random,
            vgg_divisor: 16,
            ..TrainSettings::default()
        }
    }

    fn vgg(settings: &TrainSettings) -> Vgg {
        Vgg::random(settings.seed, settings.vgg_divisor).unwrap()
    }

    fn checkpoint(folder: &std::path::Path, stage: Stage, settings: &TrainSettings) -> Checkpoint {
        let mut learner = Learner::new(stage, settings, Some(vgg(settings))).unwrap();
        learner.generator_adam.steps = 3;
        if let Some(adam) = &mut learner.discriminator_adam {
            adam.steps = 3u64.div_ceil(settings.discriminator_every);
        }
        let origin = Origin {
            vgg_blake3: None,
            scenes_blake3: String::new(),
            real_blake3: None,
            real_files_blake3: None,
            from_blake3: None,
            backtrack: None,
        };
        let past = Past { origin, history: Vec::new(), baselines: None };
        let path = write_checkpoint(folder, 3, &learner, settings, &past, None).unwrap();
        Checkpoint::read(&path).unwrap()
    }

    #[test]
    fn separators_reproduce_the_output_of_their_learner() {
        let folder = tempfile::tempdir().unwrap();
        let settings = settings();
        let checkpoint = checkpoint(folder.path(), Stage::Separation, &settings);
        let separator = Separator::new(&checkpoint, Some(vgg(&settings)), None).unwrap();
        let learner = Learner::new(Stage::Separation, &settings, Some(vgg(&settings)));
        let picture = RgbImage::from_fn(37, 21, |x, y| {
            image::Rgb([(x * 7) as u8, (y * 11) as u8, (x * y) as u8])
        });
        let expected = learner.unwrap();
        let expected = expected.networks().separate(&Picture::from_rgb(&picture), 300).unwrap();
        let found = separator.separate(&picture, WorkSize::default()).unwrap();
        let [t, r] = expected.map(|picture| picture.to_rgb());
        assert_eq!((&found.transmission, &found.glass_reflection), (&t, &r));
        assert_eq!(found.clean_reflection.unwrap().dimensions(), (37, 21));
        let small = WorkSize { longest_px: Some(32), tile_px: None };
        let found = separator.separate(&picture, small).unwrap();
        assert!(found.transmission.dimensions() == (37, 21) && found.transmission != t);
        assert_eq!(found.clean_reflection.unwrap().dimensions(), (37, 21));
    }

    #[test]
    fn unsuitable_checkpoints_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let settings = settings();
        let text = |checkpoint: &Checkpoint, vgg, blake3| {
            Separator::new(checkpoint, vgg, blake3).err().unwrap().to_string()
        };
        let alone = checkpoint(folder.path(), Stage::Backtrack, &settings);
        assert!(text(&alone, Some(vgg(&settings)), None).contains("BT-net alone"));
        let mut whole = checkpoint(folder.path(), Stage::Separation, &settings);
        let other = text(&whole, Some(vgg(&settings)), Some("abc"));
        assert!(other.contains("BLAKE3 none") && other.contains("have abc"), "{other}");
        // The first layer expects features, and the call passes none.
        let narrow = text(&whole, None, None);
        assert!(narrow.contains("kernel.0 is [4, "), "{narrow}");
        whole.model.remove("separation.last");
        let missing = text(&whole, Some(vgg(&settings)), None);
        assert!(missing.contains("separation.last is missing"), "{missing}");
        whole.state.settings.width = 0;
        assert!(text(&whole, Some(vgg(&settings)), None).contains("width"));
    }
}
