//! Fits the gain that brings the inputs of a subject closest to the truth. Tables have a row for a fitted gain.

use super::error::EvaluateError;
use super::gain::best_gain;
use super::subject::{LeftOut, Subject, Unread, read};
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};

/// Limits of the fit: number of pictures, and approximate number of pixels.
const MOST_PICTURES: usize = 64;
const MOST_PIXELS: u64 = 200_000_000;

/// The best factor for the linear light of the inputs, and the pictures to which it was fitted.
#[derive(Clone, Debug, Serialize)]
pub struct Gain {
    pub factor: f64,
    /// Path of the folder or run with the fitted pictures.
    pub fitted_to: String,
    pub images: usize,
    /// Noun for a picture: `pair` or `train scene`.
    #[serde(skip)]
    pub kind: &'static str,
}

impl Gain {
    pub fn row_name(&self) -> String {
        format!("input x {:.3}", self.factor)
    }
}

/// Fits the gain to the first readable pictures, and lists unreadable pictures. Returns no gain if none is readable.
pub fn fit_gain(
    subject: &dyn Subject,
    place: String,
    stop: &AtomicBool,
) -> Result<(Option<Gain>, Vec<LeftOut>), EvaluateError> {
    let (mut pairs, mut left_out, mut pixels) = (Vec::new(), Vec::new(), 0);
    for index in 0..subject.count() {
        if pairs.len() == MOST_PICTURES || pixels >= MOST_PIXELS || stop.load(Ordering::Relaxed) {
            break;
        }
        match read(subject, index) {
            Ok(pair) => {
                pixels += u64::from(pair.input.width()) * u64::from(pair.input.height());
                pairs.push(pair);
            }
            Err(Unread::Missing(_)) => {}
            Err(Unread::Unreadable(reason)) => left_out.push(LeftOut {
                image: subject.name(index),
                reason: format!("not used for the fit of the gain: {reason}"),
            }),
            Err(Unread::Fatal(error)) => return Err(EvaluateError::Subject(error)),
        }
    }
    if pairs.is_empty() {
        return Ok((None, left_out));
    }
    let gain = Gain {
        factor: best_gain(pairs.iter().map(|pair| (&pair.input, &pair.truth)))?,
        fitted_to: place,
        images: pairs.len(),
        kind: subject.kind(),
    };
    Ok((Some(gain), left_out))
}
