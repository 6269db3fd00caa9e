//! Means over trainings that differ in their seed alone.

use super::per_image::Row;
use super::score::{Scores, number};
use serde::Serialize;

/// Methods of one training with several seeds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SeedGroup {
    /// Name of the row of the means.
    pub method: String,
    /// Methods of the seeds, at least two.
    pub members: Vec<String>,
}

/// Sample standard deviations over seeds of the means over pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Number of seeds.
    pub seeds: usize,
    /// dB.
    #[serde(serialize_with = "number")]
    pub psnr_colour_db: f64,
    /// dB.
    #[serde(serialize_with = "number")]
    pub psnr_own_factor_db: f64,
    #[serde(serialize_with = "number")]
    pub ssim_grey: f64,
}

impl Spread {
    /// Computes the spread of the means of two or more seeds.
    pub(super) fn of(means: &[Scores]) -> Self {
        let deviation = |of: fn(&Scores) -> f64| {
            let mean = means.iter().map(of).sum::<f64>() / means.len() as f64;
            let squares = means.iter().map(|scores| (of(scores) - mean).powi(2)).sum::<f64>();
            (squares / (means.len() - 1) as f64).sqrt()
        };
        Self {
            seeds: means.len(),
            psnr_colour_db: deviation(|scores| scores.psnr_colour_db),
            psnr_own_factor_db: deviation(|scores| scores.psnr_own_factor_db),
            ssim_grey: deviation(|scores| scores.ssim_grey),
        }
    }
}

impl SeedGroup {
    /// Returns each picture's mean scores over the seeds, as rows of their own.
    pub(super) fn mean_rows(&self, rows: &[Row]) -> Vec<Row> {
        let of = |method: &String| -> Vec<&Row> {
            rows.iter().filter(|row| row.method == *method).collect()
        };
        let members: Vec<Vec<&Row>> = self.members.iter().map(of).collect();
        let Some(first) = members.first() else {
            return Vec::new();
        };
        let mean = |index: usize| {
            let scores: Vec<Scores> = members.iter().map(|rows| rows[index].scores).collect();
            let scores = Scores::mean(&scores);
            Row { method: self.method.clone(), scores, ..first[index].clone() }
        };
        (0..first.len()).map(mean).collect()
    }
}
