//! Fits the baselines, a factor and a veil rule, to training examples. A network must beat both in a table of scores.

use super::code_sums::CodeSums;
use super::error::EvaluateError;
use super::factor::{Factor, fit_factor};
use super::subject::{LeftOut, Subject, Unread, read};
use super::veil::{OfFit, VeilRule, fit_veil, veil_codes};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering};

/// Limits of the fit: number of pictures, and approximate number of pixels.
const MOST_PICTURES: usize = 64;
const MOST_PIXELS: u64 = 200_000_000;

/// The rules that change inputs towards the truth best, and the pictures to which they were fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baselines {
    pub factor: Factor,
    pub veil: VeilRule,
    /// Folder or run with the fitted pictures.
    pub fitted_to: String,
    /// Number of fitted pictures.
    pub images: usize,
}

/// The rules of a table: fitted, or given as numbers. A rule without numbers has no row.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Rules {
    pub factor: Option<Factor>,
    pub veil: Option<VeilRule>,
    /// The fit; `None` if the numbers were given. A given number replaces the fitted one above.
    pub fitted: Option<Baselines>,
}

impl Rules {
    /// Combines fitted and given rules; given ones win.
    pub fn new(fitted: Option<Baselines>, factor: Option<Factor>, veil: Option<VeilRule>) -> Self {
        Self {
            factor: factor.or(fitted.as_ref().map(|fitted| fitted.factor)),
            veil: veil.or(fitted.as_ref().map(|fitted| fitted.veil)),
            fitted,
        }
    }
}

/// Fits the baselines to the first readable pictures, and lists unreadable pictures. Returns no baselines if none is
/// readable.
pub fn fit_baselines(
    subject: &dyn Subject,
    place: String,
    stop: &AtomicBool,
) -> Result<(Option<Baselines>, Vec<LeftOut>), EvaluateError> {
    let (mut pictures, mut left_out, mut pixels) = (Vec::<OfFit>::new(), Vec::new(), 0);
    for index in 0..subject.count() {
        if pictures.len() == MOST_PICTURES || pixels >= MOST_PIXELS || stop.load(Ordering::Relaxed)
        {
            break;
        }
        match read(subject, index) {
            Ok(pair) => {
                pixels += u64::from(pair.input.width()) * u64::from(pair.input.height());
                let sums = CodeSums::of(&pair.input, &pair.truth)?;
                pictures.push((sums, veil_codes(&pair.input)));
            }
            Err(Unread::Missing(_)) => {}
            Err(Unread::Unreadable(reason)) => {
                left_out.push(unused(subject, index, &reason, false));
            }
            Err(Unread::Damaged(reason)) => left_out.push(unused(subject, index, &reason, true)),
            Err(Unread::Fatal(error)) => return Err(EvaluateError::Subject(error)),
        }
    }
    if pictures.is_empty() {
        return Ok((None, left_out));
    }
    let sums: Vec<&CodeSums> = pictures.iter().map(|(sums, _)| sums).collect();
    let baselines = Baselines {
        factor: fit_factor(&sums),
        veil: fit_veil(&pictures),
        fitted_to: place,
        images: pictures.len(),
    };
    Ok((Some(baselines), left_out))
}

fn unused(subject: &dyn Subject, index: usize, reason: &str, is_damaged: bool) -> LeftOut {
    let reason = format!("not used for the fit of the baselines: {reason}");
    LeftOut { image: subject.name(index), reason, is_damaged }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn given_rules_replace_fitted_ones() {
        let fitted = Baselines {
            factor: Factor(0.8),
            veil: VeilRule { g: 0.9, k: 0.5 },
            fitted_to: "runs/a".to_owned(),
            images: 3,
        };
        let text = serde_json::to_string(&fitted).unwrap();
        let expected = r#"{"factor":0.8,"veil":{"g":0.9,"k":0.5},"fitted_to":"runs/a","images":3}"#;
        assert_eq!(text, expected);
        assert_eq!(serde_json::from_str::<Baselines>(&text).unwrap(), fitted);
        let rules = Rules::new(Some(fitted.clone()), Some(Factor(0.7)), None);
        assert_eq!((rules.factor, rules.veil), (Some(Factor(0.7)), Some(fitted.veil)));
        assert_eq!(Rules::new(None, None, None), Rules::default());
    }
}
