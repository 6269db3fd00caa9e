//! `RUN/spec.json`: the settings of a run that must not change.

use glasshouse_line::{SceneLine, to_jsonl};
use serde::{Deserialize, Deserializer, Serialize, de};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::PathBuf;

/// Schema name of `spec.json`.
pub const SPEC_SCHEMA: &str = "glasshouse.spec/1";

/// Largest side of a tile, px: that of the largest film.
pub const MAX_TILE_PX: u32 = 16_384;

/// Reads the side of a tile. A division into tiles of other sides would fail later.
fn tile_px<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    let found = u32::deserialize(deserializer)?;
    if (1..=MAX_TILE_PX).contains(&found) {
        return Ok(found);
    }
    Err(de::Error::custom(format!("tile_px is {found}, but must be 1 to {MAX_TILE_PX}")))
}

/// Settings of a run that must not change. The spec, `manifest.jsonl` and the input files determine every pixel.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Always [`SPEC_SCHEMA`].
    pub schema: String,
    /// Name of the recipe or manifest.
    pub name: String,
    /// Number of scenes in the manifest.
    pub scenes: u32,
    /// BLAKE3 of `manifest.jsonl`.
    pub manifest_blake3: String,
    /// Side of a tile, px, from 1 to [`MAX_TILE_PX`].
    #[serde(deserialize_with = "tile_px")]
    pub tile_px: u32,
    /// [`crate::trace::TRACER_VERSION`] at planning.
    pub tracer_version: u32,
    /// Golden shard that every machine traces before it joins.
    pub golden: Golden,
    /// Folders of the named roots at planning; `--root NAME=DIR` overrides them on another machine.
    pub roots: BTreeMap<String, PathBuf>,
    /// Photographs of a recipe, or scenes of a manifest, that planning left out because their files could not be used.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
}

/// The golden shard. A machine that computes other bits must not join.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Golden {
    /// Name of the set of built-in scenes.
    pub scene: String,
    /// BLAKE3 of the digests of these scenes.
    pub blake3: String,
}

/// Differences between a run and the recipe that should continue it.
#[derive(Debug, thiserror::Error)]
#[error(
    "{} contains the run of another recipe:\n{diff}finish it with that recipe, or plan into a new folder with --out",
    run.display()
)]
pub struct SpecMismatch {
    pub run: PathBuf,
    /// Text of the differences, one per line.
    pub diff: String,
}

/// Computes the BLAKE3 digest (hex) of a manifest's text.
pub fn manifest_digest(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

/// Computes the BLAKE3 digest (hex) of one scene line, which identifies the scene in its partials.
pub fn scene_digest(line: &SceneLine) -> String {
    manifest_digest(&to_jsonl(std::slice::from_ref(line)))
}

impl Spec {
    /// Lists the differences between `self` (the run) and `new` (the recipe), one per line. Equal specs have none.
    ///
    /// Ignores `roots`, which are locations and not content, and `left_out`.
    pub fn diff(&self, old_lines: &[SceneLine], new: &Self, new_lines: &[SceneLine]) -> String {
        let mut text = String::new();
        let mut row = |what: &str, old: &dyn std::fmt::Display, new: &dyn std::fmt::Display| {
            let _ = writeln!(text, "  {what}: {old} in the run, {new} from the recipe");
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

/// Largest number of printed rows with differences of scene lines.
const SHOWN: usize = 24;

/// Difference in the values of one key.
struct Row {
    old: String,
    new: String,
    /// Id of the first scene with these values.
    first: String,
    scenes: usize,
    /// True if all scenes that differ in this key have these values.
    is_uniform: bool,
}

/// Lists new scenes, and differences of scenes with equal ids by key, so that changed seeds do not hide a changed pane.
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
        let others = if row.is_uniform { "" } else { ", with different values" };
        let _ = writeln!(
            text,
            "  {key}: {} in the run, {} from the recipe ({scenes}{others})",
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

/// Flattens JSON to dotted keys: `{"a": {"b": 1}}` becomes `a.b -> 1`.
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
