//! Tests training by the program: kills, changes, damage, all kinds of examples, and equal bits where the program
//! promises them.

use crate::support::outputs::{copy_folder, files};
use crate::support::program::{command, random, run, text, wait_until};
use serde_json::Value;
use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "lesson"
seed = 11
[film]
width = 56
height = 48
spp = 4
[sources.sample]
layout = "sample"
count = 12
width = 128
height = 96
[[split]]
name = "train"
pairs = { sample = 4 }
[[split]]
name = "validation"
pairs = { sample = 1 }
[[split]]
name = "test"
pairs = { sample = 2 }
"#;

/// Options for small networks and crops.
const SMALL: [&str; 6] = ["--width", "4", "--crop", "40", "--discriminator-width", "2"];

/// Returns a folder that contains a finished run, rendered once.
fn made() -> &'static Path {
    static MADE: OnceLock<TempDir> = OnceLock::new();
    let folder = MADE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let recipe = folder.path().join("lesson.toml");
        std::fs::write(&recipe, RECIPE).unwrap();
        let out = folder.path().join("run");
        run(&["run", text(&recipe), "--out", text(&out)]).expect(0);
        folder
    });
    folder.path()
}

/// A copy of the finished run for one test.
pub(crate) struct Place {
    pub(crate) folder: TempDir,
    pub(crate) run: PathBuf,
}

pub(crate) fn place() -> Place {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    copy_folder(&made().join("run"), &run);
    Place { folder, run }
}

impl Place {
    pub(crate) fn arguments<'a>(
        &'a self,
        stage: &'a str,
        steps: &'a str,
        more: &[&'a str],
    ) -> Vec<&'a str> {
        let mut all = vec!["train", text(&self.run), "--stage", stage, "--steps", steps];
        all.extend(more);
        all
    }

    pub(crate) fn train(&self, stage: &str, steps: &str, more: &[&str]) -> Value {
        let mut arguments = self.arguments(stage, steps, more);
        arguments.push("--json");
        run(&arguments).expect(0).json()
    }

    /// Reads the files of a checkpoint.
    pub(crate) fn checkpoint(&self, stage: &str, step: u64) -> BTreeMap<String, Vec<u8>> {
        let folder = self.folder_of(stage, step);
        let names = ["model.safetensors", "optimizer.safetensors", "state.json"];
        let read = |name: &str| (name.to_owned(), std::fs::read(folder.join(name)).unwrap());
        names.into_iter().map(read).collect()
    }

    pub(crate) fn folder_of(&self, stage: &str, step: u64) -> PathBuf {
        self.run.join("train").join(stage).join(format!("step-{step:07}"))
    }
}

#[test]
fn tuples_that_changed_since_end_training_and_scores() {
    let place = place();
    let run_folder = text(&place.run);
    let more = small(&["--network", "unet"]);
    place.train("separation", "2", &more);
    run(&["evaluate", run_folder, "-q"]).expect(0);
    let tuples: Vec<PathBuf> = crate::evaluate::tuples(&place.run, "train");
    let names: Vec<&str> =
        tuples.iter().map(|tuple| text(tuple.file_name().unwrap().as_ref())).collect();
    // Other tuples with right digests, as after a repair.
    let records: Vec<Vec<u8>> =
        tuples.iter().map(|tuple| std::fs::read(tuple.join("tuple.json")).unwrap()).collect();
    for tuple in &tuples {
        let path = tuple.join("tuple.json");
        let record = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, record.replacen("\"seconds\"", "\"Seconds\"", 1) + "\n").unwrap();
    }
    let three = format!("{}, {}, {} and 1 more", names[0], names[1], names[2]);
    let said = run(&place.arguments("separation", "4", &more)).expect(5);
    said.says(&["4 of the tuples", &three, "--name"]);
    run(&["evaluate", run_folder]).expect(5).says(&["4 of the tuples", &three]);
    std::fs::remove_dir_all(&tuples[1]).unwrap();
    for (tuple, record) in tuples.iter().zip(&records).filter(|(tuple, _)| tuple.exists()) {
        std::fs::write(tuple.join("tuple.json"), record).unwrap();
    }
    run(&place.arguments("separation", "4", &more))
        .expect(5)
        .says(&["1 of the tuples", &format!("missing: {};", names[1])]);
    // A new training takes what is there.
    let mut new = small(&["--network", "unet", "--name", "other"]);
    new.push("-q");
    run(&place.arguments("separation", "2", &new)).expect(0);
    // A tuple that does not match its digests ends training, too.
    let exr = tuples[0].join("tuple.exr");
    std::fs::write(&exr, b"nothing").unwrap();
    run(&place.arguments("separation", "8", &new)).expect(5).says(&[names[0], "digest"]);
}

pub(crate) fn small<'a>(more: &[&'a str]) -> Vec<&'a str> {
    SMALL.into_iter().chain(more.iter().copied()).collect()
}

/// Returns the checkpoints of an uninterrupted training of both stages on one thread.
fn reference() -> &'static [BTreeMap<String, Vec<u8>>; 2] {
    static REFERENCE: OnceLock<[BTreeMap<String, Vec<u8>>; 2]> = OnceLock::new();
    REFERENCE.get_or_init(|| {
        let place = place();
        let first = place.train("backtrack", "30", &small(&["-j", "1"]));
        assert_eq!((first["step"].as_u64(), first["steps_taken"].as_u64()), (Some(30), Some(30)));
        place.train("separation", "40", &["-j", "1"]);
        [place.checkpoint("backtrack", 30), place.checkpoint("separation", 40)]
    })
}

#[test]
fn a_killed_training_resumes_with_the_same_bits() {
    let place = place();
    let mut kills = 0;
    for (stage, steps, all) in [("backtrack", "30", 30), ("separation", "40", 40)] {
        let settings = if stage == "backtrack" { small(&[]) } else { Vec::new() };
        for threads in ["1", "2"] {
            let more = ["-j", threads, "--checkpoint-every", "3", "--keep", "2"];
            let more: Vec<&str> = settings.iter().chain(&more).copied().collect();
            let at = random(all as usize - 5) as u64;
            let csv = place.run.join("train").join(stage).join("metrics.csv");
            let lines = || std::fs::read_to_string(&csv).unwrap_or_default().lines().count();
            let mut child = command(&place.arguments(stage, steps, &more)).spawn().unwrap();
            wait_until(&mut child, || lines() as u64 > at + 1);
            child.kill().unwrap();
            let ended = child.wait_with_output().unwrap();
            eprintln!("{stage}, -j {threads}: killed at line {} of metrics.csv", lines());
            kills += u32::from(ended.status.signal() == Some(9));
        }
        let ended = place.train(stage, steps, &["-j", "2"]);
        assert_eq!(ended["step"].as_u64(), Some(all));
    }
    assert!(kills > 0, "training always ended before the test killed it");
    let [backtrack, separation] = reference();
    assert!(place.checkpoint("backtrack", 30) == *backtrack);
    assert!(place.checkpoint("separation", 40) == *separation);
    // Each step has one line, even if it was repeated.
    let csv = std::fs::read_to_string(place.run.join("train/separation/metrics.csv")).unwrap();
    let steps: Vec<u64> =
        csv.lines().skip(1).map(|l| l.split(',').next().unwrap().parse().unwrap()).collect();
    assert_eq!(steps, (1..=40).collect::<Vec<_>>());
    let left = files(&place.run.join("train"));
    assert!(!left.iter().any(|p| text(p).contains(".tmp-")), "{left:?}");
}

#[test]
fn a_resumed_training_has_the_same_bits_and_repeats_no_step() {
    let place = place();
    place.train("backtrack", "15", &small(&["-j", "2", "--seed", "2020"]));
    let ended = place.train("backtrack", "30", &["-j", "1"]);
    assert_eq!((ended["from_step"].as_u64(), ended["steps_taken"].as_u64()), (Some(15), Some(15)));
    assert!(place.checkpoint("backtrack", 30) == reference()[0]);
    let again = place.train("backtrack", "30", &[]);
    assert_eq!(again["steps_taken"].as_u64(), Some(0));
    // Another seed yields other weights.
    let other = self::place();
    other.train("backtrack", "30", &small(&["--seed", "1"]));
    assert!(other.checkpoint("backtrack", 30) != reference()[0]);
}

/// Makes the state that kills leave: temporary files, and a checkpoint that is newer than `best.json`.
#[test]
fn leftovers_of_a_killed_training_are_removed() {
    let place = place();
    place.train("backtrack", "2", &small(&["--checkpoint-every", "2"]));
    let stage = place.run.join("train/backtrack");
    let best = std::fs::read(stage.join("best.json")).unwrap();
    std::fs::remove_file(stage.join("best.json")).unwrap();
    std::fs::create_dir(stage.join(".tmp-folder")).unwrap();
    let left = [".tmp-file", ".tmp-folder/model.safetensors", "pictures/.tmp-file"];
    for name in left {
        std::fs::write(stage.join(name), b"half").unwrap();
    }
    // All steps are taken, and the same command still removes the leftovers.
    place.train("backtrack", "2", &small(&[]));
    assert_eq!(left.iter().find(|name| stage.join(name).exists()), None);
    assert!(!stage.join(".tmp-folder").exists());
    assert_eq!(std::fs::read(stage.join("best.json")).unwrap(), best);
    let evaluation = place.run.join("train/evaluation");
    std::fs::create_dir_all(&evaluation).unwrap();
    std::fs::write(evaluation.join(".tmp-file"), b"half").unwrap();
    run(&["evaluate", text(&place.run)]).expect(0);
    assert!(!evaluation.join(".tmp-file").exists());
}

#[test]
fn an_interrupted_training_keeps_every_step() {
    let place = place();
    let csv = place.run.join("train/backtrack/metrics.csv");
    let lines = || std::fs::read_to_string(&csv).unwrap_or_default().lines().count();
    let more = small(&["--checkpoint-every", "100000"]);
    let mut child = command(&place.arguments("backtrack", "100000", &more)).spawn().unwrap();
    wait_until(&mut child, || lines() > 5);
    let id = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(id, rustix::process::Signal::INT).unwrap();
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(130), "{ended:?}");
    let taken = lines() as u64 - 1;
    assert!(place.folder_of("backtrack", taken).join("state.json").is_file(), "{taken}");
}

#[test]
fn other_settings_are_refused_with_the_differences() {
    let place = place();
    place.train("backtrack", "2", &small(&[]));
    run(&place.arguments("backtrack", "4", &["--width", "8", "--pixel-weight", "2"]))
        .expect(5)
        .says(&["width: 4 -> 8", "pixel_weight: 1.0 -> 2.0", "step-0000002"]);
    // Rates may change, and the checkpoint records it.
    let ended = place.train("backtrack", "4", &["--learning-rate", "0.001"]);
    assert_eq!(ended["from_step"].as_u64(), Some(2));
    let state = place.checkpoint("backtrack", 4).remove("state.json").unwrap();
    let state: Value = serde_json::from_slice(&state).unwrap();
    let history = r#"[{"after_step":2,"changes":["learning_rate: 0.0001 -> 0.001"]}]"#;
    assert_eq!(state["history"].to_string(), history);
    // The next stage keeps the shape of the networks, but may change the settings of learning.
    run(&place.arguments("separation", "4", &["--width", "8"])).expect(5).says(&["width: 4 -> 8"]);
    let ended = place.train("separation", "2", &["--learning-rate", "0.001", "--no-a-priori"]);
    assert_eq!(ended["settings"]["a_priori"], false);
    run(&place.arguments("separation", "4", &["--width", "1"])).expect(2).says(&["from 3 to 1024"]);
    let other = self::place();
    run(&other.arguments("backtrack", "4", &["--real-share", "0.5"])).expect(2).says(&["--real"]);
}

#[test]
fn a_changed_recipe_is_refused_with_the_differences() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = folder.path().join("lesson.toml");
    let out = folder.path().join("run");
    let write = |steps: u32, rest: &str| {
        let train = format!(
            "[train]\nbacktrack_steps = 2\nseparation_steps = {steps}\n[train.settings]\nwidth = 4\n\
             discriminator_width = 2\n{rest}\n"
        );
        std::fs::write(&recipe, format!("{RECIPE}{train}")).unwrap();
    };
    let arguments = ["run", text(&recipe), "--out", text(&out), "--json"];
    // `run` reports impossible settings before it traces a scene.
    write(2, "crop_px = 64");
    run(&arguments).expect(4).says(&["train.settings.crop_px is 64", "film.width can be 56"]);
    write(2, "crop_px = 40\nreal_share = 0.5");
    run(&arguments).expect(4).says(&["real_share", "--real DIR"]);
    assert!(!out.exists());
    write(2, "crop_px = 40");
    let first = run(&arguments).expect(0).json();
    assert_eq!(first["train"]["separation"]["step"].as_u64(), Some(2));
    assert_eq!(first["train"]["evaluation"]["rows"][0]["method"], "input");
    // A finished training is not repeated, more steps continue it, and other settings are refused.
    let again = run(&arguments).expect(0).json();
    assert_eq!(again["train"]["separation"]["steps_taken"].as_u64(), Some(0));
    assert_eq!(again["train"]["evaluation"]["rows"], first["train"]["evaluation"]["rows"]);
    write(3, "crop_px = 40");
    let more = run(&arguments).expect(0).json();
    assert_eq!(more["train"]["separation"]["steps_taken"].as_u64(), Some(1));
    write(3, "crop_px = 40\npixel_weight = 2");
    run(&arguments).expect(5).says(&["pixel_weight: 1.0 -> 2.0", "recipe's [train]"]);
    write(3, "crop_px = 40\nnetwork = \"unet\"\nstart = \"residual\"\na_priori = false");
    run(&arguments).expect(4).says(&["train.backtrack_steps is 2", "set it to 0"]);
}

#[test]
fn the_a_priori_loss_needs_a_bt_net() {
    let place = place();
    run(&place.arguments("separation", "2", &small(&[])))
        .expect(4)
        .says(&["--stage backtrack", "--no-a-priori"]);
    place.train("separation", "2", &small(&["--no-a-priori"]));
}

#[test]
fn an_older_checkpoint_replaces_a_damaged_one() {
    let place = place();
    place.train("backtrack", "30", &small(&["--checkpoint-every", "10"]));
    for (name, damage) in
        [("model.safetensors", 0), ("optimizer.safetensors", 1), ("state.json", 2)]
    {
        let path = place.folder_of("backtrack", 30).join(name);
        let mut bytes = std::fs::read(&path).unwrap();
        match damage {
            0 => {
                let middle = bytes.len() / 2;
                bytes[middle] ^= 1;
            }
            1 => bytes.truncate(bytes.len() / 2),
            _ => bytes = b"{}".to_vec(),
        }
        std::fs::write(&path, bytes).unwrap();
        let ended = run(&place.arguments("backtrack", "30", &["--json"])).expect(0).says(&[
            "step-0000030",
            name,
            "step 20 is used instead",
        ]);
        assert_eq!(ended.json()["from_step"].as_u64(), Some(20));
        assert!(place.checkpoint("backtrack", 30) == reference()[0], "{name}");
    }
}

#[test]
fn errors_name_a_damaged_tuple() {
    let place = place();
    place.train("backtrack", "1", &small(&[]));
    let tuples = files(&place.run.join("tuples"));
    for exr in tuples.iter().filter(|p| p.ends_with("tuple.exr") && text(p).contains("train")) {
        let path = place.run.join("tuples").join(exr);
        let mut bytes = std::fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&path, bytes).unwrap();
    }
    run(&place.arguments("backtrack", "9", &[])).expect(5).says(&["tuple.exr", "audit"]);
    // Training can also read the 8-bit files.
    let other = self::place();
    other.train("backtrack", "2", &small(&["--pixels", "png"]));
}

#[test]
fn training_follows_a_running_farm() {
    let done = place();
    done.train("backtrack", "12", &small(&["--follow"]));
    let place = place();
    std::fs::remove_dir_all(place.run.join("tuples")).unwrap();
    let child = command(&place.arguments("backtrack", "12", &small(&["--follow", "--json"])))
        .spawn()
        .unwrap();
    run(&["work", text(&place.run)]).expect(0);
    let ended = child.wait_with_output().unwrap();
    assert!(ended.status.success(), "{ended:?}");
    let model = |place: &Place| place.checkpoint("backtrack", 12).remove("model.safetensors");
    assert!(model(&done) == model(&place));
}

#[test]
fn real_pairs_and_mixtures_of_photographs_are_examples() {
    let place = place();
    for kind in ["zhang", "ceilnet"] {
        let place = self::place();
        let ended = place.train("backtrack", "3", &small(&["--examples", kind]));
        assert_eq!(ended["settings"]["examples"], kind);
    }
    let real = place.folder.path().join("real");
    let scenes: Vec<PathBuf> = std::fs::read_dir(place.run.join("tuples"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    for (layer, folder) in [("input", "blended"), ("transmission", "transmission_layer")] {
        std::fs::create_dir_all(real.join(folder)).unwrap();
        for (n, scene) in scenes.iter().enumerate() {
            let to = real.join(folder).join(format!("{n}.png"));
            std::fs::copy(scene.join(format!("{layer}.png")), to).unwrap();
        }
    }
    place.train("backtrack", "2", &small(&[]));
    let more = ["--real", text(&real), "--real-share", "0.5"];
    let ended = place.train("separation", "6", &more);
    assert_eq!(ended["real_pairs"].as_u64(), Some(scenes.len() as u64));
    let csv = std::fs::read_to_string(place.run.join("train/separation/metrics.csv")).unwrap();
    // A real pair has no R~, so every other line has no loss of R~.
    let known: Vec<bool> =
        csv.lines().skip(1).map(|l| !l.split(',').nth(4).unwrap().is_empty()).collect();
    assert_eq!(known.iter().filter(|k| **k).count(), 3, "{csv}");
    // A changed pixel of a pair is refused, and so is a changed set of pairs.
    let first = real.join("blended/0.png");
    let published = std::fs::read(&first).unwrap();
    let mut picture = image::open(&first).unwrap().into_rgb8();
    picture.get_pixel_mut(3, 2).0[0] ^= 1;
    picture.save(&first).unwrap();
    run(&place.arguments("separation", "8", &more)).expect(5).says(&["real pairs"]);
    std::fs::write(&first, published).unwrap();
    assert_eq!(place.train("separation", "7", &more)["steps_taken"], 1);
    for folder in ["blended", "transmission_layer"] {
        std::fs::remove_file(real.join(folder).join("0.png")).unwrap();
    }
    run(&place.arguments("separation", "8", &more)).expect(5).says(&["real pairs"]);
}

#[test]
fn features_are_random_or_from_a_file_with_a_recorded_digest() {
    let weights = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/train/step.safetensors");
    let place = place();
    let file = ["--features", text(&weights), "--vgg-divisor", "32"];
    let ended = place.train("backtrack", "2", &small(&file));
    assert!(ended["settings"]["features"] == "file");
    let state = place.checkpoint("backtrack", 2).remove("state.json").unwrap();
    let state: Value = serde_json::from_slice(&state).unwrap();
    let digest = blake3::hash(&std::fs::read(&weights).unwrap()).to_hex().to_string();
    assert_eq!(state["origin"]["vgg_blake3"], digest.as_str());
    run(&place.arguments("backtrack", "4", &[])).expect(4).says(&["--features FILE"]);
    let model = place.folder_of("backtrack", 2).join("model.safetensors");
    run(&place.arguments("backtrack", "4", &["--features", text(&model)]))
        .expect(4)
        .says(&["features.0.weight", "torchvision"]);
    // BT-net has learned with the features of the unchanged weights.
    let changed = place.folder.path().join("changed.safetensors");
    let mut bytes = std::fs::read(&weights).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&changed, bytes).unwrap();
    run(&place.arguments("separation", "2", &["--features", text(&changed)]))
        .expect(5)
        .says(&["VGG-19's weights", "step-0000002"]);
    let other = self::place();
    let more = small(&["--features", "random", "--vgg-divisor", "32"]);
    run(&other.arguments("backtrack", "2", &more)).expect(0).says(&["unlike the paper's"]);
    run(&["train", text(&other.run), "--stage", "separation", "--steps", "2"]).expect(0);
}

#[test]
fn tensorboard_reads_the_events() {
    let reader = "from tensorboard.backend.event_processing.event_accumulator import EventAccumulator as E\n\
                  import sys\ne = E(sys.argv[1])\ne.Reload()\nt = e.Tags()\n\
                  print(len(e.Scalars('loss/total')), e.Scalars('loss/total')[-1].step, t['images'])";
    let python =
        |arguments: &[&str]| std::process::Command::new("python3").args(arguments).output();
    if !python(&["-c", "import tensorboard"]).is_ok_and(|o| o.status.success()) {
        eprintln!("skipped: tensorboard is not installed (pip install tensorboard)");
        return;
    }
    let place = place();
    place.train("backtrack", "12", &small(&["--pictures-every", "6"]));
    let folder = place.run.join("train/backtrack");
    let read = python(&["-c", reader, text(&folder)]).unwrap();
    let said = String::from_utf8(read.stdout).unwrap();
    assert_eq!(said.trim(), "12 12 ['validation']", "{}", String::from_utf8_lossy(&read.stderr));
}

#[test]
fn features_and_batches_keep_the_bits_through_kills() {
    let more = small(&["--features", "random", "--vgg-divisor", "32", "--batch", "2", "-j", "1"]);
    let [whole, killed] = [(); 2].map(|()| place());
    whole.train("backtrack", "3", &more);
    whole.train("separation", "16", &["-j", "1"]);
    killed.train("backtrack", "3", &more);
    let mut kills = 0;
    for step in [2, 7] {
        let often = ["--checkpoint-every", "1", "-j", "2", "-q"];
        let mut child = command(&killed.arguments("separation", "16", &often)).spawn().unwrap();
        let state = killed.folder_of("separation", step).join("state.json");
        wait_until(&mut child, || state.exists());
        child.kill().unwrap();
        kills += u32::from(child.wait().unwrap().signal() == Some(9));
    }
    assert!(kills > 0, "training always ended before the test killed it");
    killed.train("separation", "16", &[]);
    assert!(killed.checkpoint("separation", 16) == whole.checkpoint("separation", 16));
}
