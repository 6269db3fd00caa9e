//! Tests the measurements of `bench`, and the files that it writes.

use crate::support::outputs::read_json;
use crate::support::program::{command, run_line, text, wait_until};
use crate::support::scenes::{photographs, scene};
use glasshouse::bench::{Ladder, Slope, Work, climb, own_reference, pair, slopes};
use glasshouse_line::layer::Layer;
use render::trace::Isa;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Writes a scene line and its photographs to `folder`; returns the path of the scene file.
fn scene_file(folder: &Path, line: &Value) -> PathBuf {
    photographs(folder);
    let path = folder.join("scene.json");
    std::fs::write(&path, line.to_string()).unwrap();
    path
}

/// Returns the rows of one sampling variant and one layer.
fn rows<'a>(result: &'a Value, variant: &str, layer: &str) -> Vec<&'a Value> {
    let all = result["rows"].as_array().unwrap();
    all.iter().filter(|row| row["variant"] == variant && row["layer"] == layer).collect()
}

#[test]
fn more_samples_reduce_the_error() {
    let folder = tempfile::tempdir().unwrap();
    let scene_path = scene_file(folder.path(), &scene("one"));
    let out = folder.path().join("error");
    let line = format!(
        "bench error --scene {} --spp 16,1,4 --seeds 2 --reference-spp 1024 --out {} --json",
        text(&scene_path),
        text(&out)
    );
    let result = run_line(&line).expect(0).json();
    assert_eq!(result["schema"], "glasshouse.bench_error/1");
    assert_eq!(result["reference"]["reused"], false);
    assert_eq!(result["rows"].as_array().unwrap().len(), 3 * 3 * 4);
    for variant in ["sobol", "independent"] {
        for layer in Layer::NAMES {
            let rows = rows(&result, variant, layer);
            let of = |key: &str| -> Vec<f64> {
                rows.iter().map(|row| row[key].as_f64().unwrap()).collect()
            };
            assert_eq!(of("spp"), [1.0, 4.0, 16.0]);
            if layer == "clean_reflection" {
                // With apex `mirror`, R is in closed form.
                assert_eq!((of("samples"), of("rmse")), (vec![0.0; 3], vec![0.0; 3]));
                continue;
            }
            // Both reflected orders of the pane are faint and therefore get half the samples, but at least one.
            let thinning = if layer == "glass_reflection" { 2.0 } else { 1.0 };
            let samples = [1.0, 4.0 / thinning, 16.0 / thinning];
            assert_eq!(of("samples"), samples);
            for key in ["rmse", "relative_mse", "srgb_steps", "cell_rmse_worst"] {
                assert!(
                    of(key).is_sorted_by(|a, b| a > b),
                    "{variant} {layer} {key}: {:?}",
                    of(key)
                );
            }
            for row in &rows {
                let number = |key: &str| row[key].as_f64().unwrap();
                assert!(number("cpu_s") > 0.0);
                assert!(number("cell_rmse_worst") >= number("cell_rmse_p99"));
                assert!(number("cell_rmse_worst") > number("rmse"));
                assert_eq!(row["stated_rmse"].is_null(), row["spp"] == 1);
            }
        }
    }
    // The JSON and CSV files have the same rows, and the SVG plots them.
    let file = read_json(out.join("error.json"));
    assert_eq!((&file["schema"], &file["rows"]), (&result["schema"], &result["rows"]));
    let csv = std::fs::read_to_string(out.join("error.csv")).unwrap();
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 1 + 3 * 3 * 4);
    assert!(lines[1].starts_with("sobol,input,1,1,"), "{}", lines[1]);
    assert!(lines.iter().all(|line| line.split(',').count() == 13));
    let svg = std::fs::read_to_string(out.join("error.svg")).unwrap();
    assert_eq!(svg.matches("stroke-width=\"1.8\"").count(), 3 * 2 * 3 + 3);

    // The second call reuses the reference. A call with the reference's folder finds the same errors; without --json,
    // it prints tables.
    let again = run_line(&format!("{line} --progress none")).expect(0);
    let again = again.says(&["reusing the reference"]).json();
    assert_eq!(again["reference"]["reused"], true);
    let rmse = |result: &Value| -> Vec<Value> {
        result["rows"].as_array().unwrap().iter().map(|row| row["rmse"].clone()).collect()
    };
    assert_eq!(rmse(&again), rmse(&result));
    let reference = out.join("reference");
    let other = folder.path().join("other");
    let given = format!(
        "bench error --scene {} --spp 1,4,16 --seeds 2 --reference {} --out {}",
        text(&scene_path),
        text(&reference),
        text(&other)
    );
    let given = run_line(&given).expect(0);
    assert!(given.stdout.contains("input, sobol: RMSE ~ samples^-"), "{given:?}");
    let file = read_json(other.join("error.json"));
    assert_eq!(rmse(&file), rmse(&result));

    // A pane of another thickness does not match the reference.
    let mut changed = scene("one");
    changed["glass"]["thickness_m"] = json!(0.02);
    std::fs::write(&scene_path, changed.to_string()).unwrap();
    let fresh = run_line(&line).expect(0).json();
    assert_eq!(fresh["reference"]["reused"], false);
    assert_ne!(rmse(&fresh), rmse(&result));
}

#[test]
fn references_of_another_size_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene_path = scene_file(folder.path(), &scene("one"));
    let out = folder.path().join("out");
    let (scene_text, out) = (text(&scene_path), text(&out));
    run_line(&format!("render {scene_text} --out {out}")).expect(0);
    let mut wider = scene("one");
    wider["film"]["width"] = json!(48);
    std::fs::write(&scene_path, wider.to_string()).unwrap();
    run_line(&format!("bench error --scene {scene_text} --reference {out} -n"))
        .expect(4)
        .says(&["input.exr has 40 x 24 px", "48 x 24"]);
}

/// On a small built-in pair, independent points converge with the theoretical slope and Sobol points faster. Both
/// converge to the same image.
#[test]
fn independent_samples_agree_with_sobol_and_converge_slower() {
    let folder = tempfile::tempdir().unwrap();
    let scene = pair([128, 96], 32).unwrap();
    let (stop, counted) = (AtomicBool::new(false), AtomicU64::new(0));
    let count = |n| {
        counted.fetch_add(n, Ordering::Relaxed);
    };
    let work = Work { threads: 2, isa: Isa::detect(), stop: &stop, on_samples: &count };
    let ladder = Ladder { spp: vec![1, 4, 16, 64], seeds: 2 };
    let reference = own_reference(&scene, 8192, folder.path(), &work).unwrap().unwrap();
    assert_eq!(counted.load(Ordering::Relaxed), 32 * 32 * 8192);
    let rows = climb(&scene, &ladder, &reference, &work).unwrap().unwrap();
    let fixed = |slope: &Slope| slope.variant != "adaptive";
    for slope in slopes(&rows, &reference).into_iter().filter(fixed) {
        if slope.layer == "clean_reflection" {
            // R is in closed form.
            assert_eq!(slope.slope, None);
            continue;
        }
        let found = slope.slope.unwrap();
        eprintln!("{} {}: {found:.3} over {}", slope.variant, slope.layer, slope.rungs);
        if slope.variant == "independent" {
            assert!((found + 0.5).abs() < 0.06, "{slope:?}");
        } else {
            assert!(found < -0.53, "{slope:?}");
        }
    }
    // Finished cells take no more samples, and the error of every cell is less than twice the row's target.
    for row in rows.iter().filter(|row| row.variant == "adaptive") {
        let target = 0.03 / f64::from(row.spp).sqrt();
        assert!(row.deviation.cell_rmse_worst <= 2.0 * target, "{row:?}");
        assert!(row.spp < 64 || row.samples < 64.0, "{row:?}");
        if row.layer != "clean_reflection" {
            assert!((0.7..1.4).contains(&row.stated_over_true.unwrap()), "{row:?}");
        }
    }
    for row in rows.iter().filter(|row| row.variant == "independent" && row.samples > 0.0) {
        // Errors of different pixels are independent. Errors of one pixel's colours, or of the reference, may be
        // correlated.
        let values = f64::from(32 * 32 * ladder.seeds);
        let limit = 5.0 * row.deviation.rmse / values.sqrt();
        assert!(row.deviation.bias.abs() < limit, "{row:?}");
        if let Some(ratio) = row.stated_over_true {
            assert!((0.8..1.2).contains(&ratio), "{row:?}");
        }
    }
    // Stopped work gives no result.
    stop.store(true, Ordering::Relaxed);
    assert!(climb(&scene, &ladder, &reference, &work).unwrap().is_none());
}

fn floats(path: &Path) -> Vec<f64> {
    let bytes = std::fs::read(path).unwrap();
    let (values, rest) = bytes.as_chunks::<4>();
    assert!(rest.is_empty());
    values.iter().map(|v| f64::from(f32::from_le_bytes(*v))).collect()
}

/// Reads the dump as documented: every hit inside the photograph lies on the mesh of the dumped vertices.
#[test]
fn dumped_rays_hit_the_dumped_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let scene_path = scene_file(folder.path(), &scene("one"));
    let dump = folder.path().join("rays");
    let line = format!(
        "bench trace --no-builtin --scene {} --passes 1 --dump {} --json",
        text(&scene_path),
        text(&dump)
    );
    let result = run_line(&line).expect(0).json();
    let names = |list: &Value, key: &str| -> Vec<String> {
        let all = list.as_array().unwrap();
        all.iter().map(|row| row[key].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names(&result["kernels"], "kernel"), ["t0", "t1", "r0", "r1", "r0", "r1", "R"]);
    assert_eq!(result["tracer"].as_array().unwrap().len(), 2);
    assert_eq!(result["grids"].as_array().unwrap().len(), 2);
    let list = read_json(dump.join("rays.json"));
    let classes = &list["classes"];
    let expected = ["t0", "t1", "r0.mirror", "r1.mirror", "r0.camera", "r1.camera", "R.camera"];
    assert_eq!(names(classes, "name"), expected.map(|name| format!("one.{name}")));
    // Intrinsics of the scene, for its photographs of 64 x 48 px.
    let (fx, fy, cx, cy) = (886.81 / 16.0, 927.06 / 16.0, 32.0, 24.0);
    for class in classes.as_array().unwrap() {
        let file = |key: &str| floats(&dump.join(class[key].as_str().unwrap()));
        let (rays, hits, vertices) = (file("rays"), file("hits"), file("vertices"));
        let (nx, ny) =
            (class["nx"].as_u64().unwrap() as usize, class["ny"].as_u64().unwrap() as usize);
        assert_eq!(hits.len(), class["count"].as_u64().unwrap() as usize);
        // The dump has 16 rays for every pixel of 40 x 24 px.
        assert_eq!((hits.len(), rays.len()), (10 * 6 * 256, hits.len() * 6));
        assert_eq!((nx, ny, vertices.len()), (64, 48, 64 * 48 * 3));
        assert!(class["kernel_mrays_per_s"].as_f64().unwrap() > 0.0);
        for (q, vertex) in vertices.as_chunks::<3>().0.iter().enumerate() {
            let (i, j) = ((q % nx) as f64, (q / nx) as f64);
            let [x, y, z] = vertex;
            assert!((x - (i + 0.5 - cx) / fx * z).abs() < 1e-5 * z, "{vertex:?}");
            assert!((y - (j + 0.5 - cy) / fy * z).abs() < 1e-5 * z, "{vertex:?}");
        }
        let w = |i: usize, j: usize| 1.0 / vertices[(j * nx + i) * 3 + 2];
        let mut worst = 0f64;
        for (ray, z) in rays.as_chunks::<6>().0.iter().zip(&hits) {
            let [ox, oy, oz, dx, dy, dz] = ray;
            assert_eq!((*oz, *dz), (0.0, 1.0));
            // Inside a triangle of the mesh, inverse depth is a linear function of pixel coordinates.
            let u = (ox + dx * z) / z * fx + cx - 0.5;
            let v = (oy + dy * z) / z * fy + cy - 0.5;
            if !(u > 0.0 && v > 0.0 && u < (nx - 1) as f64 && v < (ny - 1) as f64) {
                continue;
            }
            let (i, j) = (u as usize, v as usize);
            let (a, b) = (u - i as f64, v - j as f64);
            let on_mesh = if a + b < 1.0 {
                w(i, j) + (w(i + 1, j) - w(i, j)) * a + (w(i, j + 1) - w(i, j)) * b
            } else {
                let far = w(i + 1, j + 1);
                far + (w(i, j + 1) - far) * (1.0 - a) + (w(i + 1, j) - far) * (1.0 - b)
            };
            worst = worst.max((1.0 / z - on_mesh).abs());
        }
        assert!(worst < 1e-4, "{}: {worst} 1/m off the mesh", class["name"]);
    }
}

/// In the simulated farm, equal arguments give equal numbers, faults are counted, and every shard is traced.
#[test]
fn the_simulated_farm_is_deterministic() {
    let simulate = || {
        let line = "bench farm --simulate --json --workers 40 --scenes 400 --shards 4 --seed 7 --lease-s 2 --kill 0@3.1 \
                    --kill 10% --slow 1x4 --stop 2@1+5 --wipe 2 --away 4+1";
        let mut result = run_line(line).expect(0).json();
        let cpu_s = result.as_object_mut().unwrap().remove("cpu_s");
        assert!(cpu_s.unwrap().as_f64().unwrap() >= 0.0);
        result
    };
    let result = simulate();
    assert_eq!(result, simulate());
    assert_eq!(result["schema"], "glasshouse.bench_farm/1");
    let number = |key: &str| result[key].as_f64().unwrap();
    assert_eq!(number("shards_traced") - number("shards_traced_again"), 1600.0);
    assert!(number("over_bound") >= 1.0);
    assert!(number("known_s") >= number("makespan_s"));
    assert!(result["faults"]["killed"].as_u64().unwrap() > 1);
    assert_eq!(result["faults"]["wiped"], 1);

    let table = run_line("bench farm --simulate").expect(0);
    assert!(table.stdout.contains("| lower bound "), "{table:?}");
}

#[test]
fn impossible_simulations_are_refused() {
    run_line("bench farm --simulate --kill 8@1").expect(2).says(&["no worker 8", "0 to 7"]);
    run_line("bench farm --simulate --kill 3").expect(2).says(&["3@SECOND"]);
    run_line("bench farm --simulate --workers 1 --kill 0@1").expect(1).says(&["no worker is left"]);
}

/// Returns the number of candle's own threads of a process; they spin while they wait for work.
#[cfg(target_os = "linux")]
fn candle_threads(process: u32) -> usize {
    let tasks = std::fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    let names = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("comm")).ok());
    names.filter(|name| name.starts_with("candle-bp")).count()
}

#[cfg(target_os = "linux")]
#[test]
fn candle_starts_no_more_threads_than_the_program() {
    let start = |steps: &str, threads: &str| {
        let line = format!("bench train --size 32 --width 4 --steps {steps} -j {threads}");
        command(&line.split(' ').map(str::to_owned).collect::<Vec<_>>()).spawn().unwrap()
    };
    // With three threads, candle has some: the test can see them.
    let mut many = start("1000", "3");
    let id = many.id();
    assert!(wait_until(&mut many, || candle_threads(id) > 0));
    assert!(candle_threads(id) <= 3);
    many.kill().unwrap();
    many.wait().unwrap();

    let mut one = start("1", "1");
    let id = one.id();
    let mut most = 0;
    let status = loop {
        most = most.max(candle_threads(id));
        if let Some(status) = one.try_wait().unwrap() {
            break status;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    };
    assert!(status.success());
    assert_eq!(most, 0);
}
