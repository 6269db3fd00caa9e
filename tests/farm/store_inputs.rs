//! Photographs in a bucket yield the same scenes and pixels as in a folder, and a cache avoids repeated fetches.

use crate::support::moto::Moto;
use crate::support::outputs::{assert_same, files, tuples};
use crate::support::program::{Ended, command, run, text};
use crate::support::s3_server::S3Server;
use glasshouse::farm::{FarmError, WorkOptions, work};
use glasshouse::run::AccessError;
use glasshouse::run::Run;
use glasshouse::store::{Cache, Inputs, StoreError};
use glasshouse_line::Roots;
use render::trace::Isa;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use tempfile::TempDir;

const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "bucket"
seed = 3
[film]
width = 40
height = 24
spp = 16
[sources.diode]
layout = "diode"
[[split]]
name = "train"
pairs = { diode = 3 }
"#;

/// A folder with a recipe and photographs, and a bucket with the same photographs below `diode`.
struct Both {
    folder: TempDir,
    bucket: S3Server,
}

impl Both {
    fn new(seed: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("bucket.toml"), RECIPE).unwrap();
        let diode = folder.path().join("photographs");
        let size = ["--width", "64", "--height", "48"];
        run(&[&["sample", text(&diode), "--count", "6"][..], &size].concat()).expect(0);
        let bucket = S3Server::start(seed);
        let store = bucket.store("diode");
        for path in files(&diode) {
            let bytes = std::fs::read(diode.join(&path)).unwrap();
            store.create(text(&path), &bytes).unwrap();
        }
        Self { folder, bucket }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs the program with the address and the keys of the bucket.
    fn run(&self, arguments: &[&str]) -> Ended {
        let mut command = command(arguments);
        self.bucket.tell(&mut command);
        command.output().unwrap().into()
    }

    fn plan(&self, run: &Path, root: &str) {
        let recipe = self.path("bucket.toml");
        let root = format!("diode={root}");
        self.run(&["plan", text(&recipe), "--out", text(run), "--root", &root]).expect(0);
    }
}

#[test]
fn a_bucket_of_photographs_makes_the_same_tuples_as_a_folder() {
    let both = Both::new(21);
    let (here, there) = (both.path("here"), both.path("there"));
    both.plan(&here, text(&both.path("photographs")));
    run(&["work", text(&here)]).expect(0);
    both.bucket.faults.set(100);
    both.plan(&there, "s3://bucket/diode");
    let manifest = |run: &Path| std::fs::read(run.join("manifest.jsonl")).unwrap();
    assert!(manifest(&here) == manifest(&there));
    both.run(&["work", text(&there)]).expect(0);
    assert_same(&tuples(&there), &tuples(&here));
    let cached = files(&there.join("cache"));
    assert!(cached.len() >= 6, "{cached:?}");
    // A second run reads the cache, except for a damaged entry; `--root` may be given again.
    let file = there.join("cache").join(&cached[0]);
    let mut bytes = std::fs::read(&file).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&file, bytes).unwrap();
    std::fs::remove_dir_all(there.join("tuples")).unwrap();
    let cache = there.join("cache");
    let arguments =
        ["work", text(&there), "--cache", text(&cache), "--root", "diode=s3://bucket/diode/"];
    both.run(&arguments).expect(0);
    assert_same(&tuples(&there), &tuples(&here));
    // A tuple names the places of its photographs, so it can be rendered again.
    let id = tuples(&there).keys().next().unwrap().parent().unwrap().to_owned();
    let record = there.join("tuples").join(id).join("tuple.json");
    both.run(&["render", text(&record), "--out", text(&both.path("again"))]).expect(0);
}

#[test]
fn a_missing_photograph_quarantines_its_scenes_but_an_unreachable_bucket_does_not() {
    let both = Both::new(22);
    let run = both.path("run");
    both.plan(&run, "s3://bucket/diode");
    let mut opened = Run::open(&run, &Roots::default()).unwrap();
    opened.inputs = Inputs::new(both.bucket.options(Duration::from_secs(1)), None);
    let never = AtomicBool::new(false);
    let options = WorkOptions::new(1, Isa::detect(), &never);
    both.bucket.faults.set_away(true);
    match work(&opened, &options, &|_| {}) {
        Err(FarmError::Access(AccessError::Store(error))) => assert!(error.is_passing(), "{error}"),
        other => panic!("{other:?}"),
    }
    assert!(!run.join("quarantine").exists());
    both.bucket.faults.set_away(false);
    let color = opened.lines[0].front.name().to_owned();
    let key = color.replace(':', "/");
    both.bucket.store("").delete(std::slice::from_ref(&key)).unwrap();
    let outcome = both.run(&["work", text(&run), "--json"]).expect(3).json();
    let reason = outcome["quarantined"][0]["reason"].as_str().unwrap();
    assert!(reason.contains(&format!("s3://bucket/{key}")), "{reason}");
}

#[test]
fn plan_reports_truncated_objects_and_leaves_them_out_if_asked() {
    let both = Both::new(23);
    let store = both.bucket.store("diode");
    let whole = both.path("whole");
    both.plan(&whole, "s3://bucket/diode");
    let whole = Run::open(&whole, &Roots::default()).unwrap();
    // The test damages the depth images of two photographs that scenes use.
    let mut depths: Vec<String> = Vec::new();
    for side in whole.lines.iter().map(|line| &line.front) {
        let depth = side.photograph().unwrap().depth.clone();
        if depths.len() < 2 && !depths.contains(&depth) {
            depths.push(depth);
        }
    }
    let keys: Vec<&str> = depths.iter().map(|d| &d["diode:".len()..]).collect();
    let bytes = std::fs::read(both.path("photographs").join(keys[0])).unwrap();
    store.replace(keys[0], &bytes[..1000]).unwrap();
    store.replace(keys[1], b"").unwrap();
    let recipe = both.path("bucket.toml");
    let out = both.path("short");
    let arguments =
        ["plan", text(&recipe), "--out", text(&out), "--root", "diode=s3://bucket/diode", "--json"];
    let ended = both.run(&arguments).expect(4).says(&[
        "2 of ",
        "input files cannot be used",
        "needs 12288 bytes of data, but the file has 872",
        "it is empty",
    ]);
    assert_eq!(ended.json()["invalid"].as_array().unwrap().len(), 2);
    assert!(!out.exists());
    let planned = both.run(&[&arguments[..], &["--skip-invalid"]].concat());
    let planned = planned.expect(0).json();
    assert_eq!(planned["scenes"], 3);
    // At least four photographs have a PNG, and a depth image and a mask of 12,416 bytes each.
    assert!(planned["input_bytes"].as_u64().unwrap() > 4 * 2 * 12_416);
}

/// s3s-fs ignores `If-None-Match` of a get, so this test uses moto.
#[test]
fn an_object_is_fetched_again_only_when_it_changed() {
    let Some(server) = Moto::start() else { return };
    let store = server.store("x");
    store.create("a", b"one").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::new(folder.path().join("cache"), 1 << 20);
    let inputs = Inputs::new(server.options(), Some(cache));
    let url = Path::new("s3://bucket/x/./a");
    assert_eq!(inputs.read(url).unwrap(), b"one");
    // While the object's ETag is the same, the cache returns its entry, although the test has forged it.
    let file = folder.path().join("cache").join(&files(&folder.path().join("cache"))[0]);
    let text = String::from_utf8(std::fs::read(&file).unwrap()).unwrap();
    let digest = |bytes: &[u8]| blake3::hash(bytes).to_hex().to_string();
    let forged = text.replace(&digest(b"one"), &digest(b"ONE"));
    std::fs::write(&file, forged.replace("\none", "\nONE")).unwrap();
    assert_eq!(inputs.read(url).unwrap(), b"ONE");
    store.replace("a", b"two").unwrap();
    assert_eq!(inputs.read(url).unwrap(), b"two");
    let error = inputs.read(Path::new("s3://bucket/x/b")).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::NotFound);
    // An absent bucket is an error of the store and not of the file.
    let error = inputs.read(Path::new("s3://absent/x/b")).unwrap_err();
    let error = error.downcast::<StoreError>().unwrap();
    assert!(!error.is_passing(), "{error}");
}
