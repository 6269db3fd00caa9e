//! Starts coordinators and workers, waits for their end, and checks the finished run.

use crate::support::nats::Nats;
use crate::support::outputs::{Tuples, assert_same, files, tuples};
use crate::support::program::{Ended, LONGEST, Running, command, run, send, text};
use crate::support::scenes::{Place, place};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// A sleep of 2 ms in each shard of a worker: the 192 shards of a scene of [`slow_place`] take at least 0.4 s on every
/// machine, so that tests have time to stop a process.
pub(crate) const SLEEP: [&str; 2] = ["--fault", "cost:4,192,0.002,0,0,0,0"];

/// A sleep of 20 ms in each shard: a scene takes longer than processes need to notice that their run is paused.
pub(crate) const LONG_SLEEP: [&str; 2] = ["--fault", "cost:4,192,0.02,0,0,0,0"];

/// Plans scenes of 192 shards. Workers that [`start`] starts sleep in each of their shards.
pub(crate) fn slow_place() -> Place {
    let mut place = place();
    let recipe = std::fs::read_to_string(&place.recipe).unwrap();
    std::fs::write(&place.recipe, recipe.replace("spp = 256", "spp = 2048")).unwrap();
    place.plan();
    place.is_slow = true;
    place
}

/// Renders the recipe of a place with one worker, without a queue, in a separate folder; returns the folder.
pub(crate) fn run_alone(place: &Place) -> PathBuf {
    let folder = place.folder.path().join("alone");
    let (recipe, out) = (text(&place.recipe), text(&folder));
    run(&["plan", recipe, "--out", out, "--tile", "16"]).expect(0);
    run(&["work", out, "-q"]).expect(0);
    folder
}

/// Returns the tuples that one worker makes from the recipe of a place. Renders each recipe once.
pub(crate) fn alone(place: &Place) -> &'static Tuples {
    static MADE: Mutex<BTreeMap<String, &'static Tuples>> = Mutex::new(BTreeMap::new());
    let recipe = std::fs::read_to_string(&place.recipe).unwrap();
    let mut made = MADE.lock().unwrap();
    made.entry(recipe).or_insert_with(|| Box::leak(Box::new(tuples(&run_alone(place)))))
}

pub(crate) fn start(verb: &str, place: &Place, server: &Nats, more: &[&str]) -> Running {
    let url = server.url();
    let mut arguments = vec![verb, text(&place.run), "--queue", &url];
    arguments.extend(["--progress", "none", "--json"]);
    arguments.extend(more);
    if !more.contains(&"--lease-s") {
        arguments.extend(["--lease-s", "2"]);
    }
    if verb == "work" && place.is_slow {
        arguments.extend(SLEEP);
    }
    command(&arguments).spawn().unwrap()
}

pub(crate) fn coordinator(place: &Place, server: &Nats) -> Running {
    start("coordinate", place, server, &[])
}

pub(crate) fn worker(place: &Place, server: &Nats) -> Running {
    start("work", place, server, &["-j", "1"])
}

/// Waits for the end of a process; kills it and panics after [`LONGEST`]. Reads its output meanwhile, because a full
/// pipe blocks the process.
#[track_caller]
pub(crate) fn end(mut child: Running) -> Ended {
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

/// Counts the partials and the files of tuples.
pub(crate) fn results(run: &Path) -> usize {
    files(&run.join("partials")).len() + files(&run.join("tuples")).len()
}

/// Waits for the end of a coordinator and its workers, and asserts that all of them report the run as done.
#[track_caller]
pub(crate) fn all_done(coordinator: Running, workers: impl IntoIterator<Item = Running>) {
    end(coordinator).expect(0);
    for worker in workers {
        end(worker).expect(0);
    }
}

/// Asserts that the run is finished and has the expected tuples.
#[track_caller]
pub(crate) fn assert_whole(run: &Path, expected: &Tuples) {
    assert_same(&tuples(run), expected);
    assert_finished(run);
}

/// Asserts that the run is recorded as finished and has no partials, and that no put of a tuple is unfinished.
pub(crate) fn assert_finished(run: &Path) {
    assert!(run.join("finished.json").is_file());
    assert_eq!(files(&run.join("partials")), Vec::<PathBuf>::new());
    let odd = files(&run.join("tuples")).into_iter().find(|p| p.to_string_lossy().contains('#'));
    assert_eq!(odd, None);
}
