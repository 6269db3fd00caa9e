//! Killed at any moment, a run ends with the same bits.

use super::program::{files, leftovers, program, recipe, run, run_json, tuples};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const SCENES: u32 = 4;
const SPP: u32 = 256;

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Waits until `ready`, at most half a minute.
fn wait_until(what: &str, mut ready: impl FnMut() -> bool) {
    let start = Instant::now();
    while !ready() {
        assert!(
            start.elapsed() < Duration::from_secs(30),
            "{what} did not happen"
        );
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn killed_three_times_it_ends_with_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = recipe(folder.path(), SCENES, SPP);
    let whole = folder.path().join("whole");
    assert_eq!(
        run(&["run", text(&recipe), "--out", text(&whole), "--tile", "16"]).0,
        0
    );
    let expected = tuples(&whole);

    // Counted in files that are there when the kill comes: a different place in the work each time.
    for (round, kills) in [[1usize, 9, 40], [3, 27, 61]].into_iter().enumerate() {
        let killed = folder.path().join(format!("killed-{round}"));
        let threads = ["1", "2"][round];
        for count in kills {
            let mut child = program()
                .args([
                    "run",
                    text(&recipe),
                    "--out",
                    text(&killed),
                    "--tile",
                    "16",
                    "-j",
                    threads,
                ])
                .stdout(Stdio::null())
                .spawn()
                .unwrap();
            let done = || {
                files(&killed.join("partials")).len() + 40 * files(&killed.join("tuples")).len() / 6
            };
            let mut ended = false;
            wait_until("a kill", || {
                ended = child.try_wait().unwrap().is_some();
                ended || done() >= count
            });
            child.kill().unwrap();
            child.wait().unwrap();
            println!(
                "round {round}: killed with {} partials and tuple files (ended by itself: {ended})",
                done()
            );
        }
        let (code, object) =
            run_json(&["run", text(&recipe), "--out", text(&killed), "--tile", "16"]);
        assert_eq!(code, 0, "{object}");
        assert!(
            tuples(&killed) == expected,
            "pixels differ after kills at {kills:?}"
        );
        assert_eq!(leftovers(&killed), Vec::<std::path::PathBuf>::new());
        // Nothing is left to do.
        let (code, object) = run_json(&["work", text(&killed)]);
        assert_eq!((code, object["shards_traced"].as_u64()), (0, Some(0)));
        assert_eq!(object["already_merged"].as_u64(), Some(u64::from(SCENES)));
    }
}

#[test]
fn killed_while_planning_it_plans_again() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = recipe(folder.path(), 2, 16);
    let out = folder.path().join("run");
    let mut child = program()
        .args(["plan", text(&recipe), "--out", text(&out), "-j", "1"])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    wait_until("a photograph", || {
        files(&out.join("inputs")).len() >= 2 || child.try_wait().unwrap().is_some()
    });
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(run(&["run", text(&recipe), "--out", text(&out)]).0, 0);
    assert_eq!(tuples(&out), {
        let whole = folder.path().join("whole");
        assert_eq!(run(&["run", text(&recipe), "--out", text(&whole)]).0, 0);
        tuples(&whole)
    });
}

#[test]
fn signals_and_time_limits_stop_cleanly() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = recipe(folder.path(), SCENES, 1024);
    let out = folder.path().join("run");
    assert_eq!(
        run(&["plan", text(&recipe), "--out", text(&out), "--tile", "16"]).0,
        0
    );

    let (code, object) = run_json(&["work", text(&out), "--time-limit", "0.05s", "-j", "1"]);
    assert_eq!(
        (code, object["stopped"].as_str()),
        (75, Some("time_limit")),
        "{object}"
    );

    for (signal, expected) in [("-TERM", 143), ("-INT", 130)] {
        let before = files(&out.join("partials")).len();
        let mut child = program()
            .args(["work", text(&out), "-j", "1"])
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        wait_until("a partial", || {
            files(&out.join("partials")).len() > before + 2
        });
        let busy = run(&["work", text(&out)]);
        assert_eq!(busy.0, 75, "{}", busy.2);
        assert!(busy.2.contains("another process is working"), "{}", busy.2);
        Command::new("kill")
            .args([signal, &child.id().to_string()])
            .status()
            .unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(expected));
    }
    let (code, object) = run_json(&["work", text(&out), "--time-limit", "1h"]);
    assert_eq!(code, 0, "{object}");
    assert!(object["shards_resumed"].as_u64().unwrap() >= 6, "{object}");
    let whole = folder.path().join("whole");
    assert_eq!(run(&["run", text(&recipe), "--out", text(&whole)]).0, 0);
    assert!(
        tuples(&whole) == tuples(&out),
        "pixels differ after signals"
    );
}
