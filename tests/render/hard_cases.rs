//! `run manifests/hard-cases.toml` as a user would, and with expectations that are wrong.

use crate::support::program::{run, text};
use std::path::Path;

const TWO: &str = r#"
schema = "glasshouse.cases/1"
name = "two"
[film]
width = 6
height = 4
spp = 16
[camera]
focal_length_mm = 55
aperture_radius_m = 0.01
focus = { at = "front_center" }
[glass]
distance_m = 0.3
thickness_m = 0.01
ior = 1.6
[[case]]
id = "grey"
what = "Grey planes."
front = { radiance = [0.5, 0.5, 0.5], depth_m = 2, color_file = "png", depth_file = "png" }
back = { radiance = [0.25, 0.25, 0.25], depth_m = 2, color_file = "exr" }
expect = [
  { layer = "transmission", value = [0.5, 0.5, 0.5], bound = 0.005 },
  { layer = "clean_reflection", value = [0.25, 0.25, 0.25], bound = 0 },
]
[[case]]
id = "steep"
what = "Refused."
glass = { tilt_deg = [0, 80] }
front = { radiance = [1, 1, 1], depth_m = 2 }
back = { radiance = [1, 1, 1], depth_m = 2 }
refused = "85"
"#;

#[test]
fn the_shipped_cases_hold() {
    let folder = tempfile::tempdir().unwrap();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("manifests/hard-cases.toml");
    let out = folder.path().join("run");
    let ended = run(&["run", text(&file), "--out", text(&out)]).expect(0);
    for word in [
        "light-through-glass",
        "radius, px",
        "3.0978000",
        "no-depth-nan",
        "expected",
    ] {
        assert!(ended.stdout.contains(word), "no {word:?} in the table");
    }
    assert!(ended.stdout.contains(" checks, 0 failed"));
    assert!(!ended.stdout.contains(" NO"));
    assert!(out.join("report/index.html").is_file());
    assert!(out.join("inputs/cases/holes-front-depth.npy").is_file());

    // Again: nothing to do, the same answers.
    let again = run(&["run", text(&file), "--out", text(&out), "--json"])
        .expect(0)
        .json();
    assert_eq!(again["shards_traced"], 0);
    assert_eq!(again["checks_failed"], 0);
    let checks = again["checks"].as_array().unwrap();
    assert!(checks.len() >= 40 && checks.iter().all(|row| row["ok"] == true));
}

#[test]
fn a_wrong_expectation_fails() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("two.toml");
    let out = folder.path().join("run");
    let try_with = |from: &str, to: &str| {
        assert!(TWO.contains(from));
        std::fs::write(&file, TWO.replace(from, to)).unwrap();
        run(&["run", text(&file), "--out", text(&out), "--json"])
    };
    assert_eq!(
        try_with("Grey", "Grey").expect(0).json()["checks_failed"],
        0
    );
    // Expectations are no part of the plan: the run is still the same.
    let failed = |from: &str, to: &str| {
        let object = try_with(from, to).expect(1).json();
        assert_eq!(object["shards_traced"], 0);
        assert_eq!(object["checks_failed"], 1, "{object}");
        let rows = object["checks"].as_array().unwrap().clone();
        rows.into_iter().find(|row| row["ok"] == false).unwrap()
    };
    let row = failed("value = [0.25, 0.25, 0.25]", "value = [0.25, 0.26, 0.25]");
    assert_eq!(
        (&row["layer"], &row["got"]),
        (&"clean_reflection".into(), &0.25.into())
    );
    // 0.5 is 128 of 255 in a PNG: a bound too tight for that is broken.
    assert_eq!(
        failed("bound = 0.005", "bound = 0.0005")["layer"],
        "transmission"
    );
    // Refused for another reason than expected, and not refused at all.
    assert_eq!(
        failed("refused = \"85\"", "refused = \"lens\"")["quantity"],
        "refused"
    );
    let steep = "expect = [{ layer = \"input\", at_most = 1, bound = 0 }]";
    assert_eq!(failed("refused = \"85\"", steep)["case"], "steep");
}

#[test]
fn wrong_files_say_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("two.toml");
    for (from, to, words) in [
        ("depth_m = 2, color_file", "depth = 2, color_file", "depth"),
        (
            "bound = 0 }",
            "bound = 0, sum = 1 }",
            "an expectation is one of",
        ),
        ("layer = \"clean", "layer = \"cleen", "none of input"),
        ("refused = \"85\"", "", "either expect or refused"),
        ("id = \"steep\"", "id = \"grey\"", "another of this id"),
        ("ior = 1.6", "ior = 0.5", "ior"),
        ("ior = 1.6", "index = 1.6", "index"),
        (
            "radiance = [0.25",
            "spot = 1, radiance = [0.25",
            "a picture is one of",
        ),
    ] {
        std::fs::write(&file, TWO.replace(from, to)).unwrap();
        let ended = run(&[
            "run",
            text(&file),
            "--out",
            text(&folder.path().join("run")),
        ])
        .expect(4);
        assert!(ended.stderr.contains(words), "{to}: {}", ended.stderr);
    }
}
