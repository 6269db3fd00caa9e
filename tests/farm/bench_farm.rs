//! Runs `bench farm` briefly on real processes; its figures must be present and plausible.

use crate::support::nats::Nats;
use crate::support::program::run;
use serde_json::Value;

fn measured(arguments: &[&str]) -> Value {
    let all = [&["bench", "farm", "--json"], arguments].concat();
    let result = run(&all).expect(0).json();
    assert_eq!(result["schema"], "glasshouse.bench_farm/1");
    assert_eq!(result["measured"], true);
    result
}

fn number(object: &Value, key: &str) -> f64 {
    let number = object[key].as_f64();
    number.unwrap_or_else(|| panic!("no {key} in {object}"))
}

#[test]
fn the_makespan_of_a_farm_with_faults_is_measured() {
    let Some(server) = Nats::start() else { return };
    let result = measured(&[
        "--makespan",
        "--queue",
        &server.url(),
        "--passes",
        "1",
        "--workers",
        "4",
        "--scenes",
        "12",
        "--shards",
        "4",
        "--shard-s",
        "0.01",
        "--load-s",
        "0.02",
    ]);
    assert_eq!(result["queue"], "the given server");
    assert_eq!(result["tuples_equal_those_of_one_process"], true);
    let runs = result["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 2);
    for (run, faults) in runs.iter().zip([0, 2]) {
        assert_eq!(run["faults"].as_array().unwrap().len(), faults);
        let pass = &run["passes"][0];
        // A sleep is never shorter than its argument, so the bound holds.
        assert!((1.0..60.0).contains(&number(pass, "over_bound")), "{run}");
        assert!(number(pass, "known_s") >= number(pass, "makespan_s"));
        assert!((12.0..=48.0).contains(&number(pass, "loads")), "{run}");
        assert!((1.0..=4.0).contains(&number(run, "loads_per_scene")));
    }
    // The count excludes the shards of the killed worker.
    let traced = |run: &Value| number(&run["passes"][0], "shards_traced");
    assert!(traced(&runs[0]) >= 48.0, "{}", runs[0]);
    assert!((1.0..=96.0).contains(&traced(&runs[1])), "{}", runs[1]);
    let bound = |run: &Value| number(run, "bound_s");
    assert!(bound(&runs[1]) > bound(&runs[0]));
}

#[test]
fn the_overhead_of_a_farm_is_measured() {
    let result = measured(&["--workers", "2", "--scenes", "2", "--shards", "4"]);
    let queues = match result["queue"].as_str().unwrap() {
        "none" => vec!["process"],
        _ => vec!["nats", "process"],
    };
    let runs = result["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 4 * queues.len());
    for run in runs.iter().chain([&result["real_shards"]]) {
        assert!(queues.contains(&run["queue"].as_str().unwrap()), "{run}");
        assert!(number(run, "shards_per_s") > 0.0);
        assert!(number(run, "overhead_cpu_us_per_shard") > 0.0);
        let share = number(run, "overhead_cpu_share");
        assert!(share > 0.0 && share < 1.0, "{run}");
        assert!(number(&run["cpu_seconds"], "trace") > 0.0);
        // A sleep is never shorter than its argument.
        let least_s = number(run, "shards") * number(run, "shard_s") / number(run, "workers");
        assert!(number(run, "wall_s") >= least_s, "{run}");
    }
    let of = |workers: u64, asleep: bool| {
        let mut all = runs.iter().filter(move |run| {
            run["workers"] == workers && (number(run, "shard_s") > 0.0) == asleep
        });
        number(all.next().unwrap(), "shards")
    };
    assert_eq!([of(1, false), of(2, false)], [8.0, 8.0]);
    assert_eq!([of(1, true), of(2, true)], [4.0, 8.0]);
    assert_eq!(number(&result["real_shards"], "shards"), 6.0);
}

#[test]
fn the_time_to_resume_is_measured() {
    let result = measured(&["--resume", "--scenes", "20", "--shards", "8", "--passes", "2"]);
    assert_eq!(number(&result, "shards"), 160.0);
    assert_eq!(number(&result, "tuples_there"), 10.0);
    assert_eq!(number(&result, "partials_there"), 40.0);
    assert_eq!(number(&result, "scenes_missing"), 10.0);
    let mut keys = vec!["status_s", "work_s"];
    if result["queue"] != "none" {
        keys.extend(["coordinate_s", "work_queue_s"]);
    }
    for key in keys {
        let row = &result[key];
        assert_eq!(row["passes"].as_array().unwrap().len(), 2, "{key}");
        assert!((0.0..60.0).contains(&number(row, "median")), "{key}: {row}");
    }
}

#[test]
fn impossible_measurements_are_refused() {
    run(&["bench", "farm", "--workers", "300"]).expect(2).says(&["256", "--simulate"]);
    run(&["bench", "farm", "--makespan", "--simulate"]).expect(2);
    run(&["bench", "farm", "--makespan", "--stop", "1@1+1"]).expect(2).says(&["--kill and --slow"]);
    let planned = run(&["bench", "farm", "--resume", "--dry-run", "--json"]).expect(0);
    assert_eq!(planned.json()["mode"], "resume");
    // A dry run of a simulation simulates nothing.
    let planned = run(&["bench", "farm", "--simulate", "--dry-run", "--json"]).expect(0).json();
    assert_eq!((&planned["measured"], &planned["dry_run"]), (&false.into(), &true.into()));
    assert!(planned["events"].is_null(), "{planned}");
}
