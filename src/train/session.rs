//! A training session: steps, validation, checkpoints, logs, resuming.

use super::batch::Batch;
use super::checkpoint::{
    Checkpoint, CheckpointError, CheckpointState, Past, prune, write_checkpoint,
};
use super::checks::{Checks, ChosenOn, MOST_SHOWN};
use super::error::TrainError;
use super::grid::{Grid, picture_grid};
use super::jumps::warning_of_jumps;
use super::learner::{Learner, StepLosses};
use super::logs::{Logged, Logs};
use super::validation::{Validated, Validation};
use examples::Example;
use examples::ExampleError;
use examples::Loader;
use examples::Picture;
use plan::{Stage, TrainSettings};
use render::atomic_file::{self, WriteError};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// The last step, and the settings of checkpoints and pictures, which do not change the weights.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    pub until: u64,
    /// Number of steps between checkpoints; the last step always has a checkpoint.
    pub checkpoint_every: u64,
    /// Number of newest checkpoints to keep; the best is also kept.
    pub keep: usize,
    /// Number of steps between grids of pictures; 0 for no grids.
    pub pictures_every: u64,
}

impl Schedule {
    fn has_pictures(&self, step: u64) -> bool {
        let every = self.pictures_every;
        every > 0 && (step.is_multiple_of(every) || step == self.until)
    }
}

/// A receiver of the events of training.
pub trait Watcher {
    /// Reports the steps to train and the number of examples per step.
    fn begins(&mut self, _steps: Range<u64>, _batch: usize) {}
    fn step(&mut self, _step: u64, _losses: &StepLosses, _wall_s: f64) {}
    /// Reports a check of the networks at work with the validation images.
    fn validated(&mut self, _step: u64, _validated: &Validated) {}
    fn checkpoint(&mut self, _step: u64, _path: &Path, _validation_psnr_db: Option<f64>) {}
    fn note(&mut self, _text: &str) {}
    fn warning(&mut self, _text: &str) {}
}

impl Watcher for () {}

/// The result of [`Session::run`].
#[derive(Clone, Debug, Serialize)]
pub struct Trained {
    pub step: u64,
    /// Number of steps of the call.
    #[serde(rename = "steps_taken")]
    pub taken: u64,
    /// Folder of the newest checkpoint, if any.
    #[serde(serialize_with = "render::path_text::optional")]
    pub checkpoint: Option<PathBuf>,
    /// Loss of the last step of the call.
    pub loss: Option<f32>,
    /// Validation PSNR of the newest checkpoint, dB.
    pub validation_psnr_db: Option<f64>,
    /// Time spent on steps, excluding checkpoints and logs, s.
    #[serde(skip)]
    pub busy_s: f64,
    /// True if the stop flag ended the call.
    #[serde(skip)]
    pub stopped: bool,
}

/// Contents of `best.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Best {
    /// Step of the checkpoint.
    pub step: u64,
    /// Mean PSNR of the validation pictures, dB.
    pub validation_psnr_db: f64,
    pub chosen_on: ChosenOn,
}

impl Best {
    /// Reads `best.json` of a stage; returns `None` if the file is missing or damaged. Fails if it cannot be read.
    pub fn read(stage_folder: &Path) -> Result<Option<Self>, TrainError> {
        let path = stage_folder.join("best.json");
        match render::input_file::read_if_there(&path) {
            Ok(bytes) => Ok(bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok())),
            Err(source) => Err(TrainError::Read { path, source }),
        }
    }

    /// Updates `best.json` if the checkpoint of `step`, with this PSNR of the validation pictures, is better, or if the best
    /// one was chosen on other pictures.
    pub(super) fn note(
        stage_folder: &Path,
        step: u64,
        psnr_db: Option<f64>,
        chosen_on: ChosenOn,
    ) -> Result<(), TrainError> {
        let best = Self::read(stage_folder)?.filter(|best| best.chosen_on == chosen_on);
        let best = best.map(|best| best.validation_psnr_db);
        let Some(validation_psnr_db) = psnr_db.filter(|db| best.is_none_or(|best| best < *db))
        else {
            return Ok(());
        };
        let json = serde_json::to_vec(&Self { step, validation_psnr_db, chosen_on });
        let json = json.map_err(candle_core::Error::wrap)?;
        Ok(atomic_file::write(&stage_folder.join("best.json"), &json)?)
    }
}

pub struct Session {
    folder: PathBuf,
    learner: Learner,
    settings: TrainSettings,
    past: Past,
    checks: Checks,
    /// First example of the session, with which each checkpoint's networks are tried.
    probe: Option<Example>,
    step: u64,
    last: Option<Last>,
}

/// The newest checkpoint.
struct Last {
    step: u64,
    path: PathBuf,
    validation_psnr_db: Option<f64>,
}

impl Session {
    /// Resumes from a checkpoint of this stage, or starts at step 0.
    pub fn new(
        folder: &Path,
        mut learner: Learner,
        settings: TrainSettings,
        past: Past,
        checks: Checks,
        from: Option<&Checkpoint>,
    ) -> Result<Self, TrainError> {
        let mut last = None;
        if let Some(checkpoint) = from {
            let state: &CheckpointState = &checkpoint.state;
            learner.set_model(&checkpoint.model, "")?;
            learner.set_moments(
                &checkpoint.moments,
                state.generator_steps,
                state.discriminator_steps,
            )?;
            last = Some(Last {
                step: state.step,
                path: checkpoint.path.clone(),
                validation_psnr_db: state.validation_psnr_db,
            });
        }
        Ok(Self {
            folder: folder.to_owned(),
            step: last.as_ref().map_or(0, |last| last.step),
            last,
            learner,
            settings,
            past,
            checks,
            probe: None,
        })
    }

    /// Trains until the schedule's end or until `stop` is set. In both cases, the last step taken has a checkpoint.
    pub fn run(
        &mut self,
        loader: &mut Loader,
        schedule: &Schedule,
        watcher: &mut dyn Watcher,
        stop: &AtomicBool,
    ) -> Result<Trained, TrainError> {
        atomic_file::create_dir(&self.folder)?;
        let mut logs = Logs::open(&self.folder, self.step)?;
        let (mut totals, mut busy_s) = (Vec::new(), 0.0);
        let mut stopped = false;
        while self.step < schedule.until {
            let clock = Instant::now();
            if stop.load(Ordering::Relaxed) {
                stopped = true;
                break;
            }
            let examples = match loader.next_step(stop) {
                Some(Ok(examples)) => examples,
                Some(Err(ExampleError::Stopped)) | None => {
                    stopped = true;
                    break;
                }
                Some(Err(error)) => {
                    // A checkpoint saves the steps so far.
                    self.write_rest(&logs, schedule, watcher)?;
                    return Err(error.into());
                }
            };
            if self.probe.is_none() {
                self.probe = examples.first().cloned();
                self.try_checkpoint()?;
                if self.last.is_none() {
                    // A training killed before its first due checkpoint resumes with its own settings.
                    self.write(None, schedule, watcher)?;
                }
            }
            let batch = Batch::new(&examples)?;
            let losses = self.learner.step(self.step, &batch, &mut |_| {})?;
            if !losses.total.is_finite() {
                return Err(TrainError::NotFinite { step: self.step + 1, loss: losses.total });
            }
            self.step += 1;
            totals.push(losses.total);
            let wall_s = clock.elapsed().as_secs_f64();
            busy_s += wall_s;
            let is_due = self.step.is_multiple_of(schedule.checkpoint_every.max(1))
                || self.step == schedule.until;
            let validated =
                if is_due { self.try_and_validate(watcher)? } else { Validated::default() };
            let logged = Logged { step: self.step, validated, wall_s, examples: examples.len() };
            if let Err(error) = self.log(&mut logs, &logged, &losses, schedule) {
                // The step is not lost, because resumed training does not repeat it; its line in a log may be.
                self.write(validated.psnr_db, schedule, watcher)?;
                return Err(error);
            }
            if is_due {
                // All other files of the step become durable first, because resumed training does not repeat the steps
                // before a checkpoint.
                let synced = logs.sync();
                self.write(validated.psnr_db, schedule, watcher)?;
                synced?;
            }
            watcher.step(self.step, &losses, wall_s);
        }
        self.write_rest(&logs, schedule, watcher)?;
        if let Some(warning) = warning_of_jumps(&totals) {
            watcher.warning(&warning);
        }
        Ok(Trained {
            step: self.step,
            taken: totals.len() as u64,
            checkpoint: self.last.as_ref().map(|last| last.path.clone()),
            validation_psnr_db: self.last.as_ref().and_then(|last| last.validation_psnr_db),
            loss: totals.last().copied(),
            busy_s,
            stopped,
        })
    }

    /// Adds a step to the logs, with pictures if they are due.
    fn log(
        &self,
        logs: &mut Logs,
        logged: &Logged,
        losses: &StepLosses,
        schedule: &Schedule,
    ) -> Result<(), TrainError> {
        logs.step(logged, losses)?;
        if schedule.has_pictures(self.step)
            && let Some(grid) = self.pictures()?
        {
            logs.pictures(self.step, self.checks.tag(), &grid)?;
        }
        Ok(())
    }

    /// Writes a checkpoint if the last one is older than the last step.
    fn write_rest(
        &mut self,
        logs: &Logs,
        schedule: &Schedule,
        watcher: &mut dyn Watcher,
    ) -> Result<(), TrainError> {
        if self.step == self.last.as_ref().map_or(0, |last| last.step) {
            return Ok(());
        }
        let synced = logs.sync();
        let validated = self.try_and_validate(watcher)?;
        self.write(validated.psnr_db, schedule, watcher)?;
        Ok(synced?)
    }

    /// Writes a checkpoint, updates `best.json` and removes old checkpoints.
    fn write(
        &mut self,
        psnr: Option<f64>,
        schedule: &Schedule,
        watcher: &mut dyn Watcher,
    ) -> Result<(), TrainError> {
        let path = write_checkpoint(
            &self.folder,
            self.step,
            &self.learner,
            &self.settings,
            &self.past,
            psnr,
        )?;
        if let Some(chosen_on) = self.checks.chosen_on.clone() {
            Best::note(&self.folder, self.step, psnr, chosen_on)?;
        }
        let best = Best::read(&self.folder)?.map(|best| best.step);
        prune(&self.folder, schedule.keep, best)
            .map_err(|source| WriteError { path: self.folder.clone(), source })?;
        watcher.checkpoint(self.step, &path, psnr);
        self.last = Some(Last { step: self.step, path, validation_psnr_db: psnr });
        Ok(())
    }

    /// Refuses a checkpoint whose weights are finite, but whose outputs are not.
    fn try_checkpoint(&self) -> Result<(), TrainError> {
        let (Some(last), Some(probe)) = (&self.last, &self.probe) else {
            return Ok(());
        };
        match self.made(probe) {
            Ok(_) => Ok(()),
            Err(error) => Err(CheckpointError::Damaged {
                path: last.path.clone(),
                reason: format!("{error}; remove it to continue from the one before"),
            }
            .into()),
        }
    }

    /// Tries the networks with an example, then compares their outputs for the validation images with the truth.
    fn try_and_validate(&self, watcher: &mut dyn Watcher) -> Result<Validated, TrainError> {
        if let Some(probe) = &self.probe {
            let step = self.step;
            let exploded = |error| CheckpointError::Exploded { step, reason: format!("{error}") };
            self.made(probe).map_err(exploded)?;
        }
        let mut validation = Validation::default();
        for example in &self.checks.validation {
            if let [input, made, truth, ..] = &self.made(example)?[..] {
                validation.add(input, made, truth)?;
            }
        }
        let validated = validation.result(self.learner.stage);
        watcher.validated(self.step, &validated);
        Ok(validated)
    }

    /// Returns an example's input, output, ground truth and other layers, with the networks at work; in the backtrack
    /// stage, none without R~ or R.
    fn made(&self, example: &Example) -> Result<Vec<Picture>, TrainError> {
        let picture = |planes: &Vec<f32>| Picture {
            rows: example.rows,
            columns: example.columns,
            planes: planes.clone(),
        };
        let whole = example.rows.max(example.columns);
        self.learner.at_work(|networks| {
            Ok(match self.learner.stage {
                Stage::Backtrack => {
                    let (Some(given), Some(truth)) =
                        (&example.glass_reflection, &example.clean_reflection)
                    else {
                        return Ok(Vec::new());
                    };
                    let tracked = networks.track_back(&picture(given), whole)?;
                    vec![picture(given), tracked, picture(truth)]
                }
                Stage::Separation => {
                    let [t, r] = networks.separate(&picture(&example.input), whole)?;
                    let black = vec![0.0; example.input.len()];
                    let known =
                        |planes: &Option<Vec<f32>>| picture(planes.as_ref().unwrap_or(&black));
                    let [glass, clean] =
                        [&example.glass_reflection, &example.clean_reflection].map(known);
                    let (input, truth) = (picture(&example.input), picture(&example.transmission));
                    let mut pictures = vec![input, t, truth, r, glass];
                    if networks.backtrack.is_some() {
                        let tracked = networks.track_back(&pictures[3], whole)?;
                        pictures.extend([tracked, clean]);
                    }
                    pictures
                }
            })
        })
    }

    /// Draws a PNG with a row per image, at most four: I, T*, T, R~*, R~ and, with BT-net, R*, R; in the backtrack stage
    /// R~, R*, R.
    fn pictures(&self) -> Result<Option<Grid>, TrainError> {
        let mut rows = Vec::new();
        let shown = self.checks.validation.iter().chain(&self.checks.shown);
        for example in shown.take(MOST_SHOWN) {
            rows.extend(Some(self.made(example)?).filter(|pictures| !pictures.is_empty()));
        }
        if rows.is_empty() {
            return Ok(None);
        }
        Ok(Some(picture_grid(&rows).map_err(candle_core::Error::wrap)?))
    }
}
