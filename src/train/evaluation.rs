//! The result of `evaluate`: a table with notes, and files with the table, the scores, the pictures and JSON.

use super::checkpoint::CheckpointState;
use super::grid::rgb_grid;
use compose::{
    Factor, INPUT, LeftOut, MethodSummary, Protocol, Row, Rules, Scored, SeedGroup, means_tables,
    per_image_csv, summaries,
};
use image::RgbImage;
use plan::{ExampleKind, FeatureSource};
use render::atomic_file::{self, WriteError};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::{self, Write};
use std::fs::File;
use std::path::{Path, PathBuf};

pub const EVALUATION_SCHEMA: &str = "glasshouse.evaluate/2";

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

/// A folder of outputs that was scored.
#[derive(Clone, Debug, Serialize)]
pub struct ScoredOutputs {
    /// Name of the row in the table.
    pub method: String,
    #[serde(serialize_with = "render::path_text::one")]
    pub path: PathBuf,
}

/// What was scored and how.
#[derive(Clone, Debug, Serialize)]
pub struct Conditions {
    /// Folder of the run or of the pairs, or file of the index.
    #[serde(rename = "where")]
    pub place: String,
    pub split: Option<&'static str>,
    /// Length to which larger pictures were scaled down, px; `None` without scaling.
    pub longest_px: Option<u32>,
    /// Side of the networks' tiles, px; `None` for whole pictures.
    pub tile_px: Option<u32>,
    /// Rules that a network must beat.
    pub baselines: Rules,
    #[serde(rename = "checkpoints")]
    pub networks: Vec<ScoredNetwork>,
    pub outputs: Vec<ScoredOutputs>,
    /// Networks that differ in their seed alone, with the row of their means.
    pub seeds: Vec<SeedGroup>,
    #[serde(skip)]
    pub protocol: Protocol,
}

/// The result of an evaluation, with the keys of [`EVALUATION_SCHEMA`].
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    #[serde(flatten)]
    pub(super) conditions: Conditions,
    /// Number of scored pictures.
    images: usize,
    bits: u8,
    /// Mean scores by group, then by method.
    #[serde(rename = "rows")]
    summaries: Vec<MethodSummary>,
    /// Best factor of the input for each group.
    pub(super) group_factors: BTreeMap<String, Factor>,
    /// Names of the columns of the picture, without the truth.
    columns: Vec<String>,
    /// Pictures that were not scored, with reasons.
    left_out: Vec<LeftOut>,
    #[serde(serialize_with = "render::path_text::each")]
    files: Vec<PathBuf>,
    /// Number of threads; omitted from the file, which has the same bytes for any number of threads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threads: Option<usize>,
    /// Scores by method, then by picture.
    #[serde(skip)]
    pub(super) rows: Vec<Row>,
    /// Reduced pictures of the columns and the truth.
    #[serde(skip)]
    pictures: Vec<Vec<RgbImage>>,
}

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    #[serde(flatten)]
    evaluation: &'a Evaluation,
}

impl Evaluation {
    /// Summarises scores. `left_out` lists pictures without scores.
    pub fn new(conditions: Conditions, scored: Scored, left_out: Vec<LeftOut>) -> Self {
        let Scored { rows, kept, columns, group_factors, .. } = scored;
        let veil = conditions.baselines.veil.map(compose::VeilRule::row_name);
        let summaries = summaries(&rows, veil.as_deref(), &conditions.seeds);
        Self {
            conditions,
            images: rows.iter().filter(|row| row.method == INPUT).count(),
            bits: 8,
            summaries,
            group_factors: group_factors.into_iter().collect(),
            columns,
            left_out,
            files: Vec::new(),
            threads: None,
            rows,
            pictures: kept,
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

    /// Writes [`Self::FILES`].
    pub fn write(&mut self, folder: &Path) -> Result<(), EvaluationError> {
        let grid = rgb_grid(&self.pictures)?;
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

    /// Returns the tables and the notes below them.
    fn table(&self) -> [String; 2] {
        let veil = self.conditions.baselines.veil.map(compose::VeilRule::row_name);
        let protocol = self.conditions.protocol;
        let table = means_tables(&self.summaries, &self.rows, veil.as_deref(), protocol);
        [table, self.notes()]
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
            for LeftOut { image, reason, .. } in &self.left_out {
                let _ = writeln!(text, "- {image}: {reason}");
            }
        }
        text
    }

    /// Returns the numbers of scored and left-out pictures and their source as one line.
    fn what(&self) -> String {
        let conditions = &self.conditions;
        let what = match conditions.split {
            Some("all") => counted(self.images, "scene"),
            Some(split) => counted(self.images, &format!("{split} scene")),
            None => counted(self.images, "pair"),
        };
        let left_out = match self.left_out.len() {
            0 => String::new(),
            count => format!("; left out: {}", counted(count, "picture")),
        };
        format!("{what} of {}{left_out}.", conditions.place)
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
pub(super) fn counted(count: usize, what: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} {what}{plural}")
}
