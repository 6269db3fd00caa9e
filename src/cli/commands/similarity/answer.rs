//! The answer of `similarity` as JSON and as tables.

use super::capture::Capture;
use compose::{Factor, Scores, markdown_table};
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use train::Similarity;

#[derive(Serialize)]
pub(super) struct Similarities<'a> {
    pub(super) dir: Cow<'a, str>,
    pub(super) dry_run: bool,
    pub(super) draws: u32,
    pub(super) seed: u64,
    /// Means over the scenes; empty in a dry run.
    pub(super) rows: Vec<Means>,
    pub(super) scenes: Vec<SceneRows>,
    pub(super) left_out: Vec<LeftOut>,
    pub(super) wall_s: f64,
}

#[derive(Serialize)]
pub(super) struct LeftOut {
    /// Name of the folder.
    pub(super) scene: String,
    pub(super) reason: String,
}

#[derive(Serialize)]
pub(super) struct SceneRows {
    /// Name of the folder.
    scene: String,
    captured: &'static str,
    width: u32,
    height: u32,
    spp: u32,
    rows: Vec<MethodRow>,
}

impl SceneRows {
    pub(super) fn new(capture: &Capture, rows: Vec<MethodRow>) -> Self {
        let (scene, film) = (capture.name(), &capture.line.film);
        let (width, height, spp) = (film.width, film.height, film.spp);
        Self { scene, captured: capture.file, width, height, spp, rows }
    }
}

/// Scores of a method in a scene; without a picture of the method, they are null.
#[derive(Serialize)]
pub(super) struct MethodRow {
    method: &'static str,
    raw: Option<Scores>,
    draw: Option<u32>,
    factor: Option<Factor>,
    after_factor: Option<Scores>,
    draw_after_factor: Option<u32>,
    /// Number of draws that the method rejects.
    rejected: u32,
}

impl MethodRow {
    pub(super) fn new(method: &'static str, found: Option<Similarity>, rejected: u32) -> Self {
        Self {
            method,
            raw: found.map(|of| of.raw),
            draw: found.and_then(|of| of.draw),
            factor: found.map(|of| of.factor),
            after_factor: found.map(|of| of.after_factor),
            draw_after_factor: found.and_then(|of| of.draw_after_factor),
            rejected,
        }
    }
}

/// Means of a method over the scenes in which it has a picture.
#[derive(Serialize)]
pub(super) struct Means {
    method: &'static str,
    count: usize,
    raw: Scores,
    after_factor: Scores,
}

impl Means {
    pub(super) fn of(scenes: &[SceneRows]) -> Vec<Self> {
        let count = scenes.first().map_or(0, |scene| scene.rows.len());
        let of = |place: usize| {
            let rows = || scenes.iter().map(|scene| &scene.rows[place]);
            let raw: Vec<Scores> = rows().filter_map(|row| row.raw).collect();
            let after: Vec<Scores> = rows().filter_map(|row| row.after_factor).collect();
            Self {
                method: scenes[0].rows[place].method,
                count: raw.len(),
                raw: Scores::mean(&raw),
                after_factor: Scores::mean(&after),
            }
        };
        (0..count).map(of).collect()
    }
}

impl fmt::Display for Similarities<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = if self.scenes.len() == 1 { "" } else { "s" };
        let (count, draws, seed) = (self.scenes.len(), self.draws, self.seed);
        if self.dry_run {
            return write!(f, "would compare {count} scene{plural} with a camera's pictures");
        }
        writeln!(f, "{count} scene{plural}; mixtures: best of {draws} draws (seed {seed})\n")?;
        f.write_str(&self.means_table())?;
        write!(f, "\nPSNR, dB, and after the own factor:\n\n{}", self.scenes_table().trim_end())?;
        for scene in &self.scenes {
            for row in scene.rows.iter().filter(|row| row.rejected > 0) {
                let (name, method, rejected) = (&scene.scene, row.method, row.rejected);
                write!(f, "\n{name}: {method} rejects {rejected} of {draws} draws")?;
            }
        }
        Ok(())
    }
}

impl Similarities<'_> {
    fn means_table(&self) -> String {
        let head = ["method", "scenes", "PSNR, dB", "SSIM", "own factor: PSNR, dB", "SSIM"];
        let mut table = vec![head.map(str::to_owned).to_vec()];
        for Means { method, count, raw, after_factor } in &self.rows {
            let scores = [raw, after_factor]
                .into_iter()
                .flat_map(|s| [format!("{:.2}", s.psnr_colour_db), format!("{:.3}", s.ssim_grey)]);
            let first = [(*method).to_owned(), count.to_string()];
            table.push(first.into_iter().chain(scores).collect());
        }
        markdown_table(&table, 1)
    }

    fn scenes_table(&self) -> String {
        let methods = self.rows.iter().map(|row| row.method.to_owned());
        let mut table = vec![std::iter::once("scene".to_owned()).chain(methods).collect()];
        for scene in &self.scenes {
            let cell = |row: &MethodRow| match (&row.raw, &row.after_factor) {
                (Some(raw), Some(after)) => {
                    format!("{:.2} / {:.2}", raw.psnr_colour_db, after.psnr_colour_db)
                }
                _ => "-".to_owned(),
            };
            let name = scene.scene.replace('|', "\\|");
            table.push(std::iter::once(name).chain(scene.rows.iter().map(cell)).collect());
        }
        markdown_table(&table, 1)
    }
}
