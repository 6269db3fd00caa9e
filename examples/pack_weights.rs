//! Makes a small checkpoint with weights alone, as half floats, such as that which ships with the program. `separate` and
//! `evaluate` read it; no training resumes from it.
//!
//! ```text
//! cargo run --release --example pack_weights -- RUN/train/NAME/separation/step-0025000 src/train/weights
//! ```

#![allow(clippy::print_stdout, reason = "examples show their results")]

use render::atomic_file;
use std::error::Error;
use std::path::Path;
use train::Checkpoint;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [checkpoint, folder] = &arguments[..] else {
        return Err(
            "give the folder of a checkpoint and the folder for model.safetensors and state.json"
                .into(),
        );
    };
    let bytes = pack(Path::new(checkpoint), Path::new(folder))?;
    println!("{folder}/model.safetensors has {bytes} bytes");
    Ok(())
}

/// Writes both files and returns the size of the weights, bytes.
pub(crate) fn pack(checkpoint: &Path, folder: &Path) -> Result<usize, Box<dyn Error>> {
    atomic_file::create_dir(folder)?;
    let [weights, state] = Checkpoint::read(checkpoint)?.packed()?;
    atomic_file::write(&folder.join("model.safetensors"), &weights)?;
    atomic_file::write(&folder.join("state.json"), &state)?;
    Ok(weights.len())
}
