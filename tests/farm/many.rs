//! Workers on a real NATS server make the tuples of one process, even if workers, coordinator or server are killed.

use crate::processes::{
    all_done, alone, assert_whole, coordinator, end, results, slow_place, start, worker,
};
use crate::support::nats::Nats;
use crate::support::outputs::{assert_same, files, tuples};
use crate::support::program::{run, runtime, send, text};
use crate::support::scenes::{SCENES, SHARDS, place, reference};
use crate::support::tools::wait_for;
use glasshouse::farm::queue::{Message, NatsWorker, Queue};
use glasshouse::run::{Run, Task};
use glasshouse_line::Roots;
use std::time::Duration;

#[test]
fn three_workers_make_the_same_tuples_as_one_process() {
    let Some(server) = Nats::start() else { return };
    let place = place();
    place.plan();
    // Workers may start before the coordinator and the stream.
    let workers = [worker(&place, &server), worker(&place, &server), worker(&place, &server)];
    std::thread::sleep(Duration::from_millis(300));
    let coordinated = end(coordinator(&place, &server)).expect(0).json();
    assert_eq!(coordinated["done"], SCENES);
    let merged: u64 = workers
        .into_iter()
        .map(|worker| end(worker).expect(0).json()["merged"].as_u64().unwrap())
        .sum();
    assert!(merged >= SCENES as u64);
    assert_whole(&place.run, reference());
    // Without remaining work, all processes end at once.
    end(coordinator(&place, &server)).expect(0);
    end(worker(&place, &server)).expect(0);
}

#[test]
fn killed_workers_and_coordinators_only_cost_time() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let first = coordinator(&place, &server);
    let mut victims = vec![worker(&place, &server), worker(&place, &server)];
    wait_for("a result", || results(&place.run) > 4);
    for victim in &mut victims {
        victim.kill().unwrap();
        victim.wait().unwrap();
    }
    let mut first = first;
    first.kill().unwrap();
    first.wait().unwrap();
    let second = coordinator(&place, &server);
    let workers = [worker(&place, &server), worker(&place, &server)];
    all_done(second, workers);
    assert_whole(&place.run, alone(&place));
}

#[test]
fn a_server_may_crash_and_lose_the_queue() {
    let Some(mut server) = Nats::start() else {
        return;
    };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let workers = [worker(&place, &server), worker(&place, &server)];
    wait_for("a result", || results(&place.run) > 2);
    server.kill_and_restart(false);
    let before = results(&place.run);
    wait_for("another result", || {
        results(&place.run) > before + 4 || place.run.join("finished.json").exists()
    });
    server.kill_and_restart(true);
    all_done(coordinator, workers);
    assert_whole(&place.run, alone(&place));
}

#[test]
fn a_worker_suspended_beyond_its_lease_changes_no_tuple() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let sleeper = worker(&place, &server);
    wait_for("a result", || results(&place.run) > 2);
    send(&sleeper, "STOP");
    let other = worker(&place, &server);
    let held = results(&place.run);
    wait_for("a result of the other worker", || {
        results(&place.run) > held + 8 || place.run.join("finished.json").exists()
    });
    std::thread::sleep(Duration::from_millis(2500));
    send(&sleeper, "CONT");
    all_done(coordinator, [sleeper, other]);
    assert_whole(&place.run, alone(&place));
}

#[test]
fn a_stopped_worker_requeues_its_work() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    // Without a requeue, the next worker would wait an hour for the end of the lease.
    let work = ["-j", "1", "--lease-s", "3600"];
    let coordinator = start("coordinate", &place, &server, &work[2..]);
    let leaving = start("work", &place, &server, &work);
    wait_for("a result", || results(&place.run) > 2);
    send(&leaving, "TERM");
    let left = end(leaving).expect(143).json();
    assert!(left["spans_given"].as_u64().unwrap() > 0, "{left}");
    let heir = start("work", &place, &server, &work);
    all_done(coordinator, [heir]);
    assert_same(&tuples(&place.run), alone(&place));
}

/// The second worker starts while the first traces the only scene, and gets a part of its shards.
#[test]
fn an_idle_worker_gets_a_part_of_a_scene() {
    let Some(server) = Nats::start() else { return };
    let mut place = place();
    let recipe = std::fs::read_to_string(&place.recipe).unwrap();
    let one = recipe
        .replace("spp = 256", "spp = 16384")
        .replace("{ sample = 3 }", "{ sample = 1 }")
        .replace("[[split]]\nname = \"test\"\npairs = { sample = 1 }\n", "");
    std::fs::write(&place.recipe, one).unwrap();
    place.plan();
    place.is_slow = true;
    let coordinator = coordinator(&place, &server);
    let busy = worker(&place, &server);
    wait_for("a result", || results(&place.run) > 2);
    let idle = worker(&place, &server);
    end(coordinator).expect(0);
    let busy = end(busy).expect(0).json();
    let idle = end(idle).expect(0).json();
    assert!(busy["spans_given"].as_u64().unwrap() > 0, "{busy}");
    assert!(idle["shards_traced"].as_u64().unwrap() > 0, "{idle}");
    assert_whole(&place.run, alone(&place));
}

/// Publishes the tasks of all scenes again, split differently and in reverse order, and also foreign messages.
#[test]
fn repeated_reordered_and_foreign_messages_change_nothing() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let workers = [worker(&place, &server), worker(&place, &server)];
    wait_for("a result", || results(&place.run) > 2);
    let run = Run::open(&place.run, &Roots::default()).unwrap();
    let mischief = NatsWorker::connect(
        &server.options(),
        run.id(),
        run.shard_counts(),
        Duration::from_secs(2),
    )
    .unwrap();
    let shards = SHARDS as u32;
    for round in 0..3 {
        let mut again = Vec::new();
        for scene in (0..SCENES as u32).rev() {
            let cut = 3 + 5 * round;
            for shards in [cut..shards, 0..shards, 0..cut, cut..cut + 1] {
                let task = Task { scene, shards };
                let hops = 7 + round;
                again.push(Message { task, hops });
            }
        }
        mischief.publish(&again).unwrap();
        std::thread::sleep(Duration::from_millis(100));
    }
    let [a, b, c, d, ..] = run.id();
    let hex = format!("{a:02x}{b:02x}{c:02x}{d:02x}");
    runtime().block_on(async {
        let client = async_nats::connect(server.url()).await.unwrap();
        let foreign: [&[u8]; 4] = [b"", b"\x01short", b"\x63of another version", &[1; 24]];
        for (number, payload) in foreign.into_iter().enumerate() {
            let subject = format!("glasshouse.{hex}.span.{number}.0-9.{}", 90 + number);
            client.publish(subject, payload.into()).await.unwrap();
        }
        client.flush().await.unwrap();
    });
    all_done(coordinator, workers);
    assert_whole(&place.run, alone(&place));
}

#[test]
fn wrong_options_of_a_farm_are_reported() {
    let place = place();
    place.plan();
    run(&["coordinate", text(&place.run)]).expect(2).says(&["--queue"]);
    run(&["work", text(&place.run), "--lease-s", "3"]).expect(2).says(&["--queue"]);
    run(&[
        "work",
        text(&place.run),
        "--queue",
        "nats://127.0.0.1:1",
        "--queue-nkey",
        "/nonexistent",
    ])
    .expect(2)
    .says(&["/nonexistent"]);
}

/// A dry run reads only the run and its store: it does not wait for an unreachable queue, and it writes nothing.
#[test]
fn a_dry_run_needs_no_queue_and_counts_results_in_the_store() {
    let place = place();
    place.plan();
    let store = place.folder.path().join("store");
    std::fs::create_dir(&store).unwrap();
    let dry = |verb: &str| {
        let all = [verb, text(&place.run), "--queue", "nats://127.0.0.1:9", "--json", "-n"];
        let here = run(&all).expect(0).json();
        let there = run(&[&all[..], &["--store", text(&store)]].concat());
        (here, there)
    };
    let before = files(&place.run);
    assert_eq!(dry("coordinate").0["scenes_left"], SCENES);
    assert_eq!(dry("work").0["shards_left"], SCENES * SHARDS);
    assert_eq!(files(&place.run), before);
    run(&["work", text(&place.run), "-q"]).expect(0);
    assert_eq!(dry("coordinate").0["scenes_left"], 0);
    assert_eq!(dry("work").0["shards_left"], 0);
    // The folder has all tuples, and the given store none.
    assert_eq!(dry("coordinate").1.expect(0).json()["scenes_left"], SCENES);
    assert_eq!(dry("work").1.expect(0).json()["shards_left"], SCENES * SHARDS);
}
