//! Mean scores of a method, as written to JSON.

use super::score::Scores;
use super::table::Row;
use serde::Serialize;

/// Mean scores over some pictures.
#[derive(Clone, Debug, Serialize)]
pub struct Means {
    pub images: usize,
    #[serde(flatten)]
    pub scores: Scores,
}

#[derive(Clone, Debug, Serialize)]
pub struct MethodMeans {
    pub method: String,
    #[serde(flatten)]
    pub all: Means,
    /// Means over the aligned pairs; `None` without measured shifts.
    pub aligned: Option<Means>,
}

impl MethodMeans {
    pub fn of(method: &str, rows: &[Row]) -> Self {
        let own: Vec<&Row> = rows.iter().filter(|row| row.method == method).collect();
        let is_measured = own.iter().any(|row| row.shift_px.is_some());
        let aligned = || own.iter().filter(|row| row.is_aligned());
        Self {
            method: method.to_owned(),
            all: Means::of(own.iter().map(|row| row.scores)),
            aligned: is_measured.then(|| Means::of(aligned().map(|row| row.scores))),
        }
    }
}

impl Means {
    fn of(scores: impl Iterator<Item = Scores>) -> Self {
        let scores: Vec<Scores> = scores.collect();
        Self { images: scores.len(), scores: Scores::mean(&scores) }
    }
}
