//! `status RUN`: prints the status once, or repeatedly with `--watch`.

use crate::cli::args::{Global, ServerArgs, StoreArgs, parse_duration};
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use crate::cli::queue;
use crate::cli::signals::Signals;
use crate::cli::status_text::{Queue, line, page};
use crate::cli::target;
use crate::farm::queue::{NatsCoordinator, QueueKeeper};
use crate::run::{Run, RunState, Scope, Snapshot, Status};
use crate::store::Store;
use crate::text::printable;
use clap::Args as ClapArgs;
use glasshouse_line::Roots;
use serde::Serialize;
use std::fmt;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

#[derive(Debug, ClapArgs)]
pub(super) struct StatusArgs {
    /// Folder of the run
    run: PathBuf,
    /// Print the status every S seconds [default: 2] until the run is over; with --json one object per line
    #[arg(long, value_name = "S", num_args = 0..=1, default_missing_value = "2", value_parser = parse_duration)]
    watch: Option<Duration>,
    #[command(flatten)]
    store: StoreArgs,
    #[command(flatten)]
    server: ServerArgs,
}

/// Largest number of printed entries of each list.
const SHOWN: usize = 20;
/// Largest number of entries of each list on the screen of `--watch`.
const SHOWN_WATCHING: usize = 6;
/// Least ratio of the time between polls to the duration of a poll.
const POLL_SHARE: u32 = 10;

/// Escape codes that enter and leave the alternate screen, without line wrap and cursor.
const ENTER: &str = "\x1b[?1049h\x1b[?7l\x1b[?25l";
const LEAVE: &str = "\x1b[?25h\x1b[?7h\x1b[?1049l";
/// Escape codes that move the cursor to the top left corner and clear the screen.
const HOME: &str = "\x1b[H\x1b[2J";

pub(super) fn run(args: &StatusArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &Roots::default())?;
    let server = queue::observer(&run, &args.server)?;
    match args.watch {
        None => {
            let view = Snapshot::take(&run, &store, Scope::STATUS)?.status();
            let queue = poll(server.as_ref(), &view);
            tell(args, &run, &view, &queue, output);
            Ok(exit(&view))
        }
        Some(every) => watch(args, &run, &store, server.as_ref(), every, global, output),
    }
}

/// Prints the status until the run is over or a signal arrives; with `-n`, once.
fn watch(
    args: &StatusArgs,
    run: &Run,
    store: &Store,
    server: Option<&NatsCoordinator>,
    every: Duration,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let signals = Signals::catch();
    let mut snapshot = Snapshot::new(run, Scope::STATUS);
    let screen = Screen::new(!global.json && std::io::stdout().is_terminal());
    loop {
        let start = Instant::now();
        snapshot.refresh(run, store)?;
        let view = snapshot.status();
        let queue = poll(server, &view);
        let is_over = matches!(view.state, RunState::Finished | RunState::Cancelled);
        let is_stopped = signals.stop().load(Ordering::Relaxed);
        if is_over || is_stopped || global.dry_run {
            drop(screen);
            tell(args, run, &view, &queue, output);
            return Ok(if is_over || !is_stopped { exit(&view) } else { signals.exit() });
        }
        if global.json {
            tell(args, run, &view, &queue, output);
        } else if screen.is_open {
            screen.draw(&page(&run.spec.name, &view, &queue, SHOWN_WATCHING));
        } else {
            output.text(&line(&run.spec.name, &view));
        }
        let until = start + every.max(start.elapsed() * POLL_SHARE);
        while Instant::now() < until && !signals.stop().load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20).min(every));
        }
    }
}

fn poll(server: Option<&NatsCoordinator>, view: &Status) -> Queue {
    match server {
        Some(server) if view.state != RunState::Finished => match server.state() {
            Ok(state) => Queue::There(state),
            Err(error) => Queue::Lost(error.to_string()),
        },
        _ => Queue::None,
    }
}

fn tell(args: &StatusArgs, run: &Run, view: &Status, queue: &Queue, output: &Output) {
    let shown = Shown {
        view,
        run: &args.run,
        name: &run.spec.name,
        finished: view.state == RunState::Finished,
        queue,
    };
    output.show("glasshouse.status/1", &shown);
}

#[derive(Serialize)]
struct Shown<'a> {
    #[serde(flatten)]
    view: &'a Status,
    #[serde(serialize_with = "render::path_text::one")]
    run: &'a Path,
    name: &'a str,
    finished: bool,
    queue: &'a Queue,
}

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&page(self.name, self.view, self.queue, SHOWN))
    }
}

fn exit(view: &Status) -> Exit {
    if view.counts.quarantined.is_empty() && view.state != RunState::Cancelled {
        Exit::Done
    } else {
        Exit::Incomplete
    }
}

/// A terminal's alternate screen, if it is open; dropping this value leaves the screen.
struct Screen {
    is_open: bool,
}

impl Screen {
    fn new(is_terminal: bool) -> Self {
        if is_terminal {
            put(ENTER);
        }
        Self { is_open: is_terminal }
    }

    #[allow(clippy::unused_self, reason = "drawing needs an open screen")]
    fn draw(&self, text: &str) {
        // A single write avoids flicker.
        put(&format!("{HOME}{}\n", printable(text)));
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        if std::mem::take(&mut self.is_open) {
            put(LEAVE);
        }
    }
}

fn put(text: &str) {
    let mut stdout = std::io::stdout().lock();
    let _ = stdout.write_all(text.as_bytes());
    let _ = stdout.flush();
}
