//! Reads the images and the record of a tuple, and computes the transmittance of the glass.
//!
//! ```text
//! cargo run --release --example render_scene      # writes into target/example/
//! cargo run --release --example read_tuple        # reads the tuple
//! ```

#![allow(clippy::print_stdout, reason = "examples show their results")]

use glasshouse_line::layer::PerLayer;
use render::merge::{TupleRecord, decode_tuple_exr};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let transmitted = read(Path::new("target/example"))?;
    println!("the glass transmits {:.1} % of the light", 100.0 * transmitted);
    Ok(())
}

/// Returns the share of the light that passes through the glass.
pub(crate) fn read(folder: &Path) -> Result<f64, Box<dyn Error>> {
    // The renderer writes `tuple.json` last: if it exists, all files of the tuple exist.
    let record: TupleRecord = serde_json::from_slice(&std::fs::read(folder.join("tuple.json"))?)?;
    let film = &record.scene.film;
    println!(
        "{}: {} x {} px, {} samples a pixel, glass of {} m",
        record.scene.id,
        film.width,
        film.height,
        film.spp,
        record.scene.glass.total_thickness_m()
    );
    // Pixels are linear Rec.709, row by row. Decoding compares their size and digests with the record.
    let exr = std::fs::read(folder.join("tuple.exr"))?;
    let PerLayer([input, transmission, glass_reflection, _clean_reflection]) =
        decode_tuple_exr(&exr, &record)?;
    let sum =
        |layer: &[[f32; 3]]| -> f64 { layer.as_flattened().iter().map(|&v| f64::from(v)).sum() };
    // I - R~ is the light through the glass, and T is the same light without the losses of the glass.
    Ok((sum(&input) - sum(&glass_reflection)) / sum(&transmission))
}
