//! Makes scene files of the public sets for `glasshouse bench`: one set on both sides, the paper's camera and pane.

use crate::real_sets::{MOTORCYCLE_DEPTH, SETS, find_sets, write_motorcycle_depth};
use crate::support::program::{run, text};
use render::atomic_file;
use serde_json::json;
use std::path::Path;

/// Writes a scene file `target/tmp/real-scenes/SET.json` for each set, and checks that the program accepts it.
#[test]
fn scene_files_of_the_sets_are_accepted() {
    let Some(root) = find_sets() else { return };
    let root = root.canonicalize().unwrap();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("real-scenes");
    atomic_file::create_dir(&folder).unwrap();
    write_motorcycle_depth(&root, &folder.join(MOTORCYCLE_DEPTH));
    for set in &SETS {
        let mut photograph = set.line();
        for part in ["color", "depth"] {
            let path = photograph[part].as_str().unwrap().to_owned();
            if let Some(rest) = path.strip_prefix("rgbd:") {
                photograph[part] = json!(root.join(rest));
            }
        }
        let scene = json!({
            "schema": "glasshouse.scene/1", "id": set.name, "seed": 2020,
            "film": { "width": 256, "height": 256, "spp": 256 },
            "camera": { "focal_length_mm": 55.0, "aperture_radius_m": 0.00893, "focus": { "at": "front_center" } },
            "glass": { "distance_m": 0.3, "thickness_m": 0.01, "ior": 1.6 },
            "front": photograph, "back": photograph,
        });
        let path = folder.join(format!("{}.json", set.name));
        atomic_file::write(&path, format!("{scene:#}\n").as_bytes()).unwrap();
        let result =
            run(&["render", text(&path), "-n", "--json", "--out", "nowhere"]).expect(0).json();
        assert_eq!(result["scene"], set.name, "{result}");
        println!("{}", path.display());
    }
}
