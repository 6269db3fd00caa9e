//! `export RUN`

use super::args::Global;
use super::exit_code::{Exit, Failure};
use super::export_args::ExportArgs;
use super::output::Output;
use super::progress::Progress;
use super::signals::Signals;
use super::target;
use super::work_cmd::threads;
use crate::doctor::{available_bytes, bytes_text};
use crate::export::{
    ExportOptions, ExportPlan, ExportWork, Exported, FolderState, export, foretell_bytes, look,
};
use anyhow::anyhow;
use render::line::{Roots, Split, is_url};
use serde_json::{Value, json};
use std::fmt::Write;
use std::time::Instant;

const SCHEMA: &str = "glasshouse.export/1";

pub(super) fn run(args: &ExportArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    if is_url(&args.out) {
        let error = anyhow!(
            "--out {} is no folder: export into a folder, then copy it there (`aws s3 sync DIR s3://BUCKET/PREFIX`)",
            args.out.display()
        );
        return Err(Failure::new(Exit::Usage, error));
    }
    let store = args.store.store.as_deref();
    let (run, store) = target::open(&args.run, store, &Roots::default())?;
    let both = [Split::Train, Split::Test].into_iter();
    let options = ExportOptions {
        format: args.format.into(),
        encoding: args.encoding(),
        splits: both.filter(|split| args.split.has(*split)).collect(),
        shard_mb: args.shard_mb,
        partial: args.partial,
    };
    let plan = ExportPlan::new(&run, &store, &options)?;
    let state = look(&args.out, &plan.request)?;
    let foretold = match state {
        FolderState::Complete => None,
        FolderState::Empty | FolderState::Begun(_) => Some(foretell_bytes(&run, &store, &plan)?),
    };
    if global.dry_run {
        let counts = [Split::Train, Split::Test].map(|split| {
            let scenes = plan.scenes.iter();
            let count = scenes.filter(|&&s| run.lines[s].split == split).count();
            (split, count as u64)
        });
        let exported = Exported {
            tuples: counts.into_iter().filter(|(_, count)| *count > 0).collect(),
            bytes: foretold.unwrap_or(0),
            already_complete: state == FolderState::Complete,
            ..Exported::default()
        };
        let text = if exported.already_complete {
            format!(
                "{} is complete: nothing would be written",
                args.out.display()
            )
        } else {
            format!(
                "would export {} tuples to {}, about {}{}",
                plan.scenes.len(),
                args.out.display(),
                bytes_text(exported.bytes as f64),
                left_out_text(&plan)
            )
        };
        output.result(SCHEMA, object(args, &plan, &exported, true), &text);
        return Ok(exit(&plan));
    }
    // Of what was begun a part is there already.
    if let (FolderState::Empty, Some(needed)) = (&state, foretold) {
        check_space(args, needed)?;
    }

    let signals = Signals::catch();
    let progress = Progress::new(global, "tuples", plan.scenes.len() as u64);
    let start = Instant::now();
    let work = ExportWork {
        threads: threads(global),
        stop: signals.stop(),
        on_tuples: &|count, found| progress.add(count, found),
    };
    let ended = export(&run, &store, plan, &args.out, &work);
    progress.finish();
    let (plan, exported) = ended?;
    let wall_s = start.elapsed().as_secs_f64();
    let total: u64 = exported.tuples.values().sum();
    if exported.stopped {
        let error = anyhow!(
            "stopped after {total} of {} tuples: the same command goes on",
            plan.scenes.len()
        );
        return Err(Failure::new(signals.exit(), error));
    }
    let text = if exported.already_complete {
        format!(
            "{} is complete, nothing to do ({total} tuples); `sha256sum -c SHA256SUMS` in it checks its files",
            args.out.display()
        )
    } else {
        format!(
            "exported {total} tuples to {} in {wall_s:.1} s: {} files, {}{}",
            args.out.display(),
            exported.files,
            bytes_text(exported.bytes as f64),
            left_out_text(&plan)
        )
    };
    let mut object = object(args, &plan, &exported, false);
    object["wall_s"] = json!(wall_s);
    output.result(SCHEMA, object, &text);
    Ok(exit(&plan))
}

fn exit(plan: &ExportPlan) -> Exit {
    if plan.request.left_out.is_empty() {
        Exit::Done
    } else {
        Exit::Incomplete
    }
}

/// What a script reads.
fn object(args: &ExportArgs, plan: &ExportPlan, exported: &Exported, dry_run: bool) -> Value {
    let tuples: serde_json::Map<String, Value> = exported
        .tuples
        .iter()
        .map(|(split, count)| (split.to_string(), json!(count)))
        .collect();
    let quarantined: Vec<Value> = plan
        .quarantined()
        .map(|(scene, reason)| json!({ "scene": scene, "reason": reason }))
        .collect();
    json!({
        "run": args.run, "out": args.out, "dry_run": dry_run, "format": plan.request.format,
        "encoding": plan.request.encoding, "tuples": tuples, "tuples_resumed": exported.resumed,
        "files": exported.files, "bytes": exported.bytes, "already_complete": exported.already_complete,
        "quarantined": quarantined, "missing": plan.missing(),
    })
}

fn left_out_text(plan: &ExportPlan) -> String {
    let (quarantined, missing) = (plan.quarantined().count(), plan.missing());
    let mut text = String::new();
    if quarantined > 0 {
        let _ = write!(text, "; {quarantined} scenes in quarantine are not in it");
    }
    if missing > 0 {
        let _ = write!(
            text,
            "; {missing} scenes that are not merged yet are not in it"
        );
    }
    text
}

/// Refuses what the disk has no room for, as far as its file system tells.
fn check_space(args: &ExportArgs, needed: u64) -> Result<(), Failure> {
    match available_bytes(&args.out) {
        Some(available) if available < needed => {
            let [needed, available] = [needed, available].map(|b| bytes_text(b as f64));
            let error = anyhow!(
                "the export takes about {needed} and there are {available} where {} is to be: make room, or give another --out",
                args.out.display()
            );
            Err(Failure::new(Exit::Failed, error))
        }
        _ => Ok(()),
    }
}
