//! Tests several trainings of a run through the program: a recipe's list with seeds, their scores, and names on the
//! command line.

use crate::support::program::{run, text};
use serde_json::Value;
use std::path::Path;

const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "names"

[film]
width = 48
height = 48
spp = 4

[sources.sample]
layout = "sample"
count = 8
width = 64
height = 48

[[split]]
name = "train"
pairs = { sample = 3 }

[[split]]
name = "test"
pairs = { sample = 2 }

[[train]]
name = "net"
seeds = [1, 2]
separation_steps = 4

[train.settings]
network = "unet"
start = "residual"
a_priori = false
width = 4
crop_px = 32
adversarial_weight = 0
learning_rate = 1e-2

[[train]]
name = "bounded"
like = "net"
seeds = []
checkpoint_every = 2

[train.settings]
bound = 1.0
"#;

fn row<'a>(json: &'a Value, method: &str) -> &'a Value {
    let rows = json["rows"].as_array().unwrap();
    rows.iter().find(|row| row["method"] == method).unwrap()
}

#[test]
fn a_recipe_trains_several_networks() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = folder.path().join("names.toml");
    std::fs::write(&recipe, RECIPE).unwrap();
    let place = folder.path().join("run");
    let json = run(&["run", text(&recipe), "--out", text(&place), "-j", "1", "--json"]);
    let json = json.expect(0).json();
    for (name, seed) in [("net-seed-1", 1), ("net-seed-2", 2), ("bounded", 2020)] {
        let trained = &json["train"][format!("{name}/separation")];
        assert_eq!((&trained["name"], &trained["step"]), (&name.into(), &4.into()));
        assert_eq!(trained["settings"]["seed"], seed);
    }
    // Both seeds have a row of means.
    let scores = &json["train"]["evaluation"];
    let [one, two] = ["net-seed-1", "net-seed-2"].map(|name| row(scores, name));
    assert_eq!((&one["seed_of"], &two["seed_of"]), (&"net".into(), &"net".into()));
    let psnr_db = |row: &Value| row["psnr_colour_db"].as_f64().unwrap();
    let net = row(scores, "net");
    assert!((psnr_db(net) - 0.5 * (psnr_db(one) + psnr_db(two))).abs() < 1e-9);
    let spread = (psnr_db(one) - psnr_db(two)).abs() / 2.0f64.sqrt();
    assert!(spread > 0.0);
    assert!((net["spread"]["psnr_colour_db"].as_f64().unwrap() - spread).abs() < 1e-9);
    assert!(row(scores, "bounded")["spread"].is_null());
    let table = std::fs::read_to_string(place.join("train/evaluation/evaluation.md")).unwrap();
    let has_row = |name: &str| table.contains(&format!("| {name} "));
    assert!(has_row("net") && has_row("bounded") && !has_row("net-seed-1"), "{table}");
    // The same command finds nothing to do.
    let again = run(&["run", text(&recipe), "--out", text(&place), "-j", "1", "--json"]);
    let again = again.expect(0).json();
    assert_eq!(again["train"]["bounded/separation"]["steps_taken"], 0);
    names_on_the_command_line(&place, folder.path());
}

fn names_on_the_command_line(place: &Path, folder: &Path) {
    let train = |more: &[&str]| run(&[&["train", text(place), "-j", "1", "--json"], more].concat());
    // The recipe gives stage, steps and settings; more steps continue.
    let json = train(&["--name", "net-seed-1"]).expect(0).json();
    assert_eq!((&json["step"], &json["steps_taken"]), (&4.into(), &0.into()));
    let json = train(&["--name", "bounded", "--steps", "6"]).expect(0).json();
    assert_eq!((&json["from_step"], &json["settings"]["bound"]), (&4.into(), &1.0.into()));
    // The recipe's distance of checkpoints holds, too.
    let stage = place.join("train/bounded/separation");
    let steps = [2, 4, 5, 6].map(|step| stage.join(format!("step-{step:07}")).is_dir());
    assert_eq!(steps, [true, true, false, true]);
    train(&["--name", "other"]).expect(2).says(&["--stage and --steps"]);
    train(&["--name", "other", "--stage", "backtrack", "--steps", "2", "--dry-run"])
        .expect(0)
        .says(&["the recipe has no training \"other\""]);
    train(&["--name", "separation", "--steps", "6"]).expect(2).says(&["a folder of every run"]);
    // A training that begins with another one's weights has its settings.
    let bounded = place.join("train/bounded");
    let from = ["--name", "tuned", "--stage", "separation", "--from", text(&bounded)];
    let tuned = train(&[&from[..], &["--steps", "2"]].concat()).expect(0);
    assert!(!tuned.stderr.contains("no training"), "{tuned:?}");
    let json = tuned.json();
    assert_eq!((&json["from_step"], &json["settings"]["bound"]), (&0.into(), &1.0.into()));
    train(&[&from[..], &["--steps", "3", "--width", "8"]].concat())
        .expect(5)
        .says(&["width: 4 -> 8"]);

    // The recipe's settings of a name count, also with weights of another training.
    let new = place.join("train/net-seed-1");
    std::fs::remove_dir_all(&new).unwrap();
    let json = train(&["--name", "net-seed-1", "--from", text(&bounded), "--steps", "1"]).expect(0);
    let settings = &json.json()["settings"];
    assert_eq!((&settings["bound"], &settings["seed"]), (&0.0.into(), &1.into()));

    // A run of several trainings has no single network.
    let photo = folder.join("photo.png");
    image::RgbImage::from_fn(40, 40, |x, y| image::Rgb([(x * 6) as u8, (y * 6) as u8, 90]))
        .save(&photo)
        .unwrap();
    let out = folder.join("out");
    let separate = |network: &Path| {
        run(&["separate", text(&photo), "--network", text(network), "--out", text(&out)])
    };
    separate(place).expect(2).says(&["train/NAME", "bounded, net-seed-1, net-seed-2, tuned"]);
    separate(&bounded).expect(0);
    let inspected = run(&["inspect", text(&place.join("train.json"))]).expect(0);
    assert!(inspected.stdout.contains("2 objects"), "{inspected:?}");
}
