//! Measures the makespan of real workers on a real queue, with shards that sleep.

use super::error::FarmBenchError;
use super::makespan_report::{Makespan, MakespanRun, Pass};
use super::place::{Place, seconds_between, tuples};
use super::process::{Process, WORK_BEGINS};
use super::recipe::Recipe;
use super::setup::Setup;
use crate::farm::Fault as Ordered;
use crate::farm::simulate::{Case, Fault, lower_bound_s};
use std::time::{Duration, Instant, SystemTime};

/// Time of the kill, as a share of the lower bound of a run with the slow worker.
const KILLED_AT: f64 = 1.0 / 3.0;

/// Measures `case` without and with its faults. If it has none, slows one of several workers and kills another.
pub fn makespan(setup: &Setup, case: &Case, passes: u32) -> Result<Makespan, FarmBenchError> {
    let mut faulty = case.clone();
    ordered(&faulty)?;
    if faulty.faults.is_empty() && faulty.fleet.workers > 1 {
        faulty.faults = usual_faults(&faulty)?;
    }
    let plain = Case { faults: Vec::new(), ..faulty.clone() };
    let place = Place::new(setup)?;
    place.need_queue()?;
    let kinds = [("without faults", &plain), ("with faults", &faulty)];
    let kinds = &kinds[..if faulty.faults.is_empty() { 1 } else { 2 }];
    let watcher = place.watcher();
    watcher.starts(u64::from(passes) * kinds.len() as u64 + 1);
    let mut all: Vec<Vec<Pass>> = kinds.iter().map(|_| Vec::new()).collect();
    for pass in 0..passes {
        for (k, (what, case)) in kinds.iter().enumerate() {
            watcher.measures(&format!("{what}, pass {}", pass + 1));
            all[k].push(measure(&place, case, &format!("k{k}p{pass}"))?);
            watcher.part_is_done();
        }
    }
    watcher.measures("one process, shards that do not sleep");
    let alone = alone(&place, &plain)?;
    watcher.part_is_done();
    let tuples_equal = all.iter().flatten().all(|pass| pass.digest == alone);
    let mut runs = Vec::new();
    for ((what, case), passes) in kinds.iter().zip(all) {
        runs.push(MakespanRun::new(what, case, bound_s(case)?, passes));
    }
    Ok(Makespan::new(place.conditions("makespan"), &plain, runs, tuples_equal))
}

fn usual_faults(case: &Case) -> Result<Vec<Fault>, FarmBenchError> {
    let slow = Fault::Slow { worker: 1, times: 4.0 };
    let slowed = Case { faults: vec![slow.clone()], ..case.clone() };
    let at_s = bound_s(&slowed)? * KILLED_AT;
    Ok(vec![slow, Fault::Kill { worker: 0, at_s }])
}

/// The kills, each as the time after the start (in seconds) and the index of the worker.
type Kills = Vec<(f64, usize)>;

/// Returns the slowness of each worker, and the kills in order of time. Fails for other faults.
fn ordered(case: &Case) -> Result<(Vec<f64>, Kills), FarmBenchError> {
    let (mut slow, mut kills) = (vec![1.0; case.fleet.workers as usize], Vec::new());
    for fault in &case.faults {
        match *fault {
            Fault::Slow { worker, times } => slow[worker as usize] *= times,
            Fault::Kill { worker, at_s } => kills.push((at_s, worker as usize)),
            _ => return Err(FarmBenchError::OtherFault),
        }
    }
    kills.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok((slow, kills))
}

fn bound_s(case: &Case) -> Result<f64, FarmBenchError> {
    lower_bound_s(case).ok_or(FarmBenchError::NoWorkerLeft)
}

fn recipe(place: &Place, case: &Case, name: &str) -> Recipe {
    let work = &case.work;
    Recipe::tiny(place.name(name), work.scenes, work.shards)
}

/// Starts workers and waits until they are ready, before work is published.
fn start_workers<'a>(
    place: &'a Place,
    case: &Case,
    run: &str,
    slow: &[f64],
) -> Result<Vec<Option<Process<'a>>>, FarmBenchError> {
    let lease = case.rules.lease_s.to_string();
    let cost = Ordered::Cost(case.work.clone()).to_string();
    let mut workers = Vec::new();
    for (index, times) in slow.iter().enumerate() {
        let (name, slowly) = (format!("worker-{index}"), Ordered::Slow(*times).to_string());
        let mut arguments = vec!["work", run, "--lease-s", &lease, "--name", &name, "-j", "1"];
        arguments.extend(["-v", "--json", "--progress", "none", "--fault", &cost]);
        if *times > 1.0 {
            arguments.extend(["--fault", &slowly]);
        }
        workers.push(Some(place.start_on_queue(&arguments)?));
    }
    for worker in workers.iter_mut().flatten() {
        worker.wait_until_it_says(WORK_BEGINS)?;
    }
    Ok(workers)
}

fn measure(place: &Place, case: &Case, name: &str) -> Result<Pass, FarmBenchError> {
    let run = place.plan(&recipe(place, case, name))?;
    let run_text = run.to_string_lossy().into_owned();
    let (slow, kills) = ordered(case)?;
    let mut workers = start_workers(place, case, &run_text, &slow)?;
    // The clock starts with the coordinator, because the queue is empty until then.
    let (begun, start) = (SystemTime::now(), Instant::now());
    let lease = case.rules.lease_s.to_string();
    let arguments = ["coordinate", &run_text, "--lease-s", &lease, "--json"];
    let coordinator = place.start_on_queue(&[&arguments[..], &["--progress", "none"]].concat())?;
    let (mut loads, mut spans_given, mut shards_traced) = (0, 0, 0);
    for (at_s, worker) in kills {
        while start.elapsed().as_secs_f64() < at_s {
            place.go_on()?;
            std::thread::sleep(Duration::from_millis(2));
        }
        if let Some(mut victim) = workers[worker].take() {
            victim.kill();
            loads += victim.loads();
        }
    }
    let (_, known) = coordinator.result()?;
    for worker in workers.into_iter().flatten() {
        let (outcome, _) = worker.result()?;
        let count = |key: &str| outcome[key].as_u64().unwrap_or(0);
        loads += count("scenes_loaded");
        spans_given += count("spans_given");
        shards_traced += count("shards_traced");
    }
    let (last, digest) = tuples(&run)?;
    let makespan_s = seconds_between(begun, last)?;
    let _ = std::fs::remove_dir_all(&run);
    Ok(Pass {
        makespan_s,
        over_bound: makespan_s / bound_s(case)?,
        known_s: known.as_secs_f64(),
        loads,
        spans_given,
        shards_traced,
        digest,
    })
}

/// Makes the run with one process and returns the digest of its tuples.
fn alone(place: &Place, case: &Case) -> Result<String, FarmBenchError> {
    let run = place.plan(&recipe(place, case, "alone"))?;
    let path = run.to_string_lossy();
    let arguments = ["work", &path, "--json", "--progress", "none"];
    place.start(&arguments)?.result()?;
    Ok(tuples(&run)?.1)
}
