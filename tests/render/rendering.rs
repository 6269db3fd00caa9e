//! Tests `render`, which makes the same pixels as a farm.

use crate::support::outputs::{assert_same, exr_channels, files, read_json, tuples};
use crate::support::program::{run, text};
use crate::support::scenes::{photographs, place, reference, scene, write_lines};
use exr::prelude::f16;
use std::collections::BTreeMap;
use std::path::Path;

const LAYERS: [&str; 4] = ["input", "transmission", "glass_reflection", "clean_reflection"];

type Files = BTreeMap<std::path::PathBuf, Vec<u32>>;

/// Reads every file that `render` wrote: the bits of R, G, B of each EXR, and the bytes of each PNG.
fn rendered(out: &Path) -> Files {
    let mut found = BTreeMap::new();
    for path in files(out) {
        let full = out.join(&path);
        if path.extension().is_some_and(|e| e == "exr") {
            let channels = exr_channels(&full);
            assert_eq!(channels.keys().collect::<Vec<_>>(), ["B", "G", "R"]);
            assert!(channels.values().all(|(kind, _)| *kind == "float"));
            let bits = ["R", "G", "B"].map(|c| channels[c].1.clone()).concat();
            found.insert(path, bits);
        } else {
            let bytes = std::fs::read(&full).unwrap();
            found.insert(path, bytes.into_iter().map(u32::from).collect());
        }
    }
    let mut names = LAYERS.map(|l| [format!("{l}.exr"), format!("{l}.png")]).concat();
    names.sort();
    assert_eq!(found.keys().map(|p| p.to_str().unwrap()).collect::<Vec<_>>(), names);
    found
}

#[test]
fn threads_and_tiles_do_not_change_images() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let path = folder.path().join("scene.json");
    std::fs::write(&path, scene("one").to_string()).unwrap();
    let mut first: Option<Files> = None;
    for (threads, tile) in [("1", "32"), ("2", "32"), ("2", "7"), ("1", "100")] {
        let out = folder.path().join("out").join(threads).join(tile);
        let arguments = [
            "render",
            text(&path),
            "--out",
            text(&out),
            "--spp",
            "1024",
            "-j",
            threads,
            "--tile",
            tile,
        ];
        run(&arguments).expect(0);
        let found = rendered(&out);
        let first = first.get_or_insert_with(|| rendered(&out));
        assert!(found == *first, "-j {threads} --tile {tile}");
    }
}

#[test]
fn sample_counts_are_powers_of_two() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let path = folder.path().join("scene.json");
    std::fs::write(&path, scene("one").to_string()).unwrap();
    let render = |spp: &str| {
        let out = folder.path().join(spp);
        (run(&["render", text(&path), "--out", text(&out), "--spp", spp, "--json"]), out)
    };
    for spp in ["1", "2"] {
        let (ended, out) = render(spp);
        assert_eq!(ended.expect(0).json()["spp"].to_string(), spp);
        rendered(&out);
    }
    for spp in ["3", "0", "131072", "many"] {
        let (ended, out) = render(spp);
        ended.expect(2).says(&["power of two"]);
        assert!(!out.exists());
    }
}

#[test]
fn a_tuple_can_be_rendered_again() {
    let place = place();
    run(&place.arguments("run", &[])).expect(0);
    assert_same(&tuples(&place.run), reference());
    let folder = place.run.join("tuples/train-sample-000001");
    let record = folder.join("tuple.json");
    let out = place.folder.path().join("again");
    run(&["render", text(&record), "--out", text(&out), "--tile", "20"]).expect(0);

    let record = read_json(record);
    let halves = exr_channels(&folder.join("tuple.exr"));
    assert_eq!(halves.len(), 12);
    for layer in LAYERS {
        let floats = exr_channels(&out.join(format!("{layer}.exr")));
        let of = |colour: &str| &floats[colour].1;
        for colour in ["R", "G", "B"] {
            let (kind, half) = &halves[&format!("{layer}.{colour}")];
            assert_eq!(*kind, "half");
            let rounded = of(colour).iter().map(|&v| f16::from_f32(f32::from_bits(v)));
            let rounded: Vec<u32> = rounded.map(|v| v.to_bits().into()).collect();
            assert!(rounded == *half, "{layer}.{colour}");
        }
        let pixels = of("R").iter().zip(of("G")).zip(of("B"));
        let bytes: Vec<u8> =
            pixels.flat_map(|((r, g), b)| [*r, *g, *b]).flat_map(u32::to_le_bytes).collect();
        let digest = blake3::hash(&bytes).to_hex().to_string();
        assert_eq!(record["layers"][layer]["blake3"], digest.as_str());
        let png = |of: &Path| std::fs::read(of.join(format!("{layer}.png"))).unwrap();
        assert!(png(&out) == png(&folder), "{layer}.png");
    }
}

#[test]
fn errors_name_the_scene_file() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let path = folder.path().join("scene.json");
    let out = folder.path().join("out");
    let render = || run(&["render", text(&path), "--out", text(&out)]);
    render().expect(4).says(&["scene.json"]);
    std::fs::write(&path, b"{").unwrap();
    render().expect(4).says(&["scene.json"]);
    let mut bad = scene("one");
    bad["back"]["depth"] = "nowhere.npy".into();
    std::fs::write(&path, bad.to_string()).unwrap();
    render().expect(4).says(&["scene.json", "nowhere.npy"]);
    assert!(!out.exists());
}

/// The map of a pane's smudges is an input of the scene like its photographs: below a root, with a digest, and a reason for
/// quarantine if it cannot be used.
#[test]
fn a_map_of_smudges_is_an_input() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let map = folder.path().join("map.png");
    let grey = image::GrayImage::from_fn(8, 4, |x, _| image::Luma([if x < 4 { 0 } else { 255 }]));
    grey.save(&map).unwrap();
    let with_map = |id: &str, map: &str| {
        let mut line = scene(id);
        line["glass"]["smudges"] = serde_json::json!({
            "map": map, "center_m": [0.0, 0.0], "width_m": 0.5, "roughness": 0.02, "transmittance": 0.0,
        });
        line
    };
    let manifest = folder.path().join("manifest.jsonl");
    let lines = [scene("clean"), with_map("map", "map.png"), with_map("none", "no.png")];
    write_lines(&manifest, &lines);
    let out = folder.path().join("run");
    run(&["run", text(&manifest), "--out", text(&out)]).expect(3).says(&["none", "no.png"]);
    let record = |id: &str| read_json(out.join("tuples").join(id).join("tuple.json"));
    let digest = blake3::hash(&std::fs::read(&map).unwrap()).to_hex().to_string();
    assert_eq!(record("map")["inputs"]["glass.smudges.map"], digest.as_str());
    assert_eq!(record("map")["scene"]["glass"]["smudges"]["map"], "manifest:map.png");
    assert!(record("clean")["inputs"].get("glass.smudges.map").is_none());
    // The opaque right half hides both sides; the left half is clean.
    let input = |id: &str| image::open(out.join("tuples").join(id).join("input.png")).unwrap();
    let [clean, smeared] = ["clean", "map"].map(|id| input(id).into_rgb8());
    let (width, y) = (clean.width(), clean.height() / 2);
    assert_eq!(smeared.get_pixel(width - 1, y).0, [0; 3]);
    assert_ne!(clean.get_pixel(width - 1, y).0, [0; 3]);
    let near = |x: u32| {
        let pixels = [&clean, &smeared].map(|picture| picture.get_pixel(x, y).0);
        (0..3).all(|c| pixels[0][c].abs_diff(pixels[1][c]) <= 2)
    };
    assert!(near(0));
}
