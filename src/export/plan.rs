//! Which scenes of a run are exported, in which order, and which are not.

use super::error::ExportError;
use super::request::{EXPORT_REQUEST_SCHEMA, ExportFormat, ExportRequest, PixelEncoding, check};
use crate::run::{AccessError, Run, Scope, Snapshot};
use crate::store::Store;
use render::ids::SceneId;
use render::line::Split;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A scene that is not exported.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeftOut {
    pub scene: SceneId,
    /// Why it is in quarantine; `null` if it was not merged yet.
    pub reason: Option<String>,
}

/// What a user asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportOptions {
    pub format: ExportFormat,
    /// How pixels are stored.
    pub encoding: PixelEncoding,
    pub splits: BTreeSet<Split>,
    /// A WebDataset shard has at most so many megabytes (1e6 bytes), or one tuple.
    pub shard_mb: u32,
    /// Scenes that are not merged yet are left out, too.
    pub partial: bool,
}

/// What will be exported.
#[derive(Clone, Debug)]
pub struct ExportPlan {
    /// What goes into `export.json`.
    pub request: ExportRequest,
    /// Places in the manifest: split by split, sorted as the names of their files are.
    pub scenes: Vec<usize>,
    /// Layers that some scene has, in the tuples' order.
    pub layers: [bool; 4],
}

impl ExportPlan {
    /// Looks at what is there of the run.
    pub fn new(run: &Run, store: &Store, options: &ExportOptions) -> Result<Self, ExportError> {
        check(options.format, options.encoding)?;
        let snapshot = Snapshot::take(run, store, Scope::DONE).map_err(AccessError::from)?;
        let mut left_out = Vec::new();
        let mut missing = 0;
        let asked: Vec<usize> = scenes(run, &options.splits);
        for &scene in asked.iter().filter(|&&scene| !snapshot.is_done(scene)) {
            let reason = snapshot.reason(scene);
            let reason = reason.map(|reason| without_places(run, reason));
            missing += usize::from(reason.is_none());
            left_out.push(LeftOut { scene: run.lines[scene].id.clone(), reason });
        }
        if asked.is_empty() {
            let reason = "the run was planned without scenes of that split; give another --split";
            return Err(ExportError::Nothing(reason.to_owned()));
        }
        if missing > 0 && !options.partial {
            return Err(ExportError::Unfinished { missing, scenes: asked.len() });
        }
        if left_out.len() == asked.len() {
            let reason = "no scene has a tuple; see `glasshouse status RUN`";
            return Err(ExportError::Nothing(reason.to_owned()));
        }
        let is_webdataset = options.format == ExportFormat::Webdataset;
        let request = ExportRequest {
            schema: EXPORT_REQUEST_SCHEMA.to_owned(),
            name: run.spec.name.clone(),
            manifest_blake3: run.spec.manifest_blake3.clone(),
            tracer_version: run.spec.tracer_version,
            format: options.format,
            encoding: options.encoding,
            splits: options.splits.iter().copied().collect(),
            shard_mb: is_webdataset.then_some(options.shard_mb),
            left_out,
        };
        Ok(Self::of(run, request))
    }

    /// The plan of a request that stands already.
    pub(super) fn of(run: &Run, request: ExportRequest) -> Self {
        let out: BTreeSet<&SceneId> = request.left_out.iter().map(|l| &l.scene).collect();
        let splits = request.splits.iter().copied().collect();
        let mut scenes = scenes(run, &splits);
        scenes.retain(|&scene| !out.contains(&run.lines[scene].id));
        let mut layers = [false; 4];
        for &scene in &scenes {
            let asked = run.lines[scene].film.layers.asked();
            layers = std::array::from_fn(|k| layers[k] | asked.0[k]);
        }
        Self { request, scenes, layers }
    }

    /// Scenes that are left out because they are in quarantine, with their reasons.
    pub fn quarantined(&self) -> impl Iterator<Item = (&SceneId, &str)> {
        let left_out = self.request.left_out.iter();
        left_out.filter_map(|l| Some((&l.scene, l.reason.as_deref()?)))
    }

    /// Scenes that are left out because they are not merged yet.
    pub fn missing(&self) -> usize {
        let left_out = self.request.left_out.iter();
        left_out.filter(|l| l.reason.is_none()).count()
    }
}

/// All scenes of some splits. The dot is what follows an id in the names of files: `a-1.json` comes before `a.json`.
fn scenes(run: &Run, splits: &BTreeSet<Split>) -> Vec<usize> {
    let mut scenes: Vec<usize> =
        (0..run.lines.len()).filter(|&scene| splits.contains(&run.lines[scene].split)).collect();
    scenes.sort_by_cached_key(|&scene| {
        let line = &run.lines[scene];
        (line.split, format!("{}.", line.id))
    });
    scenes
}

/// A reason without the folders of this machine: an export tells nobody where it was made.
fn without_places(run: &Run, reason: &str) -> String {
    let named = run.spec.roots.keys();
    let mut places: Vec<(String, String)> = named
        .filter_map(|name| {
            Some((format!("{}/", run.roots.get(name)?.display()), format!("{name}:")))
        })
        .collect();
    places.push((format!("{}/", run.root().display()), String::new()));
    // A root may lie in the run's folder.
    places.sort_by_key(|(place, _)| std::cmp::Reverse(place.len()));
    let text = reason.to_owned();
    places.iter().fold(text, |text, (place, name)| text.replace(place, name))
}
