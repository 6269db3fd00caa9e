//! `status RUN`, once or again and again.

use super::args::Global;
use super::exit_code::{Exit, Failure};
use super::farm_args::StatusArgs;
use super::output::Output;
use super::queue_cmd;
use super::signals::Signals;
use super::status_text::{Queue, line, page};
use super::target;
use crate::farm::queue::{NatsCoordinator, QueueKeeper};
use crate::run::{Observer, Overview, Run};
use crate::serve::FarmState;
use render::line::Roots;
use serde_json::{Value, json};
use std::io::{IsTerminal, Write};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Entries shown of each list: at the end, and on a screen that has an end.
const SHOWN: usize = 20;
const SHOWN_WATCHING: usize = 6;
/// A look must not cost more than a tenth of the time.
const LOOK_SHARE: u32 = 10;

/// To the other screen, without wrapping; and back.
const ENTER: &str = "\x1b[?1049h\x1b[?7l\x1b[?25l";
const LEAVE: &str = "\x1b[?25h\x1b[?7h\x1b[?1049l";
/// To its first character, with an empty screen.
const HOME: &str = "\x1b[H\x1b[2J";

pub(super) fn run(args: &StatusArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (run, store) = target::open(&args.run, args.store.store.as_deref(), &Roots::default())?;
    let server = queue_cmd::observer(&run, &args.server)?;
    let mut observer = Observer::new(&run, &store);
    match args.watch {
        None => {
            let view = observer.look()?;
            let queue = look_at(server.as_ref(), &view);
            tell(args, &run, &view, &queue, output);
            Ok(exit(&view))
        }
        Some(every) => watch(
            args,
            &run,
            &mut observer,
            server.as_ref(),
            every,
            global,
            output,
        ),
    }
}

/// Looks until the run is over or a signal comes.
fn watch(
    args: &StatusArgs,
    run: &Run,
    observer: &mut Observer,
    server: Option<&NatsCoordinator>,
    every: Duration,
    global: &Global,
    output: &Output,
) -> Result<Exit, Failure> {
    let signals = Signals::catch();
    let screen = Screen::new(!global.json && std::io::stdout().is_terminal());
    loop {
        let start = Instant::now();
        let view = observer.look()?;
        let queue = look_at(server, &view);
        let is_over = matches!(view.state, FarmState::Finished | FarmState::Cancelled);
        let is_stopped = signals.stop().load(Ordering::Relaxed);
        if is_over || is_stopped || global.dry_run {
            drop(screen);
            tell(args, run, &view, &queue, output);
            return Ok(if is_over || !is_stopped {
                exit(&view)
            } else {
                signals.exit()
            });
        }
        if global.json {
            tell(args, run, &view, &queue, output);
        } else if screen.is_open {
            screen.draw(&page(&run.spec.name, &view, &queue, SHOWN_WATCHING));
        } else {
            output.text(&line(&run.spec.name, &view));
        }
        let until = start + every.max(start.elapsed() * LOOK_SHARE);
        while Instant::now() < until && !signals.stop().load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20).min(every));
        }
    }
}

fn look_at(server: Option<&NatsCoordinator>, view: &Overview) -> Queue {
    match server {
        Some(server) if view.state != FarmState::Finished => match server.look() {
            Ok(state) => Queue::There(state),
            Err(error) => Queue::Lost(error.to_string()),
        },
        _ => Queue::None,
    }
}

fn tell(args: &StatusArgs, run: &Run, view: &Overview, queue: &Queue, output: &Output) {
    let mut object = serde_json::to_value(view).unwrap_or_default();
    object["run"] = json!(args.run);
    object["name"] = json!(run.spec.name);
    object["finished"] = json!(view.state == FarmState::Finished);
    object["queue"] = match queue {
        Queue::None => Value::Null,
        Queue::There(state) => {
            json!({ "spans_waiting": state.waiting, "spans_held": state.held, "reason": null })
        }
        Queue::Lost(reason) => {
            json!({ "spans_waiting": null, "spans_held": null, "reason": reason })
        }
    };
    let text = page(&run.spec.name, view, queue, SHOWN);
    output.result("glasshouse.status/1", object, &text);
}

fn exit(view: &Overview) -> Exit {
    if view.counts.quarantined.is_empty() && view.state != FarmState::Cancelled {
        Exit::Done
    } else {
        Exit::Incomplete
    }
}

/// A terminal's other screen, which is left whatever happens.
struct Screen {
    is_open: bool,
}

impl Screen {
    fn new(is_terminal: bool) -> Self {
        if is_terminal {
            put(ENTER);
        }
        Self {
            is_open: is_terminal,
        }
    }

    #[allow(clippy::unused_self, reason = "only who holds the screen draws")]
    fn draw(&self, text: &str) {
        // In one write, so that nothing flickers.
        put(&format!("{HOME}{text}\n"));
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
