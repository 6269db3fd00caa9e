//! Selects and orders the exported scenes.

use super::error::ExportError;
use super::request::{EXPORT_REQUEST_SCHEMA, ExportFormat, ExportRequest, PixelEncoding, check};
use crate::run::{AccessError, Run, Scope, Snapshot};
use crate::store::Store;
use glasshouse_line::Split;
use glasshouse_line::ids::SceneId;
use glasshouse_line::label::LabelSet;
use glasshouse_line::layer::Layer;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A scene that is not exported.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeftOut {
    pub scene: SceneId,
    /// Reason for the quarantine; `null` for a scene that is not merged yet.
    pub reason: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportOptions {
    pub format: ExportFormat,
    pub encoding: PixelEncoding,
    pub splits: BTreeSet<Split>,
    /// Maximum size of a shard, megabytes (1e6 bytes); a shard with a single tuple may be larger.
    pub shard_mb: u32,
    /// True to leave out scenes that are not merged yet.
    pub partial: bool,
}

#[derive(Clone, Debug)]
pub struct ExportPlan {
    /// Content of `export.json`.
    pub request: ExportRequest,
    /// Indices of the exported scenes in the manifest: split by split, in the order of file names.
    pub scenes: Vec<usize>,
    /// True for each layer that any exported scene has, in the order of [`Layer::ALL`].
    pub layers: [bool; 4],
    /// Labels that any exported scene has.
    pub labels: LabelSet,
}

impl ExportPlan {
    /// Selects scenes from the run's current tuples.
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
            let reason = "the run has no scene of this split; give another --split";
            return Err(ExportError::Nothing(reason.to_owned()));
        }
        if missing > 0 && !options.partial {
            return Err(ExportError::Unfinished { missing, scenes: asked.len() });
        }
        if left_out.len() == asked.len() {
            let reason = "no scene has a tuple; see `glasshouse status RUN`";
            return Err(ExportError::Nothing(reason.to_owned()));
        }
        if options.encoding == PixelEncoding::Photograph
            && let Some(&scene) = asked.iter().find(|&&scene| run.lines[scene].sensor.is_none())
        {
            return Err(ExportError::Nothing(format!(
                "scene {} has no photographs: render a recipe with [sensor], or photograph the run with `glasshouse develop`",
                run.lines[scene].id
            )));
        }
        let request = ExportRequest {
            schema: EXPORT_REQUEST_SCHEMA.to_owned(),
            name: run.spec.name.clone(),
            manifest_blake3: run.spec.manifest_blake3.clone(),
            tracer_version: run.spec.tracer_version,
            format: options.format,
            encoding: options.encoding,
            splits: options.splits.iter().copied().collect(),
            shard_mb: options.format.shard_ending().map(|_| options.shard_mb),
            left_out,
        };
        Ok(Self::of(run, request))
    }

    /// Makes the plan of an existing request.
    pub(super) fn of(run: &Run, request: ExportRequest) -> Self {
        let out: BTreeSet<&SceneId> = request.left_out.iter().map(|l| &l.scene).collect();
        let splits = request.splits.iter().copied().collect();
        let mut scenes = scenes(run, &splits);
        scenes.retain(|&scene| !out.contains(&run.lines[scene].id));
        let (mut layers, mut labels) = ([false; 4], LabelSet::default());
        for &scene in &scenes {
            let asked = run.lines[scene].film.layers.asked();
            layers = std::array::from_fn(|k| layers[k] | asked.0[k]);
            for label in run.lines[scene].film.layers.labels().iter() {
                labels.insert(label);
            }
        }
        Self { request, scenes, layers, labels }
    }

    /// Returns the indices and names of the exported layers.
    pub(super) fn layers(&self) -> impl Iterator<Item = (usize, &'static str)> {
        let encoding = self.request.encoding;
        let is_exported = move |layer: usize| self.layers[layer] && encoding.has(layer);
        Layer::NAMES.into_iter().enumerate().filter(move |(layer, _)| is_exported(*layer))
    }

    /// Returns the quarantined scenes and their reasons.
    pub fn quarantined(&self) -> impl Iterator<Item = (&SceneId, &str)> {
        let left_out = self.request.left_out.iter();
        left_out.filter_map(|l| Some((&l.scene, l.reason.as_deref()?)))
    }

    /// Counts the scenes that the export leaves out because they are not merged yet.
    pub fn missing(&self) -> usize {
        let left_out = self.request.left_out.iter();
        left_out.filter(|l| l.reason.is_none()).count()
    }
}

/// Lists all scenes of some splits, in the order of file names: a dot follows the id, so `a-1.json` precedes `a.json`.
fn scenes(run: &Run, splits: &BTreeSet<Split>) -> Vec<usize> {
    let mut scenes: Vec<usize> =
        (0..run.lines.len()).filter(|&scene| splits.contains(&run.lines[scene].split)).collect();
    scenes.sort_by_cached_key(|&scene| {
        let line = &run.lines[scene];
        (line.split, format!("{}.", line.id))
    });
    scenes
}

/// Replaces the folders of roots in a reason by the roots' names, and removes the run's folder, to hide these paths.
fn without_places(run: &Run, reason: &str) -> String {
    let named = run.spec.roots.keys();
    let mut places: Vec<(String, String)> = named
        .filter_map(|name| {
            Some((format!("{}/", run.roots.get(name)?.display()), format!("{name}:")))
        })
        .collect();
    places.push((format!("{}/", run.root().display()), String::new()));
    // The longest path comes first, because a root may lie in the run's folder.
    places.sort_by_key(|(place, _)| std::cmp::Reverse(place.len()));
    let text = reason.to_owned();
    places.iter().fold(text, |text, (place, name)| text.replace(place, name))
}
