//! Measures the time until a half-finished run resumes.

use super::error::FarmBenchError;
use super::half_done::{HalfDone, half_done};
use super::place::Place;
use super::process::SCENE_LOADED;
use super::recipe::Recipe;
use super::setup::{Conditions, Setup};
use crate::bench::clock::median;
use crate::bench::table::table;
use crate::farm::queue::{NatsCoordinator, NatsOptions, QueueKeeper};
use crate::run::Run;
use glasshouse_line::Roots;
use render::trace::Isa;
use serde::Serialize;
use std::fmt;
use std::path::Path;
use std::time::{Duration, Instant};

const LEASE: Duration = Duration::from_secs(30);
/// Interval between polls of the queue.
const POLL: Duration = Duration::from_millis(20);

#[derive(Clone, Debug, Serialize)]
pub struct Resume {
    #[serde(flatten)]
    how: Conditions,
    scenes: u32,
    shards: u64,
    tuples_there: u64,
    partials_there: u64,
    scenes_missing: u64,
    /// Duration of `status`.
    pub status_s: Times,
    /// Time until `work` has loaded its first scene.
    pub work_s: Times,
    /// Time until `coordinate` has published all missing scenes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coordinate_s: Option<Times>,
    /// Time until `work --queue` has loaded its first scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub work_queue_s: Option<Times>,
}

/// Durations of several passes, s. The first pass starts directly after the run's files were written.
#[derive(Clone, Debug, Serialize)]
pub struct Times {
    first: f64,
    median: f64,
    passes: Vec<f64>,
}

impl Times {
    fn new(passes: Vec<f64>) -> Self {
        Self { first: passes.first().copied().unwrap_or(f64::NAN), median: median(&passes), passes }
    }
}

/// Makes a half-finished run of `scenes` scenes with `shards` shards each, and measures the time until the run resumes.
pub fn resume(
    setup: &Setup,
    scenes: u32,
    shards: u32,
    passes: u32,
    isa: Isa,
) -> Result<Resume, FarmBenchError> {
    let place = Place::new(setup)?;
    let tiny = Recipe::tiny(place.name("resume"), scenes, shards);
    let recipe = Recipe { tile_px: 4, film_px: tiny.film_px.map(|px| px / 2), ..tiny };
    let folder = place.plan(&recipe)?;
    let run = Run::open(&folder, &Roots::default())?;
    let watcher = place.watcher();
    watcher.starts(u64::from(scenes));
    watcher.measures("making a half-finished run");
    let there = half_done(&run, isa, &|| watcher.part_is_done())?;
    let mut times: [Vec<f64>; 4] = Default::default();
    for _ in 0..passes {
        place.go_on()?;
        measure_alone(&place, &folder, there, &mut times)?;
        if let Some(url) = &place.url {
            measure_on_queue(&place, url, &folder, &run, there, &mut times)?;
        }
    }
    let [status_s, work_s, coordinate_s, work_queue_s] = times.map(Times::new);
    let on_queue = |times: Times| place.url.is_some().then_some(times);
    Ok(Resume {
        how: place.conditions("resume"),
        scenes,
        shards: u64::from(scenes) * u64::from(shards),
        tuples_there: there.tuples,
        partials_there: there.partials,
        scenes_missing: there.missing,
        status_s,
        work_s,
        coordinate_s: on_queue(coordinate_s),
        work_queue_s: on_queue(work_queue_s),
    })
}

/// Argument that makes every shard sleep for about an hour, so that no pass changes the run.
const IDLE: &str = "--fault=cost:1,1,3600,0,0,0,0";

fn work_arguments(path: &str) -> [&str; 6] {
    ["work", path, "-v", "--progress", "none", IDLE]
}

fn measure_alone(
    place: &Place,
    folder: &Path,
    there: HalfDone,
    times: &mut [Vec<f64>; 4],
) -> Result<(), FarmBenchError> {
    let path = folder.to_string_lossy();
    let (status, took) = place.start(&["status", &path, "--json"])?.result()?;
    if status["merged"] != there.tuples {
        return Err(FarmBenchError::OtherTuples {
            counted: status["merged"].to_string(),
            there: there.tuples,
        });
    }
    times[0].push(took.as_secs_f64());
    let mut worker = place.start(&work_arguments(&path))?;
    worker.wait_until_it_says(SCENE_LOADED)?;
    times[1].push(worker.age().as_secs_f64());
    worker.kill();
    forget_attempts(folder);
    Ok(())
}

/// Removes the records of killed workers. With them, the next worker would trace their scenes in a child process.
fn forget_attempts(folder: &Path) {
    let _ = std::fs::remove_dir_all(folder.join(crate::run::keys::ATTEMPTS));
}

fn measure_on_queue(
    place: &Place,
    url: &str,
    folder: &Path,
    run: &Run,
    there: HalfDone,
    times: &mut [Vec<f64>; 4],
) -> Result<(), FarmBenchError> {
    let path = folder.to_string_lossy();
    let options =
        NatsOptions { url: url.to_owned(), name: "bench".to_owned(), ..NatsOptions::default() };
    let queue = NatsCoordinator::connect(&options, run.id(), run.shard_counts(), LEASE)?;
    let coordinator = place.start_on_queue(&["coordinate", &path, "--progress", "none"])?;
    let since = Instant::now();
    loop {
        place.go_on()?;
        // The call fails until the coordinator has created the stream.
        let waiting = queue.state().map_or(0, |state| state.waiting);
        if waiting == there.missing {
            times[2].push(since.elapsed().as_secs_f64());
            break;
        }
        if since.elapsed() > Duration::from_mins(2) {
            return Err(FarmBenchError::NotPublished { waiting, missing: there.missing });
        }
        std::thread::sleep(POLL);
    }
    let mut worker = place.start_on_queue(&work_arguments(&path))?;
    worker.wait_until_it_says(SCENE_LOADED)?;
    times[3].push(worker.age().as_secs_f64());
    worker.kill();
    coordinator.terminate()?;
    forget_attempts(folder);
    queue.remove()?;
    Ok(())
}

impl fmt::Display for Resume {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = [
            ("`status` ends", Some(&self.status_s)),
            ("`work` has loaded its first scene", Some(&self.work_s)),
            ("`coordinate` has published all missing scenes", self.coordinate_s.as_ref()),
            ("`work --queue` has loaded its first scene", self.work_queue_s.as_ref()),
        ];
        let rows = rows.into_iter().filter_map(|(what, times)| {
            let Times { first, median, passes } = times?;
            let count = passes.len().to_string();
            Some(vec![what.to_owned(), format!("{first:.2} s"), format!("{median:.2} s"), count])
        });
        write!(
            f,
            "{} shards of {} scenes, {} tuples and {} partials stored; queue: {}\n\n{}",
            self.shards,
            self.scenes,
            self.tuples_there,
            self.partials_there,
            self.how,
            table("time until | first pass | median | passes", rows, 1).trim_end()
        )
    }
}
