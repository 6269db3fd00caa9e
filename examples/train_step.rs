//! Takes ten training steps of small networks on one tuple.
//!
//! ```text
//! cargo run --release --example render_scene      # writes into target/example/
//! cargo run --release --example train_step        # learns from the tuple
//! ```

#![allow(clippy::print_stdout, reason = "examples show their results")]

use std::error::Error;
use std::path::Path;
use train::{Batch, Cut, Example, Learner, Planes, Stage, TrainSettings, planes_of_bytes};

fn main() -> Result<(), Box<dyn Error>> {
    for (step, loss) in (1..).zip(train(Path::new("target/example"), 10)?) {
        println!("step {step}: loss {loss:.4}");
    }
    Ok(())
}

/// Takes `steps` training steps and returns the loss of each.
pub(crate) fn train(folder: &Path, steps: u64) -> Result<Vec<f32>, Box<dyn Error>> {
    // An example has up to four images as planes of sRGB values from 0 to 1.
    let planes = |layer: &str| -> image::ImageResult<Planes> {
        let picture = image::open(folder.join(format!("{layer}.png")))?;
        Ok(planes_of_bytes(picture.into_rgb8().as_raw()))
    };
    let (columns, rows) = image::image_dimensions(folder.join("input.png"))?;
    let example = Example {
        rows: rows as usize,
        columns: columns as usize,
        input: planes("input")?,
        transmission: planes("transmission")?,
        glass_reflection: Some(planes("glass_reflection")?),
        clean_reflection: Some(planes("clean_reflection")?),
    };
    let cut = Cut { row: 32, column: 64, size: 64, mirrored: false };

    // SP-net separates I into T* and R~*, and BT-net restores R* from R~*. The width in the paper is 64.
    let settings = TrainSettings {
        width: 8,
        discriminator_width: 8,
        learning_rate: 1e-3,
        ..TrainSettings::default()
    };
    let mut learner = Learner::new(Stage::Separation, &settings, None)?;
    let batch = Batch::new(&[example.cut(cut)])?;
    (0..steps).map(|step| Ok(learner.step(step, &batch, &mut |_| {})?.total)).collect()
}
