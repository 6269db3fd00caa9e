//! Compares a scene with reference images of 4,096 samples. Mitsuba 3 provided their camera, film, meshes, textures and
//! ray casting; a separate script computed the glass.

use glasshouse_line::{Roots, parse_scene};
use render::merge::combine;
use render::partial::{PARTIAL_SCHEMA, Partial, PartialHeader};
use render::scene::{load, read_files};
use render::shard::{ShardLayout, scene_digest};
use render::trace::{Isa, TRACER_VERSION, trace_tile};
use std::path::{Path, PathBuf};

fn oracle(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/oracle").join(name);
    if folder.join("scene.json").is_file() {
        return Some(folder);
    }
    println!("skipped: no oracle at {}", folder.display());
    None
}

fn reference(path: &Path) -> Vec<f64> {
    let bytes = std::fs::read(path).unwrap();
    let file = npyz::NpyFile::new(&bytes[..]).unwrap();
    file.into_vec::<f32>().unwrap().into_iter().map(f64::from).collect()
}

/// Returns the RMS difference of the pixels, and that of the means of 16 x 16 pixels.
fn rmse(image: &[[f32; 3]], reference: &[f64], width: usize) -> (f64, f64) {
    let height = image.len() / width;
    let difference = |x: usize, y: usize, c: usize| {
        f64::from(image[y * width + x][c]) - reference[(y * width + x) * 3 + c]
    };
    let (mut sum, mut block_sum) = (0.0, 0.0);
    for by in 0..height / 16 {
        for bx in 0..width / 16 {
            for c in 0..3 {
                let mut block = 0.0;
                for y in 0..16 {
                    for x in 0..16 {
                        let d = difference(bx * 16 + x, by * 16 + y, c);
                        sum += d * d;
                        block += d;
                    }
                }
                block_sum += (block / 256.0) * (block / 256.0);
            }
        }
    }
    let values = (width * height * 3) as f64;
    ((sum / values).sqrt(), (block_sum / (values / 256.0)).sqrt())
}

#[test]
fn agrees_with_an_independent_renderer() {
    agrees("mitsuba");
}

/// A tilted double pane: its orders are merged, and no weak one reaches the tolerance by itself.
#[test]
fn a_double_pane_agrees() {
    agrees("windows/double");
}

/// A tilted pane with a coating that outshines the front face, and absorbs.
#[test]
fn a_coated_pane_agrees() {
    agrees("windows/coated");
}

/// A tilted pane that ends inside the picture, with a frame, and a card behind the camera.
#[test]
fn a_covered_pane_agrees() {
    agrees("windows/cover");
}

/// A pane bent to spheres: its orders leave in different directions.
#[test]
fn a_bent_pane_agrees() {
    agrees("windows/bowed");
}

/// A pane with rough faces, like frosted glass.
#[test]
fn a_rough_pane_agrees() {
    agrees("windows/rough");
}

/// Renders the scene of an oracle, and compares each layer with its reference.
fn agrees(name: &str) {
    let Some(folder) = oracle(name) else { return };
    let text = std::fs::read_to_string(folder.join("scene.json")).unwrap();
    let line = parse_scene(&text).unwrap();
    let files = read_files(&line, &Roots::default(), &folder).unwrap();
    let loaded = load(&line, &files).unwrap();
    let meta: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("meta.json")).unwrap()).unwrap();
    let focus_m = meta["focus_distance_m"].as_f64().unwrap();
    assert!((loaded.facts.focus_distance_m.unwrap() - focus_m).abs() < 1e-6);

    let layout = ShardLayout::of(&line, 256);
    let partials: Vec<Partial> = layout
        .shards()
        .map(|shard| {
            let result =
                trace_tile(&loaded.scene, shard.tile, shard.samples.clone(), Isa::detect());
            let header = PartialHeader {
                schema: PARTIAL_SCHEMA.to_owned(),
                tracer_version: TRACER_VERSION,
                scene: line.id.clone(),
                line_blake3: scene_digest(&line),
                inputs: loaded.inputs.clone(),
                shard: shard.index,
                film: [line.film.width, line.film.height],
                tile: shard.tile,
                samples: [shard.samples.start, shard.samples.end],
                layer_samples: result.samples,
                sample_sums: result.sample_sums,
                paths: result.paths,
                misses: result.misses,
                facts: loaded.facts.clone(),
                blake3: String::new(),
            };
            Partial::new(header, result.pixels, result.labels)
        })
        .collect();
    let tuple = combine(&line, 256, &partials).unwrap();

    for (layer, pixels) in tuple.layers.iter() {
        let name = layer.name();
        let reference = reference(&folder.join(format!("ref_{name}.npy")));
        let (pixels, blocks) = rmse(pixels, &reference, line.film.width as usize);
        let limit = |key: &str| meta["layers"][name][key].as_f64().unwrap();
        println!(
            "{}, {name}: RMSE {pixels:.3e} (limit {:.1e}), 16x16 means {blocks:.3e} (limit {:.2e}), own estimate {:?}",
            folder.display(),
            limit("threshold_rmse"),
            limit("threshold_block16"),
            tuple.record.layers[name].error_rms
        );
        assert!(pixels <= limit("threshold_rmse"), "{name}: RMSE {pixels:e}");
        assert!(blocks <= limit("threshold_block16"), "{name}: RMSE of 16x16 means {blocks:e}");
    }
}
