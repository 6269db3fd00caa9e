//! After signals, time limits and full disks, finished work remains, and the exit code gives the reason.

use crate::support::outputs::{assert_same, assert_tidy, files, manifest, tuples};
use crate::support::program::{Ended, command, run, run_on_full_disk, send, text, wait_until};
use crate::support::scenes::{SCENES, SHARDS, place, reference};
use glasshouse::run::Run;
use glasshouse_line::Roots;
use std::path::Path;

fn stopped_by(signal: &str, code: i32) {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    let mut child = command(&["work", folder, "-j", "1", "--json"]).spawn().unwrap();
    let partials = place.run.join("partials");
    let is_begun = || files(&partials).iter().any(|p| p.extension().is_some_and(|e| e == "exr"));
    assert!(wait_until(&mut child, is_begun));
    send(&child, signal);
    let ended: Ended = child.wait_with_output().unwrap().into();
    let stopped = ended.expect(code).json();
    assert_eq!(stopped["stopped"], "signal");
    let traced = stopped["shards_traced"].as_u64().unwrap();
    assert!(traced > 0 && traced < (SCENES * SHARDS) as u64, "{traced}");

    let status = run(&["status", folder, "--json"]).expect(0).json();
    assert_eq!(status["shards_done"], traced, "a traced shard is lost");
    let outcome = run(&["work", folder, "--json"]).expect(0).json();
    let merged = stopped["merged"].as_u64().unwrap();
    assert_eq!(outcome["already_merged"], merged);
    assert_eq!(outcome["shards_resumed"], traced - merged * SHARDS as u64);
    assert_eq!(outcome["shards_traced"], (SCENES * SHARDS) as u64 - traced);
    assert_same(&tuples(&place.run), reference());
    assert_tidy(&place.run);
}

#[test]
fn sigterm_exits_with_143() {
    stopped_by("TERM", 143);
}

#[test]
fn sigint_exits_with_130() {
    stopped_by("INT", 130);
}

#[test]
fn an_interrupted_render_gives_a_json_error() {
    let place = place();
    place.plan();
    let scene = place.run.join("one.json");
    std::fs::write(&scene, manifest(&place.run)[0].to_string()).unwrap();
    let root = format!("sample={}", text(&place.run.join("inputs/sample")));
    let out = place.run.join("out");
    // The samples take far longer than the test.
    let arguments = ["render", text(&scene), "--out", text(&out), "--root", &root];
    let more = ["--spp", "65536", "--json", "-q"];
    let mut child = command(&[&arguments[..], &more].concat()).spawn().unwrap();
    let status = format!("/proc/{}/status", child.id());
    if !Path::new(&status).exists() {
        eprintln!("skipped: without /proc, caught signals are unknown");
        child.kill().unwrap();
        child.wait().unwrap();
        return;
    }
    // Bit 14 of SigCgt is set if the process catches SIGTERM.
    let catches = || {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let mask = text.lines().find_map(|l| l.strip_prefix("SigCgt:"));
        mask.and_then(|m| u64::from_str_radix(m.trim(), 16).ok()).is_some_and(|m| m >> 14 & 1 == 1)
    };
    assert!(wait_until(&mut child, catches));
    send(&child, "TERM");
    let ended: Ended = child.wait_with_output().unwrap().into();
    let error = ended.expect(143).json();
    assert_eq!(error["exit"], 143);
    assert!(!out.exists());
}

#[test]
fn a_time_limit_exits_with_75_until_the_run_is_done() {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    let ended = run(&["work", folder, "--time-limit", "0", "--json"]).expect(75);
    assert_eq!(ended.json()["stopped"], "time_limit");
    assert_eq!(ended.json()["shards_traced"], 0);
    // The run resumes in short time slots, as in a batch queue.
    let mut slots = 0;
    loop {
        slots += 1;
        let ended = run(&["work", folder, "--time-limit", "0.3s"]);
        if ended.code == Some(0) {
            break;
        }
        ended.expect(75);
        assert!(slots < 100, "no progress");
    }
    assert_same(&tuples(&place.run), reference());
    run(&["work", folder, "--time-limit", "0"]).expect(0);
}

#[test]
fn a_second_process_exits_with_75() {
    let place = place();
    place.plan();
    let run_in_use = Run::open(&place.run, &Roots::default()).unwrap();
    let lock = run_in_use.lock().unwrap();
    let folder = text(&place.run);
    for arguments in [vec!["work", folder], vec!["merge", folder], place.arguments("run", &[])] {
        run(&arguments).expect(75).says(&["another process", folder]);
    }
    // Commands that only read are allowed.
    run(&["status", folder]).expect(0);
    drop(lock);
    run(&["work", folder]).expect(0);
}

/// A limit on the size of files simulates a full disk.
#[test]
fn a_run_on_a_full_disk_exits_with_1_and_can_be_resumed() {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    run_on_full_disk(&["work", folder]).expect(1).says(&["cannot write", folder, "space"]);
    let elsewhere = place.folder.path().join("new");
    run_on_full_disk(&["plan", text(&place.recipe), "--out", text(&elsewhere)])
        .expect(1)
        .says(&["cannot write", text(&elsewhere)]);
    assert!(!elsewhere.join("spec.json").exists());
    run(&["work", folder]).expect(0);
    assert_same(&tuples(&place.run), reference());
    assert_tidy(&place.run);
}

#[test]
fn a_read_only_folder_exits_with_1() {
    let place = place();
    place.plan();
    std::fs::write(place.run.join("partials"), b"a file where a folder should be").unwrap();
    run(&["work", text(&place.run)]).expect(1).says(&["cannot list", "partials", "permissions"]);

    let read_only = place.folder.path().join("read-only");
    std::fs::create_dir(&read_only).unwrap();
    let mut permissions = std::fs::metadata(&read_only).unwrap().permissions();
    permissions.set_readonly(true);
    std::fs::set_permissions(&read_only, permissions).unwrap();
    if std::fs::write(read_only.join("probe"), b"").is_ok() {
        eprintln!("skipped the read-only folder: this user may write everywhere");
        return;
    }
    let out = read_only.join("run");
    run(&["plan", text(&place.recipe), "--out", text(&out)])
        .expect(1)
        .says(&["cannot write", text(&out)]);
}
