//! `plan` checks input files, and plans the paper's recipe over folders with the layout of the real data sets.

use crate::support::outputs::{files, manifest};
use crate::support::program::{Ended, run, text};
use crate::support::scenes::{npy, photographs, scene, write_lines};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "few"
seed = 5
[film]
width = 24
height = 16
spp = 16
[sources.diode]
layout = "diode"
[[split]]
name = "train"
pairs = { diode = 12 }
[[split]]
name = "test"
pairs = { diode = 4 }
"#;

/// A folder with a recipe and its photographs.
struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("few.toml"), RECIPE).unwrap();
        let place = Self { folder };
        let size = ["--width", "32", "--height", "24"];
        run(&[&["sample", text(&place.path("diode")), "--count", "20"][..], &size].concat())
            .expect(0);
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns the path of a photograph's file from its path in a scene line.
    fn file(&self, path: &str) -> PathBuf {
        self.path("diode").join(path.strip_prefix("diode:").unwrap())
    }

    fn plan(&self, out: &str, more: &[&str]) -> Ended {
        let (recipe, out) = (self.path("few.toml"), self.path(out));
        let root = format!("diode={}", self.path("diode").display());
        let arguments = ["plan", text(&recipe), "--out", text(&out), "--root", &root, "--json"];
        run(&[&arguments, more].concat())
    }

    fn manifest(&self, run: &str) -> String {
        std::fs::read_to_string(self.path(run).join("manifest.jsonl")).unwrap()
    }

    /// Returns the scenes of a planned run by their ids.
    fn scenes(&self, run: &str) -> BTreeMap<String, Value> {
        let lines = manifest(&self.path(run)).into_iter();
        lines.map(|line| (line["id"].as_str().unwrap().to_owned(), line)).collect()
    }
}

fn cut(path: &Path, keep: usize) {
    let bytes = std::fs::read(path).unwrap();
    std::fs::write(path, &bytes[..keep.min(bytes.len())]).unwrap();
}

#[test]
fn damaged_files_are_listed_in_one_table_and_nothing_is_written() {
    let place = Place::new();
    let planned = place.plan("whole", &[]).expect(0).json();
    assert_eq!((planned["scenes"].as_u64(), &planned["invalid"]), (Some(16), &json!([])));
    let whole = place.scenes("whole");
    let train = whole.iter().filter(|(id, _)| id.starts_with("train"));
    let used: Vec<&Value> = train.map(|(_, line)| &line["front"]).collect();

    // The test damages one file of each of four photographs.
    let mut photographs: Vec<&Value> = Vec::new();
    for front in used {
        if photographs.len() < 4 && !photographs.iter().any(|p| p["color"] == front["color"]) {
            photographs.push(front);
        }
    }
    let path = |k: usize, key: &str| photographs[k][key].as_str().unwrap().to_owned();
    let bad = [
        (path(0, "color"), "cannot read it as PNG"),
        (path(1, "depth"), "it is empty"),
        (path(2, "mask"), "it has 16x12 pixels, but the depth image has 32x24"),
        (path(3, "depth"), "needs 3072 bytes of data"),
    ];
    cut(&place.file(&bad[0].0), 400);
    cut(&place.file(&bad[1].0), 0);
    std::fs::write(place.file(&bad[2].0), npy("(12, 16)", &[1.0; 192])).unwrap();
    cut(&place.file(&bad[3].0), 3000);

    for more in [&["-n"][..], &[]] {
        let ended = place.plan("bad", more).expect(4).says(&[
            "4 of ",
            "input files cannot be used",
            "--skip-invalid",
        ]);
        assert!(!place.path("bad").exists());
        let error = ended.json();
        assert_eq!(error["schema"], "glasshouse.error/1");
        let invalid = error["invalid"].as_array().unwrap();
        assert_eq!(invalid.len(), 4);
        for (path, words) in &bad {
            let input = invalid.iter().find(|input| input["path"] == *path).unwrap();
            assert!(input["problem"].as_str().unwrap().contains(words), "{input}");
            for id in input["scenes"].as_array().unwrap() {
                assert!(whole[id.as_str().unwrap()].to_string().contains(path));
            }
            let mut rows = ended.stderr.lines().filter(|line| line.contains(path));
            assert!(rows.next().unwrap().contains(words) && rows.next().is_none());
        }
    }
    let run_folder = place.path("bad");
    let root = format!("diode={}", place.path("diode").display());
    let recipe = place.path("few.toml");
    run(&["run", text(&recipe), "--out", text(&run_folder), "--root", &root]).expect(4);

    // The photographs left out have the same replacements in each plan, and scenes without them do not change.
    let planned = place.plan("without", &["--skip-invalid"]).expect(0);
    assert!(planned.stderr.contains("photographs left out: 4"), "{planned:?}");
    let planned = planned.json();
    assert_eq!(planned["scenes"], 16);
    assert_eq!(planned["invalid"].as_array().unwrap().len(), 4);
    let left_out = planned["left_out"].as_array().unwrap();
    assert_eq!(left_out.len(), 4);
    place.plan("again", &["--skip-invalid", "-j", "1"]).expect(0);
    assert_eq!(place.manifest("without"), place.manifest("again"));
    let without = place.scenes("without");
    let needs = |line: &Value| {
        let names = [&line["front"]["color"], &line["back"]["color"]];
        names.iter().any(|name| left_out.contains(name))
    };
    assert!(without.values().all(|line| !needs(line)));
    let mut changed = 0;
    for (id, line) in &whole {
        if needs(line) {
            changed += 1;
            assert_ne!(*line, without[id]);
        } else {
            assert_eq!(*line, without[id]);
        }
    }
    assert!(changed >= 4);

    // The photographs stay out even after the repair of one file.
    let color = place.file(&bad[0].0);
    // With other bytes than any other photograph: equal ones would count as one.
    let mut picture = image::open(place.file(left_out[1].as_str().unwrap())).unwrap().to_rgb8();
    image::imageops::invert(&mut picture);
    picture.save(color).unwrap();
    for more in [&[][..], &["--skip-invalid"]] {
        let again = place.plan("without", more).expect(0).json();
        assert_eq!((&again["existed"], &again["left_out"]), (&json!(true), &planned["left_out"]));
    }
    let again = place.plan("without", &["-n"]).expect(0).json();
    assert_eq!(again["invalid"], json!([]));
    let out = place.path("without");
    let done = run(&["work", text(&out), "--json"]).expect(0).json();
    assert_eq!(done["merged"], 16);
}

#[test]
fn the_table_is_printed_even_if_too_few_photographs_are_left() {
    let place = Place::new();
    place.plan("whole", &[]).expect(0);
    for (id, line) in place.scenes("whole") {
        if id.starts_with("test") {
            for side in ["front", "back"] {
                cut(&place.file(line[side]["depth"].as_str().unwrap()), 100);
            }
        }
    }
    let ended = place.plan("out", &["--skip-invalid"]).expect(4);
    let ended = ended.says(&[
        "input files cannot be used",
        "_depth.npy",
        "the recipe cannot do without them",
    ]);
    assert!(!ended.json()["invalid"].as_array().unwrap().is_empty());
}

#[test]
fn damaged_files_do_not_change_an_existing_plan() {
    let place = Place::new();
    place.plan("run", &[]).expect(0);
    let front = &place.scenes("run")["train-diode-000000"]["front"];
    let color = front["color"].as_str().unwrap();
    cut(&place.file(color), 300);
    assert_eq!(place.plan("run", &[]).expect(0).json()["input_bytes"], Value::Null);
    place.plan("run", &["-n"]).expect(4).says(&[color]);
    let looked = place.plan("run", &["-n", "--skip-invalid"]).expect(0);
    assert!(looked.stderr.contains("does not change"), "{looked:?}");
    assert_eq!(looked.json()["invalid"][0]["path"], color);
    assert_eq!(looked.json()["left_out"], json!([]));
}

#[test]
fn skip_invalid_leaves_out_single_scenes_of_a_manifest() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let mut lines = [scene("good"), scene("bad"), scene("worse")];
    lines[1]["back"]["mask"] = json!("nowhere.npy");
    lines[2]["front"]["depth"] = json!("a.png");
    let manifest = folder.path().join("scenes.jsonl");
    write_lines(&manifest, &lines);
    let out = folder.path().join("run");
    let plan = |more: &[&str]| {
        let arguments = ["plan", text(&manifest), "--out", text(&out), "--json"];
        run(&[&arguments, more].concat())
    };
    // By default `plan` keeps all scenes of a manifest: the run quarantines bad scenes and renders the others.
    let kept = folder.path().join("kept");
    let ended = run(&["plan", text(&manifest), "--out", text(&kept), "--json"]).expect(0).says(&[
        "2 of 7 input files",
        "manifest:nowhere.npy",
        "it cannot be read",
        "manifest:a.png",
        "3 channels",
        "--skip-invalid leaves them out",
    ]);
    assert_eq!(ended.json()["invalid"][1]["scenes"], json!(["bad"]));
    let done = run(&["work", text(&kept), "--json"]).expect(3).json();
    assert_eq!(done["merged"], 1);
    assert!(
        kept.join("quarantine/bad.json").is_file() && kept.join("quarantine/worse.json").is_file()
    );

    let planned = plan(&["--skip-invalid"]).expect(0).says(&["scenes left out: 2"]).json();
    assert_eq!((&planned["scenes"], &planned["left_out"]), (&json!(1), &json!(["bad", "worse"])));
    assert_eq!(plan(&["--skip-invalid"]).expect(0).json()["existed"], true);
    let done = run(&["work", text(&out), "--json"]).expect(0).json();
    assert_eq!(done["merged"], 1);
    // No scene is left.
    write_lines(&manifest, &lines[1..]);
    let no = folder.path().join("no");
    run(&["plan", text(&manifest), "--out", text(&no), "--skip-invalid"])
        .expect(4)
        .says(&["2 of "]);
}

#[test]
fn the_recipe_of_the_paper_is_planned_over_folders_with_the_real_layout() {
    let folder = tempfile::tempdir().unwrap();
    let sample = |layout: &str, count: &str| {
        let dir = folder.path().join(layout);
        let arguments = ["sample", text(&dir), "--layout", layout, "--count", count];
        // The pictures of PLACES365 are squares.
        let height = if layout == "places" { "16" } else { "12" };
        let made =
            run(&[&arguments[..], &["--width", "16", "--height", height, "--json"]].concat());
        let roots = made.expect(0).json()["roots"].clone();
        let roots = roots.as_object().unwrap().iter();
        roots
            .map(|(name, folder)| format!("{name}={}", folder.as_str().unwrap()))
            .collect::<Vec<_>>()
    };
    let roots = [sample("diode", "120"), sample("places", "136")].concat();
    assert_eq!(roots.len(), 3);
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("manifests/paper.toml");
    let out = folder.path().join("run");
    let mut arguments = vec!["plan", text(&recipe), "--out", text(&out), "-n", "--json"];
    for root in &roots {
        arguments.extend(["--root", root]);
    }
    let planned = run(&arguments).expect(0).json();
    assert_eq!(planned["scenes"], 5200);
    assert_eq!(planned["notes"], json!([]));
    assert_eq!(planned["shards"], 5200);
    let number = |key: &str| planned[key].as_f64().unwrap_or_else(|| panic!("no {key}"));
    // A scene has 256 x 256 px of 36 floats.
    assert_eq!(number("partial_bytes"), 5200.0 * 65_536.0 * 144.0);
    assert!(number("disk_needed_bytes") > number("tuple_bytes"));
    assert!(number("partial_bytes_at_a_time") < number("partial_bytes") / 4.0);
    assert!(number("disk_available_bytes") > 0.0);
    let all: u64 = files(folder.path())
        .iter()
        .map(|path| std::fs::metadata(folder.path().join(path)).unwrap().len())
        .sum();
    // Every photograph is in some scene.
    assert_eq!(planned["input_bytes"], all);
    let calibration = &planned["calibration"];
    assert_eq!(calibration["scenes"].as_array().unwrap().len(), 3);
    let (a_sample, a_load) = (&calibration["seconds_per_sample"], &calibration["seconds_per_load"]);
    let traced_s = 5200.0 * 65_536.0 * 256.0 * a_sample.as_f64().unwrap();
    let estimate = number("core_seconds_estimate");
    assert!(estimate > traced_s + 5200.0 * a_load.as_f64().unwrap());
    assert!(!out.exists());
}
