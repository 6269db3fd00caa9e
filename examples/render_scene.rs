//! Renders a scene of 256 x 192 px from two procedural photographs, in about a second.
//!
//! ```text
//! cargo run --release --example render_scene      # writes into target/example/
//! ```

#![allow(clippy::print_stdout, reason = "examples show their results")]

use compose::write_tuple;
use glasshouse_line::{Roots, parse_scene};
use render::job::{SceneJob, render_partials};
use render::merge::combine;
use render::scene::{load, read_files};
use render::shard::ShardLayout;
use render::trace::Isa;
use std::error::Error;
use std::path::Path;
use std::sync::atomic::AtomicBool;

fn main() -> Result<(), Box<dyn Error>> {
    render(Path::new("target/example"))
}

pub(crate) fn render(folder: &Path) -> Result<(), Box<dyn Error>> {
    // A photograph is a colour image, its depth in metres, and a mask of the pixels with known depth.
    let mut sides = Vec::new();
    for photograph in procedural::listing(2, 7) {
        procedural::write(folder, &photograph, 256, 192)?;
        sides.push(serde_json::json!({
            "color": photograph.color_path(),
            "depth": photograph.depth_path(),
            "mask": photograph.mask_path(),
            "intrinsics": { "fx": 886.81, "fy": 927.06, "cx": 512.0, "cy": 384.0, "size": [1024, 768] },
        }));
    }
    // A scene line and the input files determine the pixels on every machine. Omitted parameters have defaults.
    let line = serde_json::json!({
        "schema": "glasshouse.scene/1", "id": "example", "seed": 1,
        "film": { "width": 256, "height": 192, "spp": 64 },
        "camera": { "focal_length_mm": 55.0, "aperture_radius_m": 0.0089, "focus": { "at": "front_center" } },
        "glass": { "distance_m": 0.4, "thickness_m": 0.01, "ior": 1.5, "tilt_deg": [0.0, 20.0] },
        "front": sides[0], "back": sides[1],
    });
    let line = parse_scene(&line.to_string())?;

    // Files -> two textured surfaces -> shards, traced by two threads -> four images.
    let files = read_files(&line, &Roots::default(), folder)?;
    let (tile_px, threads) = (64, 2);
    let job = SceneJob::new(&line, ShardLayout::of(&line, tile_px), load(&line, &files)?);
    let never = AtomicBool::new(false);
    let partials =
        render_partials(&job, threads, Isa::detect(), &never, &|| {}).ok_or("stopped")?;
    let tuple = combine(&line, tile_px, &partials)?;
    write_tuple(&tuple, folder)?;
    for (name, layer) in &tuple.record.layers {
        println!("{name}: mean {:.4}", layer.mean);
    }
    println!("look at {}", folder.join("input.png").display());
    Ok(())
}
