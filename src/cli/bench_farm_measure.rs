//! `bench farm`: what the farm itself costs, with real workers on a real queue.

use super::args::Global;
use super::bench_cmd::cpu_name;
use super::bench_farm_args::BenchFarmArgs;
use super::bench_farm_cmd::SCHEMA;
use super::bench_farm_measured::{Measured, text};
use super::bench_farm_place::{Place, failed, tuples};
use super::bench_farm_process::Process;
use super::bench_farm_recipe::Recipe;
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use crate::farm::Fault;
use crate::farm::simulate::Work;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::SystemTime;

/// Seconds of the shards that show how the farm scales where there are fewer cores than workers.
pub(super) const ASLEEP_S: f64 = 0.05;
/// Workers of the run with real shards.
const REAL_WORKERS: u32 = 2;
/// Its tiles and samples, as `plan` chooses them.
pub(super) const REAL: [u32; 2] = [256, 256];

/// What to run.
struct Plan {
    name: String,
    workers: u32,
    recipe: Recipe,
    asleep: Option<Work>,
}

pub(super) fn run(args: &BenchFarmArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let place = Place::new(args.queue.as_deref())?;
    if place.url.is_none() {
        output.warning(
            "there is no nats-server on this machine: only the queue inside a process is measured",
        );
    }
    let (scenes, shards) = (args.scenes.unwrap_or(16), args.shards.unwrap_or(64));
    let ladder = || (0..).map(|k| 1u32 << k).take_while(|n| *n <= args.workers);
    let mut plans = Vec::new();
    for workers in ladder() {
        plans.push(plan(&place, "awake", workers, scenes, shards, false));
        plans.push(plan(
            &place,
            "asleep",
            workers,
            scenes.div_ceil(8) * workers,
            shards,
            true,
        ));
    }
    let both = 1 + usize::from(place.url.is_some());
    let progress = Progress::new(global, "runs", (plans.len() * both + 1) as u64);
    let mut measured = Vec::new();
    for plan in &plans {
        for shared in [true, false] {
            if !shared || place.url.is_some() {
                let kind = if shared { "nats" } else { "process" };
                progress.message(format!("{} workers, {}, {kind}", plan.workers, plan.name));
                measured.push(measure(&place, plan, shared)?);
                progress.add(1, false);
            }
        }
    }
    progress.message(format!("shards of {} px, {} samples", REAL[0], REAL[1]));
    let real = Plan {
        name: "real".to_owned(),
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
    let real = measure(&place, &real, place.url.is_some())?;
    progress.finish();
    output.result(
        SCHEMA,
        json!({
            "measured": true, "mode": "overhead", "queue": place.queue_name(), "cpu": cpu_name(),
            "runs": measured.iter().map(Measured::object).collect::<Vec<_>>(),
            "real_shards": real.object(),
        }),
        text(&place, &measured, &real).trim_end(),
    );
    Ok(Exit::Done)
}

fn plan(place: &Place, what: &str, workers: u32, scenes: u32, shards: u32, asleep: bool) -> Plan {
    let work = Work {
        scenes,
        shards,
        cheapest_shard_s: ASLEEP_S,
        doublings: 0,
        dearest_last: 0,
        load_s: 0.0,
        seed: 0,
    };
    Plan {
        name: what.to_owned(),
        workers,
        recipe: Recipe::tiny(place.name(what), scenes, shards),
        asleep: asleep.then_some(work),
    }
}

fn measure(place: &Place, plan: &Plan, shared: bool) -> Result<Measured, Failure> {
    let queue = if shared { "nats" } else { "process" };
    let recipe = Recipe {
        name: place.name(&format!("{}-{}-{queue}", plan.name, plan.workers)),
        ..plan.recipe
    };
    let run = place.plan(&recipe)?;
    let path = run.to_string_lossy();
    let cost = plan
        .asleep
        .clone()
        .map(|work| Fault::Cost(work).to_string());
    let server = place.server_cpu_s();
    let threads = if shared { 1 } else { plan.workers }.to_string();
    let mut arguments = vec![
        "work",
        &path,
        "-j",
        &threads,
        "-v",
        "--json",
        "--progress",
        "none",
    ];
    if let Some(cost) = &cost {
        arguments.extend(["--fault", cost]);
    }
    let mut measured = Measured {
        queue,
        workers: plan.workers,
        shards: 0,
        asleep_s: plan.asleep.as_ref().map_or(0.0, mean_shard_s),
        wall_s: 0.0,
        cpu: BTreeMap::new(),
        coordinator_cpu_s: 0.0,
        server_cpu_s: None,
    };
    let mut workers: Vec<Process> = Vec::new();
    for _ in 0..if shared { plan.workers } else { 1 } {
        workers.push(if shared {
            place.start_on_queue(&arguments)?
        } else {
            place.start(&arguments)?
        });
    }
    for worker in &mut workers {
        worker.wait_until_ready()?;
    }
    let begun = SystemTime::now();
    if shared {
        measured.coordinator_cpu_s = coordinate(place, &path)?;
    }
    for worker in workers {
        let (outcome, _) = worker.result()?;
        measured.shards += outcome["shards_traced"].as_u64().unwrap_or(0);
        for (stage, s) in outcome["cpu_seconds"].as_object().into_iter().flatten() {
            *measured.cpu.entry(stage.clone()).or_default() += s.as_f64().unwrap_or(0.0);
        }
    }
    measured.wall_s = last_tuple(&run, begun)?;
    if let (true, Some(before), Some(after)) = (shared, server, place.server_cpu_s()) {
        measured.server_cpu_s = Some(after - before);
    }
    let _ = std::fs::remove_dir_all(&run);
    Ok(measured)
}

/// Keeps the farm supplied to its end; the coordinator's CPU seconds.
fn coordinate(place: &Place, run: &str) -> Result<f64, Failure> {
    let arguments = ["coordinate", run, "--json", "--progress", "none"];
    let (outcome, _) = place.start_on_queue(&arguments)?.result()?;
    Ok(outcome["cpu_s"].as_f64().unwrap_or(f64::NAN))
}

fn last_tuple(run: &Path, begun: SystemTime) -> Result<f64, Failure> {
    let (last, _) = tuples(run)?;
    Ok(last.duration_since(begun).map_err(failed)?.as_secs_f64())
}

fn mean_shard_s(work: &Work) -> f64 {
    let all = (0..work.scenes).flat_map(|s| (0..work.shards).map(move |k| (s, k)));
    let sum_us: u64 = all.map(|(s, k)| work.shard_us(s, k)).sum();
    sum_us as f64 * 1e-6 / f64::from(work.scenes) / f64::from(work.shards)
}
