//! Makes the weights that ship with the program from a checkpoint: half floats, and the checkpoint's state.
//!
//! ```text
//! cargo run --release --example pack_weights -- RUN/train/NAME/separation/step-0012000 src/train/weights
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
            "give the folder of a checkpoint and the folder for unet.safetensors and unet.json"
                .into(),
        );
    };
    let bytes = pack(Path::new(checkpoint), Path::new(folder))?;
    println!("{folder}/unet.safetensors has {bytes} bytes");
    Ok(())
}

/// Writes both files and returns the size of the weights, bytes.
pub(crate) fn pack(checkpoint: &Path, folder: &Path) -> Result<usize, Box<dyn Error>> {
    let [weights, state] = Checkpoint::read(checkpoint)?.packed()?;
    atomic_file::write(&folder.join("unet.safetensors"), &weights)?;
    atomic_file::write(&folder.join("unet.json"), &state)?;
    Ok(weights.len())
}
