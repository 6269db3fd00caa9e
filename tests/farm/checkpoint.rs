//! Partials stay in memory for the checkpoint interval: short scenes write none, and a stop loses none.

use crate::processes::{all_done, alone, coordinator, end, slow_place, start};
use crate::support::nats::Nats;
use crate::support::outputs::{assert_same, files, tuples};
use crate::support::program::{Ended, command, run, send, text};
use crate::support::scenes::{SCENES, place, reference};
use crate::support::tools::wait_for;
use std::path::Path;
use std::time::Duration;

/// A checkpoint interval of an hour, longer than any test.
const LATER: [&str; 2] = ["--checkpoint-s", "3600"];

fn partials(run: &Path) -> usize {
    let names = files(&run.join("partials"));
    let is_exr = |path: &&std::path::PathBuf| path.extension().is_some_and(|e| e == "exr");
    names.iter().filter(is_exr).count()
}

#[test]
fn short_scenes_write_no_partials() {
    let work = |checkpoint: &str| {
        let place = place();
        place.plan();
        let ended = run(&["work", text(&place.run), "--json", "--checkpoint-s", checkpoint]);
        assert_same(&tuples(&place.run), reference());
        let seconds = ended.expect(0).json()["thread_seconds"]["checkpoint"].as_f64();
        seconds.unwrap()
    };
    assert_eq!(work("60"), 0.0);
    assert!(work("0") > 0.0);
}

#[test]
fn a_stopped_worker_writes_partials_held_in_memory() {
    let place = slow_place();
    let folder = text(&place.run);
    let mut arguments = vec!["work", folder, "-j", "2", "--json", "--fault", "slow:20"];
    arguments.extend(LATER);
    let working = command(&arguments).spawn().unwrap();
    wait_for("an attempt", || !files(&place.run.join("attempts")).is_empty());
    std::thread::sleep(Duration::from_millis(700));
    assert_eq!(partials(&place.run), 0);
    send(&working, "TERM");
    let ended: Ended = working.wait_with_output().unwrap().into();
    let stopped = ended.expect(143).json();
    let there = partials(&place.run) as u64;
    assert!(there > 0, "{stopped}");
    let resumed = run(&["work", folder, "--json"]).expect(0).json();
    assert_eq!(resumed["shards_resumed"], there);
    assert_same(&tuples(&place.run), alone(&place));
    let shards = |end: &serde_json::Value| end["shards_traced"].as_u64().unwrap();
    // No shard was traced twice.
    assert_eq!(shards(&stopped) + shards(&resumed), SCENES as u64 * 192);
}

#[test]
fn a_donor_writes_partials_held_in_memory() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let mut slow = vec!["-j", "1", "--fault", "slow:20"];
    slow.extend(LATER);
    let one = start("work", &place, &server, &slow);
    wait_for("an attempt", || files(&place.run.join("attempts")).len() == 1);
    let mut fast = vec!["-j", "1"];
    fast.extend(LATER);
    let workers = [one, start("work", &place, &server, &fast)];
    end(coordinator).expect(0);
    let given: u64 = workers
        .into_iter()
        .map(|worker| end(worker).expect(0).json()["spans_given"].as_u64().unwrap())
        .sum();
    assert!(given > 0);
    assert_same(&tuples(&place.run), alone(&place));
    assert_eq!(files(&place.run.join("partials")).len(), 0);
}

#[test]
fn a_kill_loses_only_partials_held_in_memory() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let mut later = vec!["-j", "1"];
    later.extend(LATER);
    let mut victim = start("work", &place, &server, &later);
    wait_for("a tuple", || !files(&place.run.join("tuples")).is_empty());
    victim.kill().unwrap();
    victim.wait().unwrap();
    let heir = start("work", &place, &server, &later);
    all_done(coordinator, [heir]);
    assert_same(&tuples(&place.run), alone(&place));
    assert_eq!(files(&place.run.join("partials")).len(), 0);
}
