//! The result of `evaluate`: a table with notes, and files with the table, the scores, the pictures and JSON.

use super::checkpoint::CheckpointState;
use super::picture::rgb_grid;
use compose::{Gain, LeftOut, MethodMeans, Protocol, Row, means_table, per_image_csv};
use image::RgbImage;
use plan::{ExampleKind, FeatureSource};
use render::atomic_file::{self, WriteError};
use serde::Serialize;
use std::fmt::{self, Write};
use std::fs::File;
use std::path::{Path, PathBuf};

pub const EVALUATION_SCHEMA: &str = "glasshouse.evaluate/1";

#[derive(Debug, thiserror::Error)]
pub enum EvaluationError {
    #[error(transparent)]
    Write(#[from] WriteError),
    #[error("cannot encode the scored pictures as PNG: {0}")]
    Picture(#[from] image::ImageError),
    #[error("cannot encode the scores as JSON: {0}")]
    Json(#[from] serde_json::Error),
}

#[derive(Clone, Debug, Serialize)]
pub struct ScoredNetwork {
    /// Name of the network's row in the table.
    pub method: String,
    /// Folder of the checkpoint.
    #[serde(serialize_with = "render::path_text::one")]
    pub path: PathBuf,
    stage: &'static str,
    step: u64,
    features: FeatureSource,
    examples: ExampleKind,
    a_priori: bool,
}

impl ScoredNetwork {
    pub fn new(method: String, path: PathBuf, state: &CheckpointState) -> Self {
        Self {
            method,
            path,
            stage: state.stage.name(),
            step: state.step,
            features: state.settings.features,
            examples: state.settings.examples,
            a_priori: state.settings.a_priori,
        }
    }
}

/// The result of an evaluation, with the keys of [`EVALUATION_SCHEMA`].
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// Folder of the run, or of the pairs.
    #[serde(rename = "where")]
    pub place: String,
    pub split: Option<&'static str>,
    pub images: usize,
    resized: bool,
    bits: u8,
    /// Side of the networks' tiles, px.
    pub tile_px: u32,
    #[serde(rename = "rows")]
    pub means: Vec<MethodMeans>,
    /// Best constant factor of the input; its scores show the effect of brightness alone.
    pub gain: Option<Gain>,
    #[serde(rename = "checkpoints")]
    pub networks: Vec<ScoredNetwork>,
    /// Pictures that were not scored, with reasons.
    pub left_out: Vec<LeftOut>,
    #[serde(serialize_with = "render::path_text::each")]
    pub files: Vec<PathBuf>,
    /// Number of threads; omitted from the file, which has the same bytes for any number of threads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threads: Option<usize>,
    /// Scores by method, then by picture.
    #[serde(skip)]
    rows: Vec<Row>,
    #[serde(skip)]
    protocol: Protocol,
}

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    #[serde(flatten)]
    evaluation: &'a Evaluation,
}

impl Evaluation {
    pub fn new(place: String, methods: &[String], rows: Vec<Row>, protocol: Protocol) -> Self {
        Self {
            place,
            split: None,
            images: rows.len() / methods.len().max(1),
            resized: false,
            bits: 8,
            tile_px: 0,
            means: methods.iter().map(|method| MethodMeans::of(method, &rows)).collect(),
            gain: None,
            networks: Vec::new(),
            left_out: Vec::new(),
            files: Vec::new(),
            threads: None,
            rows,
            protocol,
        }
    }

    /// Names of the files of [`Self::write`]: table, scores per picture, pictures, all results.
    pub const FILES: [&str; 4] =
        ["evaluation.md", "evaluation.csv", "evaluation.png", "evaluation.json"];

    /// Creates a run's folder of evaluations and removes the temporary files of killed processes from it. Locks the
    /// folder until the returned file is dropped: other evaluations of the run wait.
    pub fn claim(folder: &Path) -> Result<File, WriteError> {
        atomic_file::create_dir(folder)?;
        let failed = |source| WriteError { path: folder.to_owned(), source };
        let lock = File::open(folder).map_err(failed)?;
        lock.lock().map_err(failed)?;
        atomic_file::sweep(folder, 0, &atomic_file::is_temporary);
        Ok(lock)
    }

    /// Writes [`Self::FILES`]; `pictures` are the rows of the picture.
    pub fn write(
        &mut self,
        folder: &Path,
        pictures: &[Vec<RgbImage>],
    ) -> Result<(), EvaluationError> {
        let grid = rgb_grid(pictures)?;
        let [markdown, csv, png, json] = Self::FILES.map(|name| folder.join(name));
        self.files = [&markdown, &csv, &png, &json].map(Clone::clone).to_vec();
        let mut pretty = serde_json::to_string_pretty(&Document {
            schema: EVALUATION_SCHEMA,
            evaluation: self,
        })?;
        pretty.push('\n');
        atomic_file::create_dir(folder)?;
        atomic_file::write(&markdown, self.markdown().as_bytes())?;
        atomic_file::write(&csv, per_image_csv(&self.rows).as_bytes())?;
        atomic_file::write(&png, &grid.png)?;
        atomic_file::write(&json, pretty.as_bytes())?;
        Ok(())
    }

    /// Returns the table and the notes below it.
    fn table(&self) -> [String; 2] {
        let mut notes =
            "Protocol: no resizing; scored as 8-bit sRGB. Means over images.\ninput: the unchanged pictures.\n".to_owned();
        if let Some(gain) = &self.gain {
            let _ = writeln!(
                notes,
                "{}: linear light times the best factor for {} of {}, which shows the effect of brightness alone.",
                gain.row_name(),
                counted(gain.images, gain.kind),
                gain.fitted_to,
            );
        }
        for network in &self.networks {
            let _ = writeln!(notes, "{}: {}.", network.method, network.path.display());
        }
        let is_tiled = |row: &&Row| row.width.max(row.height) > self.tile_px;
        let inputs = self.rows.iter().filter(|row| row.method == "input");
        let tiled = inputs.filter(is_tiled).count();
        if tiled > 0 && !self.networks.is_empty() {
            let _ = writeln!(
                notes,
                "Networks processed {} in overlapping tiles of {} px and normalised each tile separately.",
                counted(tiled, "picture"),
                self.tile_px,
            );
        }
        [means_table(&self.rows, self.protocol), notes]
    }

    /// Returns the evaluation as a Markdown document.
    fn markdown(&self) -> String {
        let [table, notes] = self.table();
        let mut text = format!("# Evaluation\n\n{}\n\n{table}\n", self.what());
        // The notes form a list because Markdown joins consecutive lines.
        for note in notes.lines() {
            let _ = writeln!(text, "- {note}");
        }
        if !self.left_out.is_empty() {
            text += "\n## Left out\n\n";
            for LeftOut { image, reason } in &self.left_out {
                let _ = writeln!(text, "- {image}: {reason}");
            }
        }
        text
    }

    /// Returns the numbers of scored and left-out pictures and their source as one line.
    fn what(&self) -> String {
        let what = match self.split {
            Some("all") => counted(self.images, "scene"),
            Some(split) => counted(self.images, &format!("{split} scene")),
            None => counted(self.images, "pair"),
        };
        let left_out = match self.left_out.len() {
            0 => String::new(),
            count => format!("; left out: {}", counted(count, "picture")),
        };
        format!("{what} of {}{left_out}.", self.place)
    }
}

impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [table, notes] = self.table();
        write!(f, "{}\n\n{table}\n{}", self.what(), notes.trim_end())?;
        if let Some((first, rest)) = self.files.split_first() {
            write!(f, "\n\n{}", first.display())?;
            for file in rest {
                write!(f, "\n{}", file.display())?;
            }
        }
        Ok(())
    }
}

/// Formats a count with its noun: `1 pair`, `2 pairs`.
fn counted(count: usize, what: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} {what}{plural}")
}
