//! What a run will take: bytes on the disk, and hours of a core.

use super::args::Global;
use super::exit_code::Failure;
use super::store_env;
use super::work_cmd::{isa, threads};
use crate::bench::{Calibration, calibrate};
use crate::doctor::available_bytes;
pub(super) use crate::doctor::bytes_text;
use crate::run::Planned;
use render::line::{ExrPrecision, Roots, SceneLine, is_url};
use render::scene::read_files_by;
use render::shard::{SECONDS_PER_SAMPLE, ShardLayout};
use serde_json::{Value, json};
use std::path::Path;

/// Bytes of a partial a pixel: 36 floats, which hardly shrink.
const PARTIAL_BYTES: f64 = 144.0;
/// Bytes of one layer of a tuple a pixel, in `tuple.exr` (half floats) and a PNG: 5.2 were measured on published photographs,
/// 4.5 on the smoke recipe, each 256 x 256 px with 256 samples.
const HALF_LAYER_BYTES: f64 = 5.3;
/// The same with single floats: 12.1 on the smoke recipe.
const FLOAT_LAYER_BYTES: f64 = 13.0;
/// Bytes of a scene besides: its line in the manifest, `tuple.json`, the receipt.
const SCENE_BYTES: f64 = 6_000.0;
/// Seconds of one core for reading and decoding two photographs, about, where no scene can be tried out.
const SECONDS_PER_LOAD: f64 = 0.07;
/// Seconds of one core for a pixel of a tuple: combined, coded, written.
const SECONDS_PER_TUPLE_PIXEL: f64 = 5e-7;

/// What a run takes.
pub(super) struct Cost {
    pub(super) shards: u64,
    /// Of the input files, if they were looked at; with the photographs that planning makes.
    pub(super) input_bytes: Option<u64>,
    /// If all partials were written, as when every scene is traced by several workers.
    pub(super) partial_bytes: f64,
    /// Partials that can be on the disk at a time beside one worker here: those of the scenes that it has open.
    pub(super) partial_bytes_at_a_time: f64,
    pub(super) tuple_bytes: f64,
    /// Tuples, partials at a time, and what planning makes.
    pub(super) disk_needed_bytes: f64,
    /// `None`: the system does not say.
    pub(super) disk_available_bytes: Option<u64>,
    pub(super) core_s: f64,
    /// `None`: no scene could be tried out, so that the estimate is of a typical machine.
    pub(super) calibration: Option<Calibration>,
}

impl Cost {
    /// Of the plan in the folder `run`.
    pub(super) fn of(planned: &Planned, run: &Path, global: &Global) -> Result<Self, Failure> {
        let calibration = try_out(planned, run, global)?;
        let per_sample = calibration
            .as_ref()
            .map_or(SECONDS_PER_SAMPLE, |c| c.seconds_per_sample);
        let per_load = calibration
            .as_ref()
            .map_or(SECONDS_PER_LOAD, |c| c.seconds_per_load);
        let (mut shards, mut partial_bytes, mut largest) = (0, 0.0, 0.0f64);
        let (mut tuple_bytes, mut core_s) = (0.0, 0.0);
        for line in &planned.lines {
            let layout = ShardLayout::of(line, planned.spec.tile_px);
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
        // One open scene a thread, and one that is begun.
        let open = (threads(global) + 1).min(planned.lines.len());
        let partial_bytes_at_a_time = largest * open as f64;
        // Of a run that was planned before they are there.
        let to_make = if planned.existed {
            0
        } else {
            planned.made_bytes
        };
        Ok(Self {
            shards,
            input_bytes: planned.input_bytes.map(|bytes| bytes + planned.made_bytes),
            partial_bytes,
            partial_bytes_at_a_time,
            tuple_bytes,
            disk_needed_bytes: tuple_bytes + partial_bytes_at_a_time + to_make as f64,
            disk_available_bytes: available_bytes(run),
            core_s,
            calibration,
        })
    }

    /// The disk has no room for it.
    pub(super) fn is_too_large(&self) -> bool {
        self.disk_available_bytes
            .is_some_and(|there| self.disk_needed_bytes > there as f64)
    }

    /// Keys of `glasshouse.plan/1`.
    pub(super) fn json(&self) -> Value {
        let calibration = self.calibration.as_ref().map(|c| {
            json!({
                "scenes": c.scenes,
                "seconds_per_sample": c.seconds_per_sample,
                "seconds_per_load": c.seconds_per_load,
            })
        });
        json!({
            "shards": self.shards,
            "input_bytes": self.input_bytes,
            "partial_bytes": self.partial_bytes as u64,
            "partial_bytes_at_a_time": self.partial_bytes_at_a_time as u64,
            "tuple_bytes": self.tuple_bytes as u64,
            "disk_needed_bytes": self.disk_needed_bytes as u64,
            "disk_available_bytes": self.disk_available_bytes,
            "core_seconds_estimate": self.core_s,
            "calibration": calibration,
        })
    }

    /// For a person, a line each.
    pub(super) fn text(&self) -> String {
        let inputs = self.input_bytes.map_or_else(
            || "not looked at: the run is planned".to_owned(),
            |bytes| bytes_text(bytes as f64),
        );
        let available = self.disk_available_bytes.map_or_else(String::new, |there| {
            format!(", {} available", bytes_text(there as f64))
        });
        let how = match &self.calibration {
            Some(c) => format!(
                "{} scenes tried out here: {:.1} ns a sample, {:.0} ms to load",
                c.scenes.len(),
                c.seconds_per_sample * 1e9,
                c.seconds_per_load * 1e3
            ),
            None => "no scene can be tried out here yet: a typical machine's".to_owned(),
        };
        format!(
            "  inputs    {inputs}\n  \
             tuples    about {}\n  \
             partials  up to {} at a time beside one worker here; {} if all were written\n  \
             disk      about {} needed{available}\n  \
             time      about {} of one core ({how})",
            bytes_text(self.tuple_bytes),
            bytes_text(self.partial_bytes_at_a_time),
            bytes_text(self.partial_bytes),
            bytes_text(self.disk_needed_bytes),
            span_text(self.core_s),
        )
    }
}

fn tuple_bytes_per_pixel(line: &SceneLine) -> f64 {
    let layers = line.film.layers.names().count() as f64;
    layers
        * match line.film.exr {
            ExrPrecision::Half => HALF_LAYER_BYTES,
            ExrPrecision::Float => FLOAT_LAYER_BYTES,
        }
}

/// Reads, decodes and traces a part of some scenes.
fn try_out(planned: &Planned, run: &Path, global: &Global) -> Result<Option<Calibration>, Failure> {
    let mut roots = Roots::default();
    for (name, folder) in &planned.spec.roots {
        // Relative folders are the run's own.
        let folder = if is_url(folder) {
            folder.clone()
        } else {
            run.join(folder)
        };
        roots.insert(name, folder)?;
    }
    let inputs = store_env::inputs();
    let read = |line: &SceneLine| read_files_by(line, &roots, run, &|path| inputs.read(path));
    Ok(calibrate(&planned.lines, &read, isa(global)?))
}

fn span_text(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_units() {
        assert_eq!(bytes_text(999.0), "1 kB");
        assert_eq!(bytes_text(8.86e9), "8.9 GB");
        assert_eq!(bytes_text(12_340_000.0), "12.3 MB");
        assert_eq!(span_text(7199.0), "120 min");
        assert_eq!(span_text(2.0 * 3600.0), "2.0 h");
    }
}
