//! Measures the farm's cost per shard with real workers, on a NATS queue (if any) and inside one process.

use super::error::FarmBenchError;
use super::overhead_report::{Overhead, OverheadRun};
use super::place::{Place, seconds_between, tuples};
use super::process::{Process, WORK_BEGINS};
use super::recipe::Recipe;
use super::setup::Setup;
use crate::farm::Fault;
use crate::farm::simulate::Work;
use std::time::SystemTime;

/// Nominal duration of a sleeping shard, s. Sleeping shards show the farm's scaling beyond the number of cores.
pub(super) const ASLEEP_S: f64 = 0.05;
/// Number of workers in the run with real shards.
const REAL_WORKERS: u32 = 2;
/// Tile side (px) and samples per pixel of the run with real shards. `glasshouse plan` chooses 256 px for 256 samples.
pub(super) const REAL: [u32; 2] = [256, 256];

struct Plan {
    name: &'static str,
    workers: u32,
    recipe: Recipe,
    asleep: Option<Work>,
}

/// Measures runs of 1, 2, 4, ... up to `workers` workers, on a NATS queue (if any) and inside one process, with shards
/// that cost almost nothing and with sleeping shards. The last run has real shards.
pub fn overhead(
    setup: &Setup,
    workers: u32,
    scenes: u32,
    shards: u32,
) -> Result<Overhead, FarmBenchError> {
    let place = Place::new(setup)?;
    let has_queue = place.url.is_some();
    let queues = if has_queue { &[true, false][..] } else { &[false] };
    let ladder = (0..).map(|k| 1u32 << k).take_while(|n| *n <= workers);
    let plans: Vec<Plan> = ladder
        .flat_map(|workers| {
            let asleep = scenes.div_ceil(8) * workers;
            [
                plan("awake", workers, scenes, shards, false),
                plan("asleep", workers, asleep, shards, true),
            ]
        })
        .collect();
    let watcher = place.watcher();
    watcher.starts((plans.len() * queues.len() + 1) as u64);
    let mut runs = Vec::new();
    for plan in &plans {
        for &shared in queues {
            let queue = queue_name(shared);
            watcher.measures(&format!("{} workers, {}, {queue}", plan.workers, plan.name));
            runs.push(measure(&place, plan, shared)?);
            watcher.part_is_done();
        }
    }
    watcher.measures(&format!("shards of {} px, {} samples", REAL[0], REAL[1]));
    let real = Plan {
        name: "real",
        workers: REAL_WORKERS,
        recipe: Recipe {
            name: String::new(),
            scenes: scenes.div_ceil(3),
            film_px: [3 * REAL[0], 2 * REAL[0]],
            tile_px: REAL[0],
            spp: REAL[1],
            photograph_px: [512, 384],
        },
        asleep: None,
    };
    let real_shards = measure(&place, &real, has_queue)?;
    watcher.part_is_done();
    Ok(Overhead { how: place.conditions("overhead"), runs, real_shards })
}

fn queue_name(shared: bool) -> &'static str {
    if shared { "nats" } else { "process" }
}

fn plan(name: &'static str, workers: u32, scenes: u32, shards: u32, asleep: bool) -> Plan {
    let costs = Work { cheapest_shard_s: ASLEEP_S, doublings: 0, load_s: 0.0, ..Work::default() };
    let asleep = asleep.then_some(Work { scenes, shards, ..costs });
    Plan { name, workers, recipe: Recipe::tiny(String::new(), scenes, shards), asleep }
}

fn measure(place: &Place, plan: &Plan, shared: bool) -> Result<OverheadRun, FarmBenchError> {
    let queue = queue_name(shared);
    let recipe = Recipe {
        name: place.name(&format!("{}-{}-{queue}", plan.name, plan.workers)),
        ..plan.recipe
    };
    let run = place.plan(&recipe)?;
    let path = run.to_string_lossy();
    let cost = plan.asleep.clone().map(|work| Fault::Cost(work).to_string());
    let (processes, threads) = if shared { (plan.workers, 1) } else { (1, plan.workers) };
    let threads = threads.to_string();
    let mut arguments = vec!["work", &path, "-j", &threads, "-v", "--json"];
    arguments.extend(["--progress", "none"]);
    if let Some(cost) = &cost {
        arguments.extend(["--fault", cost]);
    }
    let asleep_s = plan.asleep.as_ref().map_or(0.0, mean_shard_s);
    let mut measured =
        OverheadRun { queue, workers: plan.workers, shard_s: asleep_s, ..OverheadRun::default() };
    let server = place.server_cpu_s();
    let mut workers: Vec<Process> = Vec::new();
    for _ in 0..processes {
        let start = if shared { Place::start_on_queue } else { Place::start };
        workers.push(start(place, &arguments)?);
    }
    for worker in &mut workers {
        worker.wait_until_it_says(WORK_BEGINS)?;
    }
    let begun = SystemTime::now();
    if shared {
        // The coordinator fills the queue and ends with the run.
        let arguments = ["coordinate", &path, "--json", "--progress", "none"];
        let (outcome, _) = place.start_on_queue(&arguments)?.result()?;
        measured.coordinator_cpu_s = outcome["cpu_s"].as_f64().unwrap_or(f64::NAN);
    }
    for worker in workers {
        let (outcome, _) = worker.result()?;
        measured.shards += outcome["shards_traced"].as_u64().unwrap_or(0);
        for (stage, s) in outcome["cpu_seconds"].as_object().into_iter().flatten() {
            *measured.cpu_seconds.entry(stage.clone()).or_default() += s.as_f64().unwrap_or(0.0);
        }
    }
    measured.wall_s = seconds_between(begun, tuples(&run)?.0)?;
    if let (true, Some(before), Some(after)) = (shared, server, place.server_cpu_s()) {
        measured.server_cpu_s = Some(after - before);
    }
    let _ = std::fs::remove_dir_all(&run);
    Ok(measured.finished())
}

fn mean_shard_s(work: &Work) -> f64 {
    let all = (0..work.scenes).flat_map(|s| (0..work.shards).map(move |k| (s, k)));
    let sum_us: u64 = all.map(|(s, k)| work.shard_us(s, k)).sum();
    sum_us as f64 * 1e-6 / f64::from(work.scenes) / f64::from(work.shards)
}
