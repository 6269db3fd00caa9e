//! Outputs do not depend on the number of threads, the tile size, the kernels or the run's folder.

use crate::support::outputs::{assert_same, tuples};
use crate::support::program::{command, run, text, wait_until};
use crate::support::scenes::{place, reference};

#[test]
fn threads_and_tiles_do_not_change_tuples() {
    for (threads, tile) in [("1", "16"), ("1", "64"), ("2", "64"), ("1", "100"), ("2", "100")] {
        let place = place();
        run(&[
            "run",
            text(&place.recipe),
            "--out",
            text(&place.run),
            "-j",
            threads,
            "--tile",
            tile,
        ])
        .expect(0);
        eprintln!("-j {threads} --tile {tile}");
        assert_same(&tuples(&place.run), reference());
    }
}

#[test]
fn instruction_sets_do_not_change_tuples() {
    let mut compared = 0;
    for isa in ["baseline", "avx2", "avx512"] {
        let place = place();
        place.plan();
        let ended = run(&["work", text(&place.run), "--isa", isa]);
        if isa != "baseline" && ended.code == Some(2) {
            eprintln!("skipped: {}", ended.stderr);
            continue;
        }
        ended.expect(0);
        assert_same(&tuples(&place.run), reference());
        compared += 1;
    }
    assert!(compared > 0);
}

/// A cache that holds all photographs, and one that always drops some.
#[test]
fn cached_photographs_do_not_change_tuples() {
    for (gigabytes, threads) in [("1", "2"), ("0.001", "1")] {
        let place = place();
        place.plan();
        let options = ["--photographs-gb", gigabytes, "-j", threads];
        run(&[&["work", text(&place.run)], &options[..]].concat()).expect(0);
        assert_same(&tuples(&place.run), reference());
    }
}

#[test]
fn an_unfinished_run_can_be_moved() {
    let place = place();
    let mut child = command(&place.arguments("run", &["-j", "1"])).spawn().unwrap();
    let tuple_folders = place.run.join("tuples");
    assert!(wait_until(&mut child, || tuple_folders.exists()));
    child.kill().unwrap();
    child.wait().unwrap();
    let elsewhere = place.folder.path().join("else where");
    std::fs::rename(&place.run, &elsewhere).unwrap();
    run(&["work", text(&elsewhere)]).expect(0);
    assert_same(&tuples(&elsewhere), reference());
}
