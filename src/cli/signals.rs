//! Signal handling: after the first signal, the program finishes its current work; the second signal ends it at once.

use super::exit_code::Exit;
use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

/// The flags of the first [`Signals`].
static FIRST: OnceLock<Signals> = OnceLock::new();

/// Returns the exit code for the last signal, if the program catches signals and has caught one.
pub(super) fn caught() -> Option<Exit> {
    let signals = FIRST.get().filter(|signals| signals.stop.load(Ordering::Relaxed));
    signals.map(Signals::exit)
}

/// Flags that record the signals caught so far.
#[derive(Clone)]
pub(super) struct Signals {
    stop: Arc<AtomicBool>,
    which: Arc<AtomicUsize>,
}

impl Signals {
    /// Catches SIGINT, SIGTERM and SIGUSR1 (Slurm's warning) from now on.
    pub(super) fn catch() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let which = Arc::new(AtomicUsize::new(0));
        for signal in [SIGINT, SIGTERM, SIGUSR1] {
            // The order matters: the first signal finds `stop` unset and sets it, and only the second signal exits. A
            // signal that cannot be caught keeps its default action and ends the program, which loses no durable
            // result.
            let code = 128 + signal;
            let _ =
                signal_hook::flag::register_conditional_shutdown(signal, code, Arc::clone(&stop));
            let _ = signal_hook::flag::register_usize(signal, Arc::clone(&which), signal as usize);
            let _ = signal_hook::flag::register(signal, Arc::clone(&stop));
        }
        let signals = Self { stop, which };
        let _ = FIRST.set(signals.clone());
        signals
    }

    /// Returns the flag that the first signal sets.
    pub(super) fn stop(&self) -> &AtomicBool {
        &self.stop
    }

    /// Returns the exit code for the last signal.
    pub(super) fn exit(&self) -> Exit {
        match self.which.load(Ordering::Relaxed) as i32 {
            SIGINT => Exit::Interrupted,
            SIGUSR1 => Exit::TryAgain,
            _ => Exit::Terminated,
        }
    }
}
