//! Inspects the parts of a checkpoint that need the trainer: the type of the state, and the tensors.

use super::digests::{CheckpointDigests, Digested};
use super::facts::{Inspection, Problem};
use super::input::Input;
use super::record::typed;
use crate::text::{grouped, many};
use serde_json::json;
use std::collections::BTreeMap;
use train::safetensors::{Dtype, SafeTensors};
use train::{CheckpointState, code_path};

/// Checks `state.json` by its type, and compares its instruction set with that of this machine.
pub(super) fn check_state(found: &mut Inspection, input: &Input) {
    if !found.is_sound() {
        return;
    }
    let state = typed::<CheckpointState>(found, input, CheckpointDigests::TO_DO);
    if let Some((state, _)) = state.filter(|(state, _)| state.code_path != code_path()) {
        found.next.push(format!(
            "it was computed with {} instructions, but this machine has {}: training resumes, but the last bits differ",
            state.code_path,
            code_path()
        ));
    }
}

/// Numbers of tensors, of values, and of non-finite 32-bit values of one network.
type Group = [u64; 3];

/// Adds the networks of a safetensors file and the shapes of its tensors. Non-finite values become problems.
pub(super) fn tell(found: &mut Inspection, input: &Input) {
    let tensors = match SafeTensors::deserialize(input.bytes) {
        Ok(tensors) => tensors,
        Err(error) => {
            let what = format!("it cannot be read: {error}");
            found.wrong(Problem::new(what, CheckpointDigests::TO_DO));
            return;
        }
    };
    let mut groups: BTreeMap<String, Group> = BTreeMap::new();
    let mut shapes = BTreeMap::new();
    for (name, tensor) in tensors.tensors() {
        let network = name.split('.').next().unwrap_or(&name).to_owned();
        let group = groups.entry(network).or_default();
        group[0] += 1;
        group[1] += tensor.shape().iter().product::<usize>() as u64;
        if tensor.dtype() == Dtype::F32 {
            let values = tensor.data().chunks_exact(4);
            let values = values.map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
            group[2] += values.filter(|value| !value.is_finite()).count() as u64;
        }
        shapes.insert(name, tensor.shape().to_vec());
    }
    let numbers: u64 = groups.values().map(|group| group[1]).sum();
    let text = format!("{}, {} numbers", many(shapes.len() as u64, "tensor"), grouped(numbers));
    found.facts.fact("tensors", text, shapes.len());
    found.facts.put("numbers", numbers);
    for (name, [tensors, numbers, not_finite]) in groups {
        let text = format!("{tensors} tensors, {} numbers", grouped(numbers));
        found.facts.say(name.as_str(), text);
        if not_finite > 0 {
            found.wrong(Problem::new(
                format!("{not_finite} of the numbers in {name} are NaN or infinite"),
                "train again with a smaller --learning-rate, in a new run",
            ));
        }
    }
    found.facts.put("shapes", json!(shapes));
}
