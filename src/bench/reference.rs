//! Reference images: read from a folder, or rendered with many more samples of another seed and stored.

use super::error::BenchError;
use super::render::{Work, render};
use super::scenes::BenchScene;
use glasshouse_line::SceneLine;
use glasshouse_line::layer::{Layer, PerLayer};
use render::atomic_file;
use render::formats::NamedBytes;
use render::formats::encode_rgb_exr;
use render::scene::decode_linear_image;
use render::shard::scene_digest;
use render::trace::{Sampling, TRACER_VERSION};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// File that describes the images in its folder.
const RECORD_FILE: &str = "reference.json";

/// Schema name of `reference.json`.
pub(super) const REFERENCE_SCHEMA: &str = "glasshouse.reference/1";

/// Difference between the reference's seed and the scene's. Ladders use the seeds next to the scene's.
const SEED_STEP: u64 = 1 << 32;

/// Four images that other renderings are compared with.
pub struct Reference {
    /// Linear pixels, row by row.
    pub layers: PerLayer<Vec<[f32; 3]>>,
    /// Record of the rendering; `None` for given images.
    pub record: Option<ReferenceRecord>,
    pub dir: PathBuf,
    /// True if the images were read from disk, not rendered by this call.
    pub reused: bool,
}

/// Content of `reference.json`, which describes the images in its folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceRecord {
    /// Always [`REFERENCE_SCHEMA`].
    pub schema: String,
    /// BLAKE3 (hex) of the digests of the input files and of the reference's scene line, with its samples and seed.
    pub scene_blake3: String,
    pub tracer_version: u32,
    pub spp: u32,
    /// Seed of the sample points.
    pub seed: u64,
    /// Stated RMS error of each layer (I, T, R~, R), linear.
    pub error_rms: [Option<f64>; 4],
    pub cpu_s: f64,
}

/// Returns the names of the files that [`own_reference`] writes.
pub fn reference_files() -> impl Iterator<Item = String> {
    let images = Layer::NAMES.into_iter().map(|name| format!("{name}.exr"));
    images.chain([RECORD_FILE.to_owned()])
}

fn reference_line(line: &SceneLine, spp: u32) -> SceneLine {
    let mut line = line.clone();
    line.film.spp = spp;
    line.seed = line.seed.wrapping_add(SEED_STEP);
    line
}

/// Computes one digest of a scene line and its input files.
fn digest(scene: &BenchScene, line: &SceneLine) -> String {
    let inputs = serde_json::to_string(&scene.photographs.inputs)
        .expect("digests are a map of strings to strings");
    let text = format!("{}\n{inputs}", scene_digest(line));
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

/// Reads the scene's own reference of `spp` samples from `dir`, or renders and writes it if `dir` has no match.
///
/// Returns `None` if the work was stopped.
pub fn own_reference(
    scene: &BenchScene,
    spp: u32,
    dir: &Path,
    work: &Work,
) -> Result<Option<Reference>, BenchError> {
    let line = reference_line(&scene.line, spp);
    let scene_blake3 = digest(scene, &line);
    let record_path = dir.join(RECORD_FILE);
    let found: Option<ReferenceRecord> =
        std::fs::read(&record_path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
    if let Some(record) = found.filter(|record| {
        record.schema == REFERENCE_SCHEMA
            && record.scene_blake3 == scene_blake3
            && record.tracer_version == TRACER_VERSION
            && record.spp == spp
    }) && let Ok(mut reference) = read_reference(dir, &line)
    {
        reference.record = Some(record);
        reference.reused = true;
        return Ok(Some(reference));
    }
    let Some(rendering) = render(scene, &line, Sampling::Sobol, work)? else {
        return Ok(None);
    };
    let tuple = rendering.tuple;
    let record = ReferenceRecord {
        schema: REFERENCE_SCHEMA.to_owned(),
        scene_blake3,
        tracer_version: TRACER_VERSION,
        spp,
        seed: line.seed,
        error_rms: Layer::NAMES.map(|name| tuple.record.layers[name].error_rms),
        cpu_s: rendering.cpu_s,
    };
    atomic_file::create_dir(dir)?;
    // The record is removed first and written last, so that it never describes other images.
    let _ = std::fs::remove_file(&record_path);
    for (layer, pixels) in tuple.layers.iter() {
        let name = layer.name();
        let exr = encode_rgb_exr(pixels, tuple.width, tuple.height)
            .map_err(|e| BenchError::Encode { name, reason: e.to_string() })?;
        atomic_file::write(&dir.join(format!("{name}.exr")), &exr)?;
    }
    let json = serde_json::json!(record);
    atomic_file::write(&record_path, format!("{json:#}\n").as_bytes())?;
    Ok(Some(Reference {
        layers: tuple.layers,
        record: Some(record),
        dir: dir.to_owned(),
        reused: false,
    }))
}

/// Reads linear RGB images of the film's size: for each layer, the first of `LAYER.exr`, `ref_LAYER.npy`, `LAYER.npy`.
pub fn read_reference(dir: &Path, line: &SceneLine) -> Result<Reference, BenchError> {
    let read = |layer: &'static str| -> Result<Vec<[f32; 3]>, BenchError> {
        let names = [format!("{layer}.exr"), format!("ref_{layer}.npy"), format!("{layer}.npy")];
        let path = names
            .iter()
            .map(|name| dir.join(name))
            .find(|path| path.is_file())
            .ok_or_else(|| BenchError::NoReference { layer, dir: dir.to_owned() })?;
        let bytes = std::fs::read(&path)
            .map_err(|source| BenchError::Read { path: path.clone(), source })?;
        let file = NamedBytes { path, bytes };
        let (found_width, found_height, pixels) = decode_linear_image(&file)?;
        let (width, height) = (line.film.width, line.film.height);
        if [found_width, found_height] != [width as usize, height as usize] {
            return Err(BenchError::Size {
                path: file.path,
                found_width,
                found_height,
                width,
                height,
            });
        }
        Ok(pixels)
    };
    let [input, transmission, glass, clean] = Layer::NAMES;
    Ok(Reference {
        layers: PerLayer([read(input)?, read(transmission)?, read(glass)?, read(clean)?]),
        record: None,
        dir: dir.to_owned(),
        reused: true,
    })
}
