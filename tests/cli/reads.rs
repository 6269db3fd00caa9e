//! Tests of inputs that are no files, that are too large, or whose reads do not return.

use crate::support::program::{Ended, Program, command, run, send, text, wait_until};
use crate::support::scenes::{photographs, place, scene};
use crate::support::tools::stuck_reads;
use crate::support::workplace::{run_in, workplace};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Returns a command whose reads of files named "stuck" do not return.
fn stuck(library: &Path, folder: &Path, arguments: &[&str]) -> Program {
    let mut command = command(arguments);
    command.env("LD_PRELOAD", library).current_dir(folder);
    command
}

fn ended(mut command: Program) -> Ended {
    command.output().unwrap().into()
}

/// Commands that read the photograph NAME.
fn readers(name: &str) -> Vec<String> {
    vec![
        "plan NAME.jsonl --out planned".to_owned(),
        "run NAME.jsonl --out made".to_owned(),
        "render NAME.json --out rendered".to_owned(),
        "bench error --scene NAME.json --out error".to_owned(),
        #[cfg(feature = "train")]
        "separate NAME.png --network runs/smoke --out separated".to_owned(),
        #[cfg(feature = "train")]
        "evaluate NAME-pairs".to_owned(),
        "inspect NAME.png".to_owned(),
    ]
    .into_iter()
    .map(|line| line.replace("NAME", name))
    .collect()
}

/// Makes a scene, a manifest and pairs with the photograph NAME.png in a folder.
fn scene_with(folder: &Path, name: &str) {
    photographs(folder);
    let mut line = scene("one");
    line["front"]["color"] = format!("{name}.png").into();
    fs::write(folder.join(format!("{name}.json")), line.to_string()).unwrap();
    fs::write(folder.join(format!("{name}.jsonl")), format!("{line}\n")).unwrap();
    for layer in ["blended", "transmission_layer"] {
        let layer = folder.join(format!("{name}-pairs")).join(layer);
        fs::create_dir_all(&layer).unwrap();
        let photograph = format!("../../{name}.png");
        std::os::unix::fs::symlink(photograph, layer.join("1.png")).unwrap();
    }
}

fn words(line: &str) -> Vec<&str> {
    line.split(' ').collect()
}

/// Asserts that a command exits with 4 and these words.
#[track_caller]
fn refused(folder: &Path, line: &str, reason: &str) {
    let ended = run_in(folder, &words(line)).expect(4);
    assert!(format!("{}{}", ended.stdout, ended.stderr).contains(reason), "{line}: {ended:#?}");
}

#[test]
fn pipes_and_devices_are_refused_at_once() {
    let place = workplace();
    let folder = place.path();
    scene_with(folder, "pipe");
    let pipe = folder.join("pipe.png");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for line in readers("pipe") {
        refused(folder, &line, "a pipe, not a file");
    }
    fs::remove_file(&pipe).unwrap();
    std::os::unix::fs::symlink("/dev/zero", &pipe).unwrap();
    for line in readers("pipe") {
        refused(folder, &line, "a device, not a file");
    }
    for line in ["plan /dev/zero --out x", "render /dev/zero --out x", "inspect /dev/zero"] {
        refused(folder, line, "a device, not a file");
    }
}

#[test]
fn files_above_the_limit_are_refused() {
    let place = workplace();
    let folder = place.path();
    scene_with(folder, "large");
    fs::File::create(folder.join("large.png")).unwrap().set_len(30_000_000_000).unwrap();
    for line in readers("large") {
        refused(folder, &line, "it has 30000000000 bytes");
    }
}

#[test]
fn a_read_that_does_not_return_ends_every_command_after_hang_s() {
    let Some(library) = stuck_reads() else { return };
    let place = workplace();
    let folder = place.path();
    scene_with(folder, "slow");
    fs::copy(folder.join("a.png"), folder.join("stuck.png")).unwrap();
    std::os::unix::fs::symlink("stuck.png", folder.join("slow.png")).unwrap();
    for line in readers("slow") {
        let line = format!("{line} --hang-s 0.5");
        let ended = ended(stuck(library, folder, &words(&line)));
        ended.expect(1).says(&[".png has not returned", "--hang-s"]);
    }
}

#[test]
fn signals_and_time_limits_end_a_worker_whose_read_does_not_return() {
    let Some(library) = stuck_reads() else { return };
    let place = place();
    place.plan();
    let inputs = place.run.join("inputs");
    // Every photograph of the first scene waits.
    fs::rename(&inputs, place.folder.path().join("stuck")).unwrap();
    std::os::unix::fs::symlink("../stuck", &inputs).unwrap();
    let folder = place.folder.path();
    // A busy machine can reach a short limit before the first read begins.
    let is_stopped = |limit_s: &str| {
        let limited = stuck(library, folder, &["work", "run", "--time-limit", limit_s]);
        let ended = ended(limited).expect(75);
        let is_stopped = ended.stderr.contains("stopped during a read");
        if is_stopped {
            ended.says(&["inputs"]);
        }
        is_stopped
    };
    assert!(["0.2", "2", "20"].into_iter().any(is_stopped));
    for (signal, code) in [("TERM", 143), ("INT", 130)] {
        let mut child = stuck(library, folder, &["work", "run", "--json"]).spawn().unwrap();
        let open_files = format!("/proc/{}/fd", child.id());
        let reads = || {
            let entries = fs::read_dir(&open_files).into_iter().flatten().flatten();
            let targets = entries.filter_map(|entry| fs::read_link(entry.path()).ok());
            let is_photograph = |path: &PathBuf| path.is_file() && text(path).contains("/stuck/");
            targets.into_iter().any(|target| is_photograph(&target))
        };
        assert!(wait_until(&mut child, reads));
        send(&child, signal);
        let ended: Ended = child.wait_with_output().unwrap().into();
        let json = ended.expect(code).says(&["stopped during a read"]).json();
        assert_eq!(json["exit"], code);
    }
    fs::remove_file(&inputs).unwrap();
    fs::rename(place.folder.path().join("stuck"), &inputs).unwrap();
    run(&["work", text(&place.run)]).expect(0);
}

#[test]
fn a_missing_disk_stops_a_local_worker_without_quarantine() {
    let place = place();
    place.plan();
    let inputs = place.run.join("inputs");
    let elsewhere = place.folder.path().join("elsewhere");
    fs::rename(&inputs, &elsewhere).unwrap();
    let ended = run(&["work", text(&place.run)]);
    ended.expect(4).says(&["files of no scene can be opened", "is a disk not mounted?"]);
    assert!(!place.run.join("quarantine").exists());
    fs::rename(&elsewhere, &inputs).unwrap();
    run(&["work", text(&place.run)]).expect(0);
}
