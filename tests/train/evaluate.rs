//! Tests trained networks on a run's scenes, on public pairs and on photographs.

use crate::support::outputs::files;
use crate::support::program::{Ended, command, run, send, text, wait_until};
use crate::support::scenes::{Place, place};
use image::{ExtendedColorType, ImageEncoder, Rgb, RgbImage};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Makes a finished run with one test scene and three train scenes of 96 x 64 px.
fn merged() -> Place {
    let place = place();
    run(&place.arguments("run", &["-q"])).expect(0);
    place
}

/// Trains both stages for four steps each.
fn train(place: &Place) {
    let more = "--width 4 --crop 32 --discriminator-width 2 -q";
    for stage in ["backtrack", "separation"] {
        let mut arguments = vec!["train", text(&place.run), "--stage", stage, "--steps", "4"];
        if stage == "backtrack" {
            arguments.extend(more.split(' '));
        }
        run(&arguments).expect(0);
    }
}

/// Converts a path to text.
fn shown(path: &Path) -> String {
    path.display().to_string()
}

fn methods(json: &Value) -> Vec<&str> {
    let rows = json["rows"].as_array().unwrap();
    rows.iter().map(|r| r["method"].as_str().unwrap()).collect()
}

/// Returns the PSNR over all samples of two pictures, dB.
fn psnr_db(a: &Path, b: &Path) -> f64 {
    let [a, b] = [a, b].map(|path| compose::read_picture(path).unwrap());
    assert_eq!(a.dimensions(), b.dimensions());
    let squares = a.iter().zip(b.iter()).map(|(p, q)| (f64::from(*p) - f64::from(*q)).powi(2));
    10.0 * (255.0 * 255.0 / (squares.sum::<f64>() / a.len() as f64)).log10()
}

/// Returns the folders of a run's tuples with names that begin with `split`.
pub(crate) fn tuples(run: &Path, split: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(run.join("tuples")).unwrap();
    let mut tuples: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
    tuples.retain(|path| {
        let name = path.file_name().unwrap().to_str().unwrap();
        name.starts_with(split)
    });
    tuples.sort();
    tuples
}

#[test]
fn a_run_is_scored() {
    let place = merged();
    let run_folder = text(&place.run);
    // Before any training, the table has only the inputs.
    let ended = run(&["evaluate", run_folder, "--json"]).expect(0).says(&["the run has no SP-net"]);
    assert_eq!(methods(&ended.json()).len(), 5);

    train(&place);
    let planned = run(&["evaluate", run_folder, "-n", "--json"]).expect(0).json();
    assert_eq!(planned["images"], 1);
    let ended = run(&["evaluate", run_folder, "--json"]).expect(0);
    let json = ended.json();
    assert_eq!(json["schema"], "glasshouse.evaluate/2");
    let found = methods(&json);
    assert_eq!(found[0], "input");
    assert!(found[1].starts_with("input x "), "{found:?}");
    assert!(found[2].starts_with("veil rule "), "{found:?}");
    let oracles = ["best factor of the group (oracle)", "own factor (oracle)"];
    assert_eq!(found[3..5], oracles);
    assert_eq!(found[5], "separation step 4 (features none)");
    let oracles = json["rows"].as_array().unwrap().iter().map(|row| row["oracle"] == true);
    assert_eq!(oracles.collect::<Vec<_>>(), [false, false, false, true, true, false]);
    let fitted = &json["baselines"]["fitted"];
    assert_eq!((&fitted["images"], &fitted["fitted_to"]), (&3.into(), &run_folder.into()));
    assert_eq!(fitted["factor"], json["baselines"]["factor"]);
    assert!(fitted["veil"]["g"].is_number() && fitted["veil"]["k"].is_number());
    assert_eq!(json["left_out"], serde_json::json!([]));

    let tuple = &tuples(&place.run, "test")[0];
    let expected_db = psnr_db(&tuple.join("input.png"), &tuple.join("transmission.png"));
    let found_db = json["rows"][0]["psnr_colour_db"].as_f64().unwrap();
    assert!((found_db - expected_db).abs() < 1e-9, "{found_db} {expected_db}");
    // Rendered pairs need no alignment.
    assert!(json["rows"][0]["aligned"].is_null());

    let files: Vec<&str> =
        json["files"].as_array().unwrap().iter().map(|f| f.as_str().unwrap()).collect();
    assert_eq!(files.len(), 4);
    let folder = place.run.join("train/evaluation");
    // The pictures of the test scene are input, those of both rules, output and truth.
    let pictures = image::open(folder.join("evaluation.png")).unwrap();
    let first = image::open(tuples(&place.run, "test")[0].join("input.png")).unwrap();
    assert_eq!(pictures.width(), 5 * (first.width() + 4));
    assert_eq!(pictures.height(), first.height() + 4);
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let markdown = read("evaluation.md");
    for part in ["| input ", "(features none) |", "no resizing; scored as 8-bit", "1 test scene of"]
    {
        assert!(markdown.contains(part), "no {part:?} in {markdown}");
    }
    assert_eq!(read("evaluation.csv").lines().count(), 1 + 6);
    let written: Value = serde_json::from_str(&read("evaluation.json")).unwrap();
    assert_eq!(written["rows"], json["rows"]);

    // Without --json, stdout has the table. Rows and splits can be chosen, and rows can be named.
    let out = place.folder.path().join("scores");
    let step = format!("ours={}", shown(&place.run.join("train/separation/step-0000004")));
    let more = ["--split", "all", "--out", text(&out), "--protocol", "paper", "-q"];
    let checkpoints = ["--checkpoint", run_folder, "--checkpoint", &step];
    let ended = run(&[&["evaluate", run_folder][..], &more, &checkpoints].concat()).expect(0);
    assert!(ended.stdout.contains("| ours (features none) "), "{ended:?}");
    assert!(ended.stdout.contains("| 4 |") || ended.stdout.contains("|      4 |"), "{ended:?}");
    assert!(!ended.stdout.contains("channels"), "{ended:?}");
    let csv = std::fs::read_to_string(out.join("evaluation.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + 7 * 4);
    // Scores do not depend on the number of threads.
    let on = |threads: &str| {
        let json = run(&["evaluate", run_folder, "--json", "-j", threads]).expect(0).json();
        json["rows"].clone()
    };
    assert_eq!(on("1"), on("2"));
    assert_eq!(on("1"), json["rows"]);

    // Two rows must not have the same name.
    let twice = ["--checkpoint", run_folder, "--checkpoint", run_folder];
    run(&[&["evaluate", run_folder][..], &twice].concat())
        .expect(2)
        .says(&["would be called", "NAME="]);
}

#[test]
fn missing_and_damaged_tuples_are_listed() {
    let place = merged();
    let run_folder = text(&place.run);
    let [test, train] = ["test", "train"].map(|split| tuples(&place.run, split));
    // One tuple is not merged: it is left out, and the fit of the baselines does without it, too.
    std::fs::remove_file(train[2].join("tuple.json")).unwrap();
    let ended = run(&["evaluate", run_folder, "--split", "all", "--json"])
        .expect(3)
        .says(&["has no tuple yet"]);
    let json = ended.json();
    assert_eq!(json["images"], 3);
    assert_eq!(json["baselines"]["fitted"]["images"], 2);
    assert_eq!(json["left_out"].as_array().unwrap().len(), 1);
    // A damaged tuple gives no score.
    let whole = std::fs::read(train[1].join("input.png")).unwrap();
    std::fs::write(train[1].join("input.png"), b"\x89PNG\r\n\x1a\nnothing").unwrap();
    let id = text(train[1].file_name().unwrap().as_ref());
    for split in ["all", "test"] {
        let ended = run(&["evaluate", run_folder, "--split", split, "--json"]).expect(5);
        assert!(ended.json()["left_out"][0]["reason"].as_str().unwrap().contains("input.png"));
        ended.says(&[&format!("1 tuple of {run_folder} damaged: {id};"), "retry"]);
    }
    std::fs::write(train[1].join("input.png"), whole).unwrap();
    std::fs::remove_dir_all(&test[0]).unwrap();
    let ended = run(&["evaluate", run_folder, "--json"]).expect(4);
    assert_eq!(ended.json()["schema"], "glasshouse.error/1");
    ended.says(&["nothing to score", "glasshouse work"]);
}

/// Makes a smooth picture with edges.
fn picture(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let edge = if (x / 23 + y / 17) % 2 == 0 { 60 } else { 0 };
        Rgb([x * 2, y * 3, x + y].map(|v| (v % 190 + edge) as u8))
    })
}

/// Encodes a JPEG with an Exif orientation that rotates the picture by 90 degrees clockwise.
fn turned_jpeg(picture: &RgbImage) -> Vec<u8> {
    let (width, height) = picture.dimensions();
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
        .write_image(picture, width, height, ExtendedColorType::Rgb8)
        .unwrap();
    // A little-endian TIFF directory with one entry: tag 0x112, one 16-bit number, 6.
    let mut segment = b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0".to_vec();
    segment.extend(b"\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0");
    bytes.splice(2..2, segment);
    bytes
}

#[test]
fn photographs_are_separated() {
    let place = merged();
    train(&place);
    let folder = place.folder.path();
    let file = |name: &str| folder.join(name);
    picture(420, 340).save(file("large.png")).unwrap();
    picture(37, 21).save(file("odd.png")).unwrap();
    std::fs::write(file("turned.jpg"), turned_jpeg(&picture(48, 32))).unwrap();
    picture(300, 15).save(file("low.png")).unwrap();
    std::fs::write(file("broken.png"), b"no picture").unwrap();
    let images = ["large.png", "odd.png", "turned.jpg", "low.png", "broken.png"].map(file);

    let separate = |out: &str, more: &[&str]| {
        let out = file(out);
        let mut arguments = vec!["separate", "--network", text(&place.run), "--out", text(&out)];
        arguments.extend(images.iter().map(|path| text(path)));
        arguments.extend(["--work-px", "0", "--tile-px", "336", "--json"]);
        arguments.extend(more);
        run(&arguments)
    };
    let dry = separate("none", &["-n"]).expect(3).json();
    assert_eq!(dry["images"].as_array().unwrap().len(), 3);
    let (out, image) = (file("none"), text(&images[0]));
    let small = ["separate", image, "--network", text(&place.run), "--out", text(&out), "-n"];
    let small = run(&[&small[..], &["--tile-px", "319"]].concat());
    small.expect(2).says(&["--tile-px 319 is too small", "give 320 or more"]);
    let small = ["evaluate", text(&place.run), "-n", "--tile-px", "319"];
    run(&small).expect(2).says(&["give 320 or more"]);
    assert!(!file("none").exists());
    let one = separate("one", &["-j", "1"]).expect(3);
    let json = one.json();
    assert_eq!(json["schema"], "glasshouse.separate/1");
    assert_eq!(json["step"], 4);
    assert!(json["checkpoint"].as_str().unwrap().ends_with("step-0000004"));
    assert_eq!(json["failed"].as_array().unwrap().len(), 2);
    one.says(&["low.png", "16 px", "broken.png"]);
    separate("two", &["-j", "2", "-q"]).expect(3);
    for (stem, size) in [("large", (420, 340)), ("odd", (37, 21)), ("turned", (32, 48))] {
        for layer in ["transmission", "glass_reflection", "clean_reflection"] {
            let name = format!("{stem}.{layer}.png");
            let bytes = std::fs::read(file("one").join(&name)).unwrap();
            let made = image::load_from_memory(&bytes).unwrap();
            assert_eq!((made.width(), made.height()), size);
            assert_eq!(bytes, std::fs::read(file("two").join(&name)).unwrap());
        }
    }
    assert_eq!(files(&file("one")).len(), 9);

    // A separation with larger tiles makes nearly the same picture.
    let whole = file("whole");
    run(&[
        "separate",
        "--network",
        text(&place.run),
        text(&images[0]),
        "--out",
        text(&whole),
        "-q",
    ])
    .expect(0);
    let near_db =
        psnr_db(&whole.join("large.transmission.png"), &file("one/large.transmission.png"));
    assert!(near_db > 30.0, "{near_db}");

    // A Display P3 picture and its sRGB twin have nearly the same result, unlike the same codes without a profile.
    let colors = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/icc");
    image::open(colors.join("p3-jpeg.jpg")).unwrap().to_rgb8().save(file("untagged.png")).unwrap();
    let (p3, twin) = (colors.join("p3-jpeg.jpg"), colors.join("p3-jpeg.srgb.png"));
    let out = file("colors");
    let pictures = [text(&p3), text(&twin), text(&file("untagged.png"))].map(str::to_owned);
    let fixed =
        ["separate", "--network", text(&place.run), "--out", text(&out), "-q"].map(str::to_owned);
    run(&[&fixed[..], &pictures].concat()).expect(0);
    let of = |stem: &str| out.join(format!("{stem}.transmission.png"));
    // Colours outside of sRGB keep what the twin lacks, so they are not compared.
    let twin = compose::read_picture(&twin).unwrap();
    let is_inside =
        |(x, y): (u32, u32)| twin.get_pixel(x, y).0.iter().all(|code| (1..255).contains(code));
    let inside_db = |a: &Path, b: &Path| {
        let [a, b] = [a, b].map(|path| compose::read_picture(path).unwrap());
        let pixels = (0..a.height()).flat_map(|y| (0..a.width()).map(move |x| (x, y)));
        let kept: Vec<(u32, u32)> = pixels.filter(|at| is_inside(*at)).collect();
        assert!(kept.len() > 100, "{}", kept.len());
        let square = |&(x, y): &(u32, u32)| {
            let (p, q) = (a.get_pixel(x, y), b.get_pixel(x, y));
            (0..3).map(|c| (f64::from(p[c]) - f64::from(q[c])).powi(2)).sum::<f64>() / 3.0
        };
        10.0 * (255.0 * 255.0 * kept.len() as f64 / kept.iter().map(square).sum::<f64>()).log10()
    };
    let (same, other) = (
        inside_db(&of("p3-jpeg"), &of("p3-jpeg.srgb")),
        inside_db(&of("p3-jpeg"), &of("untagged")),
    );
    assert!(same > other + 6.0, "{same} {other}");

    // `separate` also accepts the folder of a stage or of a checkpoint.
    let stage = place.run.join("train/separation");
    for checkpoint in [&stage, &stage.join("step-0000004")] {
        let out = file("again");
        run(&[
            "separate",
            "--network",
            text(checkpoint),
            text(&images[1]),
            "--out",
            text(&out),
            "-q",
        ])
        .expect(0);
        let again = std::fs::read(out.join("odd.transmission.png")).unwrap();
        assert_eq!(again, std::fs::read(file("one/odd.transmission.png")).unwrap());
    }
}

#[test]
fn impossible_separations_are_refused() {
    let place = merged();
    train(&place);
    let folder = place.folder.path();
    let out = folder.join("out");
    let image = folder.join("a.png");
    picture(40, 30).save(&image).unwrap();
    std::fs::create_dir(folder.join("more")).unwrap();
    let namesake = folder.join("more/a.jpg");
    picture(40, 30).save(&namesake).unwrap();
    let run_folder = text(&place.run);
    let separate = |checkpoint: &str, images: &[&str], out: &Path| {
        run(&[&["separate", "--network", checkpoint, "--out", text(out)][..], images].concat())
    };
    separate(run_folder, &[text(&image), text(&namesake)], &out)
        .expect(2)
        .says(&["both become", "a.transmission.png"]);
    // The output would overwrite an image.
    let made = folder.join("a.transmission.png");
    picture(40, 30).save(&made).unwrap();
    separate(run_folder, &[text(&image), text(&made)], folder)
        .expect(2)
        .says(&["would be overwritten"]);
    // The folder has no checkpoint, or a checkpoint without an SP-net.
    separate(text(folder), &[text(&image)], &out).expect(4).says(&["holds no checkpoint"]);
    let backtrack = shown(&place.run.join("train/backtrack"));
    separate(&backtrack, &[text(&image)], &out).expect(4).says(&["BT-net alone"]);
    assert!(!out.exists());

    // A damaged checkpoint is refused if named; for the run's folder, an older checkpoint of the stage replaces it.
    let stage = place.run.join("train/separation");
    run(&["train", run_folder, "--stage", "separation", "--steps", "6", "-q"]).expect(0);
    let newest = stage.join("step-0000006");
    std::fs::write(newest.join("model.safetensors"), b"nothing").unwrap();
    separate(text(&newest), &[text(&image)], &out).expect(4).says(&["does not match its digest"]);
    let ended = separate(run_folder, &[text(&image)], &out).expect(0);
    assert!(ended.stdout.contains("step 4"), "{ended:?}");
}

#[test]
fn published_pairs_are_scored() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/reflection");
    if !root.join("index.csv").exists() {
        eprintln!("skipped: no {}", root.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["evaluate", text(&root), "--out", text(folder.path()), "--json"];
    let json = run(&arguments).expect(0).json();
    assert_eq!((&json["images"], &json["rows"][0]["count"]), (&37.into(), &37.into()));
    // All pictures and six groups, by the input, two rules, two oracles and the shipped weights.
    assert_eq!(methods(&json).len(), 6 * 6);
    assert_eq!(json["checkpoints"][0]["method"], "shipped");
    assert_eq!(json["baselines"]["fitted"]["images"], 64);
    let index = std::fs::read_to_string(root.join("index.csv")).unwrap();
    let beside = index.lines().filter(|line| line.split(',').nth(8) == Some("no"));
    let beside = beside.count();
    assert!(beside > 0);
    assert_eq!(json["rows"][0]["aligned"]["count"], 37 - beside);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let csv = read("evaluation.csv");
    // The best factors of all pictures and of their groups have rows of their own.
    assert_eq!(csv.lines().count(), 1 + 7 * 37);
    assert_eq!(csv.lines().filter(|line| line.contains(",no,")).count(), 7 * beside);
    assert!(read("evaluation.md").contains("Means without them:"));
    // `evaluation.md` also names folders of pictures without ground truth.
    assert!(read("evaluation.md").contains("ceilnet_real_inputs_only"));

    let place = merged();
    train(&place);
    let images = std::fs::read_dir(root.join("ceilnet_real_inputs_only")).unwrap();
    let mut images: Vec<PathBuf> = images.map(|e| e.unwrap().path()).collect();
    images.sort();
    images.truncate(2);
    let mut arguments =
        vec!["separate", "--network", text(&place.run), "--out", text(folder.path()), "-q"];
    arguments.extend(images.iter().map(|path| text(path)));
    run(&arguments).expect(0);
    for image in &images {
        let stem = image.file_stem().unwrap().to_str().unwrap();
        let made = image::open(folder.path().join(format!("{stem}.transmission.png"))).unwrap();
        let was = image::open(image).unwrap();
        assert_eq!((made.width(), made.height()), (was.width(), was.height()));
    }
    // The baselines can come from a run's train scenes; `--fit-gain` is the former name of the option.
    let pairs = root.join("kim2020");
    let more = ["--fit-gain", text(&place.run), "--checkpoint", text(&place.run), "--json"];
    let json =
        run(&[&["evaluate", text(&pairs), "--limit", "2"][..], &more].concat()).expect(0).json();
    assert_eq!(methods(&json).len(), 6);
    assert_eq!(json["images"], 2);
    assert_eq!(json["files"], serde_json::json!([]));
}

#[test]
fn ctrl_c_stops_between_pictures() {
    let place = merged();
    train(&place);
    let folder = place.folder.path();
    let images: Vec<PathBuf> = (0..200).map(|k| folder.join(format!("{k}.png"))).collect();
    for image in &images {
        picture(260, 200).save(image).unwrap();
    }
    let out = folder.join("out");
    let mut arguments =
        vec!["separate", "--network", text(&place.run), "--out", text(&out), "--json"];
    arguments.extend(images.iter().map(|path| text(path)));
    let mut child = command(&arguments).spawn().unwrap();
    let begun = wait_until(&mut child, || out.join("0.transmission.png").exists());
    assert!(begun);
    send(&child, "INT");
    let ended: Ended = child.wait_with_output().unwrap().into();
    let json = ended.expect(130).json();
    let done = json["images"].as_array().unwrap().len();
    assert!((1..200).contains(&done), "{done}");
    assert_eq!(files(&out).len(), 3 * done);
}

#[test]
fn a_checkpoint_brings_the_baselines_of_its_training() {
    let place = merged();
    train(&place);
    let pairs = place.folder.path().join("pairs");
    for (layer, file) in [("blended", "input.png"), ("transmission_layer", "transmission.png")] {
        std::fs::create_dir_all(pairs.join(layer)).unwrap();
        let from = tuples(&place.run, "test")[0].join(file);
        std::fs::copy(from, pairs.join(layer).join("1.png")).unwrap();
    }
    let of = |more: &[&str]| {
        let arguments = ["evaluate", text(&pairs), "--checkpoint", text(&place.run), "--json"];
        run(&[&arguments[..], more].concat()).expect(0).json()
    };
    let json = of(&[]);
    let fitted = &json["baselines"]["fitted"];
    assert_eq!(fitted["fitted_to"], "the examples of the training");
    assert_eq!((methods(&json).len(), fitted["images"].as_u64()), (6, Some(64)));
    // Other examples and given numbers replace them.
    let json = of(&["--fit-to", text(&place.run)]);
    assert_eq!(json["baselines"]["fitted"]["fitted_to"], text(&place.run));
    let json = of(&["--factor", "0.5"]);
    assert_eq!(json["baselines"]["factor"], 0.5);
    assert_eq!(json["baselines"]["fitted"]["images"], 64);
}
