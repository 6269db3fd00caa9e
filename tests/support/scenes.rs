//! Recipes, photographs and scene lines for tests, and the reference run that tests compare other runs with.

use super::outputs::{Tuples, tuples};
use super::program::{run, text};
use glasshouse::run::Run;
use glasshouse_line::Roots;
use render::job::{SceneJob, render_partials};
use render::partial::Partial;
use render::scene::{load, read_files};
use render::trace::Isa;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;
use tempfile::TempDir;

/// A recipe of four scenes of 96 x 64 px, a size that is neither square nor a whole number of tiles of 64 or 100 px.
pub(crate) const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "small"
seed = 7
[film]
width = 96
height = 64
spp = 256
[sources.sample]
layout = "sample"
count = 6
width = 256
height = 192
[[split]]
name = "train"
pairs = { sample = 3 }
[[split]]
name = "test"
pairs = { sample = 1 }
"#;

/// Number of scenes of [`RECIPE`].
pub(crate) const SCENES: usize = 4;
/// Number of shards of one scene with tiles of 16 px.
pub(crate) const SHARDS: usize = 24;

/// A temporary folder, and the paths of the recipe and the run in it.
pub(crate) struct Place {
    pub(crate) folder: TempDir,
    pub(crate) recipe: PathBuf,
    pub(crate) run: PathBuf,
    /// Whether workers sleep in each shard.
    pub(crate) is_slow: bool,
}

pub(crate) fn place() -> Place {
    let folder = tempfile::tempdir().unwrap();
    let recipe = folder.path().join("small.toml");
    std::fs::write(&recipe, RECIPE).unwrap();
    let run = folder.path().join("run");
    Place { folder, recipe, run, is_slow: false }
}

impl Place {
    /// Returns the arguments of `run` or `plan` with tiles of 16 px, followed by `more`.
    pub(crate) fn arguments<'a>(&'a self, command: &'a str, more: &[&'a str]) -> Vec<&'a str> {
        let (recipe, out) = (text(&self.recipe), text(&self.run));
        let mut all = vec![command, recipe, "--out", out, "--tile", "16"];
        all.extend(more);
        all
    }

    /// Plans the run with tiles of 16 px.
    pub(crate) fn plan(&self) {
        run(&self.arguments("plan", &[])).expect(0);
    }
}

/// Returns the tuples of an uninterrupted run, rendered once.
pub(crate) fn reference() -> &'static Tuples {
    static REFERENCE: OnceLock<Tuples> = OnceLock::new();
    REFERENCE.get_or_init(|| {
        let place = place();
        run(&place.arguments("run", &[])).expect(0);
        let tuples = tuples(&place.run);
        assert_eq!(tuples.len(), SCENES * 6);
        tuples
    })
}

/// Traces all shards of a scene of a planned run with the library; returns its id and its partials.
pub(crate) fn partials(run: &Path, scene: usize) -> (String, Vec<Partial>) {
    let run = Run::open(run, &Roots::default()).unwrap();
    let line = &run.lines[scene];
    let files = read_files(line, &run.roots, run.root()).unwrap();
    let job = SceneJob::new(line, run.layout(line), load(line, &files).unwrap());
    let never = AtomicBool::new(false);
    let mut partials = render_partials(&job, 2, Isa::detect(), &never, &|| {}).unwrap();
    partials.sort_by_key(|partial| partial.header.shard);
    (line.id.to_string(), partials)
}

/// Writes partials to the folder that `work` reads, and returns their paths.
pub(crate) fn put_partials(run: &Path, scene: &str, partials: &[Partial]) -> Vec<PathBuf> {
    let folder = run.join("partials").join(scene);
    std::fs::create_dir_all(&folder).unwrap();
    let put = |partial: &Partial| {
        let path = folder.join(format!("{:06}.exr", partial.header.shard));
        std::fs::write(&path, render::partial::encode(partial).unwrap()).unwrap();
        path
    };
    partials.iter().map(put).collect()
}

/// Writes two photographs of 64 x 48 px to `folder`: `a` and `b`, each with colour, depth and mask.
pub(crate) fn photographs(folder: &Path) {
    let made = run(&[
        "sample",
        text(&folder.join("made")),
        "--count",
        "2",
        "--width",
        "64",
        "--height",
        "48",
        "--json",
    ])
    .expect(0)
    .json();
    for (index, name) in ["a", "b"].into_iter().enumerate() {
        let color = folder.join("made").join(made["color"][index].as_str().unwrap());
        let stem = text(&color).strip_suffix(".png").unwrap().to_owned();
        for ending in [".png", "_depth.npy", "_depth_mask.npy"] {
            std::fs::copy(format!("{stem}{ending}"), folder.join(format!("{name}{ending}")))
                .unwrap();
        }
    }
}

/// Makes a scene line with the photographs `a` and `b`.
pub(crate) fn scene(id: &str) -> Value {
    let photograph = |name: &str| {
        json!({
            "color": format!("{name}.png"), "depth": format!("{name}_depth.npy"),
            "mask": format!("{name}_depth_mask.npy"),
            "intrinsics": {"fx": 886.81, "fy": 927.06, "cx": 512.0, "cy": 384.0, "size": [1024, 768]},
        })
    };
    json!({
        "schema": "glasshouse.scene/1", "id": id, "seed": 5,
        "film": {"width": 40, "height": 24, "spp": 16},
        "camera": {"focal_length_mm": 55.0, "aperture_radius_m": 0.00893, "focus": {"at": "front_center"}},
        "glass": {"distance_m": 0.3, "thickness_m": 0.01, "ior": 1.6},
        "front": photograph("a"), "back": photograph("b"),
    })
}

/// Writes scene lines to a `.jsonl`.
pub(crate) fn write_lines(path: &Path, lines: &[Value]) {
    let mut text = String::new();
    for line in lines {
        text += &line.to_string();
        text.push('\n');
    }
    std::fs::write(path, text).unwrap();
}

/// Returns the bytes of a `.npy` of f32.
pub(crate) fn npy(shape: &str, values: &[f32]) -> Vec<u8> {
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}
