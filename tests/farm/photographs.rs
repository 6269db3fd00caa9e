//! Photographs of tuples: at merge, for a recipe with `[sensor]`, and by `develop` afterwards.

use crate::support::outputs::{assert_same, files, manifest, read_json, tuple_record, tuples};
use crate::support::program::{run, text};
use crate::support::scenes::{Place, RECIPE, SCENES, place, reference};
use image::GenericImageView;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A sensor with every stage, whose photographs are smaller than the film.
const SENSOR: &str = r#"
[sensor]
camera = { choice = ["imx686", "sony-a7s2"] }
scale = { choice = [0.75, 1.0] }
raw = true
"#;

const NAMES: [&str; 4] =
    ["photo.jpg", "photo_glass_reflection.png", "photo_transmission.png", "raw.dng"];

fn photographing() -> Place {
    let place = place();
    std::fs::write(&place.recipe, format!("{RECIPE}{SENSOR}")).unwrap();
    run(&place.arguments("run", &["-q"])).expect(0);
    place
}

/// Returns the photographs below a folder, by scene and name.
fn photographs(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let scene = entry.unwrap().path();
        for name in NAMES {
            if let Ok(bytes) = std::fs::read(scene.join(name)) {
                let key = format!("{}/{name}", scene.file_name().unwrap().to_str().unwrap());
                found.insert(key, bytes);
            }
        }
    }
    found
}

#[test]
fn a_recipe_with_a_sensor_has_photographs_beside_equal_layers() {
    let place = photographing();
    let all = tuples(&place.run);
    // The layers keep the bits of a run without a sensor.
    for (path, content) in reference() {
        assert!(path.ends_with("tuple.json") || all[path] == *content, "{}", path.display());
    }
    let found = photographs(&place.run.join("tuples"));
    assert_eq!(found.len(), NAMES.len() * SCENES);
    for line in manifest(&place.run) {
        let scene = line["id"].as_str().unwrap();
        let record = tuple_record(&place.run, scene);
        let sensor = &record["scene"]["sensor"];
        assert_eq!(*sensor, line["sensor"]);
        assert_eq!(record["photographs"]["sensor_version"], 1);
        let factor = record["photographs"]["exposure_factor"].as_f64().unwrap();
        assert!(factor > 0.0 && sensor["gain_dn_per_e"].as_f64().unwrap() > 0.0);
        let scale = sensor.get("scale").and_then(Value::as_f64).unwrap_or(1.0);
        for name in NAMES {
            let bytes = &found[&format!("{scene}/{name}")];
            let digest = blake3::hash(bytes).to_hex().to_string();
            assert_eq!(record["files"][name], digest, "{scene}/{name}");
            if name != "raw.dng" {
                let (width, height) = image::load_from_memory(bytes).unwrap().dimensions();
                let size = (f64::from(width), f64::from(height));
                assert_eq!(size, (96.0 * scale, 64.0 * scale), "{scene}/{name}");
            }
        }
    }
    let audited = run(&["audit", text(&place.run), "--share", "1", "--json"]).expect(0).json();
    assert_eq!((&audited["same"], &audited["scenes"][0]["files"]), (&SCENES.into(), &10.into()));
    // A lost photograph is made again, with the same bytes.
    let lost = place.run.join("tuples/train-sample-000000/photo.jpg");
    std::fs::remove_file(lost).unwrap();
    run(&["work", text(&place.run)]).expect(0);
    assert_same(&tuples(&place.run), &all);
}

#[test]
fn developing_gives_the_bytes_of_the_merge_and_resumes() {
    let place = photographing();
    let plain = crate::support::scenes::place();
    run(&plain.arguments("run", &["-q"])).expect(0);
    let snapshot = |folder: &Path| -> Vec<(PathBuf, Vec<u8>)> {
        files(folder)
            .into_iter()
            .map(|path| (path.clone(), std::fs::read(folder.join(path)).unwrap()))
            .collect()
    };
    let sensor = place.folder.path().join("sensor.toml");
    std::fs::write(&sensor, format!("seed = 7\n{SENSOR}")).unwrap();
    let out = place.folder.path().join("developed");
    let arguments = ["develop", text(&plain.run), "--sensor", text(&sensor), "--out", text(&out)];
    let call = |more: &[&str]| run(&[&arguments[..], more].concat());
    let foretold = call(&["-n", "--json"]).expect(0).json();
    assert_eq!((&foretold["scenes"], out.exists()), (&SCENES.into(), false));
    let first = call(&["--json", "-j", "2"]).expect(0).json();
    assert_eq!((&first["scenes"], &first["scenes_resumed"]), (&SCENES.into(), &0.into()));
    let made = snapshot(&out);
    assert_eq!(photographs(&out), photographs(&place.run.join("tuples")));
    let record = read_json(out.join("test-sample-000000/photograph.json"));
    let merged = tuple_record(&place.run, "test-sample-000000");
    assert_eq!(record["sensor"], merged["scene"]["sensor"]);
    assert_eq!(record["photographs"], merged["photographs"]);
    // A killed call leaves scenes without a record, or with fewer photographs.
    std::fs::remove_file(out.join("train-sample-000001/photograph.json")).unwrap();
    std::fs::write(out.join("train-sample-000001/photo.jpg"), b"torn").unwrap();
    std::fs::remove_dir_all(out.join("train-sample-000002")).unwrap();
    let again = call(&["--json", "-j", "1"]).expect(0).json();
    assert_eq!((&again["scenes"], &again["scenes_resumed"]), (&2.into(), &2.into()));
    assert!(snapshot(&out) == made, "every byte is as before");
    // Another sensor is refused, and the photographs stay.
    std::fs::write(&sensor, "[sensor]\ncamera = \"nikon-d850\"").unwrap();
    call(&[]).expect(5).says(&["this run's photographs by this sensor", "--out"]);
    assert!(snapshot(&out) == made, "every byte is as before");
    std::fs::write(&sensor, "[sensor]\ncamera = \"nikon\"").unwrap();
    call(&[]).expect(4).says(&["sensor.toml", "unknown sensor \"nikon\", expected one of"]);
}

#[test]
fn scenes_without_a_usable_tuple_are_named_and_the_others_photographed() {
    let place = place();
    run(&place.arguments("run", &["-q"])).expect(0);
    let exr = place.run.join("tuples/train-sample-000001/tuple.exr");
    let mut bytes = std::fs::read(&exr).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&exr, bytes).unwrap();
    std::fs::remove_file(place.run.join("tuples/train-sample-000002/tuple.json")).unwrap();
    let sensor = place.folder.path().join("sensor.toml");
    std::fs::write(&sensor, SENSOR).unwrap();
    let out = place.folder.path().join("developed");
    let ended = run(&[
        "develop",
        text(&place.run),
        "--sensor",
        text(&sensor),
        "--out",
        text(&out),
        "--json",
    ])
    .expect(3);
    let answer = ended.json();
    assert_eq!(answer["scenes"], SCENES - 2);
    assert_eq!(answer["missing"], serde_json::json!(["train-sample-000002"]));
    let failed = &answer["failed"][0];
    assert_eq!(failed["scene"], "train-sample-000001");
    let reason = failed["reason"].as_str().unwrap();
    assert!(reason.contains("tuple.exr") && reason.contains("digest"), "{reason}");
    assert!(!out.join("train-sample-000001/photograph.json").exists());
}
