//! Compares the golden scenes with their images at 65,536 samples, `tests/physics/golden/NAME.npy`.
//!
//! An image is float32 of shape (10, 16, 12): rows, columns, red, green and blue of I, T, R~, R. These commands make
//! the images again after a change of the scenes or of the physics (not of rounding), and print the errors. R with apex
//! `mirror` was traced, by tracer version 4: it is the independent check of its closed form, so keep it.
//!
//! ```text
//! cargo test --release --test physics golden::references_are_made -- --ignored
//! cargo test --release --test physics golden -- --nocapture
//! ```

use glasshouse_line::layer::Layer;
use render::shard::{golden_scenes, whole};
use render::trace::{Isa, Scene, trace_tile};
use std::fmt::Write;
use std::path::{Path, PathBuf};

const REFERENCE_SPP: u32 = 65_536;

/// Limits of the RMSE of a scene with its own number of samples, relative to the RMS of its reference, for the layers
/// I, T, R~, R: 25 % above the measured values, at least 1e-6.
#[rustfmt::skip]
const BOUNDS: &[(&str, [f64; 4])] = &[
    ("mirror", [2.08e-2, 2.25e-2, 3.81e-2, 2.26e-6]),
    ("mirror-gaussian", [2.59e-2, 2.85e-2, 4.49e-2, 8.46e-5]),
    ("camera", [2.05e-2, 2.25e-2, 3.13e-2, 1.01e-2]),
    ("tilted-absorbing", [2.05e-2, 2.23e-2, 3.73e-2, 2.26e-6]),
    ("tilted-camera-gaussian", [2.54e-2, 2.86e-2, 2.60e-2, 1.41e-2]),
    ("lights", [1.08e-1, 1.08e-1, 1.16e-1, 1.58e-6]),
    ("pinhole", [4.73e-3, 4.98e-3, 1.30e-2, 2.26e-6]),
    ("thin-pane", [2.08e-2, 2.25e-2, 3.84e-2, 2.26e-6]),
    ("air", [2.25e-2, 2.25e-2, 1.00e-6, 2.26e-6]),
    ("steep", [1.82e-2, 2.27e-2, 2.48e-2, 2.26e-6]),
    ("two-ranges", [7.28e-3, 7.98e-3, 1.33e-2, 2.26e-6]),
    ("camera-two-ranges", [7.24e-3, 7.98e-3, 9.03e-3, 5.32e-3]),
    ("one-row", [1.43e-1, 1.55e-1, 2.59e-1, 2.18e-6]),
    ("one-column", [3.43e-1, 3.79e-1, 3.99e-1, 2.20e-6]),
    ("adaptive", [2.35e-2, 2.41e-2, 8.42e-2, 2.26e-6]),
    ("two-layers", [1.00e-6, 2.25e-2, 1.00e-6, 2.26e-6]),
    ("jpeg", [7.49e-3, 6.89e-3, 3.81e-2, 2.26e-6]),
    ("turned", [5.92e-3, 4.74e-3, 3.81e-2, 2.26e-6]),
    ("display-p3", [7.98e-3, 5.74e-3, 3.81e-2, 2.26e-6]),
    ("double", [1.94e-2, 2.24e-2, 3.56e-2, 1.00e-6]),
    ("bent", [2.07e-2, 2.25e-2, 3.06e-2, 4.45e-3]),
    ("rough", [3.79e-2, 2.25e-2, 4.85e-2, 1.00e-6]),
    ("waved", [2.06e-2, 2.25e-2, 5.45e-2, 6.48e-3]),
    ("framed", [3.96e-2, 4.09e-2, 8.49e-2, 8.14e-3]),
    ("framed-camera", [3.97e-2, 4.09e-2, 8.14e-2, 1.28e-2]),
    ("smudged", [4.29e-2, 2.24e-2, 6.01e-2, 1.00e-6]),
];

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/physics/golden/{name}.npy"))
}

/// Renders the mean of all samples, range by range as in a run, with twelve values per pixel.
fn render(scene: &Scene) -> Vec<f64> {
    let (tile, ranges) = whole(scene);
    let mut sums = vec![0.0; (tile.width * tile.height) as usize * 12];
    let mut samples = [0u32; 4];
    for range in ranges {
        let result = trace_tile(scene, tile, range, Isa::detect());
        for (layer, taken) in result.samples.0.into_iter().enumerate() {
            // A layer in closed form has paths, but no samples.
            let is_closed_form = taken == 0 && result.paths.0[layer] > 0;
            let taken = if is_closed_form { 1 } else { taken };
            samples[layer] += taken;
            for (q, pixel) in result.pixels.iter().enumerate() {
                for c in 0..3 {
                    sums[q * 12 + layer * 3 + c] +=
                        f64::from(pixel.mean[layer][c]) * f64::from(taken);
                }
            }
        }
    }
    // A layer that is not rendered has no samples and is 0.
    let divide = |(k, sum): (usize, f64)| sum / f64::from(samples[k % 12 / 3].max(1));
    sums.into_iter().enumerate().map(divide).collect()
}

fn read_reference(name: &str) -> Vec<f64> {
    let bytes = std::fs::read(path(name)).unwrap_or_else(|e| {
        panic!(
            "{}: {e}; make it with: cargo test --release --test physics golden::references_are_made -- --ignored",
            path(name).display()
        )
    });
    let file = npyz::NpyFile::new(&bytes[..]).expect("a .npy");
    assert_eq!(file.shape(), [10, 16, 12]);
    file.into_vec::<f32>().expect("float32").into_iter().map(f64::from).collect()
}

/// Returns the RMS difference of a layer over the RMS of its reference, or the RMS difference if the reference is 0.
fn relative_rmse(image: &[f64], reference: &[f64], layer: usize) -> f64 {
    let of_layer = |k: &usize| k % 12 / 3 == layer;
    let rms = |value: &dyn Fn(usize) -> f64| {
        let all = (0..image.len()).filter(of_layer);
        let sum: f64 = all.map(|k| value(k) * value(k)).sum();
        (sum / (image.len() / 4) as f64).sqrt()
    };
    let size = rms(&|k| reference[k]);
    rms(&|k| image[k] - reference[k]) / if size > 0.0 { size } else { 1.0 }
}

#[test]
fn scenes_are_near_their_references() {
    let mut table = String::new();
    let mut failures = vec![];
    println!("golden scene              relative RMSE of {}", Layer::NAMES.join(", "));
    for golden in golden_scenes() {
        let image = render(&golden.scene);
        let reference = read_reference(golden.name);
        let found = [0, 1, 2, 3].map(|layer| relative_rmse(&image, &reference, layer));
        println!("{:24} {}", golden.name, found.map(|v| format!("{v:9.2e}")).join(" "));
        // Exact layers have a bound of 1e-6, for rounding to f32.
        let row = found.map(|v| format!("{:.2e}", (1.25 * v).max(1e-6))).join(", ");
        let _ = writeln!(table, "    (\"{}\", [{row}]),", golden.name);
        let bound = BOUNDS.iter().find(|(name, _)| *name == golden.name);
        let ok = bound.is_some_and(|(_, bound)| (0..4).all(|k| found[k] <= bound[k]));
        if !ok {
            failures.push(golden.name);
        }
    }
    assert!(
        failures.is_empty(),
        "farther from their references than BOUNDS of tests/physics/golden.rs: {failures:?}; measured values plus 25 %:\n{table}"
    );
}

/// With 256 samples, the error of a scene's first layer is below half of its error with 16, which is above 1e-4.
#[test]
fn scenes_converge_to_their_references() {
    for golden in golden_scenes() {
        let reference = read_reference(golden.name);
        let error = |spp: u32| {
            let mut scene =
                golden_scenes().into_iter().find(|g| g.name == golden.name).unwrap().scene;
            scene.spp = spp;
            scene.target_error = None;
            let layer = scene.layers.0.iter().position(|asked| *asked).unwrap();
            relative_rmse(&render(&scene), &reference, layer)
        };
        let (few, many) = (error(16), error(256));
        assert!(few > 1e-4, "{}: {few}", golden.name);
        assert!(many < few / 2.0, "{}: {few} at 16, {many} at 256", golden.name);
    }
}

/// Writes `tests/physics/golden/*.npy` in about a minute on one core, with seeds that differ from the scenes' seeds.
#[test]
#[ignore = "writes the references"]
fn references_are_made() {
    for mut golden in golden_scenes() {
        golden.scene.seed += 1;
        golden.scene.spp = REFERENCE_SPP;
        golden.scene.target_error = None;
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (10, 16, 12), }";
        let mut npy = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        npy.extend(format!("{header:117}\n").bytes());
        for value in render(&golden.scene) {
            npy.extend((value as f32).to_le_bytes());
        }
        let path = path(golden.name);
        render::atomic_file::write(&path, &npy).unwrap();
        println!("{}: {} bytes", path.display(), npy.len());
    }
}
