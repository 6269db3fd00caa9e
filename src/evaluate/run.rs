//! All pictures of a subject, each given to every method and scored.

use super::align::shift_px;
use super::error::EvaluateError;
use super::fit_gain::Gain;
use super::gain::apply_gain;
use super::score::{Scores, score};
use super::subject::{Subject, Unread, WithTruth, read};
use super::table::Row;
use image::RgbImage;
use rayon::prelude::*;
use serde::Serialize;
use std::error::Error;
use std::sync::atomic::{AtomicBool, Ordering};

/// Pictures in memory at once, with what the methods made of them.
const AT_ONCE: usize = 8;
/// Pictures that are kept, to be looked at.
const KEPT: usize = 4;

/// What makes a picture of an input.
pub trait Method: Sync {
    /// Shortest side that it takes, px.
    fn least_px(&self) -> u32 {
        1
    }

    /// Its picture, as large as the input.
    fn make(&self, input: &RgbImage) -> Result<RgbImage, Box<dyn Error + Send + Sync>>;
}

/// The picture as it is.
struct Input;

impl Method for Input {
    fn make(&self, input: &RgbImage) -> Result<RgbImage, Box<dyn Error + Send + Sync>> {
        Ok(input.clone())
    }
}

impl Method for Gain {
    fn make(&self, input: &RgbImage) -> Result<RgbImage, Box<dyn Error + Send + Sync>> {
        Ok(apply_gain(input, self.factor))
    }
}

/// A picture that was not scored, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Its name, or its file.
    pub image: String,
    /// What is wrong with it.
    pub reason: String,
}

/// All scores.
#[derive(Default)]
pub struct Scored {
    /// Names of the methods: `input`, the gain's, those that were given.
    pub methods: Vec<String>,
    /// By method, then by picture.
    pub rows: Vec<Row>,
    /// Pictures that could not be read.
    pub left_out: Vec<LeftOut>,
    /// Of some pictures, evenly drawn: what each method made, and the truth; small.
    pub kept: Vec<Vec<RgbImage>>,
    /// Pictures that were gone through.
    pub done: usize,
    /// Told to stop before the end.
    pub stopped: bool,
}

/// Scores every picture as it is, with the gain, and by every method. One that cannot be read is left out of all, so that
/// means are of the same pictures. `on_picture` is called after each; `shrink` makes one small enough to be kept.
pub fn run(
    subject: &dyn Subject,
    gain: Option<&Gain>,
    named: &[(String, &dyn Method)],
    shrink: &dyn Fn(RgbImage) -> RgbImage,
    on_picture: &dyn Fn(),
    stop: &AtomicBool,
) -> Result<Scored, EvaluateError> {
    let mut methods: Vec<(String, &dyn Method)> = vec![("input".to_owned(), &Input)];
    methods.extend(gain.map(|gain| (gain.row_name(), gain as &dyn Method)));
    methods.extend(named.iter().cloned());
    let mut all = Scored {
        methods: methods.iter().map(|(name, _)| name.clone()).collect(),
        ..Scored::default()
    };
    let mut by_method: Vec<Vec<Row>> = methods.iter().map(|_| Vec::new()).collect();
    let least_px = methods.iter().map(|(_, method)| method.least_px()).max();
    let least_px = least_px.unwrap_or(1);
    let count = subject.count();
    let of_kept = count.min(KEPT);
    let kept: Vec<usize> = (0..of_kept).map(|k| k * count / of_kept).collect();
    let order: Vec<usize> = (0..count).collect();
    for indices in order.chunks(AT_ONCE) {
        let read = |&index: &usize| readable(subject, index, least_px);
        let found: Vec<Result<_, Unread>> = indices.par_iter().map(read).collect();
        let mut made = Vec::new();
        for (&index, found) in indices.iter().zip(found) {
            if stop.load(Ordering::Relaxed) {
                all.stopped = true;
                return Ok(all);
            }
            match found {
                Ok((pair, shift_px)) => {
                    let pictures = methods.iter().map(|(_, m)| m.make(&pair.input));
                    let pictures: Result<Vec<RgbImage>, _> = pictures.collect();
                    let pictures = pictures.map_err(EvaluateError::Method)?;
                    made.push((index, shift_px, pair.truth, pictures));
                }
                Err(Unread::Fatal(error)) => return Err(EvaluateError::Subject(error)),
                Err(Unread::Missing(reason) | Unread::Unreadable(reason)) => {
                    let image = subject.name(index);
                    all.left_out.push(LeftOut { image, reason });
                }
            }
            all.done += 1;
            on_picture();
        }
        let score_all = |(_, _, truth, pictures): &(_, _, RgbImage, Vec<RgbImage>)| {
            let scores = pictures.par_iter().map(|picture| score(picture, truth));
            scores.collect::<Result<Vec<Scores>, _>>()
        };
        let scores: Result<Vec<Vec<Scores>>, _> = made.par_iter().map(score_all).collect();
        for ((index, shift_px, truth, pictures), scores) in made.iter().zip(scores?) {
            if kept.contains(index) {
                let row = pictures.iter().chain([truth]);
                all.kept
                    .push(row.map(|picture| shrink(picture.clone())).collect());
            }
            for (rows, (scores, (name, _))) in
                by_method.iter_mut().zip(scores.into_iter().zip(&methods))
            {
                rows.push(Row {
                    method: name.clone(),
                    image: subject.name(*index),
                    width: truth.width(),
                    height: truth.height(),
                    shift_px: *shift_px,
                    scores,
                });
            }
        }
    }
    all.rows = by_method.into_iter().flatten().collect();
    Ok(all)
}

/// A picture that all methods take, and how far its truth lies beside it, px.
fn readable(
    subject: &dyn Subject,
    index: usize,
    least_px: u32,
) -> Result<(WithTruth, Option<f64>), Unread> {
    let pair = read(subject, index)?;
    let (width, height) = pair.input.dimensions();
    if width.min(height) < least_px {
        return Err(Unread::Unreadable(format!(
            "it has {width} x {height} px, and networks see nothing smaller than {least_px} px a side"
        )));
    }
    if subject.is_aligned() {
        return Ok((pair, None));
    }
    match shift_px(&pair.input, &pair.truth) {
        Ok(shift) => Ok((pair, Some(shift.length_px()))),
        Err(error) => Err(Unread::Unreadable(error.to_string())),
    }
}
