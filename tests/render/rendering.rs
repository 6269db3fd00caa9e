//! Tests `render`, which makes the same pixels as a farm.

use crate::support::outputs::{assert_same, exr_channels, files, read_json, tuples};
use crate::support::program::{run, text};
use crate::support::scenes::{photographs, place, reference, scene};
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
