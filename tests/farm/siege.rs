//! Runs workers under random faults of all kinds: after an audit and a retry, the tuples equal those of one process.
//!
//! Workers are killed, or suspended beyond their leases and resumed; one takes four times as long, one hangs with
//! a live lease keeper, one computes wrong bits, and one scene aborts each process that traces it. The coordinator and
//! the queue's server are killed, the server loses its data, tasks are published repeatedly and in any order, and
//! requests to a bucket fail. The test restarts ended workers and killed coordinators, as a service manager does.
//!
//! The short sieges have each event, but the one on a disk has no `StoreAway`; the others run with `--ignored`.

use crate::processes::alone;
use crate::store_farm::fetched;
use crate::support::nats::Nats;
use crate::support::outputs::{assert_same, files, tuples};
use crate::support::program::{Ended, Running, command, send, text};
use crate::support::s3_server::S3Server;
use crate::support::scenes::{Place, place};
use glasshouse::farm::queue::{Message, NatsCoordinator, QueueKeeper};
use glasshouse::run::keys::shard_of;
use glasshouse::run::{Run, Task};
use glasshouse::store::Store;
use glasshouse_line::Roots;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Id of the scene that aborts each process that traces it during the siege.
const POISON: &str = "test-sample-000000";
/// Number of shards in one range of samples.
const TILES: u32 = 24;
const RANGE_SPP: u32 = 256;
/// Faults of the last three workers.
const FAULTS: [&[&str]; 3] = [
    &["slow:4"],
    &["hang:train-sample-000001", "hang:train-sample-000002"],
    &[
        "wrong:train-sample-000003",
        "wrong:train-sample-000004",
        "wrong:train-sample-000005",
        "wrong:train-sample-000006",
    ],
];
const LONGEST: Duration = Duration::from_mins(4);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Event {
    KillWorker,
    Sleep,
    KillCoordinator,
    KillServer,
    ForgetAll,
    Duplicates,
    StoreAway,
}

/// Numbers of workers, scenes, sample ranges and events of a siege.
#[derive(Clone, Copy)]
struct Size {
    workers: usize,
    /// Number of scenes; the last one is the poison.
    scenes: usize,
    /// Number of sample ranges of a scene.
    ranges: u32,
    /// Number of times that each event happens; `StoreAway` happens only in a bucket.
    events: [(Event, usize); 7],
}

const LONG: Size = Size {
    workers: 8,
    scenes: 8,
    ranges: 16,
    events: [
        (Event::KillWorker, 6),
        (Event::Sleep, 3),
        (Event::KillCoordinator, 2),
        (Event::KillServer, 2),
        (Event::ForgetAll, 1),
        (Event::Duplicates, 3),
        (Event::StoreAway, 1),
    ],
};

const SHORT: Size = Size {
    workers: 4,
    scenes: 5,
    ranges: 16,
    events: [
        (Event::KillWorker, 2),
        (Event::Sleep, 1),
        (Event::KillCoordinator, 1),
        (Event::KillServer, 1),
        (Event::ForgetAll, 1),
        (Event::Duplicates, 1),
        (Event::StoreAway, 1),
    ],
};

impl Size {
    /// Returns the number of shards of a scene.
    fn shards(&self) -> usize {
        (TILES * self.ranges) as usize
    }
}

struct Siege {
    size: Size,
    random: u64,
    place: Place,
    server: Nats,
    bucket: Option<S3Server>,
    store: Store,
    workers: Vec<Option<Running>>,
    lives: Vec<usize>,
    asleep: Vec<(usize, Instant)>,
    ends: Vec<String>,
    /// Number of the poison's tasks that the siege has published.
    poison_spans: usize,
}

impl Siege {
    fn new(size: Size, seed: u64, in_bucket: bool) -> Option<Self> {
        let server = Nats::start()?;
        let place = place();
        let recipe = std::fs::read_to_string(&place.recipe).unwrap();
        let recipe = recipe.replace("spp = 256", &format!("spp = {}", RANGE_SPP * size.ranges));
        let recipe =
            recipe.replace("{ sample = 3 }", &format!("{{ sample = {} }}", size.scenes - 1));
        std::fs::write(&place.recipe, recipe).unwrap();
        place.plan();
        let bucket = in_bucket.then(|| S3Server::start(seed));
        let store = match &bucket {
            Some(bucket) => bucket.store("runs/mine"),
            None => Store::local(&place.run).unwrap(),
        };
        if let Some(bucket) = &bucket {
            bucket.faults.set(40);
        }
        Some(Self {
            size,
            random: seed,
            place,
            server,
            bucket,
            store,
            workers: (0..size.workers).map(|_| None).collect(),
            lives: vec![0; size.workers],
            asleep: Vec::new(),
            ends: Vec::new(),
            poison_spans: 0,
        })
    }

    /// Draws a number below `below` with SplitMix64, <https://prng.di.unimi.it/splitmix64.c>.
    fn draw(&mut self, below: usize) -> usize {
        self.random = self.random.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.random;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % below as u64) as usize
    }

    fn events(&mut self) -> Vec<Event> {
        let mut events: Vec<Event> = self
            .size
            .events
            .iter()
            .filter(|(event, _)| self.bucket.is_some() || *event != Event::StoreAway)
            .flat_map(|(event, count)| vec![*event; *count])
            .collect();
        for last in (1..events.len()).rev() {
            let other = self.draw(last + 1);
            events.swap(last, other);
        }
        events
    }

    fn start(&self, verb: &str, run: &Path, more: &[&str]) -> Running {
        let url = self.server.url();
        let mut arguments = vec![verb, text(run), "--queue", &url, "--lease-s", "2"];
        arguments.extend(["--progress", "none", "--json"]);
        if self.bucket.is_some() {
            arguments.extend(["--store", "s3://bucket/runs/mine"]);
        }
        arguments.extend(more);
        let mut command = command(&arguments);
        if let Some(bucket) = &self.bucket {
            bucket.tell(&mut command);
        }
        command.spawn().unwrap()
    }

    fn coordinate(&self) -> Running {
        self.start("coordinate", &self.place.run, &[])
    }

    /// Starts a worker, with its own folder if the store is a bucket.
    fn work(&self, name: &str, faults: &[&str]) -> Running {
        let own = self.place.folder.path().join(name);
        let run = if self.bucket.is_some() { &own } else { &self.place.run };
        let mut more = vec!["-j", "1", "--name", name];
        if !faults.is_empty() {
            // Some hang. Requests to a failing bucket take longer.
            more.extend(["--hang-s", if self.bucket.is_some() { "8" } else { "3" }]);
        }
        // Some workers write their partials every second; the others write each partial at once.
        if name.ends_with(['1', '3', '5', '7']) {
            more.extend(["--checkpoint-s", "1"]);
        }
        more.extend(faults.iter().flat_map(|fault| ["--fault", fault]));
        self.start("work", run, &more)
    }

    /// Starts or restarts a worker. Only the first process of the hanging worker hangs.
    fn start_worker(&mut self, number: usize) {
        let poison = format!("abort:{POISON}");
        let mut faults = vec![poison.as_str()];
        let special = number.checked_sub(self.size.workers - FAULTS.len());
        let own = special.map_or(&[][..], |special| FAULTS[special]);
        let hung = self.lives[number] > 0;
        faults.extend(own.iter().filter(|f| !(hung && f.starts_with("hang"))));
        let name = name(number);
        self.workers[number] = Some(self.work(&name, &faults));
        self.lives[number] += 1;
    }

    /// Resumes suspended workers when their time is over, and restarts ended ones.
    fn look_after(&mut self) {
        for (number, until) in std::mem::take(&mut self.asleep) {
            if Instant::now() < until {
                self.asleep.push((number, until));
            } else if let Some(worker) = &self.workers[number] {
                send(worker, "CONT");
            }
        }
        for number in 0..self.size.workers {
            let ended = self.workers[number]
                .as_mut()
                .is_none_or(|worker| worker.try_wait().unwrap().is_some());
            if !ended {
                continue;
            }
            if let Some(worker) = self.workers[number].take() {
                self.reap(number, worker);
            }
            self.start_worker(number);
        }
    }

    fn reap(&mut self, number: usize, worker: Running) {
        let ended: Ended = worker.wait_with_output().unwrap().into();
        // A worker may end because it is done, hangs, leaves its work to others, lacks its store, or gets a signal.
        let known = [Some(0), Some(1), Some(75), None];
        assert!(known.contains(&ended.code), "{ended:#?}");
        if ended.code == Some(1) {
            let known = ["hangs", "leaves the rest to others"];
            assert!(known.iter().any(|k| ended.stderr.contains(k)), "{ended:#?}");
        }
        self.ends.push(format!("{}: {:?}", name(number), ended.code));
    }

    /// Returns the number of shards with a result in the store.
    fn done(&self) -> usize {
        let count = |folder: &str| self.store.list(folder).unwrap();
        let tuples = count("tuples").iter().filter(|key| key.ends_with("/tuple.json")).count();
        let partials = count("partials");
        let partials = partials.iter().filter(|key| shard_of(key).is_some());
        tuples * self.size.shards() + partials.count()
    }

    fn is_over(&self) -> bool {
        self.store.get("finished.json").unwrap().is_some()
    }

    fn happen(&mut self, event: Event, coordinator: &mut Running) {
        let number = self.draw(self.size.workers);
        match event {
            Event::KillWorker => {
                if let Some(worker) = &mut self.workers[number] {
                    worker.kill().unwrap();
                }
            }
            Event::Sleep => {
                if let Some(worker) = &self.workers[number] {
                    send(worker, "STOP");
                    let until = Instant::now() + Duration::from_secs(4);
                    self.asleep.push((number, until));
                }
            }
            Event::KillCoordinator => {
                coordinator.kill().unwrap();
                coordinator.wait().unwrap();
                *coordinator = self.coordinate();
            }
            Event::KillServer => self.server.kill_and_restart(false),
            Event::ForgetAll => self.server.kill_and_restart(true),
            Event::Duplicates => self.publish_duplicates(),
            Event::StoreAway => {
                let bucket = self.bucket.as_ref().unwrap();
                bucket.faults.set_away(true);
                std::thread::sleep(Duration::from_secs(3));
                bucket.faults.set_away(false);
            }
        }
    }

    /// Publishes random tasks of random scenes, done or not.
    fn publish_duplicates(&mut self) {
        let run = Run::open(&self.place.run, &Roots::default()).unwrap();
        let queue = NatsCoordinator::connect(
            &self.server.options(),
            run.id(),
            run.shard_counts(),
            Duration::from_secs(2),
        )
        .unwrap();
        let again: Vec<Message> = (0..6)
            .map(|_| {
                let scene = self.draw(self.size.scenes) as u32;
                let start = self.draw(self.size.shards()) as u32;
                let length = 1 + self.draw(self.size.shards() - start as usize) as u32;
                let shards = start..start + length;
                Message { task: Task { scene, shards }, hops: 5 + self.draw(9) as u32 }
            })
            .collect();
        let poison = run.lines.iter().position(|line| line.id.as_str() == POISON);
        let of_poison = |message: &&Message| Some(message.task.scene as usize) == poison;
        self.poison_spans += again.iter().filter(of_poison).count();
        // Publishing may fail, because the server may be starting.
        let _ = queue.publish(&again);
    }

    /// Runs until the coordinator has finished; returns the scenes in quarantine.
    fn endure(&mut self) -> BTreeSet<String> {
        let start = Instant::now();
        let mut events = self.events();
        let count = events.len();
        // Events are spread over the first two thirds of the work.
        let all = events.len() * 3 / 2;
        let mut coordinator = self.coordinate();
        let mut done = 0;
        let results = self.size.scenes * self.size.shards();
        while !self.is_over() {
            assert!(start.elapsed() < LONGEST, "{:#?}", self.ends);
            if self.store.get("spec.json").unwrap().is_some() {
                self.look_after();
            }
            // A scene that is merged between two listings lowers the count, so the largest count is used.
            done = done.max(self.done());
            while done * all > (count - events.len()) * results
                && let Some(event) = events.pop()
            {
                self.happen(event, &mut coordinator);
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        let coordinated: Ended = coordinator.wait_with_output().unwrap().into();
        coordinated.expect(3);
        for number in 0..self.size.workers {
            if let Some(worker) = self.workers[number].take() {
                // A suspended worker would not end.
                send(&worker, "CONT");
                self.reap(number, worker);
            }
        }
        eprintln!(
            "{:.0} s, {} workers started, events left: {events:?}, {:#?}",
            start.elapsed().as_secs_f64(),
            self.lives.iter().sum::<usize>(),
            self.ends
        );
        assert!(events.is_empty(), "the run ended before {events:?}");
        let set_aside = self.store.list("quarantine").unwrap();
        let scene = |key: &String| Some(key.rsplit('/').next()?.strip_suffix(".json")?.to_owned());
        set_aside.iter().filter_map(scene).collect()
    }

    fn command(&self, arguments: &[&str]) -> Ended {
        let mut command = command(arguments);
        if let Some(bucket) = &self.bucket {
            command.args(["--store", "s3://bucket/runs/mine"]);
            bucket.tell(&mut command);
        }
        command.output().unwrap().into()
    }

    fn tuples_folder(&self) -> PathBuf {
        self.place.folder.path().join("fetched")
    }
}

fn name(number: usize) -> String {
    format!("worker-{number}")
}

fn hold(size: Size, in_bucket: bool) {
    let Some(mut siege) = Siege::new(size, seed(), in_bucket) else {
        return;
    };
    let quarantined = siege.endure();
    assert!(quarantined.contains(POISON), "{quarantined:?}");
    // The poison killed at most four workers, and one more for each of its tasks that the siege published.
    let killed = siege.ends.iter().filter(|end| end.ends_with("None"));
    let kills = size.events[0].1;
    let most = 4 + kills + siege.poison_spans;
    assert!(killed.count() <= most, "{most}: {:?}", siege.ends);
    if let Some(bucket) = &siege.bucket {
        bucket.faults.set(0);
    }
    let folder = siege.place.run.clone();
    let folder = text(&folder);
    // The audit finds every wrong result, and names the worker that made it. A wrong partial may lie beside a good tuple,
    // if its worker was suspended until others had finished the scene.
    let audited = siege.command(&["audit", folder, "--share", "1", "--json"]).json();
    assert_eq!(audited["not_compared"], 0);
    let mut wrong: BTreeSet<String> = quarantined;
    for scene in audited["scenes"].as_array().unwrap() {
        if scene["verdict"] == "differs" {
            for difference in scene["differences"].as_array().unwrap() {
                let made_by = difference["made_by"].to_string();
                assert!(made_by.contains(&name(size.workers - 1)), "{difference:#} of {scene:#}");
            }
            wrong.insert(scene["scene"].as_str().unwrap().to_owned());
        }
    }
    eprintln!("rendered again: {wrong:?}");
    let mut retry = vec!["retry", folder, "--anew"];
    retry.extend(wrong.iter().map(String::as_str));
    siege.command(&retry).expect(0);
    let good = [siege.work("good-1", &[]), siege.work("good-2", &[])];
    let last: Ended = siege.coordinate().wait_with_output().unwrap().into();
    last.expect(0);
    for worker in good {
        let worker: Ended = worker.wait_with_output().unwrap().into();
        worker.expect(0);
    }
    let found = if siege.bucket.is_some() {
        fetched(&siege.store, &siege.tuples_folder())
    } else {
        assert_eq!(files(&siege.place.run.join("partials")).len(), 0);
        tuples(&siege.place.run)
    };
    assert_same(&found, alone(&siege.place));
}

/// Returns the seed, 1 by default; `GLASSHOUSE_SIEGE=7 cargo test --release --test farm siege` sets it to 7.
fn seed() -> u64 {
    let given = std::env::var("GLASSHOUSE_SIEGE").ok();
    given.map_or(1, |text| text.parse().unwrap())
}

#[test]
fn a_short_siege_on_a_disk() {
    hold(SHORT, false);
}

#[test]
#[ignore = "long: run by name and by .ci/run"]
fn a_short_siege_in_a_bucket() {
    hold(SHORT, true);
}

#[test]
#[ignore = "long: run by name and by .ci/run"]
fn a_long_siege_on_a_disk() {
    hold(LONG, false);
}

#[test]
#[ignore = "long: run by name and by .ci/run"]
fn a_long_siege_in_a_bucket() {
    hold(LONG, true);
}
