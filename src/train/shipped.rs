//! The weights that ship with the program. `weights/README.md` says how they were made.

use super::checkpoint::{Checkpoint, CheckpointError, MODEL, digest};
use candle_core::{DType, Tensor};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the shipped weights in tables and messages.
pub const SHIPPED: &str = "shipped";

/// The networks' weights, half floats.
const WEIGHTS: &[u8] = include_bytes!("weights/model.safetensors");

/// The state of the checkpoint that the weights come from, with the digest of [`WEIGHTS`].
const STATE: &[u8] = include_bytes!("weights/state.json");

impl Checkpoint {
    /// Returns the weights that ship with the program, without an optimiser's state.
    pub fn shipped() -> Result<Self, CheckpointError> {
        Self::of_model(Path::new(SHIPPED), STATE, WEIGHTS)
    }

    /// Returns the model as half floats, and the state with its digest: the files of a checkpoint with weights alone.
    pub fn packed(&self) -> Result<[Vec<u8>; 2], CheckpointError> {
        let damaged = |reason| CheckpointError::Damaged { path: self.path.clone(), reason };
        let half =
            |(name, tensor): (&String, &Tensor)| Ok((name.clone(), tensor.to_dtype(DType::F16)?));
        let halves: BTreeMap<String, Tensor> =
            self.model.iter().map(half).collect::<candle_core::Result<_>>()?;
        let halves = safetensors::serialize(halves, None).map_err(|e| damaged(e.to_string()))?;
        let mut state = self.state.clone();
        state.files = BTreeMap::from([(MODEL.to_owned(), digest(&halves))]);
        let mut json = serde_json::to_vec_pretty(&state).map_err(|e| damaged(e.to_string()))?;
        json.push(b'\n');
        Ok([halves, json])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Separator;
    use plan::NetworkKind;

    #[test]
    fn the_shipped_weights_are_small_and_work() {
        assert!(WEIGHTS.len() <= 2_000_000, "{} bytes", WEIGHTS.len());
        let shipped = Checkpoint::shipped().unwrap();
        assert_eq!(shipped.state.settings.network, NetworkKind::Unet);
        assert!(shipped.state.baselines.is_some());
        assert!(shipped.state.origin.vgg_blake3.is_none());
        assert!(shipped.state.origin.real_files_blake3.is_none());
        Separator::new(&shipped, None, None).unwrap();
        // The folder of these files is a checkpoint with weights alone.
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("weights");
        let read = Checkpoint::read(&folder).unwrap();
        assert_eq!((&read.state, read.moments.len()), (&shipped.state, 0));
        // Packing halves again changes nothing.
        let [weights, state] = shipped.packed().unwrap();
        assert!(weights == WEIGHTS);
        assert_eq!(
            Checkpoint::of_model(Path::new(SHIPPED), &state, &weights).unwrap().state,
            shipped.state
        );
    }
}
