//! Kills a run at random moments of planning and tracing, and then repeats the command.

use crate::support::outputs::{assert_same, assert_tidy, files, tuples};
use crate::support::program::{command, random, run, text, wait_until};
use crate::support::scenes::{SCENES, SHARDS, place, reference};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;

/// Counts the finished shards by their files.
fn shards_done(run: &Path) -> usize {
    let is_record = |p: &&std::path::PathBuf| p.ends_with("tuple.json");
    let merged = files(&run.join("tuples")).iter().filter(is_record).count();
    merged * SHARDS + files(&run.join("partials")).len()
}

fn killed_three_times(threads: &str) {
    let place = place();
    let arguments = place.arguments("run", &["-j", threads]);
    let total = SCENES * SHARDS;
    let mut kills = 0;
    let mut targets = [random(total / 2), random(total / 2) + total / 4];
    targets.sort_unstable();
    // The first kill hits the planner while it makes photographs, and the other two hit the tracer.
    let photograph_files = random(12) + 1;
    eprintln!("-j {threads}: kills at {photograph_files} input files, then {targets:?} shards");
    let inputs = place.run.join("inputs");
    let moments: [&dyn Fn() -> bool; 3] = [
        &|| files(&inputs).len() >= photograph_files,
        &|| shards_done(&place.run) > targets[0],
        &|| shards_done(&place.run) > targets[1],
    ];
    for moment in moments {
        let mut child = command(&arguments).spawn().unwrap();
        wait_until(&mut child, moment);
        child.kill().unwrap();
        let ended = child.wait_with_output().unwrap();
        match ended.status.signal() {
            Some(9) => kills += 1,
            _ => assert!(ended.status.success(), "{ended:?}"),
        }
    }
    assert!(kills > 0, "every process ended before the test killed it");
    run(&arguments).expect(0);
    assert_same(&tuples(&place.run), reference());
    assert_tidy(&place.run);
}

#[test]
fn a_killed_run_resumes_on_one_thread() {
    killed_three_times("1");
}

#[test]
fn a_killed_run_resumes_on_two_threads() {
    killed_three_times("2");
}

/// Creates the files that a kill leaves at moments that random kills rarely hit.
#[test]
fn leftovers_of_a_killed_process_are_removed() {
    let place = place();
    place.plan();
    run(&["work", text(&place.run)]).expect(0);
    let scene = files(&place.run.join("tuples"))[0].parent().unwrap().to_owned();
    // A kill after the write of tuple.json can leave partials; a kill during a write can leave `.tmp-*`.
    let partials = place.run.join("partials").join(&scene);
    std::fs::create_dir_all(&partials).unwrap();
    std::fs::create_dir_all(place.run.join("quarantine")).unwrap();
    std::fs::create_dir_all(place.run.join("report")).unwrap();
    let mut left = vec![partials.join("000003.exr"), partials.join(".tmp-a1")];
    for folder in ["", "quarantine", "report", "inputs/sample/train/indoors"] {
        left.push(place.run.join(folder).join(".tmp-b2"));
    }
    left.push(place.run.join("tuples").join(&scene).join(".tmp-c3"));
    for folder in ["noise", "logs", "receipts", "conflicts"] {
        std::fs::create_dir_all(place.run.join(folder)).unwrap();
    }
    // A kill during a put can leave an object with `#1` after its name.
    for object in
        ["receipts/a.json", "noise/a.exr", "logs/a.json", "quarantine/a.json", "conflicts/a"]
    {
        left.push(place.run.join(format!("{object}#1")));
    }
    left.push(place.run.join("tuples").join(&scene).join("tuple.exr#12"));
    for path in &left {
        std::fs::write(path, b"half").unwrap();
    }
    run(&["work", text(&place.run)]).expect(0);
    assert_eq!(left.iter().find(|path| path.exists()), None);
    assert_tidy(&place.run);
    assert_same(&tuples(&place.run), reference());
}
