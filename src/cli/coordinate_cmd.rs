//! `coordinate RUN`

use super::args::{CoordinateArgs, Global};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::queue_cmd;
use super::signals::Signals;
use crate::farm::{CoordinateOptions, Run, Watch, WatchedRun, coordinate};
use crate::manifest::Roots;
use crate::serve::serve;
use serde_json::json;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Shortest time between two looks.
const EVERY: Duration = Duration::from_secs(1);

pub(super) fn run(
    args: &CoordinateArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    queue_cmd::fetch_run(&args.run, &args.queue)?;
    let run = Run::open(&args.run, &Roots::default())?;
    let signals = Signals::catch();
    let store = queue_cmd::store(&args.run, &args.queue)?;
    let queue = queue_cmd::coordinator(&run, &args.queue)?;
    let progress = Progress::new(global, "scenes", 0);
    let options = CoordinateOptions {
        stop: signals.stop(),
        every: EVERY,
    };
    let watch = Arc::new(Mutex::new(Watch::default()));
    let silent_s = 20.0 * args.queue.lease_s.as_secs_f64();
    let page = args.listen.map(|address| {
        let source = Arc::new(WatchedRun::new(&run, &store, &watch, silent_s));
        serve(address, source, None).map_err(|e| Failure::new(Exit::Failed, e))
    });
    let page = page.transpose()?;
    if let Some(page) = &page {
        output.note(&format!(
            "the run can be watched at http://{}/",
            page.address()
        ));
    }
    let start = Instant::now();
    let ended = coordinate(&run, &store, &queue, &options, &watch, &|event| {
        progress.event(event, output);
    });
    progress.finish();
    let ended = ended?;
    let watch = &ended.watch;
    output.result(
        "glasshouse.coordinate/1",
        json!({
            "run": args.run, "scenes": watch.scenes, "done": watch.done, "quarantined": watch.quarantined,
            "spans_published": ended.published, "finished": watch.finished, "wall_s": start.elapsed().as_secs_f64(),
        }),
        &format!(
            "{} of {} scenes are done, {} in quarantine{}",
            watch.done,
            watch.scenes,
            watch.quarantined,
            if ended.stopped {
                "; stopped by a signal, the same command goes on"
            } else {
                ""
            }
        ),
    );
    Ok(match (ended.stopped, watch.quarantined) {
        (true, _) => signals.exit(),
        (false, 0) => Exit::Done,
        (false, _) => Exit::Incomplete,
    })
}
