//! Tests the rules and oracles beside which networks are scored, indices of pairs, and outputs of other programs.

use crate::support::program::{run, text};
use crate::support::workplace::run_in;
use image::{Rgb, RgbImage};
use serde_json::Value;
use std::path::Path;

/// Returns the row of a method in a group.
#[track_caller]
fn row<'a>(json: &'a Value, group: &str, method: &str) -> &'a Value {
    let rows = json["rows"].as_array().unwrap();
    let of = |row: &&Value| row["group"] == group && row["method"] == method;
    rows.iter().find(of).unwrap_or_else(|| panic!("no row {method:?} of {group:?} in {json}"))
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {row}"))
}

#[test]
fn rules_have_their_known_scores_on_published_pairs() {
    let index = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/reflection/index.csv");
    if !index.exists() {
        eprintln!("skipped: no {}", index.display());
        return;
    }
    let rules = ["--longest", "640", "--factor", "0.83", "--veil", "0.88,0.8", "--json"];
    let json = run(&[&["evaluate", "--index", text(&index)][..], &rules].concat()).expect(0).json();
    assert_eq!((&json["images"], &json["longest_px"]), (&14.into(), &640.into()));
    assert_eq!(json["left_out"].as_array().unwrap().len(), 23);
    // PSNR over all channels, before and after own factors, of a Python program with Pillow and numpy.
    let expected = [
        ("real20", "input", 18.43, 20.31),
        ("sir2", "input", 22.68, 23.18),
        ("lasirr", "input", 19.33, 22.33),
        ("all", "input", 20.28, 21.82),
        ("real20", "input x 0.83", 19.51, 20.31),
        ("sir2", "input x 0.83", 22.67, 23.18),
        ("lasirr", "input x 0.83", 21.35, 22.33),
        ("all", "input x 0.83", 21.06, 21.82),
        ("real20", "veil rule 0.88, 0.80", 19.40, 20.27),
        ("sir2", "veil rule 0.88, 0.80", 23.33, 23.72),
        ("lasirr", "veil rule 0.88, 0.80", 21.03, 22.33),
        ("all", "veil rule 0.88, 0.80", 21.16, 21.98),
    ];
    for (group, method, raw_db, own_db) in expected {
        let row = row(&json, group, method);
        // The expected numbers are rounded to 0.01 dB, and decoders of JPEG differ in rounding.
        for (key, db) in [("psnr_colour_db", raw_db), ("psnr_own_factor_db", own_db)] {
            assert!((number(row, key) - db).abs() <= 0.01, "{group} {method} {key} {row}");
        }
    }
    let wins = |method: &str| {
        let row = row(&json, "all", method);
        [&row["wins"], &row["wins_own_factor"]].map(|wins| wins.as_u64().unwrap())
    };
    assert_eq!(wins("input x 0.83"), [10, 1]);
    assert_eq!(wins("veil rule 0.88, 0.80"), [12, 9]);
    assert_eq!(json["group_factors"]["all"], 0.83);
    let over = &row(&json, "all", "input")["over_veil_db"];
    assert!((number(over, "mean") - (20.28 - 21.16)).abs() < 0.02, "{over}");
    assert!(number(over, "low") < number(over, "mean") && number(over, "high") < 0.0, "{over}");
}

/// Makes a smooth picture with edges, darker by a factor of its codes.
fn picture(salt: u32, scale: f64) -> RgbImage {
    RgbImage::from_fn(48, 36, |x, y| {
        let edge = if (x / 11 + y / 7 + salt).is_multiple_of(2) { 60 } else { 0 };
        Rgb([x * 3, y * 4 + salt, x + y].map(|v| (f64::from(v % 190 + edge) * scale) as u8))
    })
}

/// Makes an index of three pairs in two groups, with one row of another kind.
fn index(folder: &Path) {
    let mut lines = vec!["id,group,kind,blended,transmission,aligned".to_owned()];
    for (place, (id, group)) in [("a1", "a"), ("a2", "a"), ("b1", "b")].iter().enumerate() {
        let salt = place as u32;
        picture(salt, 0.7).save(folder.join(format!("{id}-i.png"))).unwrap();
        picture(salt, 1.0).save(folder.join(format!("{id}-t.png"))).unwrap();
        lines.push(format!("{id},{group},real,{id}-i.png,{id}-t.png,yes"));
    }
    lines.push("other,b,synthetic,x.png,y.png,yes\n".to_owned());
    std::fs::write(folder.join("index.csv"), lines.join("\n")).unwrap();
}

#[test]
fn outputs_of_other_programs_are_scored() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    index(folder);
    let out = folder.join("outputs");
    std::fs::create_dir(&out).unwrap();
    // Perfect outputs but one; one has the name of its pair.
    for (name, salt, scale) in [("a1-i", 0, 1.0), ("a2-i", 1, 1.0), ("b1", 2, 0.6)] {
        picture(salt, scale).save(out.join(format!("{name}.png"))).unwrap();
    }
    let evaluate = |more: &[&str]| run_in(folder, &[&["evaluate"], more].concat());
    let with = ["--index", "index.csv", "--outputs", "mine=outputs", "--json"];
    let json = evaluate(&[&with[..], &["--veil", "1.2,0.5"]].concat()).expect(0).json();
    assert_eq!(json["outputs"][0]["method"], "mine");
    assert_eq!(json["left_out"][0]["image"], "other");
    let mine = row(&json, "a", "mine");
    assert_eq!((&mine["count"], &mine["psnr_colour_db"]), (&2.into(), &"inf".into()));
    assert_eq!((&mine["wins"], &mine["over_veil_db"]["low"]), (&2.into(), &"inf".into()));
    let mine = row(&json, "b", "mine");
    assert_eq!((&mine["count"], &mine["wins"]), (&1.into(), &0.into()));
    assert_eq!(row(&json, "all", "mine")["wins_veil"], 2);
    // Without examples and numbers, the rules are those of the shipped weights, which have a row of their own.
    let json = evaluate(&with).expect(0).json();
    assert_eq!(json["rows"].as_array().unwrap().len(), 3 * 7);
    assert!(row(&json, "all", "shipped")["over_veil_db"].is_object());
    let fitted = &json["baselines"]["fitted"];
    assert_eq!(json["baselines"]["factor"], fitted["factor"]);
    // The rules can be fitted to a folder of pairs.
    for (layer, part) in [("blended", "i"), ("transmission_layer", "t")] {
        let layer = folder.join("pairs").join(layer);
        std::fs::create_dir_all(&layer).unwrap();
        for id in ["a1", "a2"] {
            let from = folder.join(format!("{id}-{part}.png"));
            std::fs::copy(from, layer.join(format!("{id}.png"))).unwrap();
        }
    }
    let json = evaluate(&[&with[..], &["--fit-to", "pairs"]].concat()).expect(0).json();
    let factor = json["baselines"]["factor"].as_f64().unwrap();
    assert!(factor > 1.5 && json["baselines"]["fitted"]["images"] == 2, "{factor}");

    // An output of another size, and a missing one, leave their pictures out for all methods.
    picture(0, 1.0).save(out.join("a1-i.png")).unwrap();
    RgbImage::new(47, 36).save(out.join("a2-i.png")).unwrap();
    std::fs::remove_file(out.join("b1.png")).unwrap();
    let ended = evaluate(&with).expect(3).says(&["a2-i.png has 47 x 36 px", "b1-i.png does not"]);
    let json = ended.json();
    assert_eq!((&json["images"], &row(&json, "all", "input")["count"]), (&1.into(), &1.into()));
    assert_eq!(json["left_out"].as_array().unwrap().len(), 3);

    // Names are necessary and unique, and folders exist.
    let two = ["--outputs", "mine=outputs"];
    evaluate(&[&with[..], &two].concat()).expect(2).says(&["would be called \"mine\""]);
    for (value, code, words) in
        [("outputs", 2, "NAME=outputs"), ("input=outputs", 2, "\"input\""), ("x=none", 4, "none")]
    {
        evaluate(&["pairs", "--outputs", value]).expect(code).says(&[words]);
    }
    evaluate(&["--index", "none.csv"]).expect(4).says(&["none.csv"]);
    evaluate(&["--veil", "0.88", "pairs"]).expect(2).says(&["G,K"]);
    evaluate(&[]).expect(2);
}
