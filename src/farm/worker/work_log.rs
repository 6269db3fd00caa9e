//! What a worker records of itself when it ends.

use super::options::{Outcome, WorkOptions};
use crate::run::{LogTime, SceneTrace, StageSeconds, WORK_LOG_SCHEMA, WorkLog};
use render::trace::TRACER_VERSION;
use std::collections::BTreeMap;
use std::time::SystemTime;

/// The log of a worker that ends.
pub(super) fn work_log(
    outcome: &Outcome,
    options: &WorkOptions,
    scenes: Vec<SceneTrace>,
    is_child: bool,
    began: &LogTime,
) -> WorkLog {
    let since_1970 = began.clock.duration_since(SystemTime::UNIX_EPOCH);
    let seconds: &StageSeconds = &outcome.seconds;
    let named = |seconds: &[(&'static str, f64)]| -> BTreeMap<String, f64> {
        let named = seconds.iter().map(|(stage, s)| ((*stage).to_owned(), *s));
        named.collect()
    };
    WorkLog {
        schema: WORK_LOG_SCHEMA.to_owned(),
        worker: options.who.worker.clone(),
        host: options.who.host.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        tracer_version: TRACER_VERSION,
        is_child,
        threads: options.threads.max(1) as u32,
        started_unix_s: since_1970.unwrap_or_default().as_secs_f64(),
        wall_s: began.start.elapsed().as_secs_f64(),
        stopped: outcome.stopped.map(|stop| stop.name().to_owned()),
        merged: outcome.merged,
        shards_traced: outcome.traced,
        shards_resumed: outcome.resumed,
        scenes_loaded: outcome.loaded,
        thread_seconds: named(&seconds.all()),
        cpu_seconds: named(&seconds.cpu()),
        scenes,
    }
}
