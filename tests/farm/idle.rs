//! Compute threads without work cost no time, and threads that the system cannot start are an error.

use crate::support::program::{run, text};
use crate::support::scenes::{photographs, scene, write_lines};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

const PROGRAM: &str = env!("CARGO_BIN_EXE_glasshouse");

/// A folder with a manifest of tiny scenes.
fn tiny(count: usize) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let line = |number: usize| {
        let mut line = scene(&format!("s{number}"));
        line["film"] = json!({ "width": 32, "height": 32, "spp": 4 });
        line
    };
    let manifest = folder.path().join("tiny.jsonl");
    write_lines(&manifest, &(0..count).map(line).collect::<Vec<_>>());
    (folder, manifest)
}

/// Calls `work` in a shell after `before`, which also prints the CPU seconds of the call to standard error.
fn work(run: &Path, threads: &str, before: &str) -> Output {
    let script = format!("{before}; TIMEFORMAT='%U %S'; time \"$@\"");
    let arguments = ["-c", &script, "bash", PROGRAM, "work", text(run), "-q", "-j", threads];
    Command::new("bash").args(arguments).output().unwrap()
}

#[test]
fn idle_threads_sleep() {
    let (folder, manifest) = tiny(64);
    let mut cpu_s = ["2", "256"].map(|threads| {
        // The least of three, because other tests share the machine.
        let times = (0..3).map(|round| {
            let out = folder.path().join(format!("run-{threads}-{round}"));
            run(&["plan", text(&manifest), "--out", text(&out)]).expect(0);
            let ended = work(&out, threads, "true");
            let said = String::from_utf8_lossy(&ended.stderr).into_owned();
            assert!(ended.status.success(), "{said}");
            let last = said.lines().last().unwrap().to_owned();
            last.split(' ').map(|s| s.parse::<f64>().unwrap()).sum::<f64>()
        });
        times.fold(f64::INFINITY, f64::min)
    });
    // Starting 254 more threads costs some hundredths of a second in any case.
    cpu_s[0] += 0.1;
    assert!(cpu_s[1] <= 1.5 * cpu_s[0], "{cpu_s:?}");
}

#[test]
fn threads_that_cannot_start_are_an_error() {
    let (folder, manifest) = tiny(2);
    let out = folder.path().join("run");
    run(&["plan", text(&manifest), "--out", text(&out)]).expect(0);
    let ended = work(&out, "1000", "ulimit -v 1200000");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert!(said.contains("cannot start 1000 compute threads") && said.contains("-j"), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    run(&["work", text(&out)]).expect(0);
}
