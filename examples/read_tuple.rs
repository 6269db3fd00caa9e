//! Reads the images and the record of a tuple, and measures how much light the glass takes.
//!
//! ```text
//! cargo run --release --example render_scene      # writes into target/example/
//! cargo run --release --example read_tuple        # reads it
//! ```

#![allow(clippy::print_stdout, reason = "examples show their results")]

use render::layer::PerLayer;
use render::merge::{TupleRecord, decode_tuple_exr};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let transmitted = read(Path::new("target/example"))?;
    println!("the glass transmits {:.1} % of the light", 100.0 * transmitted);
    Ok(())
}

/// The light that passes the glass, as a share of the light that reaches it.
pub(crate) fn read(folder: &Path) -> Result<f64, Box<dyn Error>> {
    // `tuple.json` is written last: where it is, all files of the tuple are.
    let record: TupleRecord = serde_json::from_slice(&std::fs::read(folder.join("tuple.json"))?)?;
    let film = &record.scene.film;
    println!(
        "{}: {} x {} px, {} samples a pixel, glass of {} m",
        record.scene.id, film.width, film.height, film.spp, record.scene.glass.thickness_m
    );
    // Linear Rec.709, row by row; checked against the size and the digests of the record.
    let exr = std::fs::read(folder.join("tuple.exr"))?;
    let PerLayer([input, transmission, glass_reflection, _clean_reflection]) =
        decode_tuple_exr(&exr, &record)?;
    let sum =
        |layer: &[[f32; 3]]| -> f64 { layer.as_flattened().iter().map(|&v| f64::from(v)).sum() };
    // I = what passes the glass + R~, and T is the same light without the glass's loss.
    Ok((sum(&input) - sum(&glass_reflection)) / sum(&transmission))
}
