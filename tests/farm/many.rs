//! Many workers on a real NATS server, with everything dying in turns: the tuples are those of one process.

use crate::support::nats_server::Server;
use crate::support::outputs::{Content, assert_same, files, tuples};
use crate::support::program::{Ended, LONGEST, command, run, send, text};
use crate::support::scenes::{Place, SCENES, SHARDS, place, reference};
use glasshouse::farm::queue::{NatsOptions, NatsWorker, Queue, Waiting};
use glasshouse::run::{Run, Span};
use render::line::Roots;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Output};
use std::time::{Duration, Instant};

/// Scenes take a few tenths of a second each, so that there is time to kill somebody.
pub(crate) fn slow_place() -> Place {
    let place = place();
    let recipe = std::fs::read_to_string(&place.recipe).unwrap();
    std::fs::write(&place.recipe, recipe.replace("spp = 256", "spp = 4096")).unwrap();
    place.plan();
    place
}

/// The tuples of one process.
pub(crate) fn alone(place: &Place) -> BTreeMap<PathBuf, Content> {
    let folder = place.folder.path().join("alone");
    run(&[
        "plan",
        text(&place.recipe),
        "--out",
        text(&folder),
        "--tile",
        "16",
    ])
    .expect(0);
    run(&["work", text(&folder), "-q"]).expect(0);
    tuples(&folder)
}

pub(crate) fn start(verb: &str, place: &Place, server: &Server, more: &[&str]) -> Child {
    let url = server.url();
    let mut arguments = vec![verb, text(&place.run), "--queue", &url];
    arguments.extend(["--progress", "none", "--json"]);
    arguments.extend(more);
    if !more.contains(&"--lease-s") {
        arguments.extend(["--lease-s", "2"]);
    }
    command(&arguments).spawn().unwrap()
}

pub(crate) fn coordinator(place: &Place, server: &Server) -> Child {
    start("coordinate", place, server, &[])
}

pub(crate) fn worker(place: &Place, server: &Server) -> Child {
    start("work", place, server, &["-j", "1"])
}

/// Waits for the end of a process, no longer than [`LONGEST`]. What it says is read meanwhile: who fills a pipe waits for ever.
#[track_caller]
pub(crate) fn end(mut child: Child) -> Ended {
    let pid = child.id();
    let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
    let read = |from: Option<Box<dyn Read + Send>>| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            if let Some(mut from) = from {
                from.read_to_end(&mut bytes).unwrap();
            }
            bytes
        })
    };
    let stdout = read(stdout.map(|pipe| Box::new(pipe) as _));
    let stderr = read(stderr.map(|pipe| Box::new(pipe) as _));
    let start = Instant::now();
    let (mut status, mut is_late) = (child.try_wait().unwrap(), false);
    while status.is_none() {
        if start.elapsed() > LONGEST && !is_late {
            is_late = true;
            send(&child, "KILL");
        }
        std::thread::sleep(Duration::from_millis(10));
        status = child.try_wait().unwrap();
    }
    let ended = Ended::from(Output {
        status: status.unwrap(),
        stdout: stdout.join().unwrap(),
        stderr: stderr.join().unwrap(),
    });
    assert!(!is_late, "process {pid} does not end: {ended:#?}");
    ended
}

pub(crate) fn wait_for(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < LONGEST, "{what} does not happen");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Partials that were written and tuples that are whole.
pub(crate) fn results(run: &Path) -> usize {
    files(&run.join("partials")).len() + files(&run.join("tuples")).len()
}

/// Nothing unfinished, no partial, no queue's leftovers.
pub(crate) fn assert_finished(run: &Path) {
    assert!(run.join("finished.json").is_file());
    assert_eq!(files(&run.join("partials")), Vec::<PathBuf>::new());
    let odd = files(&run.join("tuples"))
        .into_iter()
        .find(|p| p.to_string_lossy().contains('#'));
    assert_eq!(odd, None);
}

#[test]
fn three_workers_make_what_one_process_makes() {
    let Some(server) = Server::start() else {
        return;
    };
    let place = place();
    place.plan();
    // Workers may be there first: before coordinator and stream.
    let workers = [
        worker(&place, &server),
        worker(&place, &server),
        worker(&place, &server),
    ];
    std::thread::sleep(Duration::from_millis(300));
    let coordinated = end(coordinator(&place, &server)).expect(0).json();
    assert_eq!(coordinated["done"], SCENES);
    let merged: u64 = workers
        .into_iter()
        .map(|worker| end(worker).expect(0).json()["merged"].as_u64().unwrap())
        .sum();
    assert!(merged >= SCENES as u64);
    assert_same(&tuples(&place.run), reference());
    assert_finished(&place.run);
    // Nothing is left: all end at once.
    end(coordinator(&place, &server)).expect(0);
    end(worker(&place, &server)).expect(0);
}

#[test]
fn killed_workers_and_coordinators_cost_time_alone() {
    let Some(server) = Server::start() else {
        return;
    };
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
    end(second).expect(0);
    for worker in workers {
        end(worker).expect(0);
    }
    assert_same(&tuples(&place.run), &alone(&place));
    assert_finished(&place.run);
}

#[test]
fn a_server_may_die_and_forget_everything() {
    let Some(mut server) = Server::start() else {
        return;
    };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let workers = [worker(&place, &server), worker(&place, &server)];
    wait_for("a result", || results(&place.run) > 2);
    server.kill_and_restart(false);
    let before = results(&place.run);
    wait_for("more", || {
        results(&place.run) > before + 4 || place.run.join("finished.json").exists()
    });
    server.kill_and_restart(true);
    end(coordinator).expect(0);
    for worker in workers {
        end(worker).expect(0);
    }
    assert_same(&tuples(&place.run), &alone(&place));
    assert_finished(&place.run);
}

#[test]
fn a_holder_that_slept_beyond_its_lease_does_no_harm() {
    let Some(server) = Server::start() else {
        return;
    };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let sleeper = worker(&place, &server);
    wait_for("a result", || results(&place.run) > 2);
    send(&sleeper, "STOP");
    let other = worker(&place, &server);
    let held = results(&place.run);
    wait_for("the other's results", || {
        results(&place.run) > held + 8 || place.run.join("finished.json").exists()
    });
    std::thread::sleep(Duration::from_millis(2500));
    send(&sleeper, "CONT");
    end(coordinator).expect(0);
    end(sleeper).expect(0);
    end(other).expect(0);
    assert_same(&tuples(&place.run), &alone(&place));
    assert_finished(&place.run);
}

#[test]
fn a_worker_that_is_told_to_stop_hands_its_work_back() {
    let Some(server) = Server::start() else {
        return;
    };
    let place = slow_place();
    // Whoever has to wait for the end of a lease of an hour does not end in time.
    let work = ["-j", "1", "--lease-s", "3600"];
    let coordinator = start("coordinate", &place, &server, &work[2..]);
    let leaving = start("work", &place, &server, &work);
    wait_for("a result", || results(&place.run) > 2);
    send(&leaving, "TERM");
    let left = end(leaving).expect(143).json();
    assert!(left["spans_given"].as_u64().unwrap() > 0, "{left}");
    let heir = start("work", &place, &server, &work);
    end(coordinator).expect(0);
    end(heir).expect(0);
    assert_same(&tuples(&place.run), &alone(&place));
}

/// The second worker comes when the first holds the only scene: it gets the later half of it.
#[test]
fn an_idle_worker_gets_a_part_of_a_scene() {
    let Some(server) = Server::start() else {
        return;
    };
    let place = place();
    let recipe = std::fs::read_to_string(&place.recipe).unwrap();
    let one = recipe
        .replace("spp = 256", "spp = 65536")
        .replace("{ sample = 3 }", "{ sample = 1 }")
        .replace("[[split]]\nname = \"test\"\npairs = { sample = 1 }\n", "");
    std::fs::write(&place.recipe, one).unwrap();
    place.plan();
    let coordinator = coordinator(&place, &server);
    let busy = worker(&place, &server);
    wait_for("a result", || results(&place.run) > 2);
    let idle = worker(&place, &server);
    end(coordinator).expect(0);
    let busy = end(busy).expect(0).json();
    let idle = end(idle).expect(0).json();
    assert!(busy["spans_given"].as_u64().unwrap() > 0, "{busy}");
    assert!(idle["shards_traced"].as_u64().unwrap() > 0, "{idle}");
    assert_same(&tuples(&place.run), &alone(&place));
    assert_finished(&place.run);
}

/// Spans twice, cut otherwise, in any order, of scenes that are done; and messages of somebody else.
#[test]
fn repeated_reordered_and_foreign_messages_change_nothing() {
    let Some(server) = Server::start() else {
        return;
    };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let workers = [worker(&place, &server), worker(&place, &server)];
    wait_for("a result", || results(&place.run) > 2);
    let run = Run::open(&place.run, &Roots::default()).unwrap();
    let options = NatsOptions {
        url: server.url(),
        name: "mischief".to_owned(),
        ..NatsOptions::default()
    };
    let mischief = NatsWorker::connect(&options, run.id(), SCENES, Duration::from_secs(2)).unwrap();
    let shards = SHARDS as u32;
    for round in 0..3 {
        let mut again = Vec::new();
        for scene in (0..SCENES as u32).rev() {
            let cut = 3 + 5 * round;
            for shards in [cut..shards, 0..shards, 0..cut, cut..cut + 1] {
                let span = Span { scene, shards };
                let handed_on = 7 + round;
                again.push(Waiting { span, handed_on });
            }
        }
        mischief.publish(&again).unwrap();
        std::thread::sleep(Duration::from_millis(100));
    }
    let [a, b, c, d, ..] = run.id();
    let hex = format!("{a:02x}{b:02x}{c:02x}{d:02x}");
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(async {
        let client = async_nats::connect(server.url()).await.unwrap();
        let foreign: [&[u8]; 4] = [b"", b"\x01short", b"\x63of another version", &[1; 24]];
        for (number, payload) in foreign.into_iter().enumerate() {
            let subject = format!("glasshouse.{hex}.span.{number}.0-9.{}", 90 + number);
            client.publish(subject, payload.into()).await.unwrap();
        }
        client.flush().await.unwrap();
    });
    end(coordinator).expect(0);
    for worker in workers {
        end(worker).expect(0);
    }
    assert_same(&tuples(&place.run), &alone(&place));
    assert_finished(&place.run);
}

#[test]
fn what_a_farm_is_told_wrongly_is_said() {
    let place = place();
    place.plan();
    run(&["coordinate", text(&place.run)])
        .expect(2)
        .says(&["--queue"]);
    run(&["work", text(&place.run), "--lease-s", "3"])
        .expect(2)
        .says(&["--queue"]);
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

/// A dry run asks the store alone: it neither waits for a queue that is away nor makes anything.
#[test]
fn a_dry_run_needs_no_queue_and_counts_what_is_in_the_store() {
    let place = place();
    place.plan();
    let store = place.folder.path().join("store");
    std::fs::create_dir(&store).unwrap();
    let dry = |verb: &str| {
        let all = [
            verb,
            text(&place.run),
            "--queue",
            "nats://127.0.0.1:9",
            "--json",
            "-n",
        ];
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
    // The folder has all tuples, that store has none.
    assert_eq!(dry("coordinate").1.expect(0).json()["scenes_left"], SCENES);
    assert_eq!(
        dry("work").1.expect(0).json()["shards_left"],
        SCENES * SHARDS
    );
}
