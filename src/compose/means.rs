//! A method's mean scores, as the object of `--json` has them.

use super::score::Scores;
use super::table::Row;
use serde::{Serialize, Serializer};

/// Means over some pictures. The PSNR of equal pictures is the string `inf`; means of nothing are null.
#[derive(Clone, Debug, Serialize)]
pub struct Means {
    pub images: usize,
    /// See [`Scores`].
    #[serde(serialize_with = "number")]
    pub psnr_colour_db: f64,
    /// See [`Scores`].
    #[serde(serialize_with = "number")]
    pub ssim_grey: f64,
    /// See [`Scores`].
    #[serde(serialize_with = "number")]
    pub psnr_channels_db: f64,
    /// See [`Scores`].
    #[serde(serialize_with = "number")]
    pub ssim_channels: f64,
}

/// The means of a method.
#[derive(Clone, Debug, Serialize)]
pub struct MethodMeans {
    pub method: String,
    #[serde(flatten)]
    pub all: Means,
    /// Of those whose truth lies on the picture; `None` where no shift was measured.
    pub aligned: Option<Means>,
}

impl MethodMeans {
    /// Those of `method` among `rows`.
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
        let mean = Scores::mean(&scores);
        Self {
            images: scores.len(),
            psnr_colour_db: mean.psnr_colour_db,
            ssim_grey: mean.ssim_grey,
            psnr_channels_db: mean.psnr_channels_db,
            ssim_channels: mean.ssim_channels,
        }
    }
}

/// JSON has no infinite numbers.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks for it")]
fn number<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if value.is_infinite() {
        serializer.serialize_str("inf")
    } else {
        serializer.serialize_f64(*value)
    }
}
