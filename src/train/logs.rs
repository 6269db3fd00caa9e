//! The logs of a training: `metrics.csv` and TensorBoard's events.

use super::events::EventFile;
use super::grid::Grid;
use super::learner::StepLosses;
use super::metrics::Metrics;
use super::validation::Validated;
use render::atomic_file::{self, WriteError};
use std::io;
use std::path::{Path, PathBuf};

pub(super) struct Logs {
    folder: PathBuf,
    csv: PathBuf,
    metrics: Metrics,
    events: EventFile,
}

/// Numbers of one step besides its losses.
pub(super) struct Logged {
    pub(super) step: u64,
    pub(super) validated: Validated,
    /// Duration of the step, s.
    pub(super) wall_s: f64,
    /// Number of examples of the step.
    pub(super) examples: usize,
}

impl Logs {
    /// Opens the logs of a stage's folder for training that continues at `step`.
    pub(super) fn open(folder: &Path, step: u64) -> Result<Self, WriteError> {
        let csv = folder.join("metrics.csv");
        let metrics = Metrics::open(&csv, step);
        let metrics = metrics.map_err(|source| WriteError { path: csv.clone(), source })?;
        let events = EventFile::create(folder, step)?;
        Ok(Self { folder: folder.to_owned(), csv, metrics, events })
    }

    /// Adds a step.
    pub(super) fn step(&mut self, logged: &Logged, losses: &StepLosses) -> Result<(), WriteError> {
        let Logged { step, validated, wall_s, examples } = *logged;
        let added = self.metrics.add(step, losses, validated, wall_s);
        self.of_csv(added)?;
        let mut numbers: Vec<(&str, f32)> = vec![("loss/total", losses.total)];
        let tags: Vec<String> = losses.terms.iter().map(|t| format!("loss/{}", t.name)).collect();
        let terms = tags.iter().zip(&losses.terms);
        numbers.extend(terms.map(|(tag, term)| (tag.as_str(), term.value)));
        numbers.extend(losses.discriminator.map(|v| ("loss/discriminator", v)));
        numbers.extend(validated.psnr_db.map(|v| ("validation/psnr_db", v as f32)));
        numbers.extend(validated.light_ratio.map(|v| ("validation/light_ratio", v as f32)));
        numbers.push(("speed/images_per_s", (examples as f64 / wall_s) as f32));
        let added = self.events.scalars(step, &numbers);
        self.of_events(added)
    }

    /// Adds the pictures of a step; `tag` is their name in the events.
    pub(super) fn pictures(&mut self, step: u64, tag: &str, grid: &Grid) -> Result<(), WriteError> {
        let folder = self.folder.join("pictures");
        atomic_file::create_dir(&folder)?;
        atomic_file::write(&folder.join(format!("step-{step:07}.png")), &grid.png)?;
        let added = self.events.picture(step, tag, grid.size, &grid.png);
        self.of_events(added)
    }

    /// Makes everything durable.
    pub(super) fn sync(&self) -> Result<(), WriteError> {
        self.of_csv(self.metrics.sync())?;
        self.of_events(self.events.sync())
    }

    fn of_csv(&self, result: io::Result<()>) -> Result<(), WriteError> {
        result.map_err(|source| WriteError { path: self.csv.clone(), source })
    }

    fn of_events(&self, result: io::Result<()>) -> Result<(), WriteError> {
        result.map_err(|source| WriteError { path: self.events.path.clone(), source })
    }
}
