//! `render`: one scene, whatever the cut; and a tuple made again from its record.

use super::program::{exr_bits, program, recipe, run, run_json};
use std::collections::BTreeMap;
use std::path::Path;

const LAYERS: [&str; 4] = [
    "input",
    "transmission",
    "glass_reflection",
    "clean_reflection",
];

fn layers(folder: &Path) -> BTreeMap<String, BTreeMap<String, Vec<u32>>> {
    LAYERS
        .iter()
        .map(|l| ((*l).to_owned(), exr_bits(&folder.join(format!("{l}.exr")))))
        .collect()
}

#[test]
fn a_tuple_is_made_again_to_the_bit_and_in_any_cut() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let recipe = recipe(here, 2, 64);
    let out = here.join("run");
    assert_eq!(
        run(&[
            "run",
            recipe.to_str().unwrap(),
            "--out",
            out.to_str().unwrap(),
            "--tile",
            "40"
        ])
        .0,
        0
    );
    let tuple = out.join("tuples/train-000001");
    let record = tuple.join("tuple.json");
    let record_text = record.to_str().unwrap();

    let mut first = None;
    for (name, extra) in [
        ("a", ["-j", "1"]),
        ("b", ["-j", "2"]),
        ("c", ["--tile", "7"]),
        ("d", ["--tile", "500"]),
    ] {
        let again = here.join(name);
        let (code, object) = run_json(
            &[
                &["render", record_text, "--out", again.to_str().unwrap()][..],
                &extra[..],
            ]
            .concat(),
        );
        assert_eq!(code, 0, "{object}");
        let found = layers(&again);
        let expected: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(&record).unwrap()).unwrap();
        for layer in LAYERS {
            assert_eq!(
                object["layers"][layer], expected["layers"][layer],
                "{layer}"
            );
            let png = format!("{layer}.png");
            assert_eq!(
                std::fs::read(again.join(&png)).unwrap(),
                std::fs::read(tuple.join(&png)).unwrap()
            );
            assert_eq!(found[layer].keys().collect::<Vec<_>>(), ["B", "G", "R"]);
        }
        let first = first.get_or_insert_with(|| layers(&again));
        assert!(*first == found, "{name}");
    }
    // tuple.exr holds the same, rounded to half floats.
    let halves = exr_bits(&tuple.join("tuple.exr"));
    for (layer, channels) in first.unwrap() {
        for (colour, bits) in channels {
            let rounded: Vec<u32> = bits
                .iter()
                .map(|&b| {
                    exr::prelude::f16::from_f32(f32::from_bits(b))
                        .to_f32()
                        .to_bits()
                })
                .collect();
            assert!(
                rounded == halves[&format!("{layer}.{colour}")],
                "{layer}.{colour}"
            );
        }
    }
}

#[test]
fn sample_counts_from_one_on_are_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let recipe = recipe(here, 2, 16);
    let out = here.join("run");
    assert_eq!(
        run(&[
            "plan",
            recipe.to_str().unwrap(),
            "--out",
            out.to_str().unwrap()
        ])
        .0,
        0
    );
    let manifest = std::fs::read_to_string(out.join("manifest.jsonl")).unwrap();
    let scene = here.join("scene.json");
    super::program::write(&scene, manifest.lines().next().unwrap().as_bytes());
    let root = format!("sample={}", out.join("inputs/sample").display());
    for spp in ["1", "2", "8", "1024"] {
        let images = here.join(spp);
        let output = program()
            .args([
                "render",
                scene.to_str().unwrap(),
                "--spp",
                spp,
                "--root",
                &root,
                "--out",
            ])
            .arg(&images)
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        for (layer, channels) in layers(&images) {
            assert!(
                channels
                    .values()
                    .flatten()
                    .all(|&b| f32::from_bits(b) >= 0.0),
                "{spp} {layer}"
            );
        }
    }
}
