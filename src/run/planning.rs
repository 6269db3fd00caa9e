//! `plan`: writes `RUN/manifest.jsonl` and `RUN/spec.json` from a recipe or a `.jsonl`. Later calls do not change these
//! files.

use super::error::RunError;
use super::keys;
use super::open::{Run, lock};
use glasshouse_line::{Roots, SceneLine, to_jsonl};
use plan::{
    DraftError, Drafted, InputFiles, ProceduralInput, Request, draft, invalid_text, make_inputs,
    rejected_lines,
};
use procedural::SampleError;
use render::atomic_file::{self, WriteError, is_temporary};
use render::folder_lock::FolderLock;
use render::shard::{
    Golden, SPEC_SCHEMA, ShardLayout, Spec, SpecMismatch, TooManyShards, choose_tile_px, golden,
    manifest_digest,
};
use render::trace::{Isa, TRACER_VERSION};
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

pub(crate) struct PlanOptions<'a> {
    /// Roots from `--root NAME=DIR`.
    pub(crate) roots: &'a Roots,
    /// Reader of input files, which also lists roots in object stores.
    pub(crate) inputs: &'a dyn InputFiles,
    /// Side of a tile, px; `None` lets the planner choose.
    pub(crate) tile_px: Option<u32>,
    pub(crate) dry_run: bool,
    /// True if planning leaves out photographs with unusable files (for a `.jsonl`, scenes).
    pub(crate) skip_invalid: bool,
    /// Number of scenes to plan, spread over all, for measurements; `None` plans all.
    pub(crate) only: Option<usize>,
    /// The golden shard, if the caller has traced it.
    pub(crate) golden: Option<Golden>,
    /// Content of [`keys::TRAIN`], if the recipe has a `[train]` table.
    pub(crate) training: Option<&'a str>,
    /// Number of threads that check input files, preview scenes, trace the golden shard and make photographs.
    pub(crate) threads: usize,
}

/// A plan; a dry run does not write it.
#[derive(Debug)]
pub(crate) struct Planned {
    pub(crate) spec: Spec,
    pub(crate) drafted: Drafted,
    /// True if the folder already had the same plan.
    pub(crate) existed: bool,
}

impl Planned {
    /// Estimates the size of the procedural pictures in the run's folder, bytes.
    pub(crate) fn made_bytes(&self) -> u64 {
        self.drafted.to_make.iter().map(ProceduralInput::estimated_bytes).sum()
    }

    /// Formats a table of the unusable input files and their treatment; returns `None` if all files are usable.
    pub(crate) fn invalid_text(&self) -> Option<String> {
        let Drafted { invalid, files, left_out_kind: parts, .. } = &self.drafted;
        if invalid.is_empty() {
            return None;
        }
        let table = invalid_text(invalid, *files);
        let count = self.spec.left_out.len();
        let done = match *parts {
            _ if self.existed => {
                "the run is already planned and does not change: scenes that cannot be made go into quarantine".to_owned()
            }
            _ if count == 0 => {
                "scenes that need them go into quarantine with these reasons; --skip-invalid leaves them out".to_owned()
            }
            "photographs" => format!("{parts} left out: {count}; others were drawn in their place"),
            _ => format!("{parts} left out: {count}"),
        };
        Some(format!("{table}{done}"))
    }
}

/// Reason why a recipe or manifest cannot be planned.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The recipe or manifest cannot be turned into scenes.
    #[error(transparent)]
    Draft(#[from] DraftError),
    /// The folder holds a run of another plan.
    #[error(transparent)]
    Mismatch(#[from] SpecMismatch),
    /// The folder's run cannot be opened.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The folder holds a file of the user where planning would write.
    #[error("{} exists, and no `glasshouse plan` wrote it; plan into another folder with --out, or remove it", path.display())]
    Foreign { path: PathBuf },
    /// `--tile` divides a scene into too many shards.
    #[error(transparent)]
    Tile(#[from] TooManyShards),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// Procedural photographs cannot be encoded or written.
    #[error(transparent)]
    Sample(#[from] SampleError),
}

/// Plans `source` into the folder `out`. Calls `on_progress` with (step, done, all) while it checks files, previews
/// scenes and makes photographs.
pub(crate) fn plan_run(
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
    if existing.is_none() {
        // Drawing may take minutes; a wrong --out is told before.
        check_folder(source, out)?;
        if !options.dry_run {
            check_writing(out)?;
        }
    }
    // A run continues to leave out the same inputs, even if their files are usable now.
    let left_out = existing.iter().flat_map(|run| run.spec.left_out.clone());
    let begun = OnceLock::new();
    let begin_writing = || match begun.get_or_init(|| begin(source, out)) {
        Ok(_) => Ok(()),
        Err(error) => Err(io::Error::other(error.to_string())),
    };
    let request = Request {
        roots: options.roots,
        inputs: options.inputs,
        run: out,
        begin_writing: (existing.is_none() && !options.dry_run).then_some(&begin_writing),
        left_out: left_out.collect(),
        planned: existing.as_ref().map(|run| &run.lines[..]),
        checks_files: existing.is_none() || options.dry_run,
        skip_invalid: options.skip_invalid,
        only: options.only,
        threads: options.threads,
    };
    let drafted = draft(source, &request, on_progress);
    let mut begun = begun.into_inner();
    if let Some(Err(error)) = begun.take_if(|begun| begun.is_err()) {
        return Err(error);
    }
    let drafted = match (drafted, &existing) {
        (Err(DraftError::OtherScenes { name, lines, scenes }), Some(run)) => {
            return Err(changed(run, options, name, &lines, scenes).into());
        }
        (drafted, _) => drafted?,
    };
    let manifest = to_jsonl(&drafted.lines);
    let tile_px = options
        .tile_px
        .or(existing.as_ref().map(|run| run.spec.tile_px))
        .unwrap_or_else(|| choose_tile_px(&drafted.lines));
    ShardLayout::check(&drafted.lines, tile_px)?;
    let spec = Spec {
        schema: SPEC_SCHEMA.to_owned(),
        name: drafted.name.clone(),
        scenes: drafted.lines.len() as u32,
        manifest_blake3: manifest_digest(&manifest),
        tile_px,
        tracer_version: TRACER_VERSION,
        golden: match &options.golden {
            Some(traced) => traced.clone(),
            None => golden(Isa::detect(), options.threads),
        },
        roots: drafted.roots.clone(),
        left_out: drafted.left_out.iter().cloned().collect(),
    };
    if let Some(run) = &existing {
        let diff = run.spec.diff(&run.lines, &spec, &drafted.lines);
        if !diff.is_empty() {
            return Err(SpecMismatch { run: out.to_owned(), diff }.into());
        }
    }
    let is_whole = existing.is_some() && drafted.to_make.iter().all(|made| made.is_written(out));
    if !options.dry_run && !is_whole {
        let mut begun = match begun {
            Some(begun) => begun?,
            None if existing.is_some() => Begun { lock: lock(out)?, made: None },
            None => begin(source, out)?,
        };
        // From now on the folder stays, and a later planning continues in it.
        begun.made = None;
        let on_picture = |done, all| on_progress("pictures", done, all);
        make_inputs(out, &drafted.to_make, options.threads, &on_picture)?;
        if existing.is_none() {
            write_plan(out, &drafted, &manifest, &spec, options.training)?;
        }
        if !begun.lock.is_in_place() {
            return Err(RunError::Changed { path: out.join(keys::LOCK) }.into());
        }
    }
    // The table may change after planning, and older versions wrote it after the spec.
    if let (false, Some(training), true) = (options.dry_run, options.training, existing.is_some()) {
        keep(out, keys::TRAIN, Some(training))?;
    }
    Ok(Planned { spec, drafted, existed: existing.is_some() })
}

/// Compares a run with a recipe. Only the scenes `lines` of the recipe were drawn, because some of them differ.
fn changed(
    run: &Run,
    options: &PlanOptions,
    name: String,
    lines: &[SceneLine],
    scenes: usize,
) -> SpecMismatch {
    let new = Spec {
        name,
        scenes: scenes as u32,
        manifest_blake3: manifest_digest(&to_jsonl(lines)),
        tile_px: options.tile_px.unwrap_or(run.spec.tile_px),
        ..run.spec.clone()
    };
    let mut diff = run.spec.diff(&run.lines, &new, lines);
    if !lines.is_empty() {
        let _ = writeln!(diff, "  compared: {} of {scenes} scenes", lines.len());
    }
    SpecMismatch { run: run.root().to_owned(), diff }
}

/// The locked folder of a run that is being planned. Planning that fails while it draws scenes removes the folder, with
/// the pictures of its previews, if it made it.
struct Begun {
    lock: FolderLock,
    /// The folder, if this planning made it and may still remove it.
    made: Option<PathBuf>,
}

impl Drop for Begun {
    fn drop(&mut self) {
        if let Some(folder) = &self.made {
            // Files that stay cost their space; the next planning continues with them.
            let _ = std::fs::remove_dir_all(folder);
        }
    }
}

/// Locks the folder of a new run, makes it if it is missing, and removes what a killed planning left unfinished.
fn begin(source: &Path, out: &Path) -> Result<Begun, PlanError> {
    check_folder(source, out)?;
    let made = (!out.exists()).then(|| out.to_owned());
    atomic_file::create_dir(out)?;
    let lock = lock(out)?;
    if out.join(keys::SPEC).exists() {
        // Another process planned the run since it was opened; its plan may be of another recipe.
        return Err(RunError::Busy { root: out.to_owned() }.into());
    }
    // Depth 5 covers the input folders of DIODE: source / train / indoors / scene / scan.
    atomic_file::sweep(out, 0, &is_temporary);
    atomic_file::sweep(&out.join(keys::INPUTS), 5, &is_temporary);
    Ok(Begun { lock, made })
}

/// Refuses a folder without a run if planning would overwrite the source or, unless an earlier planning was killed
/// there, other files.
fn check_folder(source: &Path, out: &Path) -> Result<(), PlanError> {
    let real = |path: &Path| path.canonicalize().ok();
    let is_begun = out.join(keys::LOCK).exists();
    for name in [keys::MANIFEST, keys::REJECTED, keys::TRAIN, keys::INPUTS] {
        let path = out.join(name);
        if path.symlink_metadata().is_ok() && (!is_begun || real(&path) == real(source)) {
            return Err(PlanError::Foreign { path });
        }
    }
    Ok(())
}

/// Refuses a folder that cannot be made, or in which no file can be made.
fn check_writing(out: &Path) -> Result<(), WriteError> {
    let there = out.ancestors().find(|path| path.exists());
    let folder = there.unwrap_or(Path::new("."));
    let tried = tempfile::tempfile_in(folder);
    tried.map(|_| ()).map_err(|source| WriteError { path: folder.to_owned(), source })
}

fn write_plan(
    out: &Path,
    drafted: &Drafted,
    manifest: &str,
    spec: &Spec,
    training: Option<&str>,
) -> Result<(), PlanError> {
    let rejected = (!drafted.rejected.is_empty()).then(|| rejected_lines(&drafted.rejected));
    keep(out, keys::REJECTED, rejected.as_deref())?;
    keep(out, keys::TRAIN, training)?;
    atomic_file::write(&out.join(keys::MANIFEST), manifest.as_bytes())?;
    // Writes the spec last, because it marks the run as planned.
    let mut json = serde_json::to_string_pretty(spec).expect("a spec is JSON");
    json.push('\n');
    Ok(atomic_file::write(&out.join(keys::SPEC), json.as_bytes())?)
}

/// Makes a file of the run hold `text`. Without a text, removes the file, which a killed planning may have left.
fn keep(out: &Path, name: &str, text: Option<&str>) -> Result<(), WriteError> {
    let path = out.join(name);
    match text {
        Some(text) if std::fs::read(&path).is_ok_and(|there| there == text.as_bytes()) => Ok(()),
        Some(text) => atomic_file::write(&path, text.as_bytes()),
        None => match std::fs::remove_file(&path) {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                Err(WriteError { path, source })
            }
            _ => Ok(()),
        },
    }
}
