//! Pauses, resumes and cancels a run while one or more processes work on it; no result is lost.

use crate::processes::{LONG_SLEEP, alone, coordinator, end, results, slow_place, start};
use crate::support::nats::Nats;
use crate::support::outputs::{assert_same, tuples};
use crate::support::program::{Running, command, run, send, text};
use crate::support::scenes::{Place, SCENES};
use crate::support::tools::wait_for;
use serde_json::Value;
use std::time::Duration;

/// Options of a slow worker.
const SLOW: [&str; 4] = ["-j", "1", LONG_SLEEP[0], LONG_SLEEP[1]];

/// A time longer than the interval between two polls of a folder.
const LOOK: Duration = Duration::from_millis(2500);

fn status(place: &Place, more: &[&str]) -> Value {
    let arguments = [&["status", text(&place.run), "--json"], more].concat();
    let ended = run(&arguments);
    assert!(matches!(ended.code, Some(0 | 3)), "{ended:?}");
    ended.json()
}

fn tell(place: &Place, verb: &str) -> Value {
    run(&[verb, text(&place.run), "--json"]).expect(0).json()
}

fn work(place: &Place) -> Running {
    let arguments = [&["work", text(&place.run), "--json"], &SLOW[..]].concat();
    command(&arguments).spawn().unwrap()
}

#[test]
fn a_process_waits_while_its_run_is_paused() {
    let place = slow_place();
    let told = run(&["pause", text(&place.run), "--reason", "backup", "--json"]).expect(0).json();
    assert_eq!((&told["before"], &told["state"]), (&"running".into(), &"paused".into()));
    let mut child = work(&place);
    std::thread::sleep(LOOK);
    assert!(child.try_wait().unwrap().is_none());
    assert_eq!(results(&place.run), 0);
    let paused = status(&place, &[]);
    assert_eq!((&paused["state"], &paused["reason"]), (&"paused".into(), &"backup".into()));

    // The run resumes and is paused again midway: the process finishes its open scenes and opens no others.
    tell(&place, "resume");
    wait_for("a result", || results(&place.run) > 0);
    tell(&place, "pause");
    wait_for("the end of open scenes", || {
        let now = status(&place, &[]);
        now["started"] == 0 && now["merged"] != 0
    });
    std::thread::sleep(LOOK);
    let before = status(&place, &[]);
    assert!(before["merged"].as_u64().unwrap() < SCENES as u64, "{before}");
    std::thread::sleep(LOOK);
    assert_eq!(status(&place, &[])["shards_done"], before["shards_done"]);
    assert!(child.try_wait().unwrap().is_none());

    tell(&place, "resume");
    let ended = end(child).expect(0).says(&["paused (backup)", "resumed"]);
    assert_eq!(ended.json()["merged"], SCENES);
    assert_same(&tuples(&place.run), alone(&place));
}

#[test]
fn a_paused_process_still_stops() {
    let place = slow_place();
    tell(&place, "pause");
    let child = work(&place);
    std::thread::sleep(Duration::from_secs(1));
    send(&child, "TERM");
    end(child).expect(143);
    // A time limit also ends a paused process.
    let limited = run(&["work", text(&place.run), "--time-limit", "1"]);
    limited.expect(75);
    assert_eq!(results(&place.run), 0);
}

#[test]
fn a_cancelled_run_ends_and_can_be_resumed() {
    let place = slow_place();
    let child = work(&place);
    wait_for("a result", || results(&place.run) > 0);
    tell(&place, "cancel");
    let ended = end(child).expect(3).says(&["cancelled"]).json();
    assert_eq!(ended["stopped"], "cancelled");
    let cancelled = status(&place, &[]);
    assert_eq!(cancelled["state"], "cancelled");
    assert_ne!(cancelled["shards_done"], cancelled["shards"]);
    let again = end(work(&place)).expect(3).json();
    assert_eq!(again["shards_traced"], 0);
    // A pause must not replace the cancellation.
    run(&["pause", text(&place.run)]).expect(1).says(&["resume"]);
    assert_eq!(tell(&place, "resume")["before"], "cancelled");
    let ended = end(work(&place)).expect(0).json();
    // The cancelled process stored the shards that it was tracing.
    let traced = ended["shards_traced"].as_u64().unwrap();
    let done = cancelled["shards_done"].as_u64().unwrap();
    assert_eq!(traced + done, cancelled["shards"].as_u64().unwrap());
    assert_same(&tuples(&place.run), alone(&place));
}

#[test]
fn a_damaged_control_record_pauses_the_run() {
    let place = slow_place();
    std::fs::write(place.run.join("control.json"), b"{\"schema\"").unwrap();
    let held = status(&place, &[]);
    assert_eq!(held["state"], "paused");
    let reason = held["reason"].as_str().unwrap();
    assert!(reason.contains("control.json") && reason.contains("resume"), "{reason}");
    tell(&place, "resume");
    assert_eq!(status(&place, &[])["state"], "running");
}

#[test]
fn a_farm_can_be_paused_resumed_and_cancelled() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let url = server.url();
    let first = coordinator(&place, &server);
    let queue = || status(&place, &["--queue", &url])["queue"].clone();
    wait_for("a full queue", || queue()["spans_waiting"] == SCENES);
    tell(&place, "pause");
    let workers = [start("work", &place, &server, &SLOW), start("work", &place, &server, &SLOW)];
    std::thread::sleep(LOOK);
    assert_eq!(results(&place.run), 0);
    let now = queue();
    assert_eq!((&now["spans_waiting"], &now["spans_held"]), (&SCENES.into(), &0.into()));
    tell(&place, "resume");
    wait_for("a result", || results(&place.run) > 2);

    tell(&place, "cancel");
    let ended = end(first).expect(3).says(&["cancelled"]).json();
    assert_eq!((&ended["cancelled"], &ended["finished"]), (&true.into(), &false.into()));
    for worker in workers {
        let ended = end(worker).expect(3).json();
        assert_eq!(ended["stopped"], "cancelled");
        // A worker may donate a task before the cancellation; after it, workers publish none.
        assert!(ended["spans_given"].as_u64().unwrap() <= 1, "{ended}");
    }
    let cancelled = status(&place, &["--queue", &url]);
    assert!(cancelled["merged"].as_u64().unwrap() < SCENES as u64);
    // The coordinator has removed the queue.
    assert!(cancelled["queue"]["reason"].is_string(), "{cancelled}");
    assert!(!place.run.join("finished.json").exists());
    end(coordinator(&place, &server)).expect(3);
    end(start("work", &place, &server, &SLOW)).expect(3);

    tell(&place, "resume");
    let all = [coordinator(&place, &server), start("work", &place, &server, &SLOW)];
    for one in all {
        end(one).expect(0);
    }
    assert_same(&tuples(&place.run), alone(&place));
    run(&["pause", text(&place.run)]).expect(1).says(&["done or in quarantine"]);
    let finished = status(&place, &["--queue", &url]);
    assert_eq!(finished["state"], "finished");
    assert_eq!(finished["queue"], Value::Null);
    let tuples: u64 = finished["workers"]
        .as_array()
        .unwrap()
        .iter()
        .map(|worker| worker["tuples"].as_u64().unwrap())
        .sum();
    assert_eq!(tuples, SCENES as u64);
}
