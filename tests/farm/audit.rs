//! An audit finds one wrong pixel, and names its file and worker.

use crate::processes::{all_done, start};
use crate::support::nats::Nats;
use crate::support::outputs::manifest;
use crate::support::program::{run, text};
use crate::support::scenes::{Place, SCENES, partials, place, put_partials};
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, WritableImage, f16, read};
use glasshouse_line::label::LabelImages;
use render::partial::{Maker, Partial};
use serde_json::json;
use std::path::Path;

/// Decodes an EXR, changes one pixel of a channel by 0.5, and encodes it again.
fn damage(path: &Path, channel: &str, pixel: usize) {
    let mut image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .unwrap();
    let list = &mut image.layer_data.channel_data.list;
    let found = list.iter_mut().find(|c| c.name.to_string() == channel);
    match &mut found.unwrap().sample_data {
        FlatSamples::F16(values) => values[pixel] = f16::from_f32(values[pixel].to_f32() + 0.5),
        FlatSamples::F32(values) => values[pixel] += 0.5,
        FlatSamples::U32(_) => panic!("a tuple holds floats"),
    }
    image.write().to_file(path).unwrap();
}

#[test]
fn one_wrong_pixel_is_found() {
    let place = place();
    run(&place.arguments("run", &["-q"])).expect(0);
    let folder = text(&place.run);
    let all = ["audit", folder, "--share", "1", "--json"];
    let good = run(&all).expect(0).json();
    assert_eq!((&good["same"], &good["differ"]), (&SCENES.into(), &0.into()));
    assert_eq!(good["scenes"][0]["files"], 6);

    // A row has 96 pixels: pixel 500 is at (20, 5).
    damage(&place.run.join("tuples/train-sample-000001/tuple.exr"), "input.G", 500);
    let bad =
        run(&all).expect(1).says(&["train-sample-000001", "tuple.exr", "1 of 6144 pixels"]).json();
    assert_eq!((&bad["same"], &bad["differ"]), (&(SCENES - 1).into(), &1.into()));
    let scenes = bad["scenes"].as_array().unwrap();
    let scene = scenes.iter().find(|s| s["verdict"] == "differs").unwrap();
    assert_eq!(scene["scene"], "train-sample-000001");
    let differences = scene["differences"].as_array().unwrap();
    assert_eq!(differences.len(), 1, "{differences:#?}");
    assert_eq!(differences[0]["file"], "tuples/train-sample-000001/tuple.exr");
    assert_eq!((&differences[0]["pixels"], &differences[0]["at"]), (&1.into(), &json!([20, 5])));
    let largest = differences[0]["largest"].as_f64().unwrap();
    assert!((largest - 0.5).abs() < 1e-2, "{largest}");
    run(&["audit", folder, "--scene", "train-sample-000001"]).expect(1);
    run(&["audit", folder, "--scene", "train-sample-000000"]).expect(0);

    // The test changes a value of a record, and truncates a picture.
    let path = place.run.join("tuples/train-sample-000000/tuple.json");
    let record = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, record.replacen("\"miss_share\": ", "\"miss_share\": 1", 1)).unwrap();
    let path = place.run.join("tuples/train-sample-000000/input.png");
    let png = std::fs::read(&path).unwrap();
    std::fs::write(&path, &png[..png.len() / 2]).unwrap();
    run(&["audit", folder, "--scene", "train-sample-000000"]).expect(1).says(&[
        "layers.",
        "miss_share",
        "input.png: it cannot be read",
    ]);
}

#[test]
fn the_same_seed_draws_the_same_scenes() {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    run(&["audit", folder]).expect(1).says(&["nothing can be compared yet"]);
    run(&["work", folder, "-q"]).expect(0);
    let drawn = |seed: &str| {
        let draw = ["audit", folder, "--share", "0.5", "--seed", seed, "-n", "--json"];
        run(&draw).expect(0).json()["scenes"].clone()
    };
    assert_eq!(drawn("7"), drawn("7"));
    assert_eq!(drawn("7").as_array().unwrap().len(), SCENES / 2);
    let others = (0..8).map(|seed| drawn(&seed.to_string()));
    assert!(others.into_iter().any(|scenes| scenes != drawn("7")));
    run(&["audit", folder, "--scene", "unknown"]).expect(2).says(&["is not a scene"]);
}

#[test]
fn partials_are_compared_unless_inputs_have_changed() {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    let (id, made) = partials(&place.run, 0);
    let mut made = made[..3].to_vec();
    made[1] = with_wrong_pixel(&made[1]);
    // Any worker may have made an equal partial.
    made[2].maker = Some(Maker { worker: "another-1".to_owned(), host: "another".to_owned() });
    put_partials(&place.run, &id, &made);
    let found = run(&["audit", folder, "--scene", &id, "--json"]).expect(1);
    let found = found.says(&["made by: unknown makers of partials"]).json();
    let differences = found["scenes"][0]["differences"].as_array().unwrap();
    assert_eq!(differences.len(), 1, "{differences:#?}");
    assert_eq!(differences[0]["file"], format!("partials/{id}/000001.exr"));
    assert_eq!(differences[0]["pixels"], 1);
    // The addition has rounded the f32 value.
    let largest = differences[0]["largest"].as_f64().unwrap();
    assert!((largest - 1.0).abs() < 1e-6, "{largest}");

    std::fs::remove_dir_all(place.run.join("partials")).unwrap();
    run(&["work", folder, "-q"]).expect(0);
    let line = &manifest(&place.run)[0];
    let color = line["front"]["color"].as_str().unwrap();
    let color = place.run.join("inputs/sample").join(color.split_once(':').unwrap().1);
    let mut picture = image::open(&color).unwrap().into_rgb8();
    picture.put_pixel(0, 0, image::Rgb([1, 2, 3]));
    picture.save(&color).unwrap();
    let scene = line["id"].as_str().unwrap();
    run(&["audit", folder, "--scene", scene]).expect(3).says(&["front.color", "not compared"]);
    std::fs::remove_file(&color).unwrap();
    run(&["audit", folder, "--scene", scene]).expect(3).says(&["cannot load"]);
}

/// In a farm, receipts name the workers; the audit reads results and receipts from the store.
#[test]
fn the_audit_names_the_worker() {
    let Some(server) = Nats::start() else { return };
    let place = place();
    place.plan();
    let store = place.folder.path().join("store");
    let store = text(&store);
    let coordinator = start("coordinate", &place, &server, &["--store", store]);
    let named = start("work", &place, &server, &["-j", "1", "--store", store, "--name", "crooked"]);
    all_done(coordinator, [named]);
    damage(&Path::new(store).join("tuples/test-sample-000000/tuple.exr"), "clean_reflection.B", 0);
    let audit = ["audit", text(&place.run), "--store", store, "--share", "1", "--json"];
    let found = run(&audit).expect(1).says(&["made by: crooked"]).json();
    assert_eq!(found["workers"], json!([{"worker": "crooked", "differ": 1, "audited": SCENES}]));
    // The remedy in the message works.
    std::fs::remove_dir_all(Path::new(store).join("tuples/test-sample-000000")).unwrap();
    for path in ["receipts/test-sample-000000.json", "finished.json"] {
        std::fs::remove_file(Path::new(store).join(path)).unwrap();
    }
    let coordinator = start("coordinate", &place, &server, &["--store", store]);
    let honest = worker_at(&place, &server, store);
    all_done(coordinator, [honest]);
    run(&audit).expect(0);

    // A worker that was suspended leaves a wrong partial beside the good tuple of another one.
    let (id, mut made) = partials(&place.run, 0);
    made[1] = with_wrong_pixel(&made[1]);
    for partial in &mut made {
        partial.maker = Some(Maker { worker: "late".to_owned(), host: "another".to_owned() });
    }
    put_partials(Path::new(store), &id, &made);
    let found = run(&audit).expect(1).says(&["made by: late\n"]).json();
    let counts = found["workers"].as_array().unwrap();
    assert!(counts.contains(&json!({"worker": "late", "differ": 1, "audited": 1})), "{counts:?}");
    assert_eq!(counts.iter().filter(|worker| worker["differ"] != 0).count(), 1, "{counts:?}");
    let scenes = found["scenes"].as_array().unwrap();
    let differs = scenes.iter().find(|scene| scene["verdict"] == "differs").unwrap();
    assert_eq!(differs["differences"][0]["made_by"], json!(["late"]));
}

/// Returns a partial with a valid digest and a wrong pixel.
fn with_wrong_pixel(partial: &Partial) -> Partial {
    let (header, mut pixels) = (partial.header.clone(), partial.pixels.clone());
    pixels[7].mean[0][0] += 1.0;
    Partial::new(header, pixels, LabelImages::new())
}

fn worker_at(place: &Place, server: &Nats, store: &str) -> crate::support::program::Running {
    start("work", place, server, &["-j", "1", "--store", store])
}
