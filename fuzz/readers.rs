//! One function per reader for arbitrary bytes, called by the fuzz targets and, with the seeds, by `tests/formats/corpus`.
//!
//! Each function returns whether its reader accepted the bytes, and asserts the invariants of accepted ones; for others it
//! must only return. A new reader needs a function and a row in [`READERS`] here, a target in `fuzz_targets/`, and seeds in
//! `tests/formats/corpus`.

#![allow(dead_code, reason = "each fuzz target uses one of them")]

use glasshouse::farm::queue::{read_message, write_message};
use glasshouse::inspect::{Input, Whole, inspect_bytes};
use glasshouse::run::{Control, Provenance, QuarantineRecord, attempts};
use glasshouse::store::Store;
use glasshouse_line::ids::SceneId;
use glasshouse_line::{Photograph, Roots, Side, parse_jsonl, parse_scene, to_jsonl};
use plan::{LocalFiles, Recipe, Request, draft};
use render::formats::limits::{MAX_PIXELS, MAX_SIDE};
use render::formats::{NamedBytes, PhotographFiles, SceneError};
use render::merge::TupleRecord;
use render::partial;
use render::scene::{decode_mesh, decode_photograph};
use render::shard::{ShardLayout, Spec};
use std::collections::BTreeSet;
use std::path::Path;
use tempfile::TempDir;

/// A reader's name, that of its seeds' folder and of its fuzz target.
pub(crate) type Reader = (&'static str, fn(&[u8]) -> bool);

/// All of them.
pub(crate) const READERS: &[Reader] = &[
    ("color", color),
    ("depth", depth),
    ("mask", mask),
    ("ply", ply),
    ("scene_line", scene_line),
    ("manifest", manifest),
    ("recipe", recipe),
    ("partial", partial),
    ("list", list),
    ("spec", spec),
    ("tuple", tuple),
    ("message", message),
    ("record", record),
    ("inspect", inspect),
];

/// Foreign decoders may panic on hostile bytes, and glasshouse contains that; libFuzzer's hook would abort first.
pub(crate) fn let_panics_unwind() {
    let _ = std::panic::take_hook();
}

/// Decodes a photograph of three files. An accepted one is valid; an error names its file.
fn photograph(color: &[u8], depth: &[u8], mask: Option<&[u8]>) -> bool {
    let line = r#"{"color":"c","depth":"d","intrinsics":{"fx":10,"fy":10,"cx":2,"cy":1}}"#;
    let line: Photograph = serde_json::from_str(line).expect("a line as in a manifest");
    let named = |bytes: &[u8]| NamedBytes { path: "a file".into(), bytes: bytes.to_vec() };
    let files = PhotographFiles { color: named(color), depth: named(depth), mask: mask.map(named) };
    match decode_photograph(&line, &files) {
        Ok(sheet) => {
            let color = [sheet.texture.width(), sheet.texture.height()];
            let sizes = [sheet.width, sheet.height, color[0], color[1]];
            assert!(sizes.iter().all(|n| (1..=MAX_SIDE).contains(n)));
            let (vertices, texels) = (sheet.width * sheet.height, color[0] * color[1]);
            assert!(vertices <= MAX_PIXELS && texels <= MAX_PIXELS);
            assert_eq!(sheet.inverse_depths_per_m().count(), vertices);
            assert_eq!(sheet.valid.len(), vertices);
            assert_eq!(sheet.radiance().count(), texels);
            assert!(sheet.inverse_depths_per_m().all(|w| w.is_normal() && w > 0.0));
            let most = sheet.texture.max_radiance();
            assert!(sheet.radiance().flatten().all(|v| (0.0..=most).contains(v)));
            assert!(most.is_finite() && sheet.front_center_z_m > 0.0);
            true
        }
        Err(SceneError::NoDepth { .. }) => false,
        Err(error) => {
            assert!(error.to_string().contains("a file"), "{error}");
            false
        }
    }
}

const GREY: &[u8] = b"P5 3 2 255 abcdef";

/// PNG, JPEG, PNM, EXR, .npy as a colour image.
pub(crate) fn color(bytes: &[u8]) -> bool {
    photograph(bytes, GREY, None)
}

/// PNG, PNM, EXR, .npy as a depth image.
pub(crate) fn depth(bytes: &[u8]) -> bool {
    photograph(GREY, bytes, None)
}

/// PNG, PNM, .npy as a mask.
pub(crate) fn mask(bytes: &[u8]) -> bool {
    photograph(GREY, GREY, Some(bytes))
}

/// A PLY mesh.
pub(crate) fn ply(bytes: &[u8]) -> bool {
    let side: Side = serde_json::from_str(r#"{"mesh":"m"}"#).expect("a line as in a manifest");
    let Side::Mesh(line) = side else {
        panic!("the line names a mesh");
    };
    let file = NamedBytes { path: "a file".into(), bytes: bytes.to_vec() };
    match decode_mesh(&line, &file) {
        Ok(mesh) => {
            let vertices = mesh.vertices_m.len();
            assert_eq!(mesh.radiance.len(), vertices);
            assert!(mesh.vertices_m.iter().all(|v| v.is_finite()));
            let corners = mesh.triangles.as_flattened();
            assert!(corners.iter().all(|&corner| (corner as usize) < vertices));
            let radiance = mesh.radiance.as_flattened();
            assert!(radiance.iter().all(|v| (0.0..=mesh.max_radiance).contains(v)));
            assert!(mesh.max_radiance.is_finite());
            true
        }
        Err(error) => {
            assert!(error.to_string().contains("a file"), "{error}");
            false
        }
    }
}

fn text(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes).ok()
}

/// One scene line: an accepted one survives a round trip.
pub(crate) fn scene_line(bytes: &[u8]) -> bool {
    let Some(Ok(line)) = text(bytes).map(parse_scene) else {
        return false;
    };
    let again = parse_scene(to_jsonl(std::slice::from_ref(&line)).trim());
    assert_eq!(again.expect("a written line can be read"), line);
    let _ = render::scene::check_geometry(&line, 0.5);
    true
}

/// A manifest of lines.
pub(crate) fn manifest(bytes: &[u8]) -> bool {
    let Some(Ok(lines)) = text(bytes).map(parse_jsonl) else {
        return false;
    };
    let again = parse_jsonl(&to_jsonl(&lines));
    assert_eq!(again.expect("a written manifest can be read"), lines);
    true
}

/// A recipe.
pub(crate) fn recipe(bytes: &[u8]) -> bool {
    matches!(text(bytes).map(Recipe::parse), Some(Ok(_)))
}

/// A partial: accepted only if its digest matches, and then it can be written.
pub(crate) fn partial(bytes: &[u8]) -> bool {
    match partial::decode(Path::new("a file"), bytes) {
        Ok(partial) => {
            assert!(partial.is_intact());
            partial::encode(&partial).expect("a partial that was read can be written");
            true
        }
        Err(error) => {
            assert!(error.to_string().contains("a file"), "{error}");
            false
        }
    }
}

/// A list of photographs, up to the plan of a recipe that draws scenes from it. Accepted lists give valid lines.
pub(crate) fn list(bytes: &[u8]) -> bool {
    thread_local! {
        static FOLDER: TempDir = tempfile::tempdir().expect("a folder for a recipe");
    }
    let folder = FOLDER.with(|folder| folder.path().to_owned());
    let recipe = folder.join("recipe.toml");
    let text = "schema = \"glasshouse.recipe/1\"\nname = \"a\"\n[film]\nwidth = 9\nheight = 6\nspp = 4\n\
                [sources.mine]\nlayout = \"list\"\nroot = \".\"\n\
                [[split]]\nname = \"train\"\npairs = { mine = 3 }\n";
    for (path, bytes) in [(&recipe, text.as_bytes()), (&folder.join("photographs.jsonl"), bytes)] {
        render::atomic_file::write_relaxed(path, bytes).expect("a small file");
    }
    let request = Request {
        roots: &Roots::default(),
        inputs: &LocalFiles,
        run: &folder,
        begin_writing: None,
        left_out: BTreeSet::new(),
        planned: None,
        only: None,
        // The photographs do not exist.
        checks_files: false,
        skip_invalid: false,
        threads: 1,
    };
    match draft(&recipe, &request, &|_, _, _| {}) {
        Ok(drafted) => {
            assert_eq!(drafted.lines.len(), 3);
            assert!(drafted.lines.iter().all(|line| line.validate().is_ok()));
            manifest(to_jsonl(&drafted.lines).as_bytes())
        }
        Err(error) => {
            assert!(!error.to_string().is_empty());
            false
        }
    }
}

/// `spec.json`, up to the shards of a scene.
pub(crate) fn spec(bytes: &[u8]) -> bool {
    let Ok(spec) = serde_json::from_slice::<Spec>(bytes) else {
        return false;
    };
    let text = serde_json::to_string(&spec).expect("plain numbers and strings");
    assert_eq!(serde_json::from_str::<Spec>(&text).expect("as written"), spec);
    assert_eq!(spec.diff(&[], &spec, &[]), "");
    let line = r#"{"schema":"glasshouse.scene/1","id":"a","seed":1,"film":{"width":16384,"height":9,"spp":65536},
        "camera":{"focal_length_mm":55,"aperture_radius_m":0,"focus":{"at":"infinity"}},
        "glass":{"distance_m":0.3,"thickness_m":0.01,"ior":1.6},"front":{"mesh":"a"},"back":{"mesh":"b"}}"#;
    let mut line = parse_scene(line).expect("a scene");
    for target_error in [None, Some(0.1)] {
        line.film.target_error = target_error;
        if ShardLayout::check(std::slice::from_ref(&line), spec.tile_px).is_ok() {
            let layout = ShardLayout::of(&line, spec.tile_px);
            let last = layout.shard(layout.len() - 1);
            assert_eq!((last.tile.x + last.tile.width, last.samples.end), (16_384, 65_536));
        }
    }
    true
}

/// `inspect` on a file of any kind, alone in its folder.
pub(crate) fn inspect(bytes: &[u8]) -> bool {
    let found = inspect_bytes(&Input { name: "file", bytes, beside: &|_| None });
    // A file with a finding is not whole.
    assert_eq!(found.whole == Whole::No, !found.is_sound());
    found.is_sound()
}

/// `tuple.json`.
pub(crate) fn tuple(bytes: &[u8]) -> bool {
    let Ok(record) = serde_json::from_slice::<TupleRecord>(bytes) else {
        return false;
    };
    let text = serde_json::to_string(&record).expect("plain numbers and strings");
    assert_eq!(serde_json::from_str::<TupleRecord>(&text).expect("as written"), record);
    true
}

/// A message of the queue.
pub(crate) fn message(bytes: &[u8]) -> bool {
    let run = *b"8 bytes!";
    let Ok(Some(message)) = read_message(bytes, run, &[64; 1000]) else {
        return false;
    };
    assert!(message.task.scene < 1000 && !message.task.shards.is_empty());
    assert!(message.task.shards.end <= 64);
    assert_eq!(write_message(run, &message), bytes);
    true
}

/// A small record in a run's store: control, attempts, receipt, quarantine. A damaged record is reported as damaged, not as
/// an error.
pub(crate) fn record(bytes: &[u8]) -> bool {
    thread_local! {
        static FOLDER: TempDir = tempfile::tempdir().expect("a folder for records");
    }
    let folder = FOLDER.with(|folder| folder.path().to_owned());
    let store = Store::local(&folder).expect("a folder is a store");
    let scene = SceneId::new("a").expect("a name");
    let keys = ["control.json", "attempts/a/0-4.1.json", "receipts/a.json", "quarantine/a.json"];
    for key in keys {
        store.replace(key, bytes).expect("a small file");
    }
    let is_json = serde_json::from_slice::<serde_json::Value>(bytes).is_ok();
    let control = Control::get(&store).expect("it is there");
    assert!(is_json || control.because().contains("damaged"));
    assert_eq!(attempts(&store, &scene).expect("it is there").len(), 1);
    let receipt = Provenance::get(&store, &scene).expect("it is there");
    let _ = receipt.expect("it is there").makers();
    let set_aside = QuarantineRecord::get(&store, &scene).expect("it is there");
    set_aside.is_some() && is_json
}
