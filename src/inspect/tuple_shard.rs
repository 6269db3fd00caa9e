//! Inspects shards of exported tuples in the format of safetensors.

use super::facts::{Inspection, Problem, first_of};
use super::input::Input;
use super::kind::Kind;
use crate::export::TUPLES_SCHEMA;
use crate::text::many;
use safetensors::SafeTensors;
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};

/// Remedy for a damaged shard.
const EXPORT: &str = "`glasshouse export RUN --format safetensors` makes it again";
const SHOWN: usize = 3;

/// Inspects a shard by its header: its scenes, their tensors, and the places of the data.
pub(super) fn read(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::Tuples);
    match header(input.bytes) {
        Ok(shard) => tell(&mut found, &shard),
        Err(what) => found.wrong(Problem::new(what, EXPORT)),
    }
    found.may_be_whole("`sha256sum -c SHA256SUMS` compares its bytes");
    found
}

/// Name of a layer or label, and the type of its numbers.
type Named = (String, String);

struct Shard {
    /// Ids in the metadata.
    scenes: Vec<String>,
    /// Tensors of each id.
    tensors: BTreeMap<String, BTreeSet<Named>>,
}

/// Reads the header, and checks the places of the data. An error is a text for the user.
fn header(bytes: &[u8]) -> Result<Shard, String> {
    let failed = |e: &dyn std::fmt::Display| format!("it cannot be read: {e}");
    let read = SafeTensors::deserialize(bytes).map_err(|e| failed(&e))?;
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| failed(&e))?;
    let metadata = header.metadata().clone().unwrap_or_default();
    let schema = metadata.get("schema").map_or("", String::as_str);
    if schema != TUPLES_SCHEMA {
        return Err(format!("its schema is {schema:?} instead of {TUPLES_SCHEMA:?}"));
    }
    let scenes = metadata.get("scenes").map_or("", String::as_str);
    let scenes: Vec<String> = serde_json::from_str(scenes)
        .map_err(|e| format!("the scenes in its metadata cannot be read: {e}"))?;
    let mut tensors: BTreeMap<String, BTreeSet<Named>> = BTreeMap::new();
    for (name, tensor) in read.iter() {
        let (scene, what) = name.split_once('.').unwrap_or((name, ""));
        if !what.ends_with(".padding") {
            let named = (what.to_owned(), format!("{:?}", tensor.dtype()));
            tensors.entry(scene.to_owned()).or_default().insert(named);
        }
    }
    Ok(Shard { scenes, tensors })
}

fn tell(found: &mut Inspection, Shard { scenes, tensors }: &Shard) {
    let text = format!("{}: {}", scenes.len(), first_of(scenes, SHOWN));
    found.facts.fact("scenes", text, json!(scenes));
    let all: BTreeSet<&Named> = tensors.values().flatten().collect();
    let all: Vec<String> =
        all.iter().map(|(what, numbers)| format!("{what} ({numbers})")).collect();
    found.facts.fact("tensors", first_of(&all, all.len()), json!(all));
    let listed: BTreeSet<&String> = scenes.iter().collect();
    let there: BTreeSet<&String> = tensors.keys().collect();
    if let Some(scene) = listed.symmetric_difference(&there).next() {
        let others = many(listed.symmetric_difference(&there).count() as u64, "scene");
        let what = format!("{others}, {scene} first, are in either its metadata or its tensors");
        found.wrong(Problem::new(what, EXPORT));
    }
}
