//! Calls that fail with EIO or ENOSPC: a command says so or succeeds, and the same command later gives the same bits.

use super::disk::put_tree;
use super::parallel::each;
use super::phase::{Phase, phases, run_in, scratch};
use super::recording::{can_trace, traced};
use super::recovery::recovered;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Calls that fail, and their error with the system's words for it.
const FAULTS: [(&str, &str, &str); 7] = [
    ("write,writev", "ENOSPC", "No space left on device"),
    ("write,writev", "EIO", "Input/output error"),
    ("fsync,fdatasync,syncfs", "EIO", "Input/output error"),
    ("rename,renameat,renameat2,link,linkat", "ENOSPC", "No space left on device"),
    ("mkdir,mkdirat", "ENOSPC", "No space left on device"),
    ("unlink,unlinkat,rmdir", "EIO", "Input/output error"),
    ("read,pread64", "EIO", "Input/output error"),
];

/// Number of commands in which a call failed.
static INJECTED: AtomicUsize = AtomicUsize::new(0);

/// A failure of the `when`-th of the calls of each thread.
struct Injected<'a> {
    phase: &'a Phase,
    fault: (&'static str, &'static str, &'static str),
    when: usize,
}

fn inject(injected: &Injected) -> Result<(), String> {
    let Injected { phase, fault: (calls, error, words), when } = injected;
    let folder = scratch();
    let at = folder.path();
    put_tree(&phase.journal.before.tree(), at);
    let trace = format!("trace={calls}");
    let inject = format!("inject={calls}:error={error}:when={when}");
    let log = at.with_extension("strace");
    let options = ["-e", &trace, "-e", &inject, "-o", log.to_str().unwrap()];
    let output = traced(&options, at, &phase.arguments).output().unwrap();
    let is_injected = std::fs::read_to_string(&log).is_ok_and(|log| log.contains("(INJECTED)"));
    let _ = std::fs::remove_file(log);
    let said = String::from_utf8_lossy(&output.stderr);
    let failed = |reason: &str| {
        let line = phase.arguments.join(" ");
        Err(format!("`{line}`, {error} in call {when} of {calls}: {reason}: {said}"))
    };
    if is_injected {
        INJECTED.fetch_add(1, Ordering::Relaxed);
    }
    match output.status.code() {
        // The dynamic loader could not read a library.
        Some(127) => return Ok(()),
        Some(0) => {
            if let Err(reason) = recovered_without_maps(phase, at)
                // A leftover does no harm: the removal failed.
                && !reason.contains("is left")
            {
                return failed(&format!("exit code 0, but {reason}"));
            }
        }
        _ if !is_injected => return failed("it fails without a fault"),
        // A failed write of a message leaves no words.
        Some(1 | 3 | 4) if said.contains(words) || calls.starts_with("write") => {}
        code => return failed(&format!("exit code {code:?}, without the words {words:?}")),
    }
    recover(phase, at).or_else(|reason| failed(&reason))
}

/// Repeats the command without faults. Scenes with unreadable inputs need `retry` before.
fn recover(phase: &Phase, at: &Path) -> Result<(), String> {
    if at.join("run/quarantine").is_dir() {
        run_in(at, &["retry", "run", "--all"]);
    }
    let ended = run_in(at, &phase.arguments);
    if ended.code != Some(0) {
        return Err(format!("later it ends with {:?}: {}", ended.code, ended.stderr));
    }
    recovered_without_maps(phase, at)
}

/// Compares the results. A worker that cannot put a noise map continues without one, as docs/formats.md says.
fn recovered_without_maps(phase: &Phase, at: &Path) -> Result<(), String> {
    for (map, bytes) in &phase.reference {
        let path = at.join(map);
        if let (true, Some(bytes), false) = (map.starts_with("run/noise"), bytes, path.exists()) {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, &**bytes).unwrap();
        }
    }
    recovered(phase, at)
}

/// Lets the first, second, ... `most`-th call fail, then every `step`-th up to `last`.
fn fail(most: usize, step: usize, last: usize) {
    if !can_trace() {
        return;
    }
    let phases = phases();
    let moments: Vec<usize> = (1..=most).chain((most + step..=last).step_by(step)).collect();
    let mut faults = Vec::new();
    for phase in phases {
        for fault in FAULTS {
            faults.extend(moments.iter().map(|&when| Injected { phase, fault, when }));
        }
    }
    let wrong = each(&faults, inject);
    let injected = INJECTED.load(Ordering::Relaxed);
    eprintln!(
        "{injected} of {} commands had failing calls; wrong or lost results: {}",
        faults.len(),
        wrong.len()
    );
    assert!(injected > faults.len() / 2, "strace made too few calls fail");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn failing_calls_are_reported_and_change_no_result() {
    fail(1, 4, 5);
}

#[test]
#[ignore = "takes minutes; `just crash` runs it"]
fn every_failing_call_is_reported_and_changes_no_result() {
    fail(12, 5, 60);
}

/// Trains nine steps without a checkpoint in between, with `options` of strace.
fn train_nine(options: &[&str], folder: &Path) -> std::process::Output {
    let line = "train run --stage backtrack --steps 9 --checkpoint-every 100 --keep 9 -j 1";
    let arguments: Vec<&str> = line.split(' ').collect();
    traced(options, folder, &arguments).output().unwrap()
}

#[test]
fn a_line_of_metrics_that_cannot_be_written_loses_no_step() {
    if !can_trace() {
        return;
    }
    let phase = phases().iter().find(|phase| phase.name == "checkpoint").unwrap();
    let [whole, failing] = [(); 2].map(|()| {
        let folder = scratch();
        put_tree(&phase.journal.before.tree(), folder.path());
        folder
    });
    let quiet = ["-e", "trace=fsync", "-o", "/dev/null"];
    assert!(train_nine(&quiet, whole.path()).status.success());
    let stage = failing.path().join("run/train/backtrack");
    let metrics = stage.join("metrics.csv");
    let log = failing.path().join("log");
    let options = ["-P", metrics.to_str().unwrap(), "-e", "trace=write", "-e"];
    let inject = ["inject=write:error=ENOSPC:when=4", "-o", log.to_str().unwrap()];
    let ended = train_nine(&[&options[..], &inject[..]].concat(), failing.path());
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert!(said.contains("metrics.csv") && said.contains("No space left"), "{said}");
    assert!(stage.join("step-0000004/state.json").exists(), "{said}");
    // The next call takes the other five steps, to the same bits.
    assert!(train_nine(&quiet, failing.path()).status.success());
    let lines = std::fs::read_to_string(&metrics).unwrap();
    let steps: Vec<&str> = lines.lines().skip(1).filter_map(|l| l.split(',').next()).collect();
    assert_eq!(steps, ["1", "2", "3", "5", "6", "7", "8", "9"]);
    let model = |folder: &Path| {
        let model = "run/train/backtrack/step-0000009/model.safetensors";
        std::fs::read(folder.join(model)).unwrap()
    };
    assert!(model(whole.path()) == model(failing.path()));
}
