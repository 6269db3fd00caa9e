//! `status RUN`

use super::args::{Global, RunFolder};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use crate::farm::{Run, run_status};
use crate::manifest::Roots;
use serde_json::json;
use std::fmt::Write;

pub(super) fn run(args: &RunFolder, _: &Global, output: &Output) -> Result<Exit, Failure> {
    let run = Run::open(&args.run, &Roots::default())?;
    let status = run_status(&run);
    let mut text = format!(
        "{}: {} of {} tuples, {} of {} shards; {} scenes begun, {} waiting, {} in quarantine",
        run.spec.name,
        status.merged,
        status.scenes,
        status.shards_done,
        status.shards,
        status.started,
        status.waiting,
        status.quarantined.len()
    );
    for scene in &status.quarantined {
        let _ = write!(text, "\n  {}: {}", scene.scene, scene.reason);
    }
    let finished = status.is_finished();
    let mut object = serde_json::to_value(&status).unwrap_or_default();
    object["run"] = json!(args.run);
    object["name"] = json!(run.spec.name);
    object["finished"] = json!(finished);
    output.result("glasshouse.status/1", object, &text);
    Ok(if status.quarantined.is_empty() {
        Exit::Done
    } else {
        Exit::Incomplete
    })
}
