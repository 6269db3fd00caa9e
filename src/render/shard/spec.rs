//! `RUN/spec.json`: the settings that a run may not change.

use crate::line::{SceneLine, to_jsonl};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::PathBuf;

/// The schema name of a spec.
pub const SPEC_SCHEMA: &str = "glasshouse.spec/1";

/// A run's frozen rules. With `manifest.jsonl` beside it, it determines every pixel.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Always [`SPEC_SCHEMA`].
    pub schema: String,
    /// Name of the recipe or manifest.
    pub name: String,
    /// Scenes of the manifest.
    pub scenes: u32,
    /// BLAKE3 of `manifest.jsonl`.
    pub manifest_blake3: String,
    /// Side of a tile, px.
    pub tile_px: u32,
    /// [`crate::trace::TRACER_VERSION`] at planning.
    pub tracer_version: u32,
    /// A shard that every machine traces before it joins.
    pub golden: Golden,
    /// Folders of the named roots at planning; `--root NAME=DIR` overrides them on another machine.
    pub roots: BTreeMap<String, PathBuf>,
    /// Photographs (of a manifest: scenes) that planning left out as their files could not be used.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
}

/// The golden shard: a machine that computes other bits may not join.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Golden {
    /// Which set of built-in scenes.
    pub scene: String,
    /// BLAKE3 of all their pixels.
    pub blake3: String,
}

/// The run was planned from another recipe.
#[derive(Debug, thiserror::Error)]
#[error(
    "{} holds another run than this recipe makes:\n{diff}finish it with the recipe it was planned from, or plan \
     into a new folder with --out", run.display()
)]
pub struct SpecMismatch {
    pub run: PathBuf,
    /// The differences, one per line.
    pub diff: String,
}

/// BLAKE3 (hex) of a manifest's text.
pub fn manifest_digest(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

/// BLAKE3 (hex) of one scene line: the identity of its shards.
pub fn scene_digest(line: &SceneLine) -> String {
    manifest_digest(&to_jsonl(std::slice::from_ref(line)))
}

impl Spec {
    /// Differences between `self` (the run) and `new` (the recipe), one per line; empty if they agree.
    ///
    /// Ignores roots: they are locations, not content.
    pub fn diff(&self, old_lines: &[SceneLine], new: &Self, new_lines: &[SceneLine]) -> String {
        let mut text = String::new();
        let mut row = |what: &str, old: &dyn std::fmt::Display, new: &dyn std::fmt::Display| {
            let _ = writeln!(text, "  {what}: {old} in the run, {new} by the recipe");
        };
        if self.name != new.name {
            row("name", &self.name, &new.name);
        }
        if self.tile_px != new.tile_px {
            row("tile_px", &self.tile_px, &new.tile_px);
        }
        if self.tracer_version != new.tracer_version {
            row("tracer_version", &self.tracer_version, &new.tracer_version);
        }
        if self.golden != new.golden {
            let show = |golden: &Golden| format!("{} {}", golden.scene, golden.blake3);
            row("golden shard", &show(&self.golden), &show(&new.golden));
        }
        if self.scenes != new.scenes {
            row("scenes", &self.scenes, &new.scenes);
        }
        if self.manifest_blake3 != new.manifest_blake3 {
            text += &lines_diff(old_lines, new_lines);
        }
        text
    }
}

/// Rows of the scene lines' differences that are shown.
const SHOWN: usize = 24;

/// A key whose values differ.
struct Row {
    old: String,
    new: String,
    /// The first scene of these values.
    first: String,
    scenes: usize,
    /// All these scenes have the same values.
    is_uniform: bool,
}

/// Differences of scenes with the same id, one row per key, so that many changed seeds do not hide a changed pane.
fn lines_diff(old_lines: &[SceneLine], new_lines: &[SceneLine]) -> String {
    let by_id: BTreeMap<&str, &SceneLine> = old_lines.iter().map(|l| (l.id.as_str(), l)).collect();
    let mut rows: BTreeMap<String, Row> = BTreeMap::new();
    let mut fresh: Vec<&str> = Vec::new();
    for line in new_lines {
        let id = line.id.as_str();
        let Some(old) = by_id.get(id) else {
            fresh.push(id);
            continue;
        };
        let (mut a, mut b) = (BTreeMap::new(), BTreeMap::new());
        flatten("", &serde_json::to_value(old).unwrap_or_default(), &mut a);
        flatten("", &serde_json::to_value(line).unwrap_or_default(), &mut b);
        for key in a.keys().chain(b.keys()).collect::<BTreeSet<_>>() {
            let show = |v: Option<&String>| v.map_or("(absent)".to_owned(), Clone::clone);
            let (old, new) = (show(a.get(key)), show(b.get(key)));
            if old == new {
                continue;
            }
            let row = rows.entry(key.clone()).or_insert_with(|| Row {
                old: old.clone(),
                new: new.clone(),
                first: id.to_owned(),
                scenes: 0,
                is_uniform: true,
            });
            row.scenes += 1;
            row.is_uniform &= row.old == old && row.new == new;
        }
    }
    let mut text = String::new();
    if let Some(first) = fresh.first() {
        let scenes = scenes_text(fresh.len(), first);
        let _ = writeln!(text, "  new in the recipe: {scenes}");
    }
    for (key, row) in rows.iter().take(SHOWN) {
        let scenes = scenes_text(row.scenes, &row.first);
        let others = if row.is_uniform { "" } else { ", the others have other values" };
        let _ = writeln!(
            text,
            "  {key}: {} in the run, {} by the recipe ({scenes}{others})",
            row.old, row.new
        );
    }
    if rows.len() > SHOWN {
        let _ = writeln!(text, "  ... and {} more", rows.len() - SHOWN);
    }
    text
}

fn scenes_text(count: usize, first: &str) -> String {
    if count == 1 { format!("scene {first}") } else { format!("{count} scenes, first {first}") }
}

/// `{"a": {"b": 1}}` as `a.b -> 1`.
fn flatten(prefix: &str, value: &Value, into: &mut BTreeMap<String, String>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                let path = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
                flatten(&path, value, into);
            }
        }
        _ => {
            into.insert(prefix.to_owned(), value.to_string());
        }
    }
}
