//! Ends the program if a read of a file does not return: nothing else can stop a thread inside the operating system. Ends
//! it after a signal, too, if the command says that its computations cannot be interrupted.
//!
//! Every result that a command reports is durable before, so that this end loses no more than a kill does.

use super::exit_code::{Exit, failure};
use super::output::Output;
use super::signals;
use render::input_file::longest_wait;
use std::sync::{Mutex, OnceLock};
use std::time::{Duration, Instant};

/// Time between two looks.
const EVERY: Duration = Duration::from_millis(100);
/// Time that a command has to end by itself after a signal or its time limit, if a read has not returned for as long.
const GRACE: Duration = Duration::from_secs(1);

/// Time that a command with computations that cannot be interrupted has to end by itself after a signal.
const PROMPT_GRACE: Duration = Duration::from_millis(500);

/// Set by commands that end during a computation.
static PROMPT: OnceLock<()> = OnceLock::new();
/// Held during writes, which are completed.
static WRITES: Mutex<()> = Mutex::new(());

/// Time at which the command should end.
static DEADLINE: OnceLock<Instant> = OnceLock::new();

/// Sets the time at which the command should end.
pub(super) fn set_deadline(deadline: Instant) {
    let _ = DEADLINE.set(deadline);
}

/// Lets a signal end the program within a second, whatever it computes, except inside of [`undisturbed`].
pub(super) fn end_promptly() {
    let _ = PROMPT.set(());
}

/// Writes results that a signal must not cut.
pub(super) fn undisturbed<T>(write: impl FnOnce() -> T) -> T {
    let _held = WRITES.lock();
    write()
}

/// Starts to watch the reads of this process. `hang` is the longest time without progress of a read.
pub(super) fn start(hang: Duration, output: Output) {
    std::thread::spawn(move || watch(hang, &output));
}

fn watch(hang: Duration, output: &Output) {
    let mut asked: Option<(Instant, Exit)> = None;
    loop {
        std::thread::sleep(EVERY);
        asked = asked.or_else(|| signals::caught().map(|exit| (Instant::now(), exit)));
        let timed_out = DEADLINE.get().filter(|deadline| Instant::now() >= **deadline);
        let end = asked.or(timed_out.map(|deadline| (*deadline, Exit::TryAgain)));
        if let (Some((since, exit)), Some(())) = (asked, PROMPT.get())
            && since.elapsed() >= PROMPT_GRACE
        {
            let _held = WRITES.lock();
            output.error(&failure!(exit, "stopped by a signal; finished results are complete"));
            exit.now();
        }
        let Some((path, wait)) = longest_wait() else {
            continue;
        };
        let (path, wait_s) = (path.display(), wait.as_secs());
        let failure = match end {
            Some((since, exit)) if since.elapsed() >= GRACE && wait >= GRACE => {
                failure!(
                    exit,
                    "stopped during a read of {path} that has not returned for {wait_s} s"
                )
            }
            _ if wait >= hang => failure!(
                Exit::Failed,
                "a read of {path} has not returned for {wait_s} s: check its disk or mount, or allow more time with --hang-s"
            ),
            _ => continue,
        };
        output.error(&failure);
        failure.exit.now();
    }
}
