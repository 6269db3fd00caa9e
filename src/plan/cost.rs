//! Estimates the cost of a run: bytes on disk and core time.

use glasshouse_line::ids::SceneId;
use glasshouse_line::{ExrPrecision, SceneLine};
use render::shard::{SECONDS_PER_SAMPLE, ShardLayout};
use serde::Serialize;

/// Bytes per pixel of a partial: 36 floats.
const PARTIAL_BYTES: f64 = 144.0;
/// Bytes per pixel of one layer of a tuple, in `tuple.exr` (half floats) and a PNG. Measurements at 256 x 256 px and
/// 256 samples gave 5.2 on published photographs and 4.5 on the smoke recipe.
const HALF_LAYER_BYTES: f64 = 5.3;
/// Bytes per pixel of one layer with single floats in `tuple.exr`. The smoke recipe gave 12.1.
const FLOAT_LAYER_BYTES: f64 = 13.0;
/// Bytes of the photographs per pixel of the photograph: a JPEG and two PNGs.
const PHOTOGRAPH_BYTES: f64 = 3.0;
/// Bytes of `raw.dng` per pixel of the film.
const RAW_BYTES: f64 = 2.0;
/// Other bytes per scene: its manifest line, `tuple.json` and the receipt.
const SCENE_BYTES: f64 = 6_000.0;
/// Approximate seconds of one core to read and decode two photographs, used without a calibration.
const SECONDS_PER_LOAD: f64 = 0.07;
/// Seconds of one core per pixel of a tuple, to combine, encode and write it.
const SECONDS_PER_TUPLE_PIXEL: f64 = 5e-7;

/// Measured cost of some scenes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibration {
    pub scenes: Vec<SceneId>,
    /// Seconds of one core per camera sample; an adaptive scene counts as `film.spp` samples per pixel.
    pub seconds_per_sample: f64,
    /// Seconds of one core for reading and decoding a scene's files.
    pub seconds_per_load: f64,
}

/// Input of [`cost`]: the plan and the machine.
#[derive(Clone, Debug)]
pub struct Estimate<'a> {
    pub lines: &'a [SceneLine],
    /// Side of a tile, px.
    pub tile_px: u32,
    pub threads: usize,
    /// Size of the input files, if known.
    pub input_bytes: Option<u64>,
    /// Size of the procedural photographs.
    pub made_bytes: u64,
    /// True if the procedural photographs are already in the run's folder.
    pub is_made: bool,
    /// Free space on the run's disk; `None` if unknown.
    pub disk_available_bytes: Option<u64>,
    /// Measured rates; `None` stands for those of a typical machine.
    pub calibration: Option<Calibration>,
}

/// Estimated cost of a run, with the keys of `glasshouse.plan/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// Number of shards of all scenes.
    pub shards: u64,
    /// Size of the input files, if known, with the procedural photographs.
    pub input_bytes: Option<u64>,
    /// Size of all partials: an upper bound, reached if several workers share every scene.
    pub partial_bytes: u64,
    /// Largest size of the partials on disk at one time with one worker: the partials of its open scenes.
    pub partial_bytes_at_a_time: u64,
    pub tuple_bytes: u64,
    /// Size of the tuples, `partial_bytes_at_a_time`, and the procedural photographs that are not made yet.
    pub disk_needed_bytes: u64,
    /// Free space on the run's disk; `None` if unknown.
    pub disk_available_bytes: Option<u64>,
    /// Seconds of one core.
    #[serde(rename = "core_seconds_estimate")]
    pub core_s: f64,
    /// Measured rates; `None` if the estimate assumes a typical machine.
    pub calibration: Option<Calibration>,
}

/// Estimates the cost of a run.
pub fn cost(estimate: Estimate<'_>) -> Cost {
    let rates = estimate.calibration.as_ref();
    let per_sample = rates.map_or(SECONDS_PER_SAMPLE, |c| c.seconds_per_sample);
    let per_load = rates.map_or(SECONDS_PER_LOAD, |c| c.seconds_per_load);
    let (mut shards, mut partial_bytes, mut largest) = (0, 0.0, 0.0f64);
    let (mut tuple_bytes, mut core_s) = (0.0, 0.0);
    for line in estimate.lines {
        let layout = ShardLayout::of(line, estimate.tile_px);
        let pixels = f64::from(line.film.width) * f64::from(line.film.height);
        let of_scene = pixels * f64::from(layout.ranges()) * PARTIAL_BYTES;
        shards += u64::from(layout.len());
        partial_bytes += of_scene;
        largest = largest.max(of_scene);
        tuple_bytes += pixels * tuple_bytes_per_pixel(line) + SCENE_BYTES;
        core_s += pixels * f64::from(line.film.spp) * per_sample
            + pixels * SECONDS_PER_TUPLE_PIXEL
            + per_load;
    }
    // Every thread has one open scene, and one more scene is being loaded.
    let open = (estimate.threads + 1).min(estimate.lines.len());
    let at_a_time = largest * open as f64;
    let to_make = if estimate.is_made { 0 } else { estimate.made_bytes };
    let input_bytes = estimate.input_bytes;
    Cost {
        shards,
        input_bytes: input_bytes.map(|bytes| bytes + estimate.made_bytes),
        partial_bytes: partial_bytes as u64,
        partial_bytes_at_a_time: at_a_time as u64,
        tuple_bytes: tuple_bytes as u64,
        disk_needed_bytes: (tuple_bytes + at_a_time + to_make as f64) as u64,
        disk_available_bytes: estimate.disk_available_bytes,
        core_s,
        calibration: estimate.calibration,
    }
}

impl Cost {
    /// True if the disk has too little space.
    pub fn is_too_large(&self) -> bool {
        self.disk_available_bytes.is_some_and(|there| self.disk_needed_bytes > there)
    }
}

fn tuple_bytes_per_pixel(line: &SceneLine) -> f64 {
    let layers = line.film.layers.names().count() as f64;
    let photographs = line.sensor.as_ref().map_or(0.0, |sensor| {
        let raw = if sensor.raw { RAW_BYTES } else { 0.0 };
        PHOTOGRAPH_BYTES * sensor.scale * sensor.scale + raw
    });
    photographs
        + layers
            * match line.film.exr {
                ExrPrecision::Half => HALF_LAYER_BYTES,
                ExrPrecision::Float => FLOAT_LAYER_BYTES,
            }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line() -> SceneLine {
        serde_json::from_str(
            r#"{"schema":"glasshouse.scene/1","id":"a","seed":1,
                "film":{"width":128,"height":64,"spp":512,"exr":"half"},
                "camera":{"focal_length_mm":55,"aperture_radius_m":0.01,"focus":{"distance_m":7}},
                "glass":{"distance_m":0.3,"thickness_m":0.01,"ior":1.5,"tilt_deg":[0,0]},
                "front":{"color":"a.png","depth":"a.npy",
                         "intrinsics":{"fx":900,"fy":900,"cx":512,"cy":384}},
                "back":{"color":"b.png","depth":"b.npy",
                        "intrinsics":{"fx":900,"fy":900,"cx":512,"cy":384}}}"#,
        )
        .unwrap()
    }

    fn estimate(lines: &[SceneLine]) -> Estimate<'_> {
        Estimate {
            lines,
            tile_px: 64,
            threads: 2,
            input_bytes: Some(1000),
            made_bytes: 500,
            is_made: false,
            disk_available_bytes: None,
            calibration: None,
        }
    }

    #[test]
    fn costs_are_sums_over_scenes() {
        let lines = vec![line(); 5];
        let found = cost(estimate(&lines));
        // Every scene has two tiles and two ranges of 256 samples; two threads have three scenes open.
        assert_eq!(found.shards, 5 * 2 * 2);
        assert_eq!(found.partial_bytes, 5 * 128 * 64 * 2 * 144);
        assert_eq!(found.partial_bytes_at_a_time, 3 * 128 * 64 * 2 * 144);
        assert_eq!(found.input_bytes, Some(1500));
        let needed = found.tuple_bytes + found.partial_bytes_at_a_time + 500;
        assert_eq!(found.disk_needed_bytes, needed);
        assert!(!found.is_too_large());
        let full = cost(Estimate { disk_available_bytes: Some(needed - 1), ..estimate(&lines) });
        assert!(full.is_too_large());
        let made = cost(Estimate { is_made: true, ..estimate(&lines) });
        assert_eq!(made.disk_needed_bytes, needed - 500);
        // Doubling the rate adds the cost of all samples once.
        let rate = |factor: f64| {
            let calibration = Calibration {
                scenes: Vec::new(),
                seconds_per_sample: SECONDS_PER_SAMPLE * factor,
                seconds_per_load: SECONDS_PER_LOAD,
            };
            cost(Estimate { calibration: Some(calibration), ..estimate(&lines) }).core_s
        };
        assert_eq!(rate(1.0), found.core_s);
        let samples = 5.0 * 128.0 * 64.0 * 512.0;
        let more = rate(2.0) - rate(1.0);
        assert!((more / (samples * SECONDS_PER_SAMPLE) - 1.0).abs() < 1e-9, "{more}");
        let mut float = lines.clone();
        float[0].film.exr = ExrPrecision::Float;
        assert!(cost(estimate(&float)).tuple_bytes > found.tuple_bytes);
        let sensor =
            r#"{"exposure":{"factor":1},"gain_dn_per_e":1,"bits":12,"jpeg_quality":90,"raw":true}"#;
        let sensor = serde_json::from_str(sensor).unwrap();
        let photographed =
            vec![SceneLine { sensor: Some(sensor), ..lines[0].clone() }; lines.len()];
        let more = cost(estimate(&photographed)).tuple_bytes - found.tuple_bytes;
        assert_eq!(more, lines.len() as u64 * 128 * 64 * 5);
    }
}
