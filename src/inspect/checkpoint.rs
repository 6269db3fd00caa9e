//! Inspects state and tensors of a checkpoint, and compares them with each other. Lists tensors only if the program was
//! built with the trainer.

use super::digests::{CheckpointDigests, Digested, hold_file, hold_record};
use super::facts::Inspection;
use super::input::Input;
use super::kind::Kind;
use super::record::typed;
#[cfg(feature = "train")]
use super::tensors::{check_state, tell};
use crate::text::grouped;
use serde_json::{Map, Value};

pub(super) fn read_state(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::CheckpointState);
    let to_do = CheckpointDigests::TO_DO;
    let state = typed::<CheckpointDigests>(&mut found, input, to_do);
    let Some((digests, state)) = state else {
        return found;
    };
    #[cfg(feature = "train")]
    check_state(&mut found, input);
    say_state(&mut found, &state);
    hold_record(&mut found, input, &digests);
    found
}

fn say_state(found: &mut Inspection, state: &Map<String, Value>) {
    let of = |key: &str| state.get(key).cloned().unwrap_or_default();
    let facts = &mut found.facts;
    let networks = match of("stage").as_str() {
        Some("backtrack") => "backtrack: BT-net alone",
        Some("separation") => "separation: SP-net and BT-net",
        _ => "unknown",
    };
    facts.fact("stage", networks, of("stage"));
    facts.value("step", of("step"));
    let parameters = of("parameters").as_u64().map_or_else(String::new, grouped);
    facts.fact("parameters", parameters, of("parameters"));
    let psnr = of("validation_psnr_db");
    let text = psnr.as_f64().map_or_else(|| "none".to_owned(), |psnr| format!("{psnr:.2} dB PSNR"));
    facts.fact("validation", text, psnr);
    let settings = of("settings");
    let text = format!(
        "width {}, crop {} px, learning rate {}",
        settings["width"], settings["crop_px"], settings["learning_rate"]
    );
    facts.fact("settings", text, settings);
    facts.value("code_path", of("code_path"));
}

pub(super) fn read_tensors(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::Tensors);
    #[cfg(feature = "train")]
    tell(&mut found, input);
    hold_file::<CheckpointDigests>(&mut found, input);
    found
}
