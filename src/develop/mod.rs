//! Photographs of a run's tuples by another camera, without tracing: `OUT/<scene>/photo.jpg` and the others.
//!
//! `OUT/develop.json` identifies run and sensor; a scene's `photograph.json`, its last file, marks its photographs as complete,
//! so that the same call resumes; photographs of another tuple, and damaged ones, are made again. Photographs are functions of the tuple, the scene's seed and the drawn sensor: the sensor of a
//! scene's line gives the bytes that the merge wrote.

mod error;
mod scene;

pub use error::DevelopError;
pub use scene::{PHOTOGRAPH_RECORD, PHOTOGRAPHS_SCHEMA, PhotographsRecord};

use crate::made::{Digests, Files, Remade};
use crate::outputs::is_empty;
use crate::run::{AccessError, Run, Scope, Snapshot, keys};
use crate::store::Store;
use glasshouse_line::ids::SceneId;
use glasshouse_line::{SENSOR_VERSION, SceneLine, Split};
use plan::SensorFile;
use rayon::prelude::*;
use render::atomic_file;
use scene::Photographed;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Name of the record of a folder of photographs.
pub const REQUEST_FILE: &str = "develop.json";
/// Schema of [`REQUEST_FILE`].
pub const REQUEST_SCHEMA: &str = "glasshouse.developed/1";

/// Identity of a folder of photographs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DevelopRequest {
    /// [`REQUEST_SCHEMA`].
    pub schema: String,
    /// Name of the run.
    pub name: String,
    pub manifest_blake3: String,
    pub tracer_version: u32,
    pub sensor_version: u32,
    /// BLAKE3 of the sensor's file.
    pub sensor_blake3: String,
}

/// Result of a call, with the keys of `glasshouse.develop/1`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Developed {
    /// Number of scenes with photographs by this call.
    pub scenes: u64,
    /// Number of scenes with photographs by earlier calls.
    pub scenes_resumed: u64,
    /// Scenes of `scenes` whose photographs by earlier calls were not those of the present tuple and sensor.
    #[serde(skip_serializing_if = "Remade::is_none")]
    pub remade: Remade,
    /// Scenes without a tuple.
    pub missing: Vec<SceneId>,
    /// Scenes with an unusable tuple, and the reason.
    pub failed: Vec<(SceneId, String)>,
    /// True if the stop flag ended the call early; the same call resumes.
    #[serde(skip)]
    pub stopped: bool,
}

/// The sensor of a call and its work.
pub struct DevelopWork<'a> {
    /// Bytes of the sensor's file, for its digest.
    pub sensor_text: &'a str,
    pub sensor: &'a SensorFile,
    pub splits: &'a BTreeSet<Split>,
    pub threads: usize,
    /// True to read all photographs and tuples, also where nothing seems to have changed.
    pub verify: bool,
    /// Flag that ends the call after the scenes in progress.
    pub stop: &'a AtomicBool,
    /// Called after each scene; true if an earlier call photographed it.
    pub on_scene: &'a (dyn Fn(bool) + Sync),
}

impl DevelopRequest {
    fn new(run: &Run, sensor_text: &str) -> Self {
        Self {
            schema: REQUEST_SCHEMA.to_owned(),
            name: run.spec.name.clone(),
            manifest_blake3: run.spec.manifest_blake3.clone(),
            tracer_version: run.spec.tracer_version,
            sensor_version: SENSOR_VERSION,
            sensor_blake3: blake3::hash(sensor_text.as_bytes()).to_hex().to_string(),
        }
    }

    /// Claims a folder: a new or empty one, or one with photographs of the same request.
    fn claim(&self, out: &Path) -> Result<(), DevelopError> {
        let path = out.join(REQUEST_FILE);
        let read = |e| DevelopError::Read { path: path.clone(), source: e };
        if path.exists() {
            let bytes = render::input_file::read(&path).map_err(read)?;
            return match serde_json::from_slice::<Self>(&bytes) {
                Ok(there) if there == *self => Ok(()),
                _ => Err(DevelopError::Foreign { out: out.to_owned() }),
            };
        }
        atomic_file::create_dir(out)?;
        if !is_empty(out).map_err(read)? {
            return Err(DevelopError::Foreign { out: out.to_owned() });
        }
        let json = serde_json::to_string_pretty(self).expect("the request is plain data");
        Ok(atomic_file::write(&path, format!("{json}\n").as_bytes())?)
    }
}

/// Returns the scenes of the splits, in the order of the manifest.
pub fn scenes_of<'a>(run: &'a Run, splits: &BTreeSet<Split>) -> Vec<(usize, &'a SceneLine)> {
    run.lines.iter().enumerate().filter(|(_, line)| splits.contains(&line.split)).collect()
}

/// Photographs the finished scenes of a run.
pub fn develop(
    run: &Run,
    store: &Store,
    out: &Path,
    work: &DevelopWork,
) -> Result<Developed, DevelopError> {
    DevelopRequest::new(run, work.sensor_text).claim(out)?;
    let snapshot = Snapshot::take(run, store, Scope::DONE).map_err(AccessError::from)?;
    let scenes = scenes_of(run, work.splits);
    let (done, missing): (Vec<_>, Vec<_>) =
        scenes.into_iter().partition(|(number, _)| snapshot.is_done(*number));
    let mut developed = Developed {
        missing: missing.into_iter().map(|(_, line)| line.id.clone()).collect(),
        ..Developed::default()
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(work.threads)
        .build()
        .map_err(|e| DevelopError::Threads(e.to_string()))?;
    let tuples = Files::objects(store, keys::TUPLES)?;
    let digests = Digests::open(out, work.verify);
    let places = scene::Places { store, tuples: &tuples, out, digests: &digests };
    let one = |line: &SceneLine| {
        if work.stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let result = scene::photograph(&places, line, &work.sensor.draw(line.id.as_str()));
        (work.on_scene)(matches!(result, Ok(Photographed::Found)));
        result.map(Some)
    };
    let results: Vec<_> = pool.install(|| done.par_iter().map(|(_, line)| one(line)).collect());
    digests.write(out)?;
    for ((_, line), result) in done.iter().zip(results) {
        match result {
            Ok(Some(Photographed::Found)) => developed.scenes_resumed += 1,
            Ok(Some(Photographed::Now(differences))) => {
                developed.scenes += 1;
                if !differences.is_empty() {
                    developed.remade.add(1, &differences);
                }
            }
            Ok(None) => developed.stopped = true,
            Err(error) if error.is_of_tuple() => {
                developed.failed.push((line.id.clone(), error.to_string()));
            }
            Err(error) => return Err(error),
        }
    }
    Ok(developed)
}
