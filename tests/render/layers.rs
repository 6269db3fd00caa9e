//! Tests `film.layers` (an omitted layer changes no other layer) and `film.target_error` (threads, tiles and kills
//! change no bit).

use crate::support::outputs::{Content, Tuples, assert_same, assert_tidy, tuple_record, tuples};
use crate::support::program::{command, run, text, wait_until};
use crate::support::scenes::{Place, RECIPE, SCENES, SHARDS, place, put_partials, reference};
use glasshouse::run::Run;
use glasshouse_line::Roots;
use glasshouse_line::label::Label;
use glasshouse_line::layer::Layer;
use render::job::{SceneJob, render_partials};
use render::merge::{decode_tuple_exr, decode_tuple_labels};
use render::scene::{load, read_files};
use render::trace::Isa;
use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

/// Makes a place with a recipe that has the additional lines `film` under `[film]`.
fn place_with(film: &str) -> Place {
    let place = place();
    std::fs::write(&place.recipe, RECIPE.replace("[film]\n", &format!("[film]\n{film}\n")))
        .unwrap();
    place
}

fn pixels(content: &Content) -> &BTreeMap<String, (&'static str, Vec<u32>)> {
    match content {
        Content::Pixels(channels) => channels,
        Content::Bytes(_) => panic!("not an EXR"),
    }
}

#[test]
fn omitted_layers_are_not_written_and_the_others_do_not_change() {
    let place = place_with(r#"layers = ["transmission", "input"]"#);
    run(&place.arguments("run", &[])).expect(0);
    let found = tuples(&place.run);
    let mut names: Vec<&str> = found.keys().map(|p| text(p)).collect();
    names.retain(|name| name.starts_with("train-sample-000000/"));
    let expected = ["input.png", "transmission.png", "tuple.exr", "tuple.json"];
    assert_eq!(names, expected.map(|n| format!("train-sample-000000/{n}")));
    assert_eq!(found.len(), SCENES * 4);
    for (path, content) in &found {
        let whole = &reference()[path];
        if path.ends_with("tuple.exr") {
            let (some, all) = (pixels(content), pixels(whole));
            let channels: Vec<&str> = some.keys().map(String::as_str).collect();
            let colours = ["B", "G", "R"];
            let of = |layer: &str| colours.map(|c| format!("{layer}.{c}"));
            assert_eq!(channels, [of("input"), of("transmission")].concat());
            for (name, bits) in some {
                assert!(*bits == all[name], "{} {name}", path.display());
            }
        } else if path.extension().is_some_and(|e| e == "png") {
            assert!(content == whole, "{}", path.display());
        }
    }
    let record = tuple_record(&place.run, "train-sample-000000");
    let layers: Vec<&String> = record["layers"].as_object().unwrap().keys().collect();
    assert_eq!(layers, ["input", "transmission"]);

    // The page shows only these two layers.
    let page = std::fs::read_to_string(place.run.join("report/index.html")).unwrap();
    for (layer, shown) in [
        ("input", SCENES),
        ("transmission", SCENES),
        ("glass_reflection", 0),
        ("clean_reflection", 0),
    ] {
        let pictures = page.matches(&format!("alt=\"{layer} of ")).count();
        assert_eq!(pictures, shown, "{layer}");
    }

    // A second run has no work, except for a scene that has lost a layer.
    let again = || {
        let done = run(&["work", text(&place.run), "--json"]).expect(0).json();
        done["shards_traced"].as_u64().unwrap()
    };
    assert_eq!(again(), 0);
    assert_same(&tuples(&place.run), &found);
    std::fs::remove_file(place.run.join("tuples/train-sample-000000/input.png")).unwrap();
    assert_eq!(again(), SHARDS as u64);
    assert_same(&tuples(&place.run), &found);
    assert_tidy(&place.run);
}

#[test]
fn invalid_layers_and_target_errors_are_refused() {
    for (film, word) in [
        (r#"layers = ["I"]"#, "there is no layer"),
        ("layers = []", "name at least one"),
        (r#"layers = ["input", "input"]"#, "listed twice"),
        ("target_error = 0", "film.target_error is 0"),
    ] {
        let place = place_with(film);
        run(&place.arguments("plan", &[])).expect(4).says(&[word]);
        assert!(!place.run.exists());
    }
}

const ADAPTIVE: &str = "target_error = 2e-3";

/// Returns the tuples of an uninterrupted adaptive run, rendered once.
fn adaptive_reference() -> &'static Tuples {
    static REFERENCE: OnceLock<Tuples> = OnceLock::new();
    REFERENCE.get_or_init(|| {
        let place = place_with(ADAPTIVE);
        run(&place.arguments("run", &["-j", "1"])).expect(0);
        let mut spared = false;
        for scene in [
            "train-sample-000000",
            "train-sample-000001",
            "train-sample-000002",
            "test-sample-000000",
        ] {
            let record = tuple_record(&place.run, scene);
            for (name, layer) in record["layers"].as_object().unwrap() {
                let mean = layer["mean_samples"].as_f64().unwrap();
                let most = layer["samples"].as_f64().unwrap();
                assert!(mean <= most && most <= 256.0, "{scene} {name}: {layer}");
                spared |= mean < most;
            }
        }
        assert!(spared, "all cells took the same number of samples");
        tuples(&place.run)
    })
}

#[test]
fn adaptive_tuples_depend_on_neither_threads_nor_tiles() {
    // Tiles of 12 and 100 px are rounded up to whole cells.
    for (threads, tile) in [("2", "16"), ("1", "64"), ("2", "64"), ("1", "12"), ("2", "100")] {
        let place = place_with(ADAPTIVE);
        let (recipe, out) = (text(&place.recipe), text(&place.run));
        run(&["run", recipe, "--out", out, "-j", threads, "--tile", tile]).expect(0);
        eprintln!("-j {threads} --tile {tile}");
        assert_same(&tuples(&place.run), adaptive_reference());
    }
}

#[test]
fn adaptive_runs_are_killed_and_resumed() {
    let place = place_with(ADAPTIVE);
    let arguments = place.arguments("run", &["-j", "1"]);
    let mut child = command(&arguments).spawn().unwrap();
    let folder = place.run.join("partials");
    let is_under_way = wait_until(&mut child, || {
        let scenes = std::fs::read_dir(&folder).into_iter().flatten().flatten();
        scenes.flat_map(|scene| std::fs::read_dir(scene.path()).into_iter().flatten()).count() >= 5
    });
    assert!(is_under_way, "the run ended before the test killed it");
    child.kill().unwrap();
    child.wait().unwrap();
    run(&arguments).expect(0);
    assert_same(&tuples(&place.run), adaptive_reference());
    assert_tidy(&place.run);
}

#[test]
fn adaptive_partials_are_resumed() {
    let place = place_with(ADAPTIVE);
    place.plan();
    let opened = Run::open(&place.run, &Roots::default()).unwrap();
    let line = &opened.lines[1];
    let files = read_files(line, &opened.roots, opened.root()).unwrap();
    let job = SceneJob::new(line, opened.layout(line), load(line, &files).unwrap());
    let never = AtomicBool::new(false);
    let partials = render_partials(&job, 1, Isa::detect(), &never, &|| {}).unwrap();
    assert_eq!(partials.len(), SHARDS);
    assert!(partials.iter().all(|p| p.header.sample_sums.is_some()));
    // Keeps every third partial, as after a kill.
    let some: Vec<_> = partials.iter().step_by(3).cloned().collect();
    put_partials(&place.run, line.id.as_str(), &some);
    let done = run(&["work", text(&place.run), "--json"]).expect(0).json();
    assert_eq!(done["shards_resumed"], some.len());
    assert_eq!(done["shards_traced"], SCENES * SHARDS - some.len());
    assert_same(&tuples(&place.run), adaptive_reference());
}

/// Labels stand in `tuple.exr` and `tuple.json`, whatever the tiles and the ranges of samples, and change no layer.
#[test]
fn labels_are_merged_from_tiles_and_ranges() {
    let names = "[\"input\", \"transmission\", \"glass_reflection\", \"clean_reflection\", \"coverage\", \
                 \"front_depth\", \"ghosts\", \"reflected_share\"]";
    let labelled = |tile: &str| {
        let place = place_with(&format!("layers = {names}"));
        let recipe = std::fs::read_to_string(&place.recipe).unwrap();
        std::fs::write(&place.recipe, recipe.replace("spp = 256", "spp = 1024")).unwrap();
        let (recipe, out) = (text(&place.recipe), text(&place.run));
        run(&["run", recipe, "--out", out, "--tile", tile]).expect(0);
        (tuples(&place.run), place)
    };
    let ((small, place), (large, _)) = (labelled("16"), labelled("64"));
    assert_same(&small, &large);
    let exr = |found: &Tuples| {
        let path = std::path::Path::new("train-sample-000000/tuple.exr");
        pixels(&found[path]).clone()
    };
    let channels = exr(&small);
    assert_eq!(channels["front_depth.Z"].0, "float");
    assert_eq!(channels["coverage.Y"].0, "half");
    let folder = place.run.join("tuples/train-sample-000000");
    let of_record =
        serde_json::from_value(tuple_record(&place.run, "train-sample-000000")).unwrap();
    let bytes = std::fs::read(folder.join("tuple.exr")).unwrap();
    let labels = decode_tuple_labels(&bytes, &of_record).unwrap();
    let layers = decode_tuple_exr(&bytes, &of_record).unwrap();
    assert!(labels[&Label::FrontDepth].iter().all(|z| *z > 0.3 && z.is_finite()));
    assert!(labels[&Label::Coverage].iter().all(|v| *v == 1.0));
    let (ghosts, reflection) =
        (&labels[&Label::Ghosts], layers[Layer::GlassReflection].as_flattened());
    assert!(ghosts.iter().zip(reflection).all(|(a, b)| *a >= 0.0 && a <= b));
    assert!(ghosts.iter().any(|v| *v > 0.0));
    let share = &labels[&Label::ReflectedShare];
    assert!(share.iter().all(|v| (0.0..=1.0).contains(v)) && share.iter().any(|v| *v > 0.01));
    let record = tuple_record(&place.run, "train-sample-000000");
    let labels: Vec<&String> = record["labels"].as_object().unwrap().keys().collect();
    assert_eq!(labels, ["coverage", "front_depth", "ghosts", "reflected_share"]);
    assert_eq!(record["labels"]["coverage"]["mean"], 1.0);
    // Without labels, the layers have the same bits.
    let bare = place_with("");
    let recipe = std::fs::read_to_string(&bare.recipe).unwrap();
    std::fs::write(&bare.recipe, recipe.replace("spp = 256", "spp = 1024")).unwrap();
    run(&bare.arguments("run", &[])).expect(0);
    for (name, bits) in exr(&tuples(&bare.run)) {
        assert!(bits == channels[&name], "{name}");
    }
}
