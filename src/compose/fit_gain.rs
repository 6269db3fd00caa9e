//! The gain that fits the pictures of a subject best: a row of its own in every table.

use super::error::EvaluateError;
use super::gain::best_gain;
use super::subject::{LeftOut, Subject, Unread, read};
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};

/// Pictures that are read at most, and pixels, about.
const MOST_PICTURES: usize = 64;
const MOST_PIXELS: u64 = 200_000_000;

/// The factor of an input's light that fits truths best.
#[derive(Clone, Debug, Serialize)]
pub struct Gain {
    /// On linear light.
    pub factor: f64,
    /// Folder of the pictures that it was fitted to.
    pub fitted_to: String,
    /// How many they are.
    pub images: usize,
    /// What each of them is.
    #[serde(skip)]
    pub kind: &'static str,
}

impl Gain {
    /// How its row is called.
    pub fn row_name(&self) -> String {
        format!("input x {:.3}", self.factor)
    }
}

/// Fits the gain to the first pictures that are there, and lists those that cannot be read. `None` where there are none.
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
                reason: format!("not among those that the gain is fitted to: {reason}"),
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
