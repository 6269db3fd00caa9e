//! A training: step after step, watched, written down, resumed.

use super::batch::Batch;
use super::checkpoint::{Checkpoint, CheckpointState, Origin, prune, write_checkpoint};
use super::error::TrainError;
use super::events::EventFile;
use super::example::Example;
use super::learner::{Learner, StepLosses};
use super::loader::Loader;
use super::metrics::Metrics;
use super::picture::{Grid, Picture, picture_grid};
use super::source::ExampleError;
use compose::psnr_colour_db;
use plan::{Stage, TrainSettings};
use render::atomic_file::{self, WriteError};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// PSNR of pictures that are equal, dB, so that means stay numbers.
const MOST_DB: f64 = 100.0;

/// When what is done. None of it changes what is learned.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    pub until: u64,
    /// A checkpoint every so many steps; the last step has one anyway.
    pub checkpoint_every: u64,
    /// Checkpoints that are kept, besides the best.
    pub keep: usize,
    /// A grid of pictures every so many steps; 0 for none.
    pub pictures_every: u64,
}

/// Told of what happens.
pub trait Watcher {
    /// All is ready: these steps are taken next, each of so many examples.
    fn begins(&mut self, _steps: Range<u64>, _batch: usize) {}
    /// A step was taken.
    fn step(&mut self, _step: u64, _losses: &StepLosses, _wall_s: f64) {}
    /// A checkpoint was written.
    fn checkpoint(&mut self, _step: u64, _path: &Path, _validation_psnr_db: Option<f64>) {}
    /// Something that may be worth knowing.
    fn note(&mut self, _text: &str) {}
    /// Something that should be known.
    fn warning(&mut self, _text: &str) {}
}

impl Watcher for () {}

/// How a training ended.
#[derive(Clone, Debug, Serialize)]
pub struct Trained {
    pub step: u64,
    /// Steps that were taken now.
    #[serde(rename = "steps_taken")]
    pub taken: u64,
    /// The newest checkpoint, if a step was ever taken.
    pub checkpoint: Option<PathBuf>,
    /// Loss of the last step that was taken now.
    pub loss: Option<f32>,
    /// The newest checkpoint's validation, dB.
    pub validation_psnr_db: Option<f64>,
    /// Seconds of the steps, without what is written between them.
    #[serde(skip)]
    pub busy_s: f64,
    /// It was told to stop.
    #[serde(skip)]
    pub stopped: bool,
}

/// `best.json`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Best {
    /// Step of the checkpoint.
    pub step: u64,
    /// Mean over the validation scenes, dB.
    pub validation_psnr_db: f64,
}

impl Best {
    /// The best checkpoint of a stage, if any was validated.
    pub fn read(stage_folder: &Path) -> Option<Self> {
        let bytes = std::fs::read(stage_folder.join("best.json")).ok()?;
        serde_json::from_slice(&bytes).ok()
    }
}

/// A training that can be taken further.
pub struct Session {
    folder: PathBuf,
    learner: Learner,
    settings: TrainSettings,
    origin: Origin,
    /// Whole images that nothing is learned from.
    validation: Vec<Example>,
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
    /// Goes on from a checkpoint of this stage, or begins.
    pub fn new(
        folder: &Path,
        mut learner: Learner,
        settings: TrainSettings,
        origin: Origin,
        validation: Vec<Example>,
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
            origin,
            validation,
        })
    }

    pub fn steps_taken(&self) -> u64 {
        self.step
    }

    /// Takes steps until the schedule's end, or until `stop` is set; either way what was learned is written.
    pub fn run(
        &mut self,
        loader: &mut Loader,
        schedule: &Schedule,
        watcher: &mut dyn Watcher,
        stop: &AtomicBool,
    ) -> Result<Trained, TrainError> {
        atomic_file::create_dir(&self.folder)?;
        let write_error = |path: PathBuf| move |source| WriteError { path, source };
        let csv = self.folder.join("metrics.csv");
        let mut metrics = Metrics::open(&csv, self.step).map_err(write_error(csv.clone()))?;
        let mut events = EventFile::create(&self.folder, self.step)
            .map_err(write_error(self.folder.join("events.out.tfevents")))?;
        let (mut taken, mut loss, mut busy_s) = (0, None, 0.0);
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
                    // What was learned until here is not lost.
                    self.write_rest(&metrics, schedule, watcher)?;
                    return Err(error.into());
                }
            };
            let batch = Batch::new(&examples, self.learner.device())?;
            let losses = self.learner.step(self.step, &batch, &mut |_| {})?;
            if !losses.total.is_finite() {
                return Err(TrainError::NotFinite { step: self.step + 1, loss: losses.total });
            }
            self.step += 1;
            taken += 1;
            loss = Some(losses.total);
            let wall_s = clock.elapsed().as_secs_f64();
            busy_s += wall_s;
            let is_due = self.step.is_multiple_of(schedule.checkpoint_every.max(1))
                || self.step == schedule.until;
            let validated = if is_due { self.validate()? } else { None };
            metrics.add(self.step, &losses, validated, wall_s).map_err(write_error(csv.clone()))?;
            if is_due {
                // The line first, and durably: what a checkpoint holds is not taken, and so not noted, again.
                metrics.sync().map_err(write_error(csv.clone()))?;
                self.write(validated, schedule, watcher)?;
            }
            let mut numbers: Vec<(&str, f32)> = vec![("loss/total", losses.total)];
            let tags: Vec<String> =
                losses.terms.iter().map(|t| format!("loss/{}", t.name)).collect();
            let terms = tags.iter().zip(&losses.terms);
            numbers.extend(terms.map(|(tag, term)| (tag.as_str(), term.value)));
            numbers.extend(losses.discriminator.map(|v| ("loss/discriminator", v)));
            numbers.extend(validated.map(|v| ("validation/psnr_db", v as f32)));
            numbers.push(("speed/images_per_s", (examples.len() as f64 / wall_s) as f32));
            events
                .scalars(self.step, &numbers)
                .map_err(write_error(self.folder.join("events.out.tfevents")))?;
            if schedule.pictures_every > 0
                && (self.step.is_multiple_of(schedule.pictures_every)
                    || self.step == schedule.until)
                && let Some(Grid { png, size }) = self.pictures()?
            {
                let folder = self.folder.join("pictures");
                atomic_file::create_dir(&folder)?;
                let path = folder.join(format!("step-{:07}.png", self.step));
                atomic_file::write_relaxed(&path, &png)?;
                events
                    .picture(self.step, "validation", size, &png)
                    .map_err(write_error(self.folder.join("events.out.tfevents")))?;
            }
            watcher.step(self.step, &losses, wall_s);
        }
        self.write_rest(&metrics, schedule, watcher)?;
        Ok(Trained {
            step: self.step,
            taken,
            checkpoint: self.last.as_ref().map(|last| last.path.clone()),
            validation_psnr_db: self.last.as_ref().and_then(|last| last.validation_psnr_db),
            loss,
            busy_s,
            stopped,
        })
    }

    /// Writes a checkpoint of the steps that none holds yet, if there are any.
    fn write_rest(
        &mut self,
        metrics: &Metrics,
        schedule: &Schedule,
        watcher: &mut dyn Watcher,
    ) -> Result<(), TrainError> {
        if self.step == self.last.as_ref().map_or(0, |last| last.step) {
            return Ok(());
        }
        let path = self.folder.join("metrics.csv");
        metrics.sync().map_err(|source| WriteError { path, source })?;
        let psnr = self.validate()?;
        self.write(psnr, schedule, watcher)
    }

    /// Writes a checkpoint of now and removes old ones.
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
            &self.origin,
            psnr,
        )?;
        if let Some(validation_psnr_db) = psnr
            && Best::read(&self.folder).is_none_or(|b| b.validation_psnr_db < validation_psnr_db)
        {
            let best = Best { step: self.step, validation_psnr_db };
            let json = serde_json::to_vec(&best).map_err(candle_core::Error::wrap)?;
            atomic_file::write(&self.folder.join("best.json"), &json)?;
        }
        let best = Best::read(&self.folder).map(|best| best.step);
        prune(&self.folder, schedule.keep, best)
            .map_err(|source| WriteError { path: self.folder.clone(), source })?;
        watcher.checkpoint(self.step, &path, psnr);
        self.last = Some(Last { step: self.step, path, validation_psnr_db: psnr });
        Ok(())
    }

    /// Mean PSNR of what is made of the validation images, dB, as 8-bit pictures.
    fn validate(&self) -> Result<Option<f64>, TrainError> {
        let mut sum = 0.0;
        let mut count = 0u32;
        for example in &self.validation {
            let Some((made, truth)) = self.made(example)?.last_pair() else {
                continue;
            };
            // Of equal pictures it is infinite.
            let psnr_db = psnr_colour_db(&made.to_rgb(), &truth.to_rgb());
            sum += psnr_db.map_err(candle_core::Error::wrap)?.min(MOST_DB);
            count += 1;
        }
        Ok((count > 0).then(|| sum / f64::from(count)))
    }

    /// What the networks make of an example, beside what they were given and should have made.
    fn made(&self, example: &Example) -> Result<Made, TrainError> {
        let picture = |planes: &Vec<f32>| Picture {
            rows: example.rows,
            columns: example.columns,
            planes: planes.clone(),
        };
        let networks = self.learner.networks();
        let whole = example.rows.max(example.columns);
        let mut made = Made::default();
        match self.learner.stage {
            Stage::Backtrack => {
                let (Some(given), Some(truth)) =
                    (&example.glass_reflection, &example.clean_reflection)
                else {
                    return Ok(made);
                };
                let tracked = networks.track_back(&picture(given), whole)?;
                made.pictures = vec![picture(given), tracked, picture(truth)];
                made.compared = Some([1, 2]);
            }
            Stage::Separation => {
                let [t, r] = networks.separate(&picture(&example.input), whole)?;
                let tracked = networks.track_back(&r, whole)?;
                made.pictures = vec![picture(&example.input), t, picture(&example.transmission), r];
                let black = vec![0.0; example.input.len()];
                let known = |planes: &Option<Vec<f32>>| picture(planes.as_ref().unwrap_or(&black));
                made.pictures.push(known(&example.glass_reflection));
                made.pictures.push(tracked);
                made.pictures.push(known(&example.clean_reflection));
                made.compared = Some([1, 2]);
            }
        }
        Ok(made)
    }

    /// A PNG with a row for each validation image: I, T*, T, R~*, R~, R*, R, or R~, R*, R.
    fn pictures(&self) -> Result<Option<Grid>, TrainError> {
        let mut rows = Vec::new();
        for example in self.validation.iter().take(4) {
            let made = self.made(example)?;
            if !made.pictures.is_empty() {
                rows.push(made.pictures);
            }
        }
        if rows.is_empty() {
            return Ok(None);
        }
        let grid = picture_grid(&rows).map_err(candle_core::Error::wrap)?;
        Ok(Some(grid))
    }
}

/// Pictures of one example.
#[derive(Default)]
struct Made {
    pictures: Vec<Picture>,
    /// Which of them is held against which.
    compared: Option<[usize; 2]>,
}

impl Made {
    fn last_pair(mut self) -> Option<(Picture, Picture)> {
        let [made, truth] = self.compared?;
        let truth = self.pictures.swap_remove(truth);
        Some((self.pictures.swap_remove(made), truth))
    }
}
