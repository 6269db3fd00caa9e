//! Checkpoints: a folder per step with `model.safetensors`, `optimizer.safetensors` and `state.json`.

use super::learner::Learner;
use candle_core::{DType, Device, Tensor};
use compose::Baselines;
use plan::{Stage, TrainSettings};
use render::atomic_file::{self, WriteError};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// Name of the schema of `state.json`.
pub const CHECKPOINT_SCHEMA: &str = "glasshouse.checkpoint/1";

pub(super) const MODEL: &str = "model.safetensors";
const OPTIMIZER: &str = "optimizer.safetensors";
const STATE: &str = "state.json";

/// Inputs of training besides its settings.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// BLAKE3 of VGG's weights file, if the features use one.
    pub vgg_blake3: Option<String>,
    /// Digest of the train scenes in the manifest's order.
    pub scenes_blake3: String,
    /// Digest of the names of the real pairs, in checkpoints of the first version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub real_blake3: Option<String>,
    /// Digest of the names and files of the real pairs, if any.
    #[serde(default)]
    pub real_files_blake3: Option<String>,
    /// Step and model digest of the backtrack checkpoint that the separation stage started with.
    pub backtrack: Option<(u64, String)>,
    /// Digest of the model whose weights the training started with, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from_blake3: Option<String>,
}

/// Settings that changed when a training resumed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Change {
    /// Last step with the old settings.
    pub after_step: u64,
    /// One entry per setting: `name: old -> new`.
    pub changes: Vec<String>,
}

/// What a training began with, and what happened since.
#[derive(Clone, Debug)]
pub struct Past {
    pub origin: Origin,
    pub history: Vec<Change>,
    pub baselines: Option<Baselines>,
}

/// Contents of `state.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckpointState {
    /// Always [`CHECKPOINT_SCHEMA`].
    pub schema: String,
    pub stage: Stage,
    /// Number of steps so far. With the seed, it determines order, crops and all random numbers.
    pub step: u64,
    /// Number of steps of the generators' optimiser.
    pub generator_steps: u64,
    pub discriminator_steps: u64,
    /// Number of trainable weights.
    pub parameters: usize,
    pub settings: TrainSettings,
    /// Changes of settings since the first step, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub history: Vec<Change>,
    pub origin: Origin,
    /// Factor and veil rule, fitted to the first examples of the separation stage; `None` in checkpoints of the first
    /// version, before they resume, and of trainings that follow a farm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baselines: Option<Baselines>,
    /// Instruction set of matrix products, which affects the last bits.
    pub code_path: String,
    /// Mean PSNR of the outputs for the validation scenes, dB; `None` without validation scenes.
    pub validation_psnr_db: Option<f64>,
    /// BLAKE3 digests of the other files, by name.
    pub files: BTreeMap<String, String>,
}

impl CheckpointState {
    /// Checks that the counts agree with each other and with the name of the checkpoint's folder. The file has no digest
    /// of itself.
    fn check(&self, path: &Path) -> Result<(), String> {
        let step = self.step;
        let name = path.file_name().and_then(|name| name.to_str());
        // A folder of another name is a copy.
        if let Some(of_folder) = name.and_then(step_of)
            && of_folder != step
        {
            return Err(format!("step is {step}, but the folder is of step {of_folder}"));
        }
        self.settings.validate().map_err(|e| format!("settings.{e}"))?;
        if self.generator_steps != step {
            return Err(format!("generator_steps is {} at step {step}", self.generator_steps));
        }
        let has_discriminator = self.settings.adversarial_weight > 0.0;
        let updates =
            step.div_ceil(self.settings.discriminator_every) * u64::from(has_discriminator);
        if self.discriminator_steps != updates {
            return Err(format!(
                "discriminator_steps is {} at step {step} instead of {updates}",
                self.discriminator_steps
            ));
        }
        if self.validation_psnr_db.is_some_and(f64::is_nan) {
            return Err("validation_psnr_db is not a number".to_owned());
        }
        Ok(())
    }
}

/// Returns the step in the name of a checkpoint's folder.
fn step_of(name: &str) -> Option<u64> {
    name.strip_prefix("step-")?.parse().ok()
}

#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error("the checkpoint {} cannot be used: {reason}", path.display())]
    Damaged { path: PathBuf, reason: String },
    #[error(
        "the networks of step {step} are not written: {reason}; earlier checkpoints stay. A smaller --learning-rate may help"
    )]
    Exploded { step: u64, reason: String },
    #[error(transparent)]
    Tensor(#[from] candle_core::Error),
}

/// A checkpoint with verified digests.
pub struct Checkpoint {
    pub path: PathBuf,
    /// Contents of `state.json`.
    pub state: CheckpointState,
    pub model: HashMap<String, Tensor>,
    pub moments: HashMap<String, Tensor>,
}

/// Returns the instruction set of matrix products on this machine: `avx512f`, `fma` or `baseline`.
pub fn code_path() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") {
            return "avx512f";
        }
        if std::arch::is_x86_feature_detected!("fma") {
            return "fma";
        }
    }
    "baseline"
}

/// Returns the folder of a training in a run's folder: `train`, or `train/NAME` with a name.
pub fn training_folder(run: &Path, name: Option<&str>) -> PathBuf {
    let all = run.join("train");
    name.map_or(all.clone(), |name| all.join(name))
}

/// Returns the folder of a stage's checkpoints in the folder of a training.
pub fn stage_folder(training: &Path, stage: Stage) -> PathBuf {
    training.join(stage.name())
}

/// Returns the folder of a step's checkpoint.
pub fn checkpoint_folder(stage_folder: &Path, step: u64) -> PathBuf {
    stage_folder.join(format!("step-{step:07}"))
}

/// Writes a checkpoint atomically and durably; returns its folder. Refuses values that are not finite.
pub fn write_checkpoint(
    stage_folder: &Path,
    step: u64,
    learner: &Learner,
    settings: &TrainSettings,
    past: &Past,
    validation_psnr_db: Option<f64>,
) -> Result<PathBuf, CheckpointError> {
    let path = checkpoint_folder(stage_folder, step);
    for tensors in [learner.model(), learner.moments()] {
        if let Some(reason) = not_finite(&tensors)? {
            return Err(CheckpointError::Exploded { step, reason });
        }
    }
    let bytes = |tensors: BTreeMap<String, Tensor>| {
        safetensors::serialize(tensors, None)
            .map_err(|e| CheckpointError::Damaged { path: path.clone(), reason: e.to_string() })
    };
    let files = [(MODEL, bytes(learner.model())?), (OPTIMIZER, bytes(learner.moments())?)];
    let state = CheckpointState {
        schema: CHECKPOINT_SCHEMA.to_owned(),
        stage: learner.stage,
        step,
        generator_steps: learner.generator_adam.steps,
        discriminator_steps: learner.discriminator_adam.as_ref().map_or(0, |adam| adam.steps),
        parameters: learner.parameters(),
        settings: settings.clone(),
        history: past.history.clone(),
        origin: past.origin.clone(),
        baselines: past.baselines.clone(),
        code_path: code_path().to_owned(),
        validation_psnr_db,
        files: files.iter().map(|(name, bytes)| ((*name).to_owned(), digest(bytes))).collect(),
    };
    let mut json = serde_json::to_string_pretty(&state)
        .map_err(|e| CheckpointError::Damaged { path: path.clone(), reason: e.to_string() })?;
    json.push('\n');
    atomic_file::write_dir(&path, |folder| {
        for (name, bytes) in &files {
            atomic_file::write(&folder.join(name), bytes)?;
        }
        atomic_file::write(&folder.join(STATE), json.as_bytes())
    })?;
    Ok(path)
}

/// Names a tensor that is not finite.
fn not_finite<'a>(
    tensors: impl IntoIterator<Item = (&'a String, &'a Tensor)>,
) -> candle_core::Result<Option<String>> {
    for (name, tensor) in tensors {
        let values: Vec<f32> = tensor.flatten_all()?.to_vec1()?;
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            return Ok(Some(format!("the value of {name} is not finite ({value})")));
        }
    }
    Ok(None)
}

pub(super) fn digest(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

impl Checkpoint {
    /// Returns the digest of the model's file.
    pub(super) fn model_blake3(&self) -> Option<String> {
        self.state.files.get(MODEL).cloned()
    }

    /// Reads a checkpoint, and verifies the digests of its files and that every value is finite. One without a digest of
    /// `optimizer.safetensors` holds weights alone: networks work, but no training resumes from it.
    pub fn read(path: &Path) -> Result<Self, CheckpointError> {
        let damaged = |reason: String| CheckpointError::Damaged { path: path.to_owned(), reason };
        let file = |name: &str| {
            render::input_file::read(&path.join(name)).map_err(|e| damaged(format!("{name}: {e}")))
        };
        let (state, model) = read_model(path, &file(STATE)?, &file(MODEL)?)?;
        let moments = if state.files.contains_key(OPTIMIZER) {
            read_tensors(&state, OPTIMIZER, &file(OPTIMIZER)?).map_err(damaged)?
        } else {
            HashMap::new()
        };
        Ok(Self { path: path.to_owned(), model, moments, state })
    }

    /// Reads the bytes of a state and a model, without the optimiser, and verifies them like [`Self::read`]. `path` names
    /// them in errors.
    pub(super) fn of_model(
        path: &Path,
        state: &[u8],
        model: &[u8],
    ) -> Result<Self, CheckpointError> {
        let (state, model) = read_model(path, state, model)?;
        Ok(Self { path: path.to_owned(), model, moments: HashMap::new(), state })
    }

    /// Reads the newest usable checkpoint of a stage from step `least` on; also returns the errors of newer checkpoints.
    /// The checkpoint of step 0 has the settings of a training, but nothing learnt. Fails if the folder cannot be listed.
    pub fn newest(
        stage_folder: &Path,
        least: u64,
    ) -> std::io::Result<(Option<Self>, Vec<CheckpointError>)> {
        let mut refused = Vec::new();
        for step in steps(stage_folder)?.into_iter().rev().take_while(|step| *step >= least) {
            match Self::read(&checkpoint_folder(stage_folder, step)) {
                Ok(checkpoint) => return Ok((Some(checkpoint), refused)),
                Err(error) => refused.push(error),
            }
        }
        Ok((None, refused))
    }
}

/// Reads and verifies a state and its model.
fn read_model(
    path: &Path,
    state: &[u8],
    model: &[u8],
) -> Result<(CheckpointState, HashMap<String, Tensor>), CheckpointError> {
    let damaged = |reason: String| CheckpointError::Damaged { path: path.to_owned(), reason };
    let state: CheckpointState =
        serde_json::from_slice(state).map_err(|e| damaged(format!("{STATE}: {e}")))?;
    if state.schema != CHECKPOINT_SCHEMA {
        let schema = &state.schema;
        return Err(damaged(format!(
            "its schema is {schema:?}, but this program reads {CHECKPOINT_SCHEMA:?}"
        )));
    }
    state.check(path).map_err(|reason| damaged(format!("{STATE}: {reason}")))?;
    let model = read_tensors(&state, MODEL, model).map_err(damaged)?;
    Ok((state, model))
}

/// Reads the tensors of a file; half floats become single floats. Returns the reason if the digest differs or if a value
/// is not finite.
fn read_tensors(
    state: &CheckpointState,
    name: &str,
    bytes: &[u8],
) -> Result<HashMap<String, Tensor>, String> {
    if state.files.get(name) != Some(&digest(bytes)) {
        return Err(format!("{name} does not match its digest"));
    }
    let read = || -> candle_core::Result<_> {
        let tensors = candle_core::safetensors::load_buffer(bytes, &Device::Cpu)?;
        let single = |(name, tensor): (String, Tensor)| Ok((name, tensor.to_dtype(DType::F32)?));
        let tensors = tensors.into_iter().map(single);
        let tensors: HashMap<String, Tensor> = tensors.collect::<candle_core::Result<_>>()?;
        let reason = not_finite(&tensors)?;
        Ok((tensors, reason))
    };
    let (tensors, reason) = read().map_err(|e| format!("{name}: {e}"))?;
    reason.map_or(Ok(tensors), |reason| Err(format!("{name}: {reason}")))
}

/// Returns the steps of the checkpoints in a stage's folder, in ascending order; none if the folder does not exist.
pub fn steps(stage_folder: &Path) -> std::io::Result<Vec<u64>> {
    let entries = match std::fs::read_dir(stage_folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error),
    };
    let mut steps = Vec::new();
    for entry in entries {
        steps.extend(entry?.file_name().to_str().and_then(step_of));
    }
    steps.sort_unstable();
    Ok(steps)
}

/// Removes all checkpoints except the newest `keep` (at least one) and the one of step `best`.
pub fn prune(stage_folder: &Path, keep: usize, best: Option<u64>) -> std::io::Result<()> {
    let steps = steps(stage_folder)?;
    let old = steps.len().saturating_sub(keep.max(1));
    for step in &steps[..old] {
        if Some(*step) != best {
            atomic_file::remove_dir(&checkpoint_folder(stage_folder, *step))?;
        }
    }
    Ok(())
}

/// Removes temporary files and folders of killed writers. The caller must hold the stage's lock.
pub fn clear(stage_folder: &Path) -> std::io::Result<()> {
    let Ok(entries) = std::fs::read_dir(stage_folder) else {
        return Ok(());
    };
    // Depth 1 covers the pictures.
    atomic_file::sweep(stage_folder, 1, &atomic_file::is_temporary);
    for entry in entries.flatten() {
        if atomic_file::is_temporary(&entry.path()) && entry.path().is_dir() {
            std::fs::remove_dir_all(entry.path())?;
        }
    }
    Ok(())
}
