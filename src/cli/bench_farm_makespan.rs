//! `bench farm --makespan`: real workers, a real queue, tasks that sleep.

use super::args::Global;
use super::bench_farm_args::BenchFarmArgs;
use super::bench_farm_cmd::{SCHEMA, case};
use super::bench_farm_pass::{Pass, object, text};
use super::bench_farm_place::{Place, failed, tuples};
use super::bench_farm_process::Process;
use super::bench_farm_recipe::Recipe;
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use crate::farm::Fault as Ordered;
use crate::farm::simulate::{Case, Fault, lower_bound_s};
use anyhow::anyhow;
use std::time::{Duration, Instant, SystemTime};

/// The worker that is killed is killed at this share of what the slow farm would take at best.
const KILLED_AT: f64 = 1.0 / 3.0;

pub(super) fn run(args: &BenchFarmArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let mut faulty = case(args)?;
    ordered(&faulty)?;
    if faulty.faults.is_empty() && faulty.fleet.workers > 1 {
        faulty.faults = usual_faults(&faulty)?;
    }
    let plain = Case {
        faults: Vec::new(),
        ..faulty.clone()
    };
    let place = Place::new(args.queue.as_deref())?;
    place.need_queue()?;
    let kinds = [("without faults", &plain), ("with faults", &faulty)];
    let kinds = &kinds[..if faulty.faults.is_empty() { 1 } else { 2 }];
    let progress = Progress::new(
        global,
        "runs",
        u64::from(args.passes) * kinds.len() as u64 + 1,
    );
    let mut passes: Vec<Vec<Pass>> = kinds.iter().map(|_| Vec::new()).collect();
    for pass in 0..args.passes {
        for (k, (what, case)) in kinds.iter().enumerate() {
            progress.message(format!("{what}, pass {}", pass + 1));
            passes[k].push(measure(&place, case, &format!("k{k}p{pass}"))?);
            progress.add(1, false);
        }
    }
    progress.message("one process, without sleep".to_owned());
    let alone = alone(&place, &plain)?;
    progress.add(1, false);
    progress.finish();
    let equal = passes.iter().flatten().all(|pass| pass.digest == alone);
    let object = object(&place, kinds, &passes, equal);
    output.result(
        SCHEMA,
        object,
        text(&place, kinds, &passes, equal).trim_end(),
    );
    if !equal {
        let what = "the farm's tuples are not those of one process: this must never happen; please report it";
        return Err(failed(anyhow!(what)));
    }
    Ok(Exit::Done)
}

/// One worker four times slower, another one killed.
fn usual_faults(case: &Case) -> Result<Vec<Fault>, Failure> {
    let slow = Fault::Slow {
        worker: 1,
        times: 4.0,
    };
    let slowed = Case {
        faults: vec![slow.clone()],
        ..case.clone()
    };
    let at_s = bound_s(&slowed)? * KILLED_AT;
    Ok(vec![slow, Fault::Kill { worker: 0, at_s }])
}

/// Seconds, and whom.
type Kills = Vec<(f64, usize)>;

/// How many times slower each worker is, and who is killed when.
fn ordered(case: &Case) -> Result<(Vec<f64>, Kills), Failure> {
    let (mut slow, mut kills) = (vec![1.0; case.fleet.workers as usize], Vec::new());
    for fault in &case.faults {
        match *fault {
            Fault::Slow { worker, times } => slow[worker as usize] *= times,
            Fault::Kill { worker, at_s } => kills.push((at_s, worker as usize)),
            _ => {
                let what = anyhow!("--makespan knows --kill and --slow alone");
                return Err(Failure::new(Exit::Usage, what));
            }
        }
    }
    kills.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok((slow, kills))
}

fn bound_s(case: &Case) -> Result<f64, Failure> {
    lower_bound_s(case).ok_or_else(|| failed(anyhow!("no worker is left: kill fewer of them")))
}

fn recipe(place: &Place, case: &Case, name: &str) -> Recipe {
    let work = &case.work;
    Recipe::tiny(place.name(name), work.scenes, work.shards)
}

fn measure(place: &Place, case: &Case, name: &str) -> Result<Pass, Failure> {
    let bound_s = bound_s(case)?;
    let run = place.plan(&recipe(place, case, name))?;
    let run_text = run.to_string_lossy().into_owned();
    let lease = case.rules.lease_s.to_string();
    let cost = Ordered::Cost(case.work.clone()).to_string();
    let (slow, kills) = ordered(case)?;
    let mut workers: Vec<Option<Process>> = Vec::new();
    for (index, times) in slow.iter().enumerate() {
        let (own, slowly) = (format!("worker-{index}"), Ordered::Slow(*times).to_string());
        let mut arguments = vec![
            "work",
            &run_text,
            "--lease-s",
            &lease,
            "--name",
            &own,
            "-j",
            "1",
        ];
        arguments.extend(["-v", "--json", "--progress", "none", "--fault", &cost]);
        if *times > 1.0 {
            arguments.extend(["--fault", &slowly]);
        }
        workers.push(Some(place.start_on_queue(&arguments)?));
    }
    for worker in workers.iter_mut().flatten() {
        worker.wait_until_ready()?;
    }
    // Time begins with the coordinator: all there is to do is not in the queue yet.
    let (begun, start) = (SystemTime::now(), Instant::now());
    let arguments = ["coordinate", &run_text, "--lease-s", &lease, "--json"];
    let coordinator = place.start_on_queue(&[&arguments[..], &["--progress", "none"]].concat())?;
    let (mut loads, mut given, mut traced) = (0, 0, 0);
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
        given += count("spans_given");
        traced += count("shards_traced");
    }
    let (last, digest) = tuples(&run)?;
    let makespan_s = last.duration_since(begun).map_err(failed)?.as_secs_f64();
    let _ = std::fs::remove_dir_all(&run);
    Ok(Pass {
        bound_s,
        makespan_s,
        known_s: known.as_secs_f64(),
        loads,
        spans_given: given,
        shards_traced: traced,
        digest,
    })
}

/// The digest of the tuples that one process makes.
fn alone(place: &Place, case: &Case) -> Result<String, Failure> {
    let run = place.plan(&recipe(place, case, "alone"))?;
    let arguments = [
        "work",
        &run.to_string_lossy(),
        "--json",
        "--progress",
        "none",
    ];
    place.start(&arguments)?.result()?;
    Ok(tuples(&run)?.1)
}
