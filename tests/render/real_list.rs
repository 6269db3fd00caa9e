//! Lists photographs of several public RGB-D data sets in one file, for recipes with `layout = "list"`.

use crate::real_sets::{MOTORCYCLE_DEPTH, SETS, Set, find_sets, write_motorcycle_depth};
use crate::support::program::{run, text};
use render::atomic_file;
use serde_json::{Value, json};
use std::path::Path;

/// Additional frames of [`SETS`]: name of the set, colour file, depth file.
const FRAMES: [(&str, &str, &str); 6] = [
    ("basement", "nyu_basement/rgb_00050.jpg", "nyu_basement/sync_depth_00050.png"),
    ("basement", "nyu_basement/rgb_00100.jpg", "nyu_basement/sync_depth_00100.png"),
    (
        "kitchen",
        "sevenscenes_kitchen/frame-000300.color.jpg",
        "sevenscenes_kitchen/frame-000300.depth.png",
    ),
    ("chair", "redwood_chair/color/00004.jpg", "redwood_chair/depth/00004.png"),
    ("office", "hololens_office/images/00130.png", "hololens_office/depth/00130.png"),
    ("road", "kitti_road/rgb/0000000005.png", "kitti_road/depth/0000000005.png"),
];

/// Makes a line of the list for a frame of `set`.
fn line(set: &Set, color: &str, depth: &str) -> Value {
    let mut line = set.line();
    line["color"] = json!(color);
    line["depth"] = json!(depth);
    line["schema"] = json!("glasshouse.photograph/1");
    line["place"] = json!(if set.name == "road" { "outdoor" } else { "indoors" });
    line["scan"] = json!(set.name);
    line
}

/// Makes lines of photographs with relative depth. Their cameras are unknown; the lines have a horizontal field of
/// view of 60 degrees.
fn estimates() -> [Value; 2] {
    let camera = |width: u32, height: u32| {
        let [w, h] = [width, height].map(f64::from);
        json!({ "fx": 0.866 * w, "fy": 0.866 * w, "cx": w / 2.0, "cy": h / 2.0, "size": [width, height] })
    };
    [
        json!({
            "schema": "glasshouse.photograph/1", "place": "outdoor",
            "color": "moon_estimated/moon.jpg", "depth": "moon_estimated/moon.npy",
            "depth_kind": "relative_inverse", "depth_range": { "near_m": 3.0, "far_m": 60.0 },
            "intrinsics": camera(2100, 2100),
        }),
        // A disparity map; 0 marks unknown disparity, so the map is also the mask.
        json!({
            "schema": "glasshouse.photograph/1", "place": "indoors",
            "color": "middlebury_aloe/aloeL.jpg", "depth": "middlebury_aloe/aloeGT.png",
            "mask": "middlebury_aloe/aloeGT.png",
            "depth_kind": "relative_inverse", "depth_range": { "near_m": 1.0, "far_m": 4.0 },
            "intrinsics": camera(1282, 1110),
        }),
    ]
}

/// Fills `to/photos` with links to the sets, a converted depth image and `photographs.jsonl`. Returns the number of
/// photographs.
pub(crate) fn write_list(root: &Path, to: &Path) -> usize {
    let photos = to.join("photos");
    atomic_file::create_dir(&photos).unwrap();
    for entry in std::fs::read_dir(root).unwrap() {
        let entry = entry.unwrap();
        let link = photos.join(entry.file_name());
        if entry.path().is_dir() && !link.exists() {
            std::os::unix::fs::symlink(entry.path(), link).unwrap();
        }
    }
    write_motorcycle_depth(root, &photos.join(MOTORCYCLE_DEPTH));
    let mut lines: Vec<Value> = SETS.iter().map(|s| line(s, s.color, s.depth)).collect();
    lines.extend(FRAMES.iter().map(|(name, color, depth)| {
        let set = SETS.iter().find(|set| set.name == *name).unwrap();
        line(set, color, depth)
    }));
    lines.extend(estimates());
    let text: Vec<String> = lines.iter().map(Value::to_string).collect();
    atomic_file::write(&photos.join("photographs.jsonl"), text.join("\n").as_bytes()).unwrap();
    lines.len()
}

const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "list"
[film]
width = 24
height = 24
spp = 4
[glass]
tilt_deg = [0, { uniform = [-20, 20] }]
[sources.photos]
layout = "list"
[[split]]
name = "train"
pairs = { photos = 12 }
"#;

/// Leaves `target/tmp/real-photographs/photos` behind for other recipes (`--root photos=...`).
#[test]
fn a_list_of_the_sets_is_rendered() {
    let Some(root) = find_sets() else { return };
    let root = root.canonicalize().unwrap();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("real-photographs");
    let listed = write_list(&root, &folder);
    let recipe = folder.join("list.toml");
    atomic_file::write(&recipe, RECIPE.as_bytes()).unwrap();
    let out = tempfile::tempdir().unwrap();
    run(&["run", text(&recipe), "--json", "--out", text(&out.path().join("run"))]).expect(0);
    let manifest = std::fs::read_to_string(out.path().join("run/manifest.jsonl")).unwrap();
    let mut used = std::collections::BTreeSet::new();
    for line in manifest.lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        let [front, back] = ["front", "back"].map(|side| line[side]["color"].as_str().unwrap());
        used.extend([front.to_owned(), back.to_owned()]);
        // A path starts with the folder of its set. Each set is one scan, and the sides of a scene come from two scans.
        let set = |path: &str| path.split('/').next().unwrap().to_owned();
        assert_ne!(set(front), set(back), "{line}");
        let tuple = out.path().join("run/tuples").join(line["id"].as_str().unwrap());
        assert!(tuple.join("tuple.json").is_file(), "{line}");
    }
    println!("{listed} photographs, {} of them in 12 scenes: {}", used.len(), folder.display());
    assert!(used.len() > 8, "{used:?}");
}
