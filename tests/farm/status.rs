//! Tests `status --watch`, and `status` with only a store.

use crate::processes::{SLEEP, all_done, end, slow_place, start};
use crate::support::nats::Nats;
use crate::support::program::{command, run, send, text};
use crate::support::scenes::{SCENES, place};
use crate::support::tools::wait_for;
use serde_json::Value;

#[test]
fn a_watch_ends_with_its_run() {
    let place = slow_place();
    let folder = text(&place.run);
    let lines = command(&["status", folder, "--watch", "0.2", "--json"]).spawn().unwrap();
    let plain = command(&["status", folder, "--watch=0.2"]).spawn().unwrap();
    run(&["work", folder, "-j", "1", "-q", SLEEP[0], SLEEP[1]]).expect(0);
    let lines = end(lines).expect(0).stdout;
    let looks: Vec<Value> = lines.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert!(looks.len() > 3, "{lines}");
    for pair in looks.windows(2) {
        let done = |look: &Value| look["shards_done"].as_u64().unwrap();
        assert_eq!(pair[0]["schema"], "glasshouse.status/1");
        assert!(done(&pair[0]) <= done(&pair[1]));
        assert_eq!(pair[0]["finished"], false);
    }
    let last = &looks[looks.len() - 1];
    assert_eq!((&last["finished"], &last["merged"]), (&true.into(), &SCENES.into()));
    assert!(looks.iter().any(|look| look["eta_s"].as_f64().is_some()));
    let plain = end(plain).expect(0).stdout;
    // Without a terminal, `status` prints one line per poll, and then the full status.
    assert!(plain.lines().filter(|l| l.contains("small: running")).count() > 3, "{plain}");
    assert!(plain.contains("small: finished, 4 of 4 scenes (100.0 %)"), "{plain}");
    assert!(!plain.contains('\x1b'));
}

#[test]
fn a_watch_ends_with_a_signal_and_with_a_cancelled_run() {
    let place = slow_place();
    let folder = text(&place.run);
    let mut watch = command(&["status", folder, "--watch", "30"]).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(500));
    assert!(watch.try_wait().unwrap().is_none());
    send(&watch, "INT");
    end(watch).expect(130);
    run(&["cancel", folder]).expect(0);
    let ended = run(&["status", folder, "--watch", "--json"]).expect(3);
    assert_eq!(ended.json()["state"], "cancelled");
    run(&["status", "--watch", folder]).expect(2).says(&["--watch"]);
}

/// A machine that has only the store's address can watch and control the run.
#[test]
fn a_store_is_enough_to_watch_and_control_a_run() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let store = place.folder.path().join("store");
    let store_text = text(&store);
    let elsewhere = place.folder.path().join("elsewhere");
    let here = text(&elsewhere);
    run(&["status", here, "--store", store_text]).expect(75).says(&["holds no run yet"]);
    let coordinator = start("coordinate", &place, &server, &["--store", store_text]);
    wait_for("a run in the store", || store.join("spec.json").exists());
    let url = server.url();
    let look = |more: &[&str]| {
        let arguments = [&["status", here, "--store", store_text, "--json"], more].concat();
        run(&arguments).expect(0).json()
    };
    wait_for("a full queue", || look(&["--queue", &url])["queue"]["spans_waiting"] == SCENES);
    let worker =
        start("work", &place, &server, &["-j", "1", "--store", store_text, "--name", "one"]);
    wait_for("a held span", || look(&["--queue", &url])["queue"]["spans_held"] != 0);
    run(&["cancel", here, "--store", store_text]).expect(0);
    end(coordinator).expect(3);
    end(worker).expect(3);
    run(&["resume", here, "--store", store_text]).expect(0);
    let coordinator = start("coordinate", &place, &server, &["--store", store_text]);
    let worker =
        start("work", &place, &server, &["-j", "1", "--store", store_text, "--name", "one"]);
    all_done(coordinator, [worker]);
    let over = look(&[]);
    assert_eq!(over["state"], "finished");
    assert_eq!(
        (&over["workers"][0]["worker"], &over["workers"][0]["tuples"]),
        (&"one".into(), &SCENES.into())
    );
    // `status` works although the queue cannot be reached.
    let lost = run(&["status", text(&place.run), "--queue", "nats://127.0.0.1:1", "--json"])
        .expect(0)
        .json();
    assert!(lost["queue"]["reason"].is_string(), "{lost}");
    assert_eq!(lost["merged"], 0);

    // Each of these commands refuses the store of another run.
    let other = self::place();
    other.plan();
    for verb in ["status", "pause", "resume", "cancel"] {
        run(&[verb, text(&other.run), "--store", store_text]).expect(5).says(&["another run"]);
    }
}

#[test]
fn the_text_shows_state_counts_and_progress() {
    let place = place();
    run(&place.arguments("run", &["-q"])).expect(0);
    let words = run(&["status", text(&place.run)]).expect(0).stdout;
    for part in ["small: finished, 4 of 4 scenes", "[====", "shards      96 of 96", "last tuple"] {
        assert!(words.contains(part), "no {part:?} in {words}");
    }
}
