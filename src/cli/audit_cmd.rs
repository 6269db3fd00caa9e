//! `audit RUN`

use super::args::Global;
use super::exit_code::{Exit, Failure};
use super::farm_args::AuditArgs;
use super::output::Output;
use super::progress::Progress;
use super::signals::Signals;
use super::target;
use super::work_cmd::{isa, threads};
use crate::run::{
    AuditOptions, FileDifference, Receipt, Run, SceneAudit, Verdict, audit_scene, check_auditor,
    draw_scenes,
};
use crate::store::Store;
use anyhow::anyhow;
use render::ids::SceneId;
use render::line::Roots;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::Ordering;
use std::time::Instant;

pub(super) fn run(args: &AuditArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let roots = Roots::parse(&args.roots.roots)?;
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &roots)?;
    let (places, seed) = places(args, &run, &store)?;
    if places.is_empty() {
        let error = anyhow!("no scene of the run is done: there is nothing to compare yet");
        return Err(Failure::new(Exit::Failed, error));
    }
    let shards = |index: &usize| u64::from(run.layout(&run.lines[*index]).len());
    if global.dry_run {
        let names: Vec<&str> = places.iter().map(|&i| run.lines[i].id.as_str()).collect();
        output.result(
            "glasshouse.audit/1",
            json!({ "run": args.run, "dry_run": true, "seed": seed, "scenes": names }),
            &format!("would trace again: {}", names.join(" ")),
        );
        return Ok(Exit::Done);
    }
    let signals = Signals::catch();
    let options = AuditOptions {
        threads: threads(global),
        isa: isa(global)?,
        stop: signals.stop(),
    };
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
        // What could not be compared was not traced.
        progress.add(
            shards(&index).saturating_sub(progress.done() - before),
            true,
        );
        if audit.verdict != Verdict::Same {
            progress.suspend(|| output.warning(&describe(&audit)));
        }
        audits.push(audit);
    }
    progress.finish();
    let stopped = options.stop.load(Ordering::Relaxed) && audits.len() < places.len();
    let wall_s = start.elapsed().as_secs_f64();
    let count = |verdict| audits.iter().filter(|a| a.verdict == verdict).count();
    let (same, differs) = (count(Verdict::Same), count(Verdict::Differs));
    let not_compared = count(Verdict::NotCompared);
    let mut text = format!(
        "scenes traced again in {wall_s:.1} s: {}; the same bit for bit: {same}, different: {differs}, not compared: {not_compared}",
        same + differs
    );
    if let Some(seed) = seed {
        let _ = write!(text, " (--seed {seed} --share {})", args.share);
    }
    let workers = workers(&audits);
    for (worker, [bad, all]) in workers.iter().filter(|(_, [bad, _])| *bad > 0) {
        let _ = write!(text, "\n{worker}: {bad} of {all} audited scenes differ");
    }
    if differs > 0 {
        text += "\nTake out the machine that made them, then `glasshouse retry RUN SCENE… --anew` and work again makes them anew. \
                 `glasshouse audit RUN --share 1` looks at all others.";
    }
    if stopped {
        text += "\nstopped by a signal";
    }
    let workers: Vec<Value> = workers
        .iter()
        .map(|(worker, [bad, all])| json!({ "worker": worker, "differ": bad, "audited": all }))
        .collect();
    output.result(
        "glasshouse.audit/1",
        json!({
            "run": args.run, "dry_run": false, "seed": seed, "same": same, "differ": differs, "not_compared": not_compared,
            "scenes": audits, "workers": workers, "stopped": stopped, "wall_s": wall_s,
        }),
        &text,
    );
    Ok(if differs > 0 {
        Exit::Failed
    } else if stopped {
        signals.exit()
    } else if not_compared > 0 {
        Exit::Incomplete
    } else {
        Exit::Done
    })
}

/// The scenes to trace again, and the seed that chose them.
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
            Failure::new(
                Exit::Usage,
                anyhow!("{id} is no scene of this run; manifest.jsonl names them all"),
            )
        })
    };
    let places: Result<Vec<usize>, Failure> = args.scenes.iter().map(find).collect();
    Ok((places?, None))
}

/// Small enough to be typed again.
fn random_seed() -> Result<u64, Failure> {
    let mut bytes = [0; 4];
    getrandom::fill(&mut bytes).map_err(|e| {
        let error = anyhow!("the system has no random numbers ({e}); give --seed N");
        Failure::new(Exit::Failed, error)
    })?;
    Ok(u64::from(u32::from_le_bytes(bytes)))
}

/// By worker: scenes that differ, and all that were compared.
fn workers(audits: &[SceneAudit]) -> BTreeMap<String, [u64; 2]> {
    let mut workers: BTreeMap<String, [u64; 2]> = BTreeMap::new();
    for audit in audits.iter().filter(|a| a.verdict != Verdict::NotCompared) {
        let counts = workers.entry(maker(audit)).or_default();
        counts[0] += u64::from(audit.verdict == Verdict::Differs);
        counts[1] += 1;
    }
    workers
}

/// Without a farm nobody leaves a receipt.
fn maker(audit: &SceneAudit) -> String {
    let receipt = audit.receipt.as_ref();
    receipt.map_or_else(|| "no receipt".to_owned(), Receipt::makers)
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
        maker(audit)
    );
    for difference in &audit.differences {
        let _ = write!(text, "\n  {}: {}", difference.file, amount(difference));
    }
    text
}

fn amount(difference: &FileDifference) -> String {
    let unit = if difference.file.rsplit('.').next() == Some("png") {
        "8-bit steps"
    } else {
        "linear"
    };
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
            format!("{pixels} of {all} pixels differ; at x {x}, y {y} a value is no number")
        }
        _ => difference.note.clone(),
    }
}
