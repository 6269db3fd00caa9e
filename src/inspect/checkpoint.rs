//! What a training leaves: `state.json`, tensors and event files. Without the feature `train` their insides cannot be read.

#[cfg(not(feature = "train"))]
use super::facts::Inspection;
#[cfg(not(feature = "train"))]
use super::kind::Kind;
#[cfg(not(feature = "train"))]
use super::look::Input;

#[cfg(feature = "train")]
pub(super) use super::events::read as read_events;
#[cfg(feature = "train")]
pub(super) use super::tensors::{read as read_tensors, read_state};

/// What is said of a file that this program was built without a reader for.
#[cfg(not(feature = "train"))]
fn unread(kind: Kind, what: &str) -> Inspection {
    let mut found = Inspection::new(kind);
    found.may_be_whole(format!(
        "this program was built without the feature `train`: it cannot read {what}"
    ));
    found
        .next
        .push("use a program that was built with the feature `train`".to_owned());
    found
}

#[cfg(not(feature = "train"))]
pub(super) fn read_events(_: &Input) -> Inspection {
    unread(Kind::Events, "checksums of events")
}

#[cfg(not(feature = "train"))]
pub(super) fn read_tensors(_: &Input) -> Inspection {
    unread(Kind::Tensors, "tensors")
}

/// The state is JSON; digests are told, settings are not.
#[cfg(not(feature = "train"))]
pub(super) fn read_state(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::CheckpointState);
    let state = super::records::typed::<serde_json::Value>(&mut found, input, super::look::AGAIN);
    if let Some(state) = state {
        for key in ["stage", "step", "parameters", "validation_psnr_db"] {
            found
                .facts
                .fact(key, state[key].to_string(), state[key].clone());
        }
        found.may_be_whole(
            "this program was built without the feature `train`: digests are not compared",
        );
    }
    found
}
