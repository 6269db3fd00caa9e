//! Tests scenes that kill or hang their worker or cannot be read, and faulty workers. The tuples of the other scenes
//! equal those of a run without faults.

use crate::processes::{all_done, assert_finished, assert_whole, coordinator, end, start, worker};
use crate::support::nats::Nats;
use crate::support::outputs::{
    Tuples, assert_same, files, manifest, quarantine_reason, read_json, tuples,
};
use crate::support::program::{Ended, PROGRAM, Running, run, text};
use crate::support::scenes::{Place, SCENES, photographs, place, reference, scene, write_lines};
use serde_json::{Value, json};
use std::path::Path;

fn ids(run: &Path) -> Vec<String> {
    let lines = manifest(run);
    let ids = lines.iter().map(|line| line["id"].as_str().unwrap());
    ids.map(str::to_owned).collect()
}

fn attempts(run: &Path, scene: &str) -> Vec<Value> {
    let folder = run.join("attempts").join(scene);
    // The other files are signs of life.
    let records =
        files(&folder).into_iter().filter(|path| path.extension() == Some("json".as_ref()));
    records.map(|path| read_json(folder.join(path))).collect()
}

/// Returns the reference without one scene.
fn without(scene: &str) -> Tuples {
    let mut all = reference().clone();
    all.retain(|path, _| !path.to_string_lossy().contains(scene));
    assert_eq!(all.len(), (SCENES - 1) * 6);
    all
}

#[track_caller]
fn assert_aborted(ended: &Ended) {
    assert_eq!(ended.code, None, "the process did not abort: {ended:#?}");
}

#[test]
fn a_scene_that_kills_four_processes_is_quarantined() {
    let place = place();
    place.plan();
    let poison = &ids(&place.run)[1];
    let fault = format!("abort:{poison}");
    let work = ["work", text(&place.run), "--fault", &fault];
    assert_aborted(&run(&work));
    assert_eq!(attempts(&place.run, poison).len(), 1);
    // Three child processes die, and their parent continues.
    run(&work).expect(3).says(&[
        "a child process traces it",
        "SIGABRT",
        "because of --fault",
        "quarantine",
    ]);
    assert_same(&tuples(&place.run), &without(poison));
    let records = attempts(&place.run, poison);
    assert_eq!(records.len(), 4);
    let crashed = records.iter().filter(|r| r["ended"]["kind"] == "crashed");
    assert_eq!(crashed.count(), 3);
    let reason = quarantine_reason(&place.run, poison);
    for word in ["4 processes", "SIGABRT", "aborts this process because of --fault"] {
        assert!(reason.contains(word), "{reason}");
    }
    // After a repair, the run renders the scene.
    std::fs::remove_dir_all(place.run.join("quarantine")).unwrap();
    std::fs::remove_dir_all(place.run.join("attempts")).unwrap();
    run(&["work", text(&place.run)]).expect(0);
    assert_same(&tuples(&place.run), reference());
}

/// A scene that did not cause the crash of its process is rendered in a child process, without quarantine.
#[test]
fn a_good_scene_of_a_crashed_process_is_rendered_in_a_child() {
    let place = place();
    place.plan();
    let innocent = &ids(&place.run)[2];
    let fault = format!("abort:{innocent}");
    assert_aborted(&run(&["work", text(&place.run), "--fault", &fault]));
    let ended = run(&["work", text(&place.run), "--json"]).expect(0);
    let ended = ended.says(&[innocent, "a child process traces it"]).json();
    assert_eq!(ended["quarantined"], json!([]));
    let (here, before) = (ended["merged"].as_u64(), ended["already_merged"].as_u64());
    assert_eq!(here.unwrap() + before.unwrap(), SCENES as u64);
    assert_same(&tuples(&place.run), reference());
    assert_eq!(files(&place.run.join("attempts")).len(), 0);
}

/// On a farm, a scene aborts each process that traces it; the test restarts dead workers, as systemd does.
#[test]
fn a_scene_aborts_at_most_four_processes_of_a_farm() {
    let Some(server) = Nats::start() else { return };
    let place = place();
    place.plan();
    let poison = ids(&place.run)[0].clone();
    let fault = format!("abort:{poison}");
    let more = ["-j", "1", "--fault", &fault];
    let coordinator = coordinator(&place, &server);
    let mut workers: Vec<Running> = (0..3).map(|_| start("work", &place, &server, &more)).collect();
    let mut deaths = 0;
    let mut done = 0;
    while let Some(worker) = workers.pop() {
        let ended = end(worker);
        if ended.code.is_none() {
            deaths += 1;
            workers.insert(0, start("work", &place, &server, &more));
        } else {
            ended.expect(0);
            done += 1;
        }
    }
    assert_eq!(done, 3);
    let crashed = |record: &&Value| record["ended"]["kind"] == "crashed";
    let crashes = attempts(&place.run, &poison).iter().filter(crashed).count();
    assert!(deaths >= 1 && deaths + crashes <= 4, "{deaths} {crashes}");
    let ended = end(coordinator).expect(3).json();
    assert_eq!(ended["quarantined"], 1);
    assert!(quarantine_reason(&place.run, &poison).contains("SIGABRT"));
    assert_same(&tuples(&place.run), &without(&poison));
}

/// The tracer of a worker hangs while its lease keeper runs: the worker ends, and another one takes the task.
#[test]
fn another_worker_takes_the_task_of_a_hanging_worker() {
    let Some(server) = Nats::start() else { return };
    let place = place();
    place.plan();
    let fault = format!("hang:{}", ids(&place.run)[0]);
    let coordinator = coordinator(&place, &server);
    let hung = start("work", &place, &server, &["-j", "1", "--fault", &fault, "--hang-s", "1"]);
    end(hung).expect(1).says(&["made no progress for 1 s"]);
    let healthy = worker(&place, &server);
    all_done(coordinator, [healthy]);
    assert_whole(&place.run, reference());
}

/// The scene hangs in every process; from the second attempt on, a child process traces it.
#[test]
fn a_scene_that_always_hangs_is_quarantined() {
    let Some(server) = Nats::start() else { return };
    let place = place();
    place.plan();
    let poison = ids(&place.run)[3].clone();
    let fault = format!("hang:{poison}");
    let more = ["-j", "1", "--fault", &fault, "--hang-s", "1"];
    let coordinator = coordinator(&place, &server);
    end(start("work", &place, &server, &more)).expect(1);
    let second = start("work", &place, &server, &more);
    end(coordinator).expect(3);
    end(second).expect(0).says(&["made no progress for 1 s"]);
    let records = attempts(&place.run, &poison);
    let hung = records.iter().filter(|r| r["ended"]["kind"] == "hung");
    assert_eq!(hung.count(), 3, "{records:#?}");
    assert_same(&tuples(&place.run), &without(&poison));
}

#[test]
fn a_slow_worker_changes_nothing() {
    let Some(server) = Nats::start() else { return };
    let place = place();
    place.plan();
    let coordinator = coordinator(&place, &server);
    let slow = start("work", &place, &server, &["-j", "1", "--fault", "slow:20"]);
    let workers = [worker(&place, &server), worker(&place, &server)];
    end(coordinator).expect(0);
    all_done(slow, workers);
    assert_whole(&place.run, reference());
}

/// Plans five scenes with photographs in `folder`.
fn rooted(folder: &Path) -> Place {
    photographs(folder);
    let mut place = place();
    let lines: Vec<Value> = (0..5).map(|n| scene(&format!("scene{n}"))).collect();
    place.recipe = folder.join("scenes.jsonl");
    write_lines(&place.recipe, &lines);
    place.plan();
    place
}

/// A worker that cannot read any photograph reports the error and leaves; no scene goes into quarantine.
#[test]
fn a_machine_without_the_photographs_leaves_the_farm() {
    let Some(server) = Nats::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let place = rooted(folder.path());
    let coordinator = coordinator(&place, &server);
    let root = format!("manifest={}", text(&folder.path().join("not-mounted")));
    let ill = start("work", &place, &server, &["-j", "1", "--root", &root]);
    let ended = end(ill).expect(1);
    assert_eq!(ended.json()["stopped"], "drained");
    ended.says(&["3 scenes in a row failed here", "leaves the rest to others", "--root"]);
    assert!(!place.run.join("quarantine").exists());
    let healthy = worker(&place, &server);
    all_done(coordinator, [healthy]);
    assert_eq!(tuples(&place.run).len(), 5 * 6);
    assert_finished(&place.run);
}

/// One photograph is missing: after four attempts its scene is in quarantine, and the others are done.
#[test]
fn a_file_that_no_worker_can_read_is_named() {
    let Some(server) = Nats::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let mut missing = scene("missing");
    missing["back"]["color"] = json!("nowhere.png");
    let manifest = folder.path().join("scenes.jsonl");
    write_lines(&manifest, &[scene("one"), missing, scene("two")]);
    let mut place = place();
    place.recipe = manifest;
    // The test removes the photograph after planning.
    let nowhere = folder.path().join("nowhere.png");
    std::fs::copy(folder.path().join("b.png"), &nowhere).unwrap();
    place.plan();
    std::fs::remove_file(nowhere).unwrap();
    let coordinator = coordinator(&place, &server);
    let workers = [worker(&place, &server), worker(&place, &server)];
    end(coordinator).expect(3);
    for worker in workers {
        end(worker).expect(0);
    }
    assert!(quarantine_reason(&place.run, "missing").contains("nowhere.png"));
    assert_eq!(tuples(&place.run).len(), 2 * 6);
}

/// An image that exceeds the memory limit of the process aborts the process without an injected fault.
#[test]
fn a_scene_too_large_for_the_memory_is_quarantined() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let mut large = scene("large");
    large["front"]["color"] = json!("large.ppm");
    let side = 8192;
    let mut ppm = format!("P6 {side} {side} 255\n").into_bytes();
    ppm.resize(ppm.len() + side * side * 3, 90);
    std::fs::write(folder.path().join("large.ppm"), ppm).unwrap();
    let manifest = folder.path().join("scenes.jsonl");
    write_lines(&manifest, &[scene("one"), large, scene("two")]);
    let out = folder.path().join("run");
    run(&["plan", text(&manifest), "--out", text(&out)]).expect(0);
    let limited = || -> Ended {
        let script = format!("ulimit -v 1300000; exec '{PROGRAM}' work '{}' -j 1", text(&out));
        let output = std::process::Command::new("bash").args(["-c", &script]).output();
        output.unwrap().into()
    };
    assert_aborted(&limited());
    limited().expect(3).says(&["SIGABRT", "memory allocation"]);
    assert!(quarantine_reason(&out, "large").contains("memory allocation"));
    assert_eq!(tuples(&out).len(), 2 * 6);
}
