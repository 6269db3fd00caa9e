//! Weights and moments of a checkpoint, and its state, each held against the other.

use super::facts::{Inspection, Problem, many};
use super::kind::Kind;
use super::look::Input;
use super::records::typed;
use serde_json::json;
use std::collections::BTreeMap;
use train::safetensors::{Dtype, SafeTensors};
use train::{CheckpointState, code_path};

/// What to do about a damaged checkpoint.
const TRAIN_AGAIN: &str =
    "delete its folder: `glasshouse train` goes on from the checkpoint before it";
/// Digests of the files beside `state.json`.
const STATE: &str = "state.json";

pub(super) fn read_state(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::CheckpointState);
    let Some(state) = typed::<CheckpointState>(&mut found, input, TRAIN_AGAIN) else {
        return found;
    };
    say_state(&mut found, &state);
    let mut compared = 0;
    for (name, expected) in &state.files {
        match (input.beside)(name) {
            None => {
                let what = format!("{name}, which belongs to it, is not beside it");
                found.wrong(Problem::new(what, TRAIN_AGAIN));
            }
            Some(bytes) if blake3::hash(&bytes).to_hex().as_str() != expected => {
                let what = format!("{name} beside it is not what was written: its digest differs");
                found.wrong(Problem::new(what, TRAIN_AGAIN));
            }
            Some(_) => compared += 1,
        }
    }
    found.may_be_whole(format!(
        "its digests fit the {compared} files beside it; it has no digest of its own"
    ));
    found
}

pub(super) fn say_state(found: &mut Inspection, state: &CheckpointState) {
    let facts = &mut found.facts;
    let (stage, networks) = match state.stage {
        train::Stage::Backtrack => ("backtrack", "BT-net alone"),
        train::Stage::Separation => ("separation", "SP-net and BT-net"),
    };
    facts.fact("stage", format!("{stage}: {networks}"), stage);
    facts.fact("step", crate::serve::text::grouped(state.step), state.step);
    facts.fact(
        "parameters",
        crate::serve::text::grouped(state.parameters as u64),
        state.parameters,
    );
    let psnr = state.validation_psnr_db;
    let text = psnr.map_or_else(|| "none".to_owned(), |psnr| format!("{psnr:.2} dB PSNR"));
    facts.fact("validation", text, json!(psnr));
    let settings = &state.settings;
    let text = format!(
        "width {}, crop {} px, learning rate {}",
        settings.width, settings.crop_px, settings.learning_rate
    );
    facts.say("settings", text);
    facts.put("settings", json!(settings));
    facts.fact(
        "code_path",
        state.code_path.as_str(),
        state.code_path.as_str(),
    );
    if state.code_path != code_path() {
        found.next.push(format!(
            "it was computed with {} instructions, this machine has {}: going on is allowed, the last bits differ",
            state.code_path,
            code_path()
        ));
    }
}

/// Tensors of one network.
#[derive(Default)]
struct Group {
    tensors: u64,
    numbers: u64,
    not_finite: u64,
}

/// Tensors that are listed.
const SHOWN: usize = 4;

pub(super) fn read(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::Tensors);
    let tensors = match SafeTensors::deserialize(input.bytes) {
        Ok(tensors) => tensors,
        Err(error) => {
            found.wrong(Problem::new(
                format!("it cannot be read: {error}"),
                TRAIN_AGAIN,
            ));
            return found;
        }
    };
    let mut list: Vec<(&str, _)> = tensors.iter().collect();
    list.sort_by(|a, b| a.0.cmp(b.0));
    let mut groups: BTreeMap<&str, Group> = BTreeMap::new();
    let mut shapes = serde_json::Map::new();
    for (name, tensor) in &list {
        let group = groups
            .entry(name.split('.').next().unwrap_or(name))
            .or_default();
        group.tensors += 1;
        group.numbers += tensor.shape().iter().product::<usize>() as u64;
        if tensor.dtype() == Dtype::F32 {
            let values = tensor
                .data()
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            group.not_finite += values.filter(|value| !value.is_finite()).count() as u64;
        }
        shapes.insert((*name).to_owned(), json!(tensor.shape()));
    }
    let numbers: u64 = groups.values().map(|group| group.numbers).sum();
    let text = format!(
        "{}, {} numbers",
        many(list.len() as u64, "tensor"),
        crate::serve::text::grouped(numbers)
    );
    found.facts.fact("tensors", text, list.len());
    found.facts.put("numbers", numbers);
    for (name, group) in &groups {
        let text = format!(
            "{} tensors, {} numbers",
            group.tensors,
            crate::serve::text::grouped(group.numbers)
        );
        found.facts.say(*name, text);
        if group.not_finite > 0 {
            let what = format!(
                "{} of its numbers in {name} are NaN or infinite",
                group.not_finite
            );
            found.wrong(Problem::new(
                what,
                "train again with a smaller --learning-rate, in a new run",
            ));
        }
    }
    // The largest ones say most.
    list.sort_by_key(|(name, tensor)| {
        let numbers: usize = tensor.shape().iter().product();
        (std::cmp::Reverse(numbers), *name)
    });
    for (index, (name, tensor)) in list.iter().take(SHOWN).enumerate() {
        let text = format!("{name} {:?}", tensor.shape());
        found
            .facts
            .say(if index == 0 { "shapes" } else { "" }, text);
    }
    if list.len() > SHOWN {
        found.facts.say(
            "",
            format!("and {} more; --json lists all", list.len() - SHOWN),
        );
    }
    found.facts.put("shapes", shapes);
    hold(&mut found, input);
    found
}

/// The state beside it has its digest.
fn hold(found: &mut Inspection, input: &Input) {
    let state = (input.beside)(STATE)
        .and_then(|bytes| serde_json::from_slice::<CheckpointState>(&bytes).ok());
    let Some(expected) = state.as_ref().and_then(|state| state.files.get(input.name)) else {
        found.may_be_whole("every tensor is there; no state.json beside it holds its digest");
        return;
    };
    if blake3::hash(input.bytes).to_hex().as_str() == expected {
        found.is_whole("its digest is that of state.json");
    } else {
        let what = "it is not what was written: its digest differs from that of state.json";
        found.wrong(Problem::new(what, TRAIN_AGAIN));
    }
}
