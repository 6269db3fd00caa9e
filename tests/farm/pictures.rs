//! Folders of pictures without depth: sketched shapes, and depth by a network with random weights.

use crate::support::outputs::{files, manifest, read_json};
use crate::support::program::{command, run, text, wait_until};
use image::{Rgb, RgbImage};
use serde_json::{Value, json};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "pictures"
seed = 3
[film]
width = 48
height = 32
spp = 16
[camera]
focal_length_mm = 60
[sources.photos]
layout = "folder"
root = "photos"
DEPTH
[[split]]
name = "train"
pairs = { photos = 4 }
"#;

/// A picture with edges; its ending tells its format.
fn picture(path: &Path, size: [u32; 2], seed: u32) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let pixel = |x: u32, y: u32| {
        let stripe = (x / 9 + y / 7 + seed).is_multiple_of(2);
        Rgb([(x * 3 + seed * 40) as u8, (y * 5) as u8, if stripe { 220 } else { 30 }])
    };
    RgbImage::from_fn(size[0], size[1], pixel).save(path).unwrap();
}

/// Puts an EXIF segment with an orientation and a focal length for 35 mm film behind the start of a JPEG.
fn add_exif(path: &Path, orientation: u8, mm: u16) {
    let mut tiff = b"II*\0\x08\0\0\0".to_vec();
    // The first directory has the orientation and the pointer to the EXIF directory.
    tiff.extend([2, 0, 0x12, 0x01, 3, 0, 1, 0, 0, 0, orientation, 0, 0, 0]);
    tiff.extend([0x69, 0x87, 4, 0, 1, 0, 0, 0, 38, 0, 0, 0, 0, 0, 0, 0]);
    tiff.extend([1, 0, 0x05, 0xa4, 3, 0, 1, 0, 0, 0]);
    tiff.extend(mm.to_le_bytes());
    tiff.extend([0; 6]);
    let mut segment = b"Exif\0\0".to_vec();
    segment.extend(tiff);
    let mut bytes = std::fs::read(path).unwrap();
    let mut header = vec![0xff, 0xe1];
    header.extend((segment.len() as u16 + 2).to_be_bytes());
    header.extend(segment);
    bytes.splice(2..2, header);
    std::fs::write(path, bytes).unwrap();
}

fn folder() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    picture(&photos.join("indoors/a.jpg"), [120, 80], 1);
    picture(&photos.join("indoors/b.png"), [80, 120], 2);
    picture(&photos.join("Outdoor 2024/c.JPG"), [160, 100], 3);
    picture(&photos.join("d.jpeg"), [100, 100], 4);
    // Stored rows of 160 px are columns of the upright picture.
    add_exif(&photos.join("Outdoor 2024/c.JPG"), 6, 28);
    std::fs::write(photos.join("indoors/broken.jpg"), b"\xff\xd8\xff\xe0 nothing").unwrap();
    std::fs::write(photos.join("notes.txt"), b"no picture").unwrap();
    let odd = std::ffi::OsStr::from_bytes(b"\xff.jpg");
    std::fs::copy(photos.join("d.jpeg"), photos.join(odd)).unwrap();
    std::fs::write(photos.join("phone.HEIC"), b"not read").unwrap();
    (folder, photos)
}

fn made(depth: &str) -> (TempDir, PathBuf, String) {
    let (folder, _) = folder();
    let recipe = folder.path().join("pictures.toml");
    std::fs::write(&recipe, RECIPE.replace("DEPTH", depth)).unwrap();
    let out = folder.path().join("run");
    let said = run(&["run", text(&recipe), "--out", text(&out)]).expect(0).stderr;
    (folder, out, said)
}

fn sides(lines: &[Value]) -> Vec<&Value> {
    lines.iter().flat_map(|line| [&line["front"], &line["back"]]).collect()
}

/// One command makes tuples of a folder of pictures. The line has all that was assumed.
#[test]
fn a_folder_of_pictures_becomes_tuples() {
    let (_folder, out, said) = made("");
    for words in [
        "2 pictures cannot be read",
        "its name is not UTF-8",
        "1 pictures are neither JPEG, PNG, EXR nor HDR",
        "1 pictures are taken as outdoor",
        "3 pictures have no focal length",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
    let lines = manifest(&out);
    assert_eq!(lines.len(), 4);
    let mut drawn = Vec::new();
    for side in sides(&lines) {
        assert!(side.get("depth").is_none(), "{side}");
        let sketch = &side["sketch"];
        assert_eq!((&sketch["camera_height_m"], &sketch["horizon"]), (&json!(1.5), &json!(0.5)));
        let wall_m = sketch["wall_m"].as_f64().unwrap();
        assert!((5.0..=50.0).contains(&wall_m));
        drawn.push(wall_m.to_bits());
        let [fx, cx, cy] = ["fx", "cx", "cy"].map(|key| side["intrinsics"][key].as_f64().unwrap());
        let color = side["color"].as_str().unwrap();
        // The view of 65 degrees along the longer side, or a focal length of 28 mm for the diagonal of 43.27 mm.
        let expected = match color {
            "photos:Outdoor 2024/c.JPG" => 28.0 * 160f64.hypot(100.0) / 36f64.hypot(24.0),
            "photos:indoors/a.jpg" | "photos:indoors/b.png" => 60.0 / 32.5f64.to_radians().tan(),
            _ => 50.0 / 32.5f64.to_radians().tan(),
        };
        assert!((fx / expected - 1.0).abs() < 1e-8, "{color}: {fx} {expected}");
        let middle = match color {
            "photos:Outdoor 2024/c.JPG" => [50.0, 80.0],
            "photos:indoors/a.jpg" => [60.0, 40.0],
            "photos:indoors/b.png" => [40.0, 60.0],
            _ => [50.0, 50.0],
        };
        assert_eq!([cx, cy], middle, "{color}");
    }
    drawn.sort_unstable();
    drawn.dedup();
    assert!(drawn.len() > 4, "each side of each scene draws its own wall");
    for line in &lines {
        let id = line["id"].as_str().unwrap();
        let record = read_json(out.join("tuples").join(id).join("tuple.json"));
        assert_eq!(record["scene"]["front"]["sketch"], line["front"]["sketch"]);
    }
    let page = std::fs::read_to_string(out.join("report/index.html")).unwrap();
    assert!(
        page.contains("front assumed: ground 1.5 m below, wall at"),
        "the report names the shape"
    );
    run(&["audit", text(&out), "--share", "1"]).expect(0);
}

#[test]
fn shapes_places_and_views_are_stated() {
    let (_folder, out, said) =
        made("depth = { plane_m = 7 }\nplace = \"indoors\"\nfield_of_view_deg = 90");
    assert!(!said.contains("taken as outdoor") && !said.contains("no focal length"), "{said}");
    let lines = manifest(&out);
    for side in sides(&lines) {
        assert_eq!(side["sketch"], json!({ "plane_m": 7.0 }));
        let [fx, cx, cy] = ["fx", "cx", "cy"].map(|key| side["intrinsics"][key].as_f64().unwrap());
        assert!((fx / cx.max(cy) - 1.0).abs() < 1e-8, "half of the longer side");
    }
    let (folder, _) = folder();
    let recipe = folder.path().join("pictures.toml");
    for (depth, words) in [
        ("depth = \"plane\"", "depth must be \\\"sketch\\\", { plane_m"),
        ("depth = { plane_m = 0 }", "sources.photos.depth.plane_m is 0, but must be 0.001 to 1e6"),
        (
            "depth = { wall_m = 9, horizon = 1.5 }",
            "sources.photos.depth.horizon is 1.5, but must be 0 to 1",
        ),
        ("depth_unit_m = 2", "sources.photos.depth_unit_m does not belong to layout"),
        ("field_of_view_deg = 180", "field_of_view_deg is 180, but must be 1 to 170"),
    ] {
        std::fs::write(&recipe, RECIPE.replace("DEPTH", depth)).unwrap();
        let ended = run(&["plan", text(&recipe), "-n"]).expect(4);
        let plain = words.replace("\\\"", "\"");
        assert!(ended.stderr.contains(&plain), "{depth}: {}", ended.stderr);
    }
    std::fs::write(&recipe, RECIPE.replace("DEPTH", "").replace("\"photos\"", "\"nothing\""))
        .unwrap();
    std::fs::create_dir(folder.path().join("nothing")).unwrap();
    run(&["plan", text(&recipe), "-n"]).expect(4).says(&["holds no picture", "--root photos=DIR"]);
    for name in ["a.HEIC", "b.heic"] {
        std::fs::write(folder.path().join("nothing").join(name), b"\0\0\0\x1cftypheic").unwrap();
    }
    let says = ["2 in formats that are not read (HEIC", "heif-convert"];
    run(&["plan", text(&recipe), "-n"]).expect(4).says(&says);
}

/// A missing folder of depth maps is answered with its own root.
#[test]
fn a_missing_folder_is_answered_with_its_root() {
    let (folder, photos) = folder();
    let recipe = folder.path().join("places.toml");
    let places = RECIPE
        .replace("layout = \"folder\"", "layout = \"places\"\ndepth_ranges = \"ranges.toml\"");
    std::fs::write(&recipe, places.replace("DEPTH", "depth_kind = \"relative_inverse\"")).unwrap();
    let ranges = Path::new(env!("CARGO_MANIFEST_DIR")).join("manifests/depth-ranges.toml");
    std::fs::copy(ranges, folder.path().join("ranges.toml")).unwrap();
    let ended = run(&["plan", text(&recipe), "-n"]).expect(4);
    assert!(ended.stderr.contains("--root photos-depth=DIR"), "{}", ended.stderr);
    assert!(!ended.stderr.contains("--root photos=DIR"), "{}", ended.stderr);
    std::fs::remove_dir_all(photos).unwrap();
    let ended = run(&["plan", text(&recipe), "-n"]).expect(4);
    assert!(ended.stderr.contains("--root photos=DIR"), "{}", ended.stderr);
}

/// Weights of ViT-S from a hash.
#[cfg(feature = "train")]
fn weights(path: &Path) {
    use glasshouse::depth::Model;
    use glasshouse::train::candle_core::{Device, Tensor, safetensors};
    let tensors = Model::Vits.config().tensors().into_iter().map(|(name, shape)| {
        let count: usize = shape.iter().product();
        let fan_in = shape.iter().skip(1).product::<usize>().max(1) as f32;
        let is_offset = name.ends_with("norm1.weight")
            || name.ends_with("norm2.weight")
            || name == "head.conv3.bias";
        let values: Vec<f32> = (0..count as u32)
            .map(|k| {
                let hash = k.wrapping_mul(0x9e37_79b9).wrapping_add(name.len() as u32 * 77);
                let unit =
                    (hash ^ hash >> 15).wrapping_mul(0x735a_2d97) as f32 / u32::MAX as f32 - 0.5;
                if is_offset { 1.0 + 0.1 * unit } else { unit / fan_in.sqrt() }
            })
            .collect();
        (name, Tensor::from_vec(values, shape, &Device::Cpu).unwrap())
    });
    safetensors::save(&tensors.collect(), path).unwrap();
}

/// The whole way through a network with random weights: killed, resumed, and rendered.
#[cfg(feature = "train")]
#[test]
fn depth_by_a_network_is_resumed_and_rendered() {
    let (folder, photos) = folder();
    picture(&photos.join("indoors/a.png"), [90, 60], 5);
    let file = folder.path().join("vits.safetensors");
    weights(&file);
    let whole = folder.path().join("whole");
    let call = |out: &Path, more: &[&str]| {
        let mut all = vec!["depth", text(&photos), "--weights", text(&file), "--out"];
        all.push(text(out));
        all.extend(more);
        all.into_iter().map(str::to_owned).collect::<Vec<String>>()
    };
    let ended = run(&call(&whole, &["--json", "-j", "2"])).expect(3);
    let answer = ended.json();
    assert_eq!((&answer["pictures"], &answer["model"]), (&json!(4), &json!("vits")));
    let failed: Vec<&str> = answer["failed"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| f["picture"].as_str().unwrap())
        .collect();
    assert_eq!(failed, ["\u{fffd}.jpg", "indoors/broken.jpg", "indoors/a.png"]);
    // A killed call resumes to the same files.
    let killed = folder.path().join("killed");
    let mut child = command(&call(&killed, &["-j", "1"])).spawn().unwrap();
    // A map counts as made once its line is written, a moment after the map itself.
    let records = killed.join("made.jsonl");
    wait_until(&mut child, || std::fs::read(&records).is_ok_and(|text| text.ends_with(b"\n")));
    child.kill().unwrap();
    child.wait().unwrap();
    let resumed = run(&call(&killed, &["--json", "-j", "1"])).expect(3).json();
    assert!(resumed["pictures_resumed"].as_u64().unwrap() >= 1, "{resumed}");
    for name in files(&whole) {
        let [a, b] = [&whole, &killed].map(|out| std::fs::read(out.join(&name)).unwrap());
        assert!(a == b, "{}", name.display());
    }
    let list = std::fs::read_to_string(whole.join("photographs.jsonl")).unwrap();
    let lines: Vec<Value> = list.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 4);
    assert_eq!(lines[0]["color"], "Outdoor 2024/c.JPG");
    assert_eq!(lines[0]["depth_range"], json!({ "mean_m": 12.0 }));
    let seen = run(&["inspect", text(&whole.join("depth.json")), "--json"]).expect(0).json();
    assert_eq!(seen["files"][0]["kind"], "depth_maps");
    // A folder of depth maps may be estimated again in its own place.
    let own = |out: &Path| {
        let words = ["depth", text(out), "--weights", text(&file), "--out", text(out), "--json"];
        run(&words).expect(0).json()
    };
    picture(&killed.join("new.png"), [60, 60], 8);
    assert_eq!(own(&killed)["pictures"], 1);
    assert!(killed.join("new.png").is_file() && killed.join("new_depth.npy").is_file());
    // The list is ready for a recipe.
    let recipe = folder.path().join("listed.toml");
    let listed =
        RECIPE.replace("layout = \"folder\"\nroot = \"photos\"\nDEPTH", "layout = \"list\"");
    std::fs::write(&recipe, listed).unwrap();
    let out = folder.path().join("run");
    let root = format!("photos={}", whole.display());
    run(&["run", text(&recipe), "--root", &root, "--out", text(&out), "-q"]).expect(0);
    // A picture that was replaced is estimated again, the others are not.
    let before = std::fs::read(whole.join("d_depth.npy")).unwrap();
    std::fs::remove_file(photos.join("d.jpeg")).unwrap();
    picture(&photos.join("d.jpeg"), [100, 100], 9);
    let again = run(&call(&whole, &["--json"])).expect(3).json();
    assert_eq!((&again["pictures"], &again["pictures_resumed"]), (&json!(1), &json!(3)));
    assert!(std::fs::read(whole.join("d_depth.npy")).unwrap() != before);
    let [a, b] = [&photos, &whole].map(|of| std::fs::read(of.join("d.jpeg")).unwrap());
    assert!(a == b, "the picture beside the depth map is the new one");
    // Other settings, folders of other files, and files that hold no weights are refused.
    let words = "neither empty nor a folder of depth maps by these weights and settings";
    run(&call(&whole, &["--metric", "20"])).expect(5).says(&[words]);
    run(&call(&photos, &[])).expect(5).says(&[words]);
    run(&call(&whole, &["--model", "vitb"]))
        .expect(4)
        .says(&["it is not a Depth Anything V2 of size vitb"]);
    std::fs::write(&file, b"nothing").unwrap();
    run(&call(&whole, &[])).expect(4).says(&["holds no weights that can be read"]);
}
