//! The reports of small runs are well-formed and complete, and have the numbers of the tuples.

use crate::support::markup::{all, one, strictly, values, words};
use crate::support::outputs::{copy_folder, exr_channels, files, read_json, tuple_record};
use crate::support::program::{command, run, send, text, wait_until};
use crate::support::scenes::{SCENES, SHARDS, photographs, place, scene, write_lines};
use scraper::{ElementRef, Html};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

pub(crate) const LAYERS: [&str; 4] =
    ["input", "transmission", "glass_reflection", "clean_reflection"];

const SECTIONS: [&str; 9] = [
    "glance",
    "tuples",
    "errors",
    "seconds",
    "parameters",
    "quarantine",
    "training",
    "evaluation",
    "again",
];

/// Returns a copy of the folder of a finished run. Renders the run once.
pub(crate) fn finished() -> TempDir {
    static MADE: OnceLock<TempDir> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let place = place();
        run(&place.arguments("run", &[])).expect(0);
        place.folder
    });
    let copy = tempfile::tempdir().unwrap();
    copy_folder(&made.path().join("run"), copy.path());
    copy
}

/// Makes the report of a run; returns the page and the command's output.
#[track_caller]
pub(crate) fn report(run_folder: &Path, code: i32, more: &[&str]) -> (String, Value) {
    let arguments = [&["report", text(run_folder), "--json"][..], more].concat();
    let said = run(&arguments).expect(code).json();
    let path = said["report"].as_str().unwrap();
    let page = std::fs::read_to_string(path).unwrap();
    assert_eq!(said["bytes"], page.len());
    let html = strictly(&page);
    for section in SECTIONS {
        let section = one(&html, &format!("section#{section}"));
        assert!(words(section).trim().len() > 20, "{}", section.html());
    }
    assert!(all(&html, "script, link, iframe, object, embed").is_empty());
    for image in all(&html, "img") {
        let source = image.attr("src").unwrap();
        assert!(source.starts_with("data:image/"), "{source}");
    }
    (page, said)
}

fn tuples(html: &Html) -> Vec<ElementRef<'_>> {
    all(html, "section.tuple")
}

#[test]
fn the_report_has_the_numbers_of_the_tuples() {
    let folder = finished();
    let folder = folder.path();
    let (page, said) = report(folder, 0, &[]);
    for (key, count) in [
        ("scenes", SCENES),
        ("tuples", SCENES),
        ("shown", SCENES),
        ("noise_maps", SCENES),
        ("logs", 1),
    ] {
        assert_eq!(said[key], count, "{key}");
    }
    assert_eq!(said["damaged"], json!([]));
    // A second report is the same page.
    assert_eq!(report(folder, 0, &[]).0, page);
    let html = strictly(&page);

    let spec = read_json(folder.join("spec.json"));
    let glance = words(one(&html, "#glance"));
    for part in [
        "small",
        "96 × 64",
        "256 a pixel",
        "of 4 scenes",
        spec["manifest_blake3"].as_str().unwrap(),
        "train",
        "test",
        "sample",
    ] {
        assert!(glance.contains(part), "no {part:?} in {glance}");
    }

    let mut errors: [Vec<f64>; 4] = Default::default();
    assert_eq!(tuples(&html).len(), SCENES);
    for tuple in tuples(&html) {
        let id = tuple.attr("id").unwrap().strip_prefix("tuple-").unwrap();
        let record = tuple_record(folder, id);
        let stated = LAYERS.map(|l| record["layers"][l]["error_rms"].as_f64().unwrap());
        assert_eq!(values(tuple), stated);
        for (of_layer, error) in errors.iter_mut().zip(stated) {
            of_layer.push(error);
        }
        let said = words(tuple);
        let focus = record["facts"]["focus_distance_m"].as_f64().unwrap();
        for part in [
            format!("focus {focus:.2} m"),
            "glass 10 mm thick, ior 1.6, at 0.3 m, no tilt".to_owned(),
            "256 spp".to_owned(),
            format!("{:.2e}", stated[0]),
            "noise map I T / R".to_owned(),
        ] {
            assert!(said.contains(&part), "no {part:?} in {said}");
        }
        let pictures = tuple.select(&scraper::Selector::parse("img").unwrap()).count();
        assert_eq!(pictures, 6);
    }
    for (layer, mut errors) in LAYERS.iter().zip(errors) {
        errors.sort_by(f64::total_cmp);
        let row = values(one(&html, &format!("#errors-{layer}")));
        assert_eq!(row[1], errors[0], "{layer}");
        assert_eq!(row[2], errors[2], "{layer}: the upper of the two medians");
        assert_eq!(row[4], errors[SCENES - 1], "{layer}");
    }
    // With one worker, the plot has a point for each layer of each scene, except for R, which has no error.
    let points = all(&html, "#errors circle").len();
    assert_eq!(points, 3 * SCENES);
}

#[test]
fn a_stopped_worker_writes_its_log() {
    let place = place();
    place.plan();
    let mut child = command(&["work", text(&place.run), "-j", "1"]).spawn().unwrap();
    let partials = place.run.join("partials");
    if !wait_until(&mut child, || !files(&partials).is_empty()) {
        eprintln!("skipped: the worker ended before its signal");
        return;
    }
    send(&child, "TERM");
    let code = child.wait().unwrap().code();
    run(&["work", text(&place.run)]).expect(0);
    let logs: Vec<Value> = files(&place.run.join("logs"))
        .iter()
        .map(|file| read_json(place.run.join("logs").join(file)))
        .collect();
    let sum = |key: &str| logs.iter().map(|log| log[key].as_u64().unwrap()).sum::<u64>();
    assert_eq!(sum("merged"), SCENES as u64);
    assert_eq!(sum("shards_traced"), (SCENES * SHARDS) as u64);
    for log in &logs {
        assert_eq!(log["schema"], "glasshouse.work_log/1");
        for stage in ["read", "decode", "trace", "merge", "encode", "write"] {
            assert!(log["thread_seconds"][stage].is_f64(), "{stage} in {log}");
        }
    }
    if code == Some(143) {
        assert_eq!(logs.len(), 2);
        assert_eq!(logs[0]["stopped"], "signal");
    }
    assert_eq!(logs[logs.len() - 1]["stopped"], Value::Null);
    let (page, _) = report(&place.run, 0, &[]);
    let html = strictly(&page);
    let trace: f64 = logs.iter().map(|l| l["cpu_seconds"]["trace"].as_f64().unwrap()).sum();
    let shown = values(one(&html, "#stage-trace"))[0];
    assert!((shown - trace).abs() < 1e-9, "{shown} {trace}");
    // Two workers traced parts of a scene, and their logs have its whole cost.
    assert_eq!(all(&html, "#errors circle").len(), 3 * SCENES);
}

#[test]
fn half_done_and_damaged_runs_have_a_report() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let mut single = scene("single");
    single["film"]["spp"] = json!(1);
    let mut some = scene("some");
    some["film"]["layers"] = json!(["input", "transmission"]);
    let lines = [scene("good"), single, some, scene("torn"), scene("empty"), scene("bad")];
    let manifest = folder.path().join("<b>&scenes.jsonl");
    write_lines(&manifest, &lines);
    let out = folder.path().join("run");
    run(&["plan", text(&manifest), "--out", text(&out)]).expect(0);
    let (page, said) = report(&out, 0, &[]);
    assert_eq!((&said["tuples"], &said["shown"]), (&json!(0), &json!(0)));
    for part in [
        "The run has no tuple yet",
        "No tuple states an error yet",
        "No worker has left its log yet",
        "No scene is in quarantine",
        "Nothing was trained",
    ] {
        assert!(page.contains(part), "{part}");
    }

    let reason = "<script>alert(1)</script> & \"quotes\" 'too'";
    std::fs::create_dir_all(out.join("quarantine")).unwrap();
    let record = json!({"schema": "glasshouse.quarantine/1", "scene": "bad", "reason": reason});
    std::fs::write(out.join("quarantine/bad.json"), record.to_string()).unwrap();
    run(&["work", text(&out)]).expect(3);
    let (page, said) = report(&out, 0, &[]);
    assert_eq!((&said["tuples"], &said["noise_maps"]), (&json!(5), &json!(4)));
    let html = strictly(&page);
    assert_eq!(words(one(&html, "#quarantine td + td")), reason);
    assert!(page.contains("&lt;script&gt;alert(1)&lt;/script&gt; &amp; &quot;quotes&quot;"));
    assert!(words(one(&html, "h1")).contains("<b>&scenes"), "{page}");
    // A single sample has no halves, and layers that are not rendered have neither pictures nor maps.
    assert!(!out.join("noise/single.exr").exists());
    assert!(words(one(&html, "#tuple-single")).contains("error unknown"));
    let some = words(one(&html, "#tuple-some"));
    assert!(some.contains("noise map I T"), "{some}");
    assert_eq!(exr_channels(&out.join("noise/some.exr")).len(), 2);

    // The report names a truncated picture and an invalid record, and shows the other tuples.
    let picture = out.join("tuples/torn/transmission.png");
    let bytes = std::fs::read(&picture).unwrap();
    std::fs::write(&picture, &bytes[..bytes.len() / 2]).unwrap();
    std::fs::write(out.join("tuples/empty/tuple.json"), b"{}").unwrap();
    let (page, said) = report(&out, 3, &[]);
    assert_eq!(said["shown"], 3);
    let mut damaged: Vec<&str> = said["damaged"]
        .as_array()
        .unwrap()
        .iter()
        .map(|entry| entry["scene"].as_str().unwrap())
        .collect();
    damaged.sort_unstable();
    assert_eq!(damaged, ["empty", "torn"]);
    let html = strictly(&page);
    let named = words(one(&html, "#damaged"));
    for part in ["torn", "transmission.png cannot be read", "empty", "tuple.json"] {
        assert!(named.contains(part), "no {part:?} in {named}");
    }
    run(&["report", text(&out), "--out", text(&folder.path().join("a/b.html"))])
        .expect(3)
        .says(&["torn", "retry", "--anew"]);
    assert!(folder.path().join("a/b.html").is_file());
}

#[test]
fn a_run_in_a_store_has_the_same_page() {
    let folder = finished();
    let store = folder.path();
    let (page, _) = report(store, 0, &[]);
    let place = tempfile::tempdir().unwrap();
    let (here, file) = (place.path().join("here"), place.path().join("x.html"));
    let more = ["--store", text(store), "--out", text(&file)];
    let (of_store, said) = report(&here, 0, &more);
    assert_eq!(PathBuf::from(said["report"].as_str().unwrap()), file);
    assert_eq!(of_store, page);
    // Without --out, `report` writes the page to the run's folder.
    let (_, said) = report(&here, 0, &more[..2]);
    assert_eq!(said["report"], text(&here.join("report/index.html")));
    let would = run(&["report", text(&here), "-n", "--json"]).expect(0).json();
    assert_eq!(would["dry_run"], true);
    let nowhere = place.path().join("nowhere");
    run(&["report", text(&nowhere)]).expect(4);
    assert!(!nowhere.exists());
}
