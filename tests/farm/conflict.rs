//! Two workers make different bytes of one shard: the quarantine names both, and the farm continues.

use crate::processes::{alone, coordinator, end, slow_place, start};
use crate::support::nats::Nats;
use crate::support::outputs::{assert_same, files, tuples};
use crate::support::program::{Running, run, text};
use crate::support::scenes::{Place, SCENES, SHARDS};
use crate::support::tools::wait_for;
use glasshouse::farm::queue::{Message, NatsCoordinator, QueueKeeper};
use glasshouse::run::{QuarantineRecord, Run, Task};
use glasshouse_line::Roots;
use glasshouse_line::ids::SceneId;
use serde_json::json;
use std::path::PathBuf;
use std::time::Duration;

const SCENE: &str = "train-sample-000001";

/// Creates the queue of a planned run with two messages of one scene and no others.
fn twice(place: &Place, server: &Nats) -> NatsCoordinator {
    let run = Run::open(&place.run, &Roots::default()).unwrap();
    let scene = run.lines.iter().position(|line| line.id.as_str() == SCENE);
    let queue = NatsCoordinator::connect(
        &server.options(),
        run.id(),
        run.shard_counts(),
        Duration::from_secs(2),
    )
    .unwrap();
    queue.ensure().unwrap();
    let again = |hops| Message {
        task: Task { scene: scene.unwrap() as u32, shards: 0..SHARDS as u32 },
        hops,
    };
    queue.publish(&[again(1), again(2)]).unwrap();
    queue
}

fn named(place: &Place, server: &Nats, name: &str, fault: &str) -> Running {
    let more = ["-j", "1", "--name", name, "--fault", "slow:2", "--fault", fault];
    start("work", place, server, &more)
}

fn reason(place: &Place) -> Option<String> {
    let store = glasshouse::store::Store::local(&place.run).unwrap();
    let record = QuarantineRecord::get(&store, &SceneId::new(SCENE).unwrap()).unwrap();
    record.map(|record| record.reason)
}

/// Returns the conflicting files that workers kept, each with the worker's name.
fn kept(place: &Place) -> Vec<(String, PathBuf)> {
    let folder = place.run.join("conflicts");
    let workers = std::fs::read_dir(folder).into_iter().flatten();
    workers
        .map(|worker| {
            let path = worker.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let mut files = files(&path);
            (name, files.remove(0))
        })
        .collect()
}

#[test]
fn workers_with_different_bits_are_both_named() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let queue = twice(&place, &server);
    let workers = [
        named(&place, &server, "liar", &format!("wrong:{SCENE}")),
        named(&place, &server, "honest", "slow:1"),
    ];
    wait_for("a disagreement", || reason(&place).is_some());
    drop(queue);
    let coordinated = end(coordinator(&place, &server)).expect(3).json();
    assert_eq!(coordinated["done"], SCENES - 1);
    // Only the worker of the second put found the conflict.
    let found = workers.map(|worker| end(worker).expect(0).json()["quarantined"].clone());
    let found: Vec<_> = found.iter().filter(|q| **q != json!([])).collect();
    assert_eq!(found.len(), 1, "{found:?}");
    let reason = reason(&place).unwrap();
    for part in [
        "two workers made different bytes of partials/train-sample-000001/",
        "liar",
        "honest",
        "glasshouse audit RUN --scene train-sample-000001",
        "glasshouse retry RUN train-sample-000001 --anew",
    ] {
        assert!(reason.contains(part), "{part:?} is missing: {reason}");
    }
    // Both objects are kept: the first under its key, the other in its worker's folder.
    let kept = kept(&place);
    let (worker, path) = &kept[0];
    assert!(reason.contains(&format!("kept as conflicts/{worker}/")), "{reason}");
    let own = place.run.join("conflicts").join(worker).join(path);
    let other = place.run.join(path);
    assert_ne!(std::fs::read(own).unwrap(), std::fs::read(other).unwrap());
    // An audit by a third process finds the wrong bytes if they are under the key.
    let folder = text(&place.run);
    let audited = run(&["audit", folder, "--scene", SCENE, "--json"]).json();
    let differ = audited["scenes"][0]["differences"].as_array().unwrap();
    let is_wrong = differ.iter().any(|d| d["file"] == text(path));
    assert_eq!(is_wrong, worker == "honest", "{audited:#}");
    run(&["retry", folder, "nothing-like-it", "--anew"])
        .expect(2)
        .says(&["nothing-like-it is not a scene of this run"]);
    let retried = run(&["retry", folder, SCENE, "--anew", "--json"]).expect(0).json();
    assert_eq!(retried["retried"][0], SCENE);
    assert!(retried["results_removed"].as_u64().unwrap() > 0);
    let good = start("work", &place, &server, &["-j", "2"]);
    end(coordinator(&place, &server)).expect(0);
    end(good).expect(0);
    assert_same(&tuples(&place.run), alone(&place));
}

/// `retry --anew` repeats a finished scene while the coordinator runs.
#[test]
fn a_finished_scene_is_repeated() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let slow = ["-j", "1", "--fault", "slow:2"];
    let worker = start("work", &place, &server, &slow);
    let coordinator = coordinator(&place, &server);
    let tuple = |id: &str| place.run.join(format!("tuples/{id}/tuple.json"));
    let ids =
        ["train-sample-000000", "train-sample-000001", "train-sample-000002", "test-sample-000000"];
    let mut first = None;
    wait_for("a tuple", || {
        first = ids.into_iter().find(|id| tuple(id).is_file());
        first.is_some()
    });
    let first = first.unwrap();
    let receipt = place.run.join(format!("receipts/{first}.json"));
    wait_for("its receipt", || receipt.is_file());
    run(&["retry", text(&place.run), first, "--anew"]).expect(0);
    let coordinated = end(coordinator).expect(0).json();
    assert_eq!(coordinated["done"], SCENES);
    end(worker).expect(0);
    assert!(tuple(first).is_file());
    assert_same(&tuples(&place.run), alone(&place));
}
