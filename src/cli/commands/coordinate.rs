//! `coordinate RUN`: supplies a farm with tasks and serves the status page.

use crate::cli::args::{FARM, Global, QueueArgs};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::queue;
use crate::cli::signals::Signals;
use crate::farm::{CoordinateOptions, Watch, coordinate};
use crate::run::{Run, SILENT_LEASES, Scope, Snapshot, process_cpu_s};
use crate::serve::{ServeError, WatchedRun, serve};
use crate::store::Store;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

#[derive(Debug, ClapArgs)]
pub(super) struct CoordinateArgs {
    /// Folder of the run
    run: PathBuf,
    #[command(flatten)]
    queue: QueueArgs,
    /// Address of the status page; with port 0, the command picks a free port and prints it
    #[arg(long, value_name = "ADDR:PORT", help_heading = FARM)]
    listen: Option<std::net::SocketAddr>,
    /// File with the secret (16 characters or more) that enables the page's buttons; or set GLASSHOUSE_TOKEN
    #[arg(long, value_name = "FILE", requires = "listen", help_heading = FARM)]
    token_file: Option<PathBuf>,
}

/// Environment variable with the secret for the page's buttons.
const TOKEN: &str = "GLASSHOUSE_TOKEN";
/// Shortest time between two polls of the store.
const EVERY: Duration = Duration::from_secs(1);

pub(super) fn run(
    args: &CoordinateArgs,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    queue::fetch_run(&args.run, &args.queue)?;
    let run = Run::open(&args.run, &Roots::default())?;
    let store = queue::store(&args.run, &args.queue)?;
    if global.dry_run {
        return dry_run(args, &run, &store, output);
    }
    let signals = Signals::catch();
    let queue = queue::coordinator(&run, &args.queue)?;
    let progress = Progress::new(global, "scenes", 0);
    let options = CoordinateOptions {
        stop: signals.stop(),
        every: EVERY,
        lease: args.queue.lease_s,
        watched: args.listen.is_some(),
    };
    let watch = Arc::new(Mutex::new(Watch::new(&run)));
    let token = token(args, output)?;
    let page = args.listen.map(|address| {
        let silence = args.queue.lease_s * SILENT_LEASES;
        let source = Arc::new(WatchedRun::new(&run, &store, &watch, silence));
        serve(address, source, token.clone()).map_err(|e| Failure::new(serve_exit(&e), e))
    });
    let page = page.transpose()?;
    if let Some(page) = &page {
        output.note(&format!("the run can be watched at http://{}/", page.address()));
    }
    let start = Instant::now();
    let ended = coordinate(&run, &store, &queue, &options, &watch, &|event| {
        progress.event(event, output);
    });
    progress.finish();
    let ended = ended?;
    let counts = ended.snapshot.counts();
    let quarantined = counts.quarantined.len() as u64;
    let coordinated = Coordinated {
        run: args.run.to_string_lossy(),
        dry_run: false,
        scenes: counts.scenes,
        done: counts.merged,
        quarantined,
        spans_published: ended.published,
        finished: counts.is_finished(),
        cancelled: ended.cancelled,
        wall_s: start.elapsed().as_secs_f64(),
        cpu_s: process_cpu_s(),
        stopped: ended.stopped,
    };
    output.show("glasshouse.coordinate/1", &coordinated);
    Ok(match (ended.stopped, quarantined) {
        (true, _) => signals.exit(),
        (false, 0) if !ended.cancelled => Exit::Done,
        (false, _) => Exit::Incomplete,
    })
}

/// Counts the scenes to publish. Reads only the store, because connecting to an absent queue would block.
fn dry_run(
    args: &CoordinateArgs,
    run: &Run,
    store: &Store,
    output: &Output,
) -> Result<Exit, Failure> {
    let counts = Snapshot::take(run, store, Scope::COUNTS)?.counts();
    let planned = Planned {
        run: args.run.to_string_lossy(),
        dry_run: true,
        scenes: counts.scenes,
        done: counts.merged,
        quarantined: counts.quarantined.len(),
        scenes_left: counts.scenes_left(),
    };
    output.show("glasshouse.coordinate/1", &planned);
    Ok(Exit::Done)
}

/// Reads the secret for the page's buttons from a file or the environment, because other users can see command lines.
fn token(args: &CoordinateArgs, output: &Output) -> Result<Option<String>, Failure> {
    let Some(path) = &args.token_file else {
        #[allow(clippy::disallowed_methods, reason = "only cli reads the environment")]
        let token = std::env::var(TOKEN).ok();
        return Ok(token.filter(|token| args.listen.is_some() && !token.is_empty()));
    };
    let cannot = |e: std::io::Error| {
        failure!(Exit::Usage, "cannot read the token in {}: {e}", path.display())
    };
    let text = std::fs::read_to_string(path).map_err(cannot)?;
    let others = std::fs::metadata(path).map_err(cannot)?.mode() & 0o077;
    if others != 0 {
        output.warning(&format!("other users can read {}; run `chmod 600` on it", path.display()));
    }
    Ok(Some(text.trim().to_owned()))
}

fn serve_exit(error: &ServeError) -> Exit {
    match error {
        ServeError::WeakToken => Exit::Usage,
        _ => Exit::Failed,
    }
}

#[derive(Serialize)]
struct Planned<'a> {
    run: Cow<'a, str>,
    dry_run: bool,
    scenes: u64,
    done: u64,
    quarantined: usize,
    scenes_left: u64,
}

impl fmt::Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {} scenes would be published", self.scenes_left, self.scenes)
    }
}

#[derive(Serialize)]
struct Coordinated<'a> {
    run: Cow<'a, str>,
    dry_run: bool,
    scenes: u64,
    done: u64,
    quarantined: u64,
    spans_published: u64,
    finished: bool,
    cancelled: bool,
    wall_s: f64,
    cpu_s: f64,
    #[serde(skip)]
    stopped: bool,
}

impl fmt::Display for Coordinated<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scenes, done, quarantined, .. } = self;
        write!(f, "{done} of {scenes} scenes are done, {quarantined} in quarantine")?;
        f.write_str(match (self.stopped, self.cancelled) {
            (true, _) => "; stopped by a signal; run the same command to resume",
            (_, true) => {
                "; the run is cancelled: run `glasshouse resume RUN`, then the same command to continue"
            }
            _ => "",
        })
    }
}
