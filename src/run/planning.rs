//! `plan`: a recipe or a `.jsonl` becomes `RUN/manifest.jsonl` and `RUN/spec.json`, frozen.

use super::run_dir::{Run, RunDir, RunError};
use plan::{
    DraftError, Drafted, InputFiles, InvalidInput, ProceduralPhotograph, RejectedScene, Request, draft,
    inputs_folder, invalid_text, make_photographs, rejected_lines,
};
use procedural::SampleError;
use render::atomic_file::{self, WriteError};
use render::line::{Roots, SceneLine, to_jsonl};
use render::shard::{SPEC_SCHEMA, Spec, SpecMismatch, choose_tile_px, golden, manifest_digest};
use render::trace::{Isa, TRACER_VERSION};
use std::path::Path;

/// How to plan.
pub struct PlanOptions<'a> {
    /// `--root NAME=DIR`.
    pub roots: &'a Roots,
    /// Lists roots that are in an object store.
    pub inputs: &'a dyn InputFiles,
    /// Side of a tile, px; chosen if `None`.
    pub tile_px: Option<u32>,
    /// Write nothing.
    pub dry_run: bool,
    /// Leave out photographs whose files cannot be used (of a manifest: scenes), and go on.
    pub skip_invalid: bool,
    /// Threads that look at input files and make procedural photographs.
    pub threads: usize,
}

/// A plan, written or not.
#[derive(Debug)]
pub struct Planned {
    /// The run's rules.
    pub spec: Spec,
    /// Its scenes.
    pub lines: Vec<SceneLine>,
    /// The run was there already, with the same plan.
    pub existed: bool,
    /// What a reader should know: images without depth, scenes paired less well than wished.
    pub notes: Vec<String>,
    /// Draws that were looked at and not kept.
    pub rejected: Vec<RejectedScene>,
    /// Files that cannot be used, by path.
    pub invalid: Vec<InvalidInput>,
    /// Input files that were looked at.
    pub files: usize,
    /// What is left out, in a word: photographs, or scenes.
    pub parts: &'static str,
    /// Size of the input files together; `None` where they were not looked at, as the run was there already.
    pub input_bytes: Option<u64>,
    /// About what procedural photographs take in the run's folder, bytes.
    pub made_bytes: u64,
}

impl Planned {
    /// What of the input files is wrong, as a table, and what was done about it; nothing if all is well.
    pub fn invalid_text(&self) -> Option<String> {
        if self.invalid.is_empty() {
            return None;
        }
        let table = invalid_text(&self.invalid, self.files);
        let (count, parts) = (self.spec.left_out.len(), self.parts);
        let done = match self.parts {
            _ if self.existed => {
                "the run is planned and stays as it is: scenes that cannot be made will be set aside".to_owned()
            }
            _ if count == 0 => {
                "scenes that need them will be set aside with these reasons; --skip-invalid leaves them out".to_owned()
            }
            "photographs" => format!("{parts} left out: {count}; others were drawn in their place"),
            _ => format!("{parts} left out: {count}"),
        };
        Some(format!("{table}{done}"))
    }
}

/// A recipe that cannot be planned.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The recipe or manifest gives no scenes.
    #[error(transparent)]
    Draft(#[from] DraftError),
    /// The run is another one.
    #[error(transparent)]
    Mismatch(#[from] SpecMismatch),
    /// The run that is there cannot be opened.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The disk.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Procedural photographs cannot be written.
    #[error(transparent)]
    Sample(#[from] SampleError),
}

/// Plans `source` into the folder `out`. `on_progress` receives (what, done, all) as files are checked, scenes previewed and
/// photographs made.
pub fn plan_run(
    source: &Path,
    out: &Path,
    options: &PlanOptions,
    on_progress: &(dyn Fn(&'static str, usize, usize) + Sync),
) -> Result<Planned, PlanError> {
    let existing = match Run::open(out, options.roots) {
        Ok(run) => Some(run),
        Err(RunError::Missing { .. }) => None,
        Err(error) => return Err(error.into()),
    };
    // A run keeps what was left out of it, whatever has become of the files.
    let left_out = existing.iter().flat_map(|run| run.spec.left_out.clone());
    let request = Request {
        roots: options.roots,
        inputs: options.inputs,
        run: out,
        left_out: left_out.collect(),
        is_planned: existing.is_some(),
        checks_files: existing.is_none() || options.dry_run,
        skip_invalid: options.skip_invalid,
        threads: options.threads,
    };
    let drafted = draft(source, &request, on_progress)?;
    let manifest = to_jsonl(&drafted.lines);
    let tile_px = options
        .tile_px
        .or(existing.as_ref().map(|run| run.spec.tile_px))
        .unwrap_or_else(|| choose_tile_px(&drafted.lines));
    let spec = Spec {
        schema: SPEC_SCHEMA.to_owned(),
        name: drafted.name.clone(),
        scenes: drafted.lines.len() as u32,
        manifest_blake3: manifest_digest(&manifest),
        tile_px,
        tracer_version: TRACER_VERSION,
        golden: golden(Isa::detect(), options.threads),
        roots: drafted.roots.clone(),
        left_out: drafted.left_out.iter().cloned().collect(),
    };
    if let Some(run) = &existing {
        let diff = run.spec.diff(&run.lines, &spec, &drafted.lines);
        if !diff.is_empty() {
            return Err(SpecMismatch {
                run: out.to_owned(),
                diff,
            }
            .into());
        }
    }
    if !options.dry_run {
        let on_photograph = |done, all| on_progress("photographs", done, all);
        write_inputs(out, &drafted, options.threads, &on_photograph)?;
        if existing.is_none() {
            write_plan(out, &drafted, &manifest, &spec)?;
        }
    }
    let pictures = drafted.pictures.iter().map(|p| p.2.len() as u64);
    Ok(Planned {
        spec,
        existed: existing.is_some(),
        notes: drafted.notes,
        rejected: drafted.rejected,
        invalid: drafted.invalid,
        files: drafted.files,
        parts: drafted.left_out_kind,
        input_bytes: drafted.input_bytes,
        made_bytes: drafted.to_make.iter().map(ProceduralPhotograph::estimated_bytes).sum::<u64>() + pictures.sum::<u64>(),
        lines: drafted.lines,
    })
}

/// Writes the photographs and pictures that the plan itself makes, where they are missing.
fn write_inputs(
    out: &Path,
    drafted: &Drafted,
    threads: usize,
    on_photograph: &(dyn Fn(usize, usize) + Sync),
) -> Result<(), PlanError> {
    atomic_file::create_dir(out)?;
    for (root, name, bytes) in &drafted.pictures {
        let folder = inputs_folder(out, root);
        atomic_file::create_dir(&folder)?;
        atomic_file::write_relaxed(&folder.join(name), bytes)?;
    }
    Ok(make_photographs(
        out,
        &drafted.to_make,
        threads,
        on_photograph,
    )?)
}

fn write_plan(out: &Path, drafted: &Drafted, manifest: &str, spec: &Spec) -> Result<(), PlanError> {
    let dir = RunDir::new(out);
    if !drafted.rejected.is_empty() {
        let lines = rejected_lines(&drafted.rejected);
        atomic_file::write(&dir.rejected(), lines.as_bytes())?;
    }
    atomic_file::write(&dir.manifest(), manifest.as_bytes())?;
    // Last: a run is planned as soon as its spec exists.
    let mut json = serde_json::to_string_pretty(spec).expect("a spec is JSON");
    json.push('\n');
    Ok(atomic_file::write(&dir.spec(), json.as_bytes())?)
}
