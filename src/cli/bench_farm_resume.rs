//! `bench farm --resume`: how long a run that was left in the middle takes to go on.

use super::args::Global;
use super::bench_cmd::{cpu_name, on_cpu};
use super::bench_farm_args::BenchFarmArgs;
use super::bench_farm_cmd::SCHEMA;
use super::bench_farm_place::{Place, failed, median};
use super::bench_farm_recipe::Recipe;
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::work_cmd::isa;
use crate::bench::{HalfDone, align, half_done};
use crate::farm::queue::{NatsCoordinator, NatsOptions, QueueKeeper};
use crate::run::Run;
use anyhow::anyhow;
use render::line::Roots;
use serde_json::{Value, json};
use std::path::Path;
use std::time::{Duration, Instant};

const LEASE: Duration = Duration::from_secs(30);
/// Between two looks into the queue.
const LOOK: Duration = Duration::from_millis(20);

/// Something that was measured several times, the first time after the files were written.
struct Row {
    /// For JSON.
    key: &'static str,
    what: &'static str,
    seconds: Vec<f64>,
}

pub(super) fn run(args: &BenchFarmArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let (scenes, shards) = (args.scenes.unwrap_or(5000), args.shards.unwrap_or(64));
    let place = Place::new(args.queue.as_deref())?;
    let recipe = Recipe {
        tile_px: 4,
        film_px: Recipe::tiny(String::new(), 1, shards)
            .film_px
            .map(|px| px / 2),
        ..Recipe::tiny(place.name("resume"), scenes, shards)
    };
    let folder = place.plan(&recipe)?;
    let opened = Run::open(&folder, &Roots::default())?;
    let progress = Progress::new(global, "scenes", u64::from(scenes));
    progress.message("making a run that is half done".to_owned());
    let there = half_done(&opened, isa(global)?, &|| progress.add(1, false))?;
    progress.finish();
    let rows = measure(&place, &folder, &opened, there, args.passes)?;
    output.result(
        SCHEMA,
        object(&place, [scenes, shards], there, &rows),
        text(&place, [scenes, shards], there, &rows).trim_end(),
    );
    Ok(Exit::Done)
}

fn measure(
    place: &Place,
    folder: &Path,
    run: &Run,
    there: HalfDone,
    passes: u32,
) -> Result<Vec<Row>, Failure> {
    let path = folder.to_string_lossy();
    let mut rows = vec![
        row("status_s", "`status`, to its end"),
        row("work_s", "`work`, until its first scene is loaded"),
    ];
    if place.url.is_some() {
        rows.push(row(
            "coordinate_s",
            "`coordinate`, until all that is missing is in the queue",
        ));
        rows.push(row(
            "work_queue_s",
            "`work --queue`, until its first scene is loaded",
        ));
    }
    for _ in 0..passes {
        place.go_on()?;
        let (status, took) = place.start(&["status", &path, "--json"])?.result()?;
        if status["merged"] != there.tuples {
            return Err(failed(anyhow!(
                "status counts other tuples than there are: {status}"
            )));
        }
        rows[0].seconds.push(took.as_secs_f64());

        // Nothing is done in it: the next pass finds what this one found. Sleep is an hour a shard.
        let idle = "--fault=cost:1,1,3600,0,0,0,0";
        let arguments = ["work", &path, "-v", "--progress", "none", idle];
        let mut worker = place.start(&arguments)?;
        worker.wait_until_it_traces()?;
        rows[1].seconds.push(worker.age().as_secs_f64());
        worker.kill();

        let Some(url) = &place.url else { continue };
        let options = NatsOptions {
            url: url.clone(),
            name: "bench".to_owned(),
            ..NatsOptions::default()
        };
        let queue = NatsCoordinator::connect(&options, run.id(), LEASE)?;
        let arguments = ["coordinate", &path, "--progress", "none"];
        let coordinator = place.start_on_queue(&arguments)?;
        let since = Instant::now();
        loop {
            place.go_on()?;
            // Until the coordinator has made it, it is not there.
            let waiting = queue.look().map_or(0, |state| state.waiting);
            if waiting == there.missing {
                rows[2].seconds.push(since.elapsed().as_secs_f64());
                break;
            }
            if since.elapsed() > Duration::from_mins(2) {
                let what = anyhow!(
                    "the coordinator published {waiting} of {} spans",
                    there.missing
                );
                return Err(failed(what));
            }
            std::thread::sleep(LOOK);
        }
        let mut worker = place.start_on_queue(&arguments_on_queue(&path, idle))?;
        worker.wait_until_it_traces()?;
        rows[3].seconds.push(worker.age().as_secs_f64());
        worker.kill();
        coordinator.terminate()?;
        // It was killed; the next one is not to be afraid of what it had.
        let _ = std::fs::remove_dir_all(folder.join(crate::run::keys::ATTEMPTS));
        queue.remove()?;
    }
    Ok(rows)
}

fn arguments_on_queue<'a>(path: &'a str, idle: &'a str) -> [&'a str; 6] {
    ["work", path, "-v", "--progress", "none", idle]
}

fn row(key: &'static str, what: &'static str) -> Row {
    Row {
        key,
        what,
        seconds: Vec::new(),
    }
}

fn object(place: &Place, [scenes, shards]: [u32; 2], there: HalfDone, rows: &[Row]) -> Value {
    let mut object = json!({
        "measured": true, "mode": "resume", "queue": place.queue_name(), "cpu": cpu_name(),
        "scenes": scenes, "shards": u64::from(scenes) * u64::from(shards),
        "tuples_there": there.tuples, "partials_there": there.partials, "scenes_missing": there.missing,
    });
    for row in rows {
        object[row.key] = json!({ "first": row.seconds[0], "median": median(&row.seconds), "passes": row.seconds });
    }
    object
}

fn text(place: &Place, [scenes, shards]: [u32; 2], there: HalfDone, rows: &[Row]) -> String {
    let mut table = vec![
        ["until a run goes on", "first time", "median", "times"]
            .map(str::to_owned)
            .to_vec(),
    ];
    for row in rows {
        table.push(vec![
            row.what.to_owned(),
            format!("{:.2} s", row.seconds[0]),
            format!("{:.2} s", median(&row.seconds)),
            row.seconds.len().to_string(),
        ]);
    }
    format!(
        "{} shards of {scenes} scenes, {} tuples and {} partials there; queue: {}{}\n\n{}",
        u64::from(scenes) * u64::from(shards),
        there.tuples,
        there.partials,
        place.queue_name(),
        on_cpu(),
        align(&table, 1)
    )
}
