//! `coordinate RUN`

use super::args::{CoordinateArgs, Global};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::queue_cmd;
use super::signals::Signals;
use crate::farm::{CoordinateOptions, coordinate};
use crate::run::{Observer, Run, Watch, process_cpu_s};
use crate::serve::WatchedRun;
use crate::serve::{ServeError, serve};
use crate::store::Store;
use render::line::Roots;
use serde_json::json;
use std::os::unix::fs::MetadataExt;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Environment variable with the secret for the page's buttons.
const TOKEN: &str = "GLASSHOUSE_TOKEN";
/// Shortest time between two looks.
const EVERY: Duration = Duration::from_secs(1);

pub(super) fn run(
    args: &CoordinateArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    queue_cmd::fetch_run(&args.run, &args.queue)?;
    let run = Run::open(&args.run, &Roots::default())?;
    let store = queue_cmd::store(&args.run, &args.queue)?;
    if global.dry_run {
        return dry_run(args, &run, &store, output);
    }
    let signals = Signals::catch();
    let queue = queue_cmd::coordinator(&run, &args.queue)?;
    let progress = Progress::new(global, "scenes", 0);
    let options = CoordinateOptions {
        stop: signals.stop(),
        every: EVERY,
        watched: args.listen.is_some(),
    };
    let watch = Arc::new(Mutex::new(Watch::default()));
    let token = token(args, output)?;
    let silent_s = 20.0 * args.queue.lease_s.as_secs_f64();
    let page = args.listen.map(|address| {
        let source = Arc::new(WatchedRun::new(&run, &store, &watch, silent_s));
        serve(address, source, token.clone()).map_err(|e| Failure::new(serve_exit(&e), e))
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
            "run": args.run, "dry_run": false, "scenes": watch.scenes, "done": watch.done, "quarantined": watch.quarantined,
            "spans_published": ended.published, "finished": watch.finished,
            "cancelled": ended.cancelled, "wall_s": start.elapsed().as_secs_f64(),
            "cpu_s": process_cpu_s(),
        }),
        &format!(
            "{} of {} scenes are done, {} in quarantine{}",
            watch.done,
            watch.scenes,
            watch.quarantined,
            match (ended.stopped, ended.cancelled) {
                (true, _) => "; stopped by a signal, the same command goes on",
                (_, true) =>
                    "; the run is cancelled, after `glasshouse resume RUN` the same command goes on",
                _ => "",
            }
        ),
    );
    Ok(match (ended.stopped, watch.quarantined) {
        (true, _) => signals.exit(),
        (false, 0) if !ended.cancelled => Exit::Done,
        (false, _) => Exit::Incomplete,
    })
}

/// Looks at the store alone: a queue that is away would be waited for.
fn dry_run(
    args: &CoordinateArgs,
    run: &Run,
    store: &Store,
    output: &Output,
) -> Result<Exit, Failure> {
    let status = Observer::new(run, store).look()?.counts;
    let quarantined = status.quarantined.len() as u64;
    let left = status.scenes - status.merged - quarantined;
    output.result(
        "glasshouse.coordinate/1",
        json!({
            "run": args.run, "dry_run": true, "scenes": status.scenes, "done": status.merged,
            "quarantined": quarantined, "scenes_left": left,
        }),
        &format!("{left} of {} scenes would be published", status.scenes),
    );
    Ok(Exit::Done)
}

/// The secret for the page's buttons, from a file or the environment: a command line is seen by every user of a machine.
fn token(args: &CoordinateArgs, output: &Output) -> Result<Option<String>, Failure> {
    let Some(path) = &args.token_file else {
        #[allow(
            clippy::disallowed_methods,
            reason = "cli is where the environment is read"
        )]
        let token = std::env::var(TOKEN).ok();
        return Ok(token.filter(|token| args.listen.is_some() && !token.is_empty()));
    };
    let cannot = |e: std::io::Error| {
        let error = anyhow::anyhow!("cannot read the token in {}: {e}", path.display());
        Failure::new(Exit::Usage, error)
    };
    let text = std::fs::read_to_string(path).map_err(cannot)?;
    let others = std::fs::metadata(path).map_err(cannot)?.mode() & 0o077;
    if others != 0 {
        output.warning(&format!(
            "{} can be read by others; `chmod 600` it",
            path.display()
        ));
    }
    Ok(Some(text.trim().to_owned()))
}

fn serve_exit(error: &ServeError) -> Exit {
    match error {
        ServeError::WeakToken => Exit::Usage,
        _ => Exit::Failed,
    }
}
