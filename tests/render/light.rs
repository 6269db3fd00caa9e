//! Tests exposures, illuminants and white balance of scene lines, and their choice by previews in planning.

use crate::support::outputs::exr_channels;
use crate::support::program::{run, text};
use crate::support::scenes::{photographs, scene};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const LAYERS: [&str; 4] = ["input", "transmission", "glass_reflection", "clean_reflection"];

/// Reads red, green and blue of each pixel of a layer that `render` wrote.
fn rendered(folder: &Path, layer: &str) -> Vec<[f32; 3]> {
    let channels = exr_channels(&folder.join(format!("{layer}.exr")));
    let of = |colour: &str| channels[colour].1.iter().map(|&bits| f32::from_bits(bits));
    let pixels = of("R").zip(of("G")).zip(of("B"));
    pixels.map(|((r, g), b)| [r, g, b]).collect()
}

/// Renders the four layers of a scene line with `changes` (JSON pointer, value).
fn layers(folder: &Path, name: &str, changes: &[(&str, Value)]) -> [Vec<[f32; 3]>; 4] {
    let mut line = scene(name);
    // By default, the tracer drops and thins orders by their radiance; here, any light has the same orders and samples.
    line["film"]["order_tolerance"] = json!(0.0);
    for (pointer, value) in changes {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        line.pointer_mut(parent).unwrap()[key] = value.clone();
    }
    let path = folder.join(format!("{name}.json"));
    std::fs::write(&path, line.to_string()).unwrap();
    let out = folder.join(name);
    run(&["render", text(&path), "--out", text(&out)]).expect(0);
    LAYERS.map(|layer| rendered(&out, layer))
}

#[test]
fn light_is_linear() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder);
    let plain = layers(folder, "plain", &[]);
    assert!(plain.iter().flatten().flatten().any(|v| *v > 0.0));

    // Factors that are powers of two are exact.
    let brighter = layers(folder, "brighter", &[("/camera/exposure", json!(4.0))]);
    for (layer, before) in brighter.iter().zip(&plain) {
        let expected: Vec<_> = before.iter().map(|p| p.map(|v| 4.0 * v)).collect();
        assert!(*layer == expected);
    }
    let tinted = [
        ("/front/illuminant", json!([2.0, 1.0, 0.5])),
        ("/back/illuminant", json!([2.0, 1.0, 0.5])),
    ];
    let warm = layers(folder, "warm", &tinted);
    for (layer, before) in warm.iter().zip(&plain) {
        let expected: Vec<_> = before.iter().map(|[r, g, b]| [2.0 * r, *g, 0.5 * b]).collect();
        assert!(*layer == expected);
    }
    let balance = ("/camera/white_balance", json!([0.5, 1.0, 2.0]));
    let [one, other] = tinted;
    assert!(layers(folder, "balanced", &[one, other, balance]) == plain);

    // I is the front through the glass plus R~, and the exposure of a side scales only its part.
    let back = layers(folder, "back", &[("/back/exposure", json!(2.0))]);
    assert!(back[1] == plain[1]);
    for pixel in 0..plain[0].len() {
        for c in 0..3 {
            let (i, r) = (plain[0][pixel][c], plain[2][pixel][c]);
            assert_eq!(back[2][pixel][c], 2.0 * r);
            assert!((back[0][pixel][c] - (i + r)).abs() <= 1e-6 * (1.0 + i), "{pixel}");
        }
    }
}

#[test]
fn invalid_lights_are_refused() {
    let place = tempfile::tempdir().unwrap();
    photographs(place.path());
    for (pointer, value, words) in [
        ("/camera/exposure", json!(-1.0), "camera.exposure is -1"),
        ("/front/illuminant", json!([1.0, -2.0, 1.0]), "front.illuminant[1] is -2"),
        ("/camera/white_balance", json!([1.0, 1.0]), "invalid length 2"),
        ("/film/glass_reflection_orders", json!("second"), "unknown variant `second`"),
    ] {
        let mut line = scene("bad");
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        line.pointer_mut(parent).unwrap()[key] = value;
        let path = place.path().join("bad.json");
        std::fs::write(&path, line.to_string()).unwrap();
        let out = place.path().join("out");
        let ended = run(&["render", text(&path), "--out", text(&out)]);
        ended.expect(4).says(&[words]);
    }
}

/// A recipe with wide ranges and every rule of `[reject]`.
const WILD: &str = r#"
schema = "glasshouse.recipe/1"
name = "wild"
seed = 7
[film]
width = 96
height = 64
spp = 64
exr = "float"
[camera]
focal_length_mm = { uniform = [40, 75] }
f_number = { log_uniform = [1.4, 22] }
focus = { choice = ["front_center", "back_center", "glass"] }
[glass]
distance_m = { log_uniform = [0.1, 2.0] }
thickness_m = { log_uniform = [0.001, 0.05] }
ior = { uniform = [1.3, 1.7] }
tilt_deg = [{ normal = { mean = 0, std = 10, min = -40, max = 40 } }, { uniform = [-40, 40] }]
[front]
illuminant_k = { uniform = [3000, 9000] }
[back]
exposure_ev = { uniform = [-2, 5] }
illuminant_k = { uniform = [2500, 12000] }
[light]
scale = "metered"
white_balance = "grey_world"
auto_exposure = { percentile = 99, level = 0.9 }
[reject]
reflected_share = [0.02, 0.8]
contrast = [0.01, 2.0]
clipped_share = 0.05
ssim = [0.2, 0.985]
[sources.sample]
layout = "sample"
count = 12
width = 128
height = 96
[[split]]
name = "train"
pairs = { sample = 10 }
[[split]]
name = "test"
pairs = { sample = 3 }
"#;

/// Returns the files of a line's photographs, relative to their source.
fn photograph_files(line: &str) -> Vec<PathBuf> {
    let line: Value = serde_json::from_str(line).unwrap();
    let sides = ["front", "back"].map(|side| line[side].clone());
    let files =
        sides.iter().flat_map(|side| ["color", "depth", "mask"].map(|key| side[key].clone()));
    files.map(|file| file.as_str().unwrap().strip_prefix("sample:").unwrap().into()).collect()
}

fn files_below(folder: &Path) -> BTreeSet<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let of = |path: PathBuf| if path.is_dir() { files_below(&path) } else { [path].into() };
    entries.flat_map(of).collect()
}

#[test]
fn planning_sets_the_light_and_replaces_rejected_draws() {
    let place = tempfile::tempdir().unwrap();
    let recipe = place.path().join("wild.toml");
    std::fs::write(&recipe, WILD).unwrap();
    let plan = |name: &str, threads: &str| {
        let folder = place.path().join(name);
        let outcome =
            run(&["plan", text(&recipe), "--out", text(&folder), "-j", threads, "--json"]);
        let outcome = outcome.expect(0).json();
        let read = |file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
        (outcome, read("manifest.jsonl"), read("rejected.jsonl"))
    };
    let (outcome, manifest, rejected) = plan("one", "1");
    assert_eq!(outcome["scenes"], 13);
    assert_eq!(outcome["rejected"], rejected.lines().count());
    // Planning wrote the photographs of the scenes, and none of rejected draws alone.
    let of_scenes: BTreeSet<PathBuf> = manifest.lines().flat_map(photograph_files).collect();
    let inputs = place.path().join("one/inputs/sample");
    assert_eq!(files_below(&inputs), of_scenes.iter().map(|file| inputs.join(file)).collect());
    let again = plan("two", "2");
    assert_eq!((&again.1, &again.2), (&manifest, &rejected));
    let rejected: Vec<Value> = rejected.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert!(!rejected.is_empty());
    for one in &rejected {
        assert!(one["reason"].as_str().unwrap().len() > 10, "{one}");
    }

    // An additional scene does not change the other scenes.
    std::fs::write(&recipe, WILD.replace("{ sample = 10 }", "{ sample = 11 }")).unwrap();
    let (_, more, _) = plan("more", "2");
    for line in manifest.lines() {
        assert!(more.lines().any(|other| other == line), "{line}");
    }

    let folder = place.path().join("one");
    run(&["work", text(&folder)]).expect(0);
    for line in manifest.lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        let id = line["id"].as_str().unwrap();
        let tuple = folder.join("tuples").join(id);
        let channels = exr_channels(&tuple.join("tuple.exr"));
        // `render` makes the same images from `tuple.json`.
        let out = place.path().join("again").join(id);
        run(&["render", text(&tuple.join("tuple.json")), "--out", text(&out)]).expect(0);
        for layer in LAYERS {
            let floats = exr_channels(&out.join(format!("{layer}.exr")));
            for colour in ["R", "G", "B"] {
                let (kind, bits) = &channels[&format!("{layer}.{colour}")];
                assert_eq!(*kind, "float");
                assert!(*bits == floats[colour].1, "{id} {layer}.{colour}");
            }
        }
        // The light set by the preview of 64 x 42 px and 16 samples also suits 96 x 64 px and 64 samples.
        let input = rendered(&out, "input");
        let mut largest: Vec<f32> = input.iter().map(|p| p[0].max(p[1]).max(p[2])).collect();
        largest.sort_by(f32::total_cmp);
        let level = largest[largest.len() * 99 / 100];
        assert!((0.75..1.1).contains(&level), "{id}: {level}");
        let clipped = largest.iter().filter(|v| **v >= 1.0).count();
        assert!(clipped * 10 < largest.len(), "{id}");
        let mean = |c: usize| input.iter().map(|p| f64::from(p[c])).sum::<f64>();
        for c in [0, 2] {
            let cast = mean(c) / mean(1);
            assert!((cast - 1.0).abs() < 0.03, "{id}: {cast}");
        }
    }
    run(&["report", text(&folder)]).expect(0);
    let page = std::fs::read_to_string(folder.join("report/index.html")).unwrap();
    for words in ["Histogram of f-number", "Histogram of back against front", "Rejected draws"] {
        assert!(page.contains(words), "{words}");
    }
}

/// A rejected draw is drawn again with other covers, whose pictures the preview must have, too. Planning writes those that scenes use.
#[test]
fn rejected_draws_get_other_covers() {
    let place = tempfile::tempdir().unwrap();
    let recipe = place.path().join("covers.toml");
    let cover =
        "[cover]\npictures = 4\nphotographer = 0.5\nblind = 0.3\nplant = 0.5\nframe = 0.3\n[front]";
    let film =
        "spp = 4\nlayers = [\"input\", \"transmission\", \"glass_reflection\", \"coverage\"]";
    let covered = WILD.replace("[front]", cover).replace("spp = 64", film);
    std::fs::write(&recipe, covered).unwrap();
    let folder = place.path().join("run");
    let outcome = run(&["run", text(&recipe), "--out", text(&folder), "--json"]).expect(0);
    assert!(!outcome.stderr.contains("panicked"), "{outcome:?}");
    let read = |file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
    assert!(read("rejected.jsonl").lines().count() > 3);
    let mut used = BTreeSet::new();
    for line in read("manifest.jsonl").lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        for side in ["front", "back"] {
            for card in line[side]["cards"].as_array().into_iter().flatten() {
                let path = card["color"].as_str().unwrap().strip_prefix("cover:").unwrap();
                assert!(path.starts_with(line["split"].as_str().unwrap()), "{path}");
                used.insert(folder.join("inputs/cover").join(path));
            }
        }
    }
    let there = ["train", "test"].map(|split| folder.join("inputs/cover").join(split));
    let there = there.iter().flat_map(|split| std::fs::read_dir(split).into_iter().flatten());
    let there: BTreeSet<_> = there.map(|entry| entry.unwrap().path()).collect();
    assert!(used.len() > 4);
    assert_eq!(there, used);
}

#[test]
fn bounds_that_reject_every_draw_are_reported() {
    let place = tempfile::tempdir().unwrap();
    let recipe = place.path().join("wild.toml");
    let impossible = WILD
        .replace("[0.02, 0.8]", "[0.9999, 1.0]")
        .replace("{ sample = 10 }", "{ sample = 1 }")
        .replace("{ sample = 3 }", "{ sample = 1 }");
    std::fs::write(&recipe, impossible).unwrap();
    let folder = place.path().join("run");
    run(&["plan", text(&recipe), "--out", text(&folder)]).expect(4).says(&[
        "all 64 draws, with different photographs, were rejected",
        "reflected_share is",
        "widen [reject]",
    ]);
    assert!(!folder.exists());
}
