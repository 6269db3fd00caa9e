//! `export RUN`: writes tuples as a data set.

use crate::cli::args::{Global, SplitName, StoreArgs, VerifyArgs, threads};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::output::{Output, reasons};
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::target;
use crate::doctor::{available_bytes, bytes_text};
use crate::export::{
    ExportFormat, ExportOptions, ExportPlan, ExportWork, Exported, FolderState, PixelEncoding,
    estimate_bytes, export, look, look_again,
};
use crate::made::Remade;
use crate::outputs::check_place;
use crate::run::Run;
use clap::{Args as ClapArgs, ValueEnum};
use glasshouse_line::ids::SceneId;
use glasshouse_line::{Roots, Split, is_url};
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Debug, ClapArgs)]
pub(super) struct ExportArgs {
    /// Folder of the run
    run: PathBuf,
    /// Format of the data set
    #[arg(long, value_enum)]
    format: FormatName,
    /// Folder of the export: a new or empty one, or one with an export of the same kind, which resumes
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Pixel encoding [default: srgb8; for exr and safetensors: linear]
    #[arg(long, value_enum)]
    encoding: Option<EncodingName>,
    /// Scenes to export
    #[arg(long, value_enum, default_value = "all")]
    split: SplitName,
    /// Largest shard of webdataset or safetensors, MB (1e6 bytes); a larger tuple gets a shard of its own
    #[arg(long, value_name = "MB", default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    shard_mb: u32,
    /// Export the finished tuples of an unfinished run
    #[arg(long)]
    partial: bool,
    #[command(flatten)]
    verify: VerifyArgs,
    #[command(flatten)]
    store: StoreArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FormatName {
    /// Tars for the WebDataset library.
    Webdataset,
    /// Hugging Face's imagefolder.
    Imagefolder,
    /// Folders of pictures, as in published sets of pairs.
    Pairs,
    /// One multi-part OpenEXR file per tuple.
    Exr,
    /// Shards of linear tensors, for PyTorch and NumPy.
    Safetensors,
}

impl From<FormatName> for ExportFormat {
    fn from(name: FormatName) -> Self {
        match name {
            FormatName::Webdataset => Self::Webdataset,
            FormatName::Imagefolder => Self::Imagefolder,
            FormatName::Pairs => Self::Pairs,
            FormatName::Exr => Self::Exr,
            FormatName::Safetensors => Self::Safetensors,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum EncodingName {
    /// The tuples' PNGs, unchanged.
    Srgb8,
    /// PNGs of 16-bit sRGB codes, from the tuples' EXRs.
    Srgb16,
    /// OpenEXR files or tensors, linear and not clipped.
    Linear,
    /// PNGs of the photographs of scenes with a sensor.
    Photograph,
}

impl From<EncodingName> for PixelEncoding {
    fn from(name: EncodingName) -> Self {
        match name {
            EncodingName::Srgb8 => Self::Srgb8,
            EncodingName::Srgb16 => Self::Srgb16,
            EncodingName::Linear => Self::Linear,
            EncodingName::Photograph => Self::Photograph,
        }
    }
}

impl ExportArgs {
    /// Returns the encoding on the command line, or the format's default.
    fn encoding(&self) -> PixelEncoding {
        match (self.encoding, self.format) {
            (Some(encoding), _) => encoding.into(),
            (None, FormatName::Exr | FormatName::Safetensors) => PixelEncoding::Linear,
            (None, _) => PixelEncoding::Srgb8,
        }
    }
}

const SCHEMA: &str = "glasshouse.export/1";

/// Returns the splits of a choice. Leaves out `validation` in a run without it, so that the request equals the one of an
/// export from before this split existed.
fn splits(run: &Run, choice: SplitName) -> BTreeSet<Split> {
    let has_scenes = |split| run.lines.iter().any(|line| line.split == split);
    let chosen = Split::ALL.into_iter().filter(|split| choice.has(*split));
    chosen.filter(|&split| split != Split::Validation || has_scenes(split)).collect()
}

pub(super) fn run(args: &ExportArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    if is_url(&args.out) {
        return Err(failure!(
            Exit::Usage,
            "--out {} is a URL: export into a folder, then copy the folder there (`aws s3 sync DIR s3://BUCKET/PREFIX`)",
            args.out.display()
        ));
    }
    let store = args.store.store.as_deref();
    let (run, store) = target::open(&args.run, store, &Roots::default())?;
    let options = ExportOptions {
        format: args.format.into(),
        encoding: args.encoding(),
        splits: splits(&run, args.split),
        shard_mb: args.shard_mb,
        partial: args.partial,
    };
    let plan = ExportPlan::new(&run, &store, &options)?;
    check_place(&args.out)?;
    let state = look(&args.out, &plan.request)?;
    let foretold = match state {
        FolderState::Complete => None,
        FolderState::Empty | FolderState::Begun(_) => Some(estimate_bytes(&run, &store, &plan)?),
    };
    if global.dry_run {
        let counts = Split::ALL.map(|split| {
            let scenes = plan.scenes.iter();
            let count = scenes.filter(|&&s| run.lines[s].split == split).count();
            (split, count as u64)
        });
        let remade = match state {
            FolderState::Complete => look_again(&store, &plan, &args.out, args.verify.verify)?,
            FolderState::Empty | FolderState::Begun(_) => Remade::default(),
        };
        let exported = Exported {
            tuples: counts.into_iter().filter(|(_, count)| *count > 0).collect(),
            bytes: foretold.unwrap_or(0),
            already_complete: state == FolderState::Complete && remade.is_none(),
            remade,
            ..Exported::default()
        };
        output.show(SCHEMA, &Export::new(args, &plan, exported, None));
        return Ok(exit(&plan));
    }
    // An unfinished export already has a part of the bytes.
    if let (FolderState::Empty, Some(needed)) = (&state, foretold) {
        let shard = u64::from(args.shard_mb) * 1_000_000;
        // The data of an unfinished shard of tensors are on the disk twice.
        let is_twice = args.format == FormatName::Safetensors;
        check_space(args, needed + if is_twice { needed.min(shard) } else { 0 })?;
    }

    let signals = Signals::catch();
    let progress = Progress::new(global, "tuples", plan.scenes.len() as u64);
    let start = Instant::now();
    let work = ExportWork {
        threads: threads(global),
        stop: signals.stop(),
        verify: args.verify.verify,
        on_tuples: &|count, found| progress.add(count, found),
    };
    let ended = export(&run, &store, plan, &args.out, &work);
    progress.finish();
    let (plan, exported) = ended?;
    let wall_s = start.elapsed().as_secs_f64();
    let total: u64 = exported.tuples.values().sum();
    if exported.stopped {
        return Err(failure!(
            signals.exit(),
            "stopped after {total} of {} tuples: run the same command to resume",
            plan.scenes.len()
        ));
    }
    output.show(SCHEMA, &Export::new(args, &plan, exported, Some(wall_s)));
    Ok(exit(&plan))
}

fn exit(plan: &ExportPlan) -> Exit {
    if plan.request.left_out.is_empty() { Exit::Done } else { Exit::Incomplete }
}

#[derive(Serialize)]
struct Export<'a> {
    #[serde(serialize_with = "render::path_text::one")]
    run: &'a Path,
    #[serde(serialize_with = "render::path_text::one")]
    out: &'a Path,
    dry_run: bool,
    format: ExportFormat,
    encoding: PixelEncoding,
    #[serde(flatten)]
    exported: Exported,
    #[serde(serialize_with = "reasons")]
    quarantined: Vec<(SceneId, String)>,
    missing: usize,
    /// Duration of the export, s; `None` in a dry run.
    #[serde(skip_serializing_if = "Option::is_none")]
    wall_s: Option<f64>,
}

impl<'a> Export<'a> {
    fn new(
        args: &'a ExportArgs,
        plan: &ExportPlan,
        exported: Exported,
        wall_s: Option<f64>,
    ) -> Self {
        let quarantined = plan.quarantined();
        Self {
            run: &args.run,
            out: &args.out,
            dry_run: wall_s.is_none(),
            format: plan.request.format,
            encoding: plan.request.encoding,
            exported,
            quarantined: quarantined.map(|(s, reason)| (s.clone(), reason.to_owned())).collect(),
            missing: plan.missing(),
            wall_s,
        }
    }
}

impl fmt::Display for Export<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (out, exported) = (self.out.display(), &self.exported);
        let tuples: u64 = exported.tuples.values().sum();
        let bytes = bytes_text(exported.bytes as f64);
        match (self.wall_s, exported.already_complete) {
            (None, true) => return write!(f, "{out} is complete: nothing would be written"),
            (None, false) => write!(f, "would export {tuples} tuples to {out}, about {bytes}")?,
            (Some(_), true) => {
                return write!(
                    f,
                    "{out} is complete, nothing to do ({tuples} tuples); with --verify, all files are read"
                );
            }
            (Some(wall_s), false) => write!(
                f,
                "exported {tuples} tuples to {out} in {wall_s:.1} s: {} files, {bytes}",
                exported.files
            )?,
        }
        if !exported.remade.is_none() {
            write!(f, "; {}", exported.remade)?;
        }
        let (quarantined, missing) = (self.quarantined.len(), self.missing);
        if quarantined > 0 {
            write!(f, "; {quarantined} scenes in quarantine are left out")?;
        }
        if missing > 0 {
            write!(f, "; {missing} scenes without a tuple are left out")?;
        }
        Ok(())
    }
}

/// Fails if the free space of the disk is known and too small for the export.
fn check_space(args: &ExportArgs, needed: u64) -> Result<(), Failure> {
    match available_bytes(&args.out) {
        Some(available) if available < needed => {
            let [needed, available] = [needed, available].map(|b| bytes_text(b as f64));
            Err(failure!(
                Exit::Failed,
                "the export needs about {needed}, but the disk of {} has {available}: make room, or give another --out",
                args.out.display()
            ))
        }
        _ => Ok(()),
    }
}
