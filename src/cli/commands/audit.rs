//! `audit RUN`: traces scenes again and compares them with the run's files.

use crate::cli::args::{Global, RootArgs, StoreArgs, isa, parse_scene_id, threads};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::target;
use crate::run::{
    AuditOptions, FileDifference, Provenance, Run, SceneAudit, Verdict, audit_scene, check_auditor,
    draw_scenes, keys,
};
use crate::store::Store;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use glasshouse_line::ids::SceneId;
use serde::Serialize;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

#[derive(Debug, ClapArgs)]
pub(super) struct AuditArgs {
    /// Folder of the run
    run: PathBuf,
    /// Share of the finished scenes to trace again, 0 to 1; at least one scene
    #[arg(long, value_name = "SHARE", default_value_t = 0.005, value_parser = parse_share)]
    share: f64,
    /// Seed of the choice: equal seed, share and run give equal scenes [default: random, and printed]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Audit this scene instead of a random choice; an unfinished scene is compared as far as it has files; repeatable
    #[arg(long = "scene", value_name = "SCENE", value_parser = parse_scene_id, conflicts_with_all = ["share", "seed"])]
    scenes: Vec<SceneId>,
    #[command(flatten)]
    roots: RootArgs,
    #[command(flatten)]
    store: StoreArgs,
}

pub(super) fn run(args: &AuditArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let roots = Roots::parse(&args.roots.roots)?;
    let (run, store) = target::open_to_work(&args.run, args.store.store.as_deref(), &roots)?;
    let (places, seed) = places(args, &run, &store)?;
    if places.is_empty() {
        return Err(failure!(
            Exit::Failed,
            "no scene of the run is done: nothing can be compared yet"
        ));
    }
    let shards = |index: &usize| u64::from(run.layout(&run.lines[*index]).len());
    if global.dry_run {
        let planned = Planned {
            run: args.run.to_string_lossy(),
            dry_run: true,
            seed,
            scenes: places.iter().map(|&i| run.lines[i].id.as_str()).collect(),
        };
        output.show("glasshouse.audit/1", &planned);
        return Ok(Exit::Done);
    }
    let signals = Signals::catch();
    let options =
        AuditOptions { threads: threads(global), isa: isa(global)?, stop: signals.stop() };
    check_auditor(&run, &options)?;
    let progress = Progress::new(global, "shards", places.iter().map(shards).sum());
    let start = Instant::now();
    let mut audits = Vec::new();
    for &index in &places {
        progress.message(run.lines[index].id.to_string());
        let before = progress.done();
        let on_shard = || progress.add(1, false);
        let Some(audit) = audit_scene(&run, &store, index, &options, &on_shard)? else {
            break;
        };
        // The bar must also advance past the shards of a scene that cannot be compared and is not traced.
        progress.add(shards(&index).saturating_sub(progress.done() - before), true);
        if audit.verdict != Verdict::Same {
            progress.suspend(|| output.warning(&describe(&audit)));
        }
        audits.push(audit);
    }
    progress.finish();
    let stopped = options.stop.load(Ordering::Relaxed) && audits.len() < places.len();
    let wall_s = start.elapsed().as_secs_f64();
    let count = |verdict| audits.iter().filter(|a| a.verdict == verdict).count();
    let (same, differ) = (count(Verdict::Same), count(Verdict::Differs));
    let not_compared = count(Verdict::NotCompared);
    let audit = Audited {
        run: &args.run,
        dry_run: false,
        seed,
        same,
        differ,
        not_compared,
        workers: workers(&audits),
        scenes: audits,
        stopped,
        wall_s,
        share: args.share,
    };
    output.show("glasshouse.audit/1", &audit);
    Ok(if differ > 0 {
        Exit::Failed
    } else if stopped {
        signals.exit()
    } else if not_compared > 0 {
        Exit::Incomplete
    } else {
        Exit::Done
    })
}

/// Returns the indices of the scenes to trace again, and the seed that chose them (`None` with `--scene`).
fn places(
    args: &AuditArgs,
    run: &Run,
    store: &Store,
) -> Result<(Vec<usize>, Option<u64>), Failure> {
    if args.scenes.is_empty() {
        let seed = args.seed.map_or_else(random_seed, Ok)?;
        return Ok((draw_scenes(run, store, args.share, seed)?, Some(seed)));
    }
    let find = |id: &SceneId| {
        let place = run.lines.iter().position(|line| line.id == *id);
        place.ok_or_else(|| {
            failure!(
                Exit::Usage,
                "{id} is not a scene of this run; manifest.jsonl lists the scenes"
            )
        })
    };
    let places: Result<Vec<usize>, Failure> = args.scenes.iter().map(find).collect();
    Ok((places?, None))
}

/// Returns a random seed of 32 bits, short enough to type.
fn random_seed() -> Result<u64, Failure> {
    getrandom::u32().map(u64::from).map_err(|e| {
        failure!(Exit::Failed, "the system returns no random numbers ({e}); give --seed N")
    })
}

#[derive(Serialize)]
struct Planned<'a> {
    run: Cow<'a, str>,
    dry_run: bool,
    seed: Option<u64>,
    scenes: Vec<&'a str>,
}

impl fmt::Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "would trace again: {}", self.scenes.join(" "))
    }
}

#[derive(Serialize)]
struct Audited<'a> {
    #[serde(serialize_with = "render::path_text::one")]
    run: &'a Path,
    dry_run: bool,
    seed: Option<u64>,
    same: usize,
    differ: usize,
    not_compared: usize,
    scenes: Vec<SceneAudit>,
    workers: Vec<WorkerAudit>,
    stopped: bool,
    wall_s: f64,
    #[serde(skip)]
    share: f64,
}

/// Counts of the scenes that one worker, or one group of workers, made: scenes that differ, and all compared scenes.
#[derive(Serialize)]
struct WorkerAudit {
    worker: String,
    differ: u64,
    audited: u64,
}

impl fmt::Display for Audited<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { same, differ, not_compared, wall_s, .. } = self;
        write!(
            f,
            "scenes traced again in {wall_s:.1} s: {}; equal bit for bit: {same}, different: {differ}, not compared: {not_compared}",
            same + differ
        )?;
        if let Some(seed) = self.seed {
            write!(f, " (--seed {seed} --share {})", self.share)?;
        }
        for worker in self.workers.iter().filter(|worker| worker.differ > 0) {
            let WorkerAudit { worker, differ, audited } = worker;
            write!(f, "\n{worker}: {differ} of {audited} audited scenes differ")?;
        }
        if *differ > 0 {
            f.write_str(
                "\nRemove from the farm the machine that made the different scenes; then `glasshouse retry RUN SCENE… --anew` and \
                 `glasshouse work RUN` make these scenes again. `glasshouse audit RUN --share 1` checks all other scenes.",
            )?;
        }
        if self.stopped {
            f.write_str("\nstopped by a signal")?;
        }
        Ok(())
    }
}

fn workers(audits: &[SceneAudit]) -> Vec<WorkerAudit> {
    let mut workers: BTreeMap<String, [u64; 2]> = BTreeMap::new();
    for audit in audits.iter().filter(|a| a.verdict != Verdict::NotCompared) {
        let differing = makers_of_differences(audit);
        let mut all = differing.clone();
        if audit.receipt.is_some() || all.is_empty() {
            all.insert(makers(audit));
        }
        for worker in all {
            let differs = differing.contains(&worker);
            let counts = workers.entry(worker).or_default();
            counts[0] += u64::from(differs);
            counts[1] += 1;
        }
    }
    let worker =
        |(worker, [differ, audited]): (String, [u64; 2])| WorkerAudit { worker, differ, audited };
    workers.into_iter().map(worker).collect()
}

/// Returns the names of the workers that made a scene's tuple. Workers outside a farm write no receipt.
fn makers(audit: &SceneAudit) -> String {
    let receipt = audit.receipt.as_ref();
    receipt.map_or_else(|| "no receipt".to_owned(), Provenance::makers)
}

/// Returns the names of the workers that made the differing files. A late worker may have put wrong partials beside a
/// good tuple of other workers, so a partial's own maker counts.
fn makers_of_differences(audit: &SceneAudit) -> BTreeSet<String> {
    let of_file = |difference: &FileDifference| {
        if !difference.file.starts_with(keys::PARTIALS) {
            return makers(audit);
        }
        let maker = difference.made_by.first();
        maker.map_or_else(|| "unknown makers of partials".to_owned(), String::clone)
    };
    audit.differences.iter().map(of_file).collect()
}

fn describe(audit: &SceneAudit) -> String {
    let scene = &audit.scene;
    if let Some(reason) = &audit.reason {
        return format!("scene {scene} is not compared: {reason}");
    }
    let mut text = format!(
        "scene {scene} differs, {} of {} files; made by: {}",
        audit.differences.len(),
        audit.files,
        Vec::from_iter(makers_of_differences(audit)).join("; ")
    );
    for difference in &audit.differences {
        let _ = write!(text, "\n  {}: {}", difference.file, amount(difference));
    }
    text
}

fn amount(difference: &FileDifference) -> String {
    let unit =
        if difference.file.rsplit('.').next() == Some("png") { "8-bit steps" } else { "linear" };
    let (Some(pixels), Some(all)) = (difference.pixels, difference.of_pixels) else {
        return difference.note.clone();
    };
    match (difference.largest, difference.at) {
        (Some(largest), Some([x, y])) if largest < f64::MAX => {
            format!(
                "{pixels} of {all} pixels differ, at most by {largest:.3e} ({unit}) at x {x}, y {y}"
            )
        }
        (Some(_), Some([x, y])) => {
            format!("{pixels} of {all} pixels differ; at x {x}, y {y} a value is not finite")
        }
        _ => difference.note.clone(),
    }
}

fn parse_share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("a share is a number from 0 to 1".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_from_0_to_1() {
        assert_eq!(parse_share("0.25"), Ok(0.25));
        for bad in ["-0.1", "1.1", "nan", "x"] {
            assert!(parse_share(bad).is_err(), "{bad}");
        }
    }
}
