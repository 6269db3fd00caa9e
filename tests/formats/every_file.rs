//! Makes a file of every kind that the program writes or reads, for tests of `inspect`.

use crate::every_file_left as left;
use crate::support::scenes::{npy, partials, photographs, put_partials, scene, write_lines};
use crate::support::workplace::{run_in, workplace};
use glasshouse::run::{AttemptRecord, EndKind, Ending};
use glasshouse_line::ids::SceneId;
use serde_json::json;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder with a file of every kind, and the expected output of `inspect` for each.
pub(crate) struct Files {
    pub(crate) folder: TempDir,
    pub(crate) list: Vec<Known>,
}

impl Files {
    /// Returns the entries that are files.
    pub(crate) fn plain(&self) -> impl Iterator<Item = &Known> {
        let is_file = |known: &&Known| self.folder.path().join(&known.path).is_file();
        self.list.iter().filter(is_file)
    }
}

pub(crate) struct Known {
    pub(crate) path: PathBuf,
    pub(crate) kind: &'static str,
    /// True if the content is complete; `None` if `inspect` cannot check that.
    pub(crate) whole: Option<bool>,
    pub(crate) words: &'static [&'static str],
}

/// A scene of `runs/smoke`.
pub(crate) const SCENE: &str = "train-sample-000000";

impl Files {
    pub(crate) fn is(
        &mut self,
        path: &str,
        kind: &'static str,
        whole: Option<bool>,
        words: &'static [&'static str],
    ) {
        let path = PathBuf::from(path);
        assert!(self.folder.path().join(&path).exists(), "{}", path.display());
        self.list.push(Known { path, kind, whole, words });
    }

    pub(crate) fn put(&self, path: &str, bytes: impl AsRef<[u8]>) {
        let path = self.folder.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
}

/// Makes a file of every kind.
pub(crate) fn files() -> Files {
    let mut files = Files { folder: workplace(), list: Vec::new() };
    of_a_run(&mut files);
    of_a_farm(&mut files);
    of_inputs(&mut files);
    left::of_an_export(&mut files);
    #[cfg(feature = "train")]
    left::of_a_training(&mut files);
    files
}

fn of_a_run(files: &mut Files) {
    let folder = files.folder.path().to_owned();
    let (whole, unknown) = (Some(true), None);
    // An interrupted worker leaves partials.
    let (id, made) = partials(&folder.join("runs/smoke"), 0);
    put_partials(&folder.join("runs/smoke"), &id, &made[..1]);
    files.is("runs/smoke", "run", whole, &["scenes", "smoke", "every file of its tuples"]);
    files.is(
        "runs/smoke/spec.json",
        "spec",
        unknown,
        &["tile px", "golden", "manifest.jsonl match"],
    );
    files.is(
        "runs/smoke/manifest.jsonl",
        "manifest",
        whole,
        &["1 train, 1 validation, 1 test", "glass.tilt_deg yaw", "the one in spec.json"],
    );
    files.is("manifests/smoke.toml", "recipe", unknown, &["seed", "sample", "plan RECIPE"]);
    files.is("scene.json", "scene", unknown, &["one, split train", "a.png"]);
    files.is(
        &format!("runs/smoke/partials/{SCENE}/000000.exr"),
        "partial",
        whole,
        &[SCENE, "tile width 64", "samples 0, 64", "digest matches", "clean reflection"],
    );
    let tuple = format!("runs/smoke/tuples/{SCENE}");
    files.is(&tuple, "tuple", whole, &[SCENE, "matches its digest in tuple.json"]);
    files.is(
        &format!("{tuple}/tuple.exr"),
        "tuple_exr",
        whole,
        &["64 x 64 px, half", SCENE, "mean", "the one in tuple.json"],
    );
    files.is(
        &format!("{tuple}/tuple.json"),
        "tuple_record",
        unknown,
        &["film spp 64", "error_rms", "render"],
    );
    files.is(
        &format!("{tuple}/glass_reflection.png"),
        "picture",
        whole,
        &["64 x 64 px", "its digest matches"],
    );
    files.is("runs/smoke/report/index.html", "report", unknown, &["smoke"]);
    files.put("phone.toml", "[sensor]\ncamera = \"imx686\"\nraw = true\n");
    let develop = ["develop", "runs/smoke", "--sensor", "phone.toml", "--out", "photographs"];
    run_in(&folder, &develop).expect(0);
    files.is("photographs", "developed_folder", whole, &["scenes 3", "matches its digest"]);
    files.is("photographs/.glasshouse-digests.json", "digests", unknown, &["memory of digests"]);
    files.is("photographs/develop.json", "developed", unknown, &["smoke", "sensor version 1"]);
    let photographs = format!("photographs/{SCENE}");
    files.is(
        &format!("{photographs}/photograph.json"),
        "photographs",
        unknown,
        &[SCENE, "imx686", "raw.dng match"],
    );
    for (name, kind, words) in [
        ("photo.jpg", "picture", &["64 x 64 px", "the one in photograph.json"]),
        ("photo_transmission.png", "picture", &["64 x 64 px", "the one in photograph.json"]),
        ("raw.dng", "raw", &["rawpy", "the one in photograph.json"]),
    ] {
        files.is(&format!("{photographs}/{name}"), kind, whole, words);
    }
    files.is("out/input.exr", "exr", unknown, &["40 x 24 px, float", "by `glasshouse render`"]);
    files.is("runs/smoke/work.lock", "lock", whole, &["empty on purpose"]);
    let status = run_in(&folder, &["status", "runs/smoke", "--json"]).expect(0).stdout;
    files.put("status.json", status);
    files.is("status.json", "output", unknown, &["glasshouse.status/1"]);
}

fn of_a_farm(files: &mut Files) {
    let folder = files.folder.path().to_owned();
    // A scene with NaN depth is quarantined.
    files.put("nan_depth.npy", npy("(48, 64)", &[f32::NAN; 48 * 64]));
    let mut bad = scene("bad");
    bad["front"]["depth"] = json!("nan_depth.npy");
    write_lines(&folder.join("bad.jsonl"), &[scene("good"), bad]);
    run_in(&folder, &["plan", "bad.jsonl", "--out", "runs/bad"]).expect(0);
    run_in(&folder, &["work", "runs/bad"]).expect(3);
    run_in(&folder, &["pause", "runs/bad", "--reason", "backup"]).expect(0);
    files.is("bad.jsonl", "manifest", None, &["2: 2 train"]);
    files.is(
        "runs/bad",
        "run",
        Some(true),
        &["1 in quarantine", "nan_depth.npy", "paused (backup)", "retry", "resume"],
    );
    files.is(
        "runs/bad/quarantine/bad.json",
        "quarantine",
        None,
        &["nan_depth.npy", "retry RUN bad"],
    );
    files.is("runs/bad/control.json", "control", None, &["paused", "backup", "resume"]);
    let attempt = AttemptRecord {
        schema: glasshouse::run::ATTEMPT_SCHEMA.to_owned(),
        scene: SceneId::new("good").unwrap(),
        shards: [0, 4],
        n: 2,
        worker: "w-1".to_owned(),
        started_us: 1_700_000_000_000_000,
        host: "h".to_owned(),
        found: 0,
        ended: Some(Ending {
            kind: EndKind::Crashed,
            reason: "signal 9".to_owned(),
            log_tail: "out of memory\n".to_owned(),
        }),
    };
    files.put("runs/bad/attempts/good/0-4.2.json", serde_json::to_vec(&attempt).unwrap());
    files.is(
        "runs/bad/attempts/good/0-4.2.json",
        "attempt",
        None,
        &["shards 0, 4", "ended kind crashed", "signal 9", "out of memory"],
    );
    files.put("runs/bad/receipts/good.json", r#"{"schema":"glasshouse.receipt/1","scene":"good","worker":"w-1","host":"h","version":"0.1.0","with":["w-2"]}"#);
    files.is("runs/bad/receipts/good.json", "receipt", None, &["worker w-1", "with w-2", "host h"]);
    files.put(
        "runs/bad/partials/good/0-4.json",
        r#"{"schema":"glasshouse.made_by/1","shards":[0,4],"worker":"w-1","host":"h"}"#,
    );
    files.is("runs/bad/partials/good/0-4.json", "made_by", None, &["shards 0, 4", "worker w-1"]);
    files.put("finished.json", r#"{"schema":"glasshouse.finished/1","scenes":2,"quarantined":1}"#);
    files.is("finished.json", "finished", None, &["the mark of a finished run"]);
    files.put("rejected.jsonl", "{\"id\":\"a\",\"attempt\":1,\"rule\":\"black\",\"reason\":\"x\",\"front\":\"f\",\"back\":\"b\"}\n");
    files.is("rejected.jsonl", "rejected", None, &["1 draw"]);
}

fn of_inputs(files: &mut Files) {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in ["hard-cases.jsonl", "depth-ranges.toml"] {
        files.put(name, std::fs::read(repository.join("manifests").join(name)).unwrap());
    }
    files.is("hard-cases.jsonl", "manifest", None, &["33"]);
    files.is("depth-ranges.toml", "depth_ranges", None, &["26 more"]);
    let folder = files.folder.path().join("inputs");
    std::fs::create_dir(&folder).unwrap();
    photographs(&folder);
    files.is("inputs/a.png", "picture", Some(true), &["64 x 48 px"]);
    files.is("inputs/a_depth.npy", "array", None, &["48 x 64 x 1 of f4", "depth image"]);
    let mesh = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 1 9 9 9\n1 0 1 9 9 9\n0 1 1 9 9 9\n3 0 1 2\n";
    files.put("inputs/a.ply", mesh);
    files.is("inputs/a.ply", "mesh", None, &["3 vertex, 1 face"]);
    let photograph = json!({
        "schema": "glasshouse.photograph/1", "place": "indoors", "color": "a.png", "depth": "a_depth.npy",
        "intrinsics": {"fx": 64, "fy": 64, "cx": 32, "cy": 24},
    });
    files.put("inputs/list.jsonl", format!("{photograph}\n"));
    files.is("inputs/list.jsonl", "photograph_list", None, &["1 photograph"]);
}
