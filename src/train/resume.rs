//! The start of training: the stage's newest checkpoint, the BT-net of the backtrack stage, or new networks.

use super::checkpoint::{Change, Checkpoint, Origin, code_path, stage_folder};
use super::error::TrainError;
use super::example_baselines::baselines;
use super::learner::Learner;
use super::run::Training;
use super::session::Watcher;
use super::vgg::Vgg;
use compose::{Baselines, Pair};
use examples::{ExampleSampler, digest_of, scenes_digest};
use glasshouse_line::SceneLine;
use plan::{FREE, NetworkKind, ScheduleKind, Stage, TrainSettings};
use rayon::prelude::*;
use render::folder_lock::FolderLock;
use std::path::Path;

/// Settings of the architecture, which the separation stage inherits from the backtrack stage.
const OF_NETWORKS: [&str; 6] =
    ["features", "feature_style", "network", "vgg_divisor", "width", "start"];

/// The checkpoints that training starts from.
pub(super) struct Beginning {
    /// The newest usable checkpoint of this stage.
    pub(super) own: Option<Checkpoint>,
    /// The newest usable checkpoint of the backtrack stage, if the separation stage has none yet.
    before: Option<Checkpoint>,
    /// The checkpoint whose weights a new training takes.
    from: Option<Checkpoint>,
}

/// Locks a stage's folder until the returned lock is dropped.
pub(super) fn lock(folder: &Path) -> Result<FolderLock, TrainError> {
    render::atomic_file::create_dir(folder)?;
    let path = folder.join("train.lock");
    match FolderLock::try_new(&path) {
        Ok(lock) => lock.ok_or_else(|| TrainError::Busy { folder: folder.to_owned() }),
        Err(source) => Err(TrainError::Lock { path, source }),
    }
}

impl Beginning {
    /// Finds the checkpoints in a training's folder and warns of damaged checkpoints.
    pub(super) fn find(
        training: &Path,
        stage: Stage,
        watcher: &mut dyn Watcher,
    ) -> Result<Self, TrainError> {
        let mut newest = |stage, least| {
            let folder = stage_folder(training, stage);
            let (checkpoint, refused) = Checkpoint::newest(&folder, least)
                .map_err(|source| TrainError::Read { path: folder, source })?;
            for error in refused {
                let older = match &checkpoint {
                    Some(older) => format!("step {} is used instead", older.state.step),
                    None => "no older one is usable".to_owned(),
                };
                watcher.warning(&format!("{error}; {older}"));
            }
            Ok::<_, TrainError>(checkpoint)
        };
        let own = newest(stage, 0)?;
        let before = match stage {
            Stage::Separation if own.is_none() => newest(Stage::Backtrack, 1)?,
            _ => None,
        };
        Ok(Self { own, before, from: None })
    }

    /// Takes the weights to start with. A training that has steps keeps its own, which must have started with the same.
    pub(super) fn start_from(&mut self, from: Option<Checkpoint>) -> Result<(), TrainError> {
        if let (Some(own), Some(from)) = (&self.own, &from)
            && own.state.origin.from_blake3 != from.model_blake3()
        {
            return Err(other_origin("the weights to start from", own));
        }
        self.from = from.filter(|_| self.own.is_none());
        Ok(())
    }

    pub(super) fn step(&self) -> u64 {
        self.own.as_ref().map_or(0, |own| own.state.step)
    }

    /// Returns the settings of the training, which must equal those that its checkpoint fixes, except [`FREE`]. A training that begins
    /// with the weights of another is a new one, whose networks must be the same. A cosine without an end ends at the training's
    /// last step.
    pub(super) fn settings(&mut self, training: &Training) -> Result<TrainSettings, TrainError> {
        let of = |frozen: Option<&Checkpoint>| {
            (training.settings)(frozen.map(|frozen| &frozen.state.settings))
        };
        let before = self.before.as_ref().filter(|_| self.from.is_none());
        let mut settings = of(self.own.as_ref().or(before));
        if settings.network == NetworkKind::Unet {
            if training.stage == Stage::Backtrack {
                return Err(TrainError::NoBacktrackStage { run: training.typed() });
            }
            // A U-Net begins without BT-net.
            if self.before.take().is_some() {
                settings = of(None);
            }
        }
        settings.validate()?;
        if settings.schedule == ScheduleKind::Cosine {
            if settings.schedule_steps == 0 {
                let recorded = self.own.as_ref().map(|own| own.state.settings.schedule_steps);
                settings.schedule_steps =
                    recorded.filter(|steps| *steps > 0).unwrap_or(training.steps);
            }
            let end = settings.schedule_steps;
            if training.steps > end {
                return Err(TrainError::ScheduleEnds { end, steps: training.steps });
            }
        }
        if let Some(frozen) = self.own.as_ref().or(self.before.as_ref()) {
            let state = &frozen.state;
            let mut differences = state.settings.differences(&settings);
            if state.stage == training.stage {
                differences.retain(|line| !FREE.contains(&name_in(line)));
            } else {
                differences.retain(|line| OF_NETWORKS.contains(&name_in(line)));
            }
            if !differences.is_empty() {
                return Err(TrainError::Frozen { checkpoint: frozen.path.clone(), differences });
            }
        } else if let Some(from) = &self.from {
            let mut differences = from.state.settings.differences(&settings);
            differences.retain(|line| OF_NETWORKS.contains(&name_in(line)));
            if !differences.is_empty() {
                return Err(TrainError::Frozen { checkpoint: from.path.clone(), differences });
            }
        } else if training.stage == Stage::Separation && settings.a_priori {
            return Err(TrainError::NoBacktrack {
                folder: training.folder(),
                run: training.typed(),
            });
        }
        if settings.real_share > 0.0 && training.pairs.is_none() {
            return Err(TrainError::NoRealPairs { share: settings.real_share });
        }
        Ok(settings)
    }

    /// Returns the changes of the stage's settings since its first step.
    pub(super) fn history(&self, settings: &TrainSettings) -> Vec<Change> {
        let Some(own) = &self.own else {
            return Vec::new();
        };
        let mut history = own.state.history.clone();
        let changes = own.state.settings.differences(settings);
        if !changes.is_empty() {
            history.push(Change { after_step: own.state.step, changes });
        }
        history
    }

    /// Returns the inputs besides the settings. Fails if these inputs do not fit the checkpoint.
    pub(super) fn origin(
        &self,
        lines: &[SceneLine],
        pairs: &[Pair],
        vgg_blake3: Option<String>,
        watcher: &mut dyn Watcher,
    ) -> Result<Origin, TrainError> {
        let backtrack = match (&self.own, &self.before) {
            (Some(own), _) => own.state.origin.backtrack.clone(),
            (None, Some(before)) => {
                let digest = before.state.files.get("model.safetensors");
                Some((before.state.step, digest.cloned().unwrap_or_default()))
            }
            (None, None) => None,
        };
        let origin = Origin {
            vgg_blake3,
            scenes_blake3: scenes_digest(lines),
            real_blake3: None,
            real_files_blake3: digest_of_pairs(pairs)?,
            backtrack,
            from_blake3: match &self.own {
                Some(own) => own.state.origin.from_blake3.clone(),
                None => self.from.as_ref().and_then(Checkpoint::model_blake3),
            },
        };
        if let Some(own) = &self.own {
            check_origin(own, &origin, pairs)?;
            if own.state.code_path != code_path() {
                watcher.warning(&format!(
                    "the checkpoint was computed with {} instructions, but this machine has {}: the last bits will differ",
                    own.state.code_path,
                    code_path()
                ));
            }
        }
        // BT-net works only with the features that it was trained with.
        match &self.before {
            Some(before) if before.state.origin.vgg_blake3 != origin.vgg_blake3 => {
                Err(other_origin(VGG, before))
            }
            _ => Ok(origin),
        }
    }

    /// Returns the baselines of the training. Fits them to its first examples if it is new or of the first version.
    pub(super) fn baselines(
        &self,
        stage: Stage,
        settings: &TrainSettings,
        sampler: &ExampleSampler,
    ) -> Option<Baselines> {
        let fitted = self.own.as_ref().and_then(|own| own.state.baselines.clone());
        if fitted.is_some() || stage == Stage::Backtrack || settings.follow {
            // With `follow`, examples may be hours away.
            return fitted;
        }
        baselines(sampler, settings.batch)
    }

    /// Creates new networks and loads BT-net if needed. [`super::Session`] restores the stage's own checkpoint.
    pub(super) fn learner(
        &self,
        stage: Stage,
        settings: &TrainSettings,
        vgg: Option<Vgg>,
    ) -> Result<Learner, TrainError> {
        let mut learner = Learner::new(stage, settings, vgg)?;
        if let Some(before) = &self.before {
            learner.set_model(&before.model, "backtrack.")?;
        }
        if let Some(from) = &self.from {
            let failed = |source| TrainError::From { path: from.path.clone(), source };
            let has = |network: &str| from.model.keys().any(|name| name.starts_with(network));
            // Weights without a discriminator, or of the backtrack stage alone, leave the other networks new.
            for network in ["separation.", "backtrack.", "discriminator."] {
                if has(network) {
                    learner.set_model(&from.model, network).map_err(failed)?;
                }
            }
        }
        Ok(learner)
    }
}

/// Returns the setting's name in a line `name: old -> new`.
fn name_in(line: &str) -> &str {
    line.split(':').next().unwrap_or(line)
}

const VGG: &str = "VGG-19's weights";

fn check_origin(own: &Checkpoint, origin: &Origin, pairs: &[Pair]) -> Result<(), TrainError> {
    let was = &own.state.origin;
    let is_other_real = match &was.real_blake3 {
        Some(of_names) => {
            let names = pairs.iter().map(|pair| pair.name.clone());
            *of_names != digest_of(names)
        }
        None => was.real_files_blake3 != origin.real_files_blake3,
    };
    let changed = if was.scenes_blake3 != origin.scenes_blake3 {
        "the run's train scenes"
    } else if is_other_real {
        "the real pairs"
    } else if was.vgg_blake3 != origin.vgg_blake3 {
        VGG
    } else {
        return Ok(());
    };
    Err(other_origin(changed, own))
}

fn other_origin(changed: &'static str, checkpoint: &Checkpoint) -> TrainError {
    TrainError::OtherOrigin { changed, checkpoint: checkpoint.path.clone() }
}

/// Digests the names and files of real pairs; returns `None` without pairs.
pub(super) fn digest_of_pairs(pairs: &[Pair]) -> Result<Option<String>, TrainError> {
    let digest = |pair: &Pair| -> Result<String, TrainError> {
        let mut text = pair.name.clone();
        let layers = [Some(&pair.blended), Some(&pair.transmission)];
        for path in
            layers.into_iter().chain([pair.reflection.as_ref(), pair.clean_reflection.as_ref()])
        {
            text.push('\t');
            let Some(path) = path else { continue };
            let bytes = render::input_file::read(path)
                .map_err(|source| TrainError::Read { path: path.clone(), source })?;
            text += blake3::hash(&bytes).to_hex().as_str();
        }
        Ok(text)
    };
    let digests: Result<Vec<String>, TrainError> = pairs.par_iter().map(digest).collect();
    Ok((!pairs.is_empty()).then_some(digest_of(digests?.into_iter())))
}
