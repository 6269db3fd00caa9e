//! Faults that hold a command: a stop at a call, and a folder that moves away meanwhile. (`tests/cli/reads.rs` tests reads
//! that never return: a tracer that delays a call also delays the end of the process.)

use super::disk::put_tree;
use super::phase::{Phase, phases, scratch};
use super::recording::{can_trace, traced};
use crate::support::program::LONGEST;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Instant;
use tempfile::TempDir;

/// Stops a command at the first of `calls` in a thread, calls `act`, and continues the command.
fn run_and_act(folder: &Path, calls: &str, arguments: &[&str], act: impl FnOnce()) -> Output {
    let logs = tempfile::tempdir().unwrap();
    let log = logs.path().join("log");
    let (trace, inject) = (format!("trace={calls}"), format!("inject={calls}:signal=STOP:when=1"));
    let options = ["-e", "signal=all", "-e", &trace, "-e", &inject, "-o", log.to_str().unwrap()];
    let mut command = traced(&options, folder, arguments);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut watched = Watched::new(child);
    let stopped = || {
        let log = std::fs::read_to_string(&log).unwrap_or_default();
        let line = log.lines().find(|line| line.contains("stopped by SIGSTOP"));
        line.and_then(|line| line.split(' ').next()).map(str::to_owned)
    };
    let thread = watched.wait(stopped).expect("the command reaches the call");
    act();
    // Other threads stop at their own first call.
    let watched_end = watched.wait(|| {
        let _ = Command::new("kill").args(["-CONT", &thread]).stderr(Stdio::null()).status();
        None::<()>
    });
    assert!(watched_end.is_none());
    watched.end()
}

/// A child that is killed if it does not end within [`LONGEST`].
struct Watched(Option<Child>);

impl Watched {
    fn new(child: Child) -> Self {
        Self(Some(child))
    }

    /// Polls until `find` finds something, or returns `None` once the child has ended.
    fn wait<T>(&mut self, mut find: impl FnMut() -> Option<T>) -> Option<T> {
        let (start, child) = (Instant::now(), self.0.as_mut()?);
        loop {
            if let Some(found) = find() {
                return Some(found);
            }
            if child.try_wait().unwrap().is_some() {
                return None;
            }
            if start.elapsed() > LONGEST {
                let _ = child.kill();
                panic!("the command does not end");
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
    }

    fn end(mut self) -> Output {
        self.wait(|| None::<()>);
        self.0.take().unwrap().wait_with_output().unwrap()
    }
}

/// Returns a folder before `work`, and the phase.
fn planned() -> (TempDir, &'static Phase) {
    let phase = phases().iter().find(|phase| phase.name == "work").unwrap();
    let folder = scratch();
    put_tree(&phase.journal.before.tree(), folder.path());
    (folder, phase)
}

#[test]
fn work_goes_on_after_it_was_stopped_at_a_call() {
    if !can_trace() {
        return;
    }
    let (folder, phase) = planned();
    let mut is_stopped = false;
    let ended = run_and_act(folder.path(), "linkat", &phase.arguments, || is_stopped = true);
    assert!(is_stopped && ended.status.success(), "{ended:?}");
}

#[test]
fn work_fails_if_its_folder_moves() {
    if !can_trace() {
        return;
    }
    let (folder, phase) = planned();
    let run = folder.path().join("run");
    let moved = folder.path().join("moved");
    let ended = run_and_act(folder.path(), "linkat", &phase.arguments, || {
        std::fs::rename(&run, &moved).unwrap();
    });
    assert_eq!(ended.status.code(), Some(1), "{ended:?}");
    assert!(!run.exists(), "the folder was made again");
}
