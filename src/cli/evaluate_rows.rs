//! What `evaluate` scores: pictures with their truths, read and given to each method one after the other.

use super::exit_code::{Exit, Failure};
use super::progress::Progress;
use anyhow::anyhow;
use compose::{Pair, Row, Scores, apply_gain, best_gain, read_picture, score, shift_px};
use image::RgbImage;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use train::{Base, ExampleError, LEAST_PX, Separator, TupleSource, bytes_of_planes, shrunk};

/// Pictures in memory at once, with what the methods made of them.
const AT_ONCE: usize = 8;

/// Pictures that are kept, to be looked at.
const KEPT: usize = 4;

/// The gain is fitted to so many pairs at most, and about so many pixels.
const GAIN_PAIRS: usize = 64;
const GAIN_PIXELS: u64 = 200_000_000;

/// Pictures with their truths, in order.
pub(super) enum Subject {
    /// A run's scenes.
    Run(TupleSource),
    /// Photographs.
    Pairs(Vec<Pair>),
}

/// A picture, and what it should become.
struct Example {
    input: RgbImage,
    truth: RgbImage,
}

/// A picture that was not scored, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct LeftOut {
    pub(super) image: String,
    pub(super) reason: String,
}

/// Why there is no example.
enum Lack {
    /// It was not made yet.
    Missing(String),
    /// It is there, and of no use.
    Unreadable(String),
    /// Nothing can be read any more.
    Fatal(Failure),
}

impl Subject {
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Run(source) => source.lines.len(),
            Self::Pairs(pairs) => pairs.len(),
        }
    }

    /// Keeps the first ones.
    pub(super) fn limit(&mut self, count: usize) {
        match self {
            Self::Run(source) => source.lines.truncate(count),
            Self::Pairs(pairs) => pairs.truncate(count),
        }
    }

    fn name(&self, index: usize) -> String {
        match self {
            Self::Run(source) => source.lines[index].id.to_string(),
            Self::Pairs(pairs) => pairs[index].name.clone(),
        }
    }

    fn read(&self, index: usize) -> Result<Example, Lack> {
        let example = match self {
            Self::Run(source) => tuple(source, index)?,
            Self::Pairs(pairs) => {
                let read = |path| read_picture(path).map_err(|e| Lack::Unreadable(e.to_string()));
                Example {
                    input: read(&pairs[index].blended)?,
                    truth: read(&pairs[index].transmission)?,
                }
            }
        };
        let (of_input, of_truth) = (example.input.dimensions(), example.truth.dimensions());
        if of_input != of_truth {
            return Err(Lack::Unreadable(format!(
                "the picture has {} x {} px, its truth {} x {} px; crop or scale one to the other's size",
                of_input.0, of_input.1, of_truth.0, of_truth.1
            )));
        }
        Ok(example)
    }

    /// How far the truth lies beside the picture, px; rendered ones lie on each other.
    fn shift_px(&self, example: &Example) -> Result<Option<f64>, Lack> {
        match self {
            Self::Run(_) => Ok(None),
            Self::Pairs(_) => match shift_px(&example.input, &example.truth) {
                Ok(shift) => Ok(Some(shift.length_px())),
                Err(error) => Err(Lack::Unreadable(error.to_string())),
            },
        }
    }
}

/// A scene's input and transmission, as 8-bit pictures.
fn tuple(source: &TupleSource, index: usize) -> Result<Example, Lack> {
    let fatal = |error: ExampleError| match error {
        ExampleError::Store(error) => Lack::Fatal(error.into()),
        ExampleError::Damaged { .. } | ExampleError::Unusable { .. } => {
            Lack::Unreadable(error.to_string())
        }
        ExampleError::None(_) | ExampleError::Stopped => {
            Lack::Fatal(Failure::new(Exit::Failed, error))
        }
    };
    match source.read(index).map_err(fatal)? {
        Some(Base::Example(example)) => {
            let picture = |planes: &[f32]| {
                let (width, height) = (example.columns as u32, example.rows as u32);
                RgbImage::from_raw(width, height, bytes_of_planes(planes))
                    .ok_or_else(|| Lack::Unreadable("it has fewer pixels than its film".to_owned()))
            };
            Ok(Example {
                input: picture(&example.input)?,
                truth: picture(&example.transmission)?,
            })
        }
        Some(Base::Photographs { .. }) => Err(Lack::Unreadable("it is no tuple".to_owned())),
        None if source.is_in_quarantine(index).map_err(fatal)? => Err(Lack::Missing(
            "its scene is in quarantine; `glasshouse retry` has it tried again".to_owned(),
        )),
        None => Err(Lack::Missing(
            "it has no tuple yet; `glasshouse work` makes it".to_owned(),
        )),
    }
}

/// What makes a picture of an input.
pub(super) enum Method<'a> {
    /// Nothing.
    Input,
    /// Light times a factor.
    Gain(f64),
    /// Networks, with the side of their tiles, px.
    Networks(&'a Separator, usize),
}

impl Method<'_> {
    fn make(&self, input: &RgbImage) -> Result<RgbImage, Failure> {
        match self {
            Self::Input => Ok(input.clone()),
            Self::Gain(gain) => Ok(apply_gain(input, *gain)),
            Self::Networks(separator, tile_px) => {
                let made = separator.separate(input, *tile_px);
                let [transmission, _] = made.map_err(|e| Failure::new(Exit::Failed, e))?;
                Ok(transmission)
            }
        }
    }
}

/// All scores.
#[derive(Default)]
pub(super) struct Scored {
    /// By method, then by image.
    pub(super) rows: Vec<Row>,
    pub(super) left_out: Vec<LeftOut>,
    /// Of some pictures, evenly drawn: what each method made, and the truth; small.
    pub(super) kept: Vec<Vec<RgbImage>>,
    /// Told to stop before the end.
    pub(super) stopped: bool,
}

/// Scores every picture by every method: one that cannot be read is left out of all, so that means are of the same.
pub(super) fn scored(
    subject: &Subject,
    methods: &[(String, Method)],
    progress: &Progress,
    stop: &AtomicBool,
) -> Result<Scored, Failure> {
    let mut all = Scored::default();
    let mut by_method: Vec<Vec<Row>> = methods.iter().map(|_| Vec::new()).collect();
    let sees_least = methods
        .iter()
        .any(|(_, method)| matches!(method, Method::Networks(..)));
    let order: Vec<usize> = (0..subject.len()).collect();
    let of_kept = subject.len().min(KEPT);
    let kept: Vec<usize> = (0..of_kept).map(|k| k * subject.len() / of_kept).collect();
    for indices in order.chunks(AT_ONCE) {
        let read = |&index: &usize| {
            let example = subject.read(index)?;
            let (width, height) = example.input.dimensions();
            if sees_least && (width.min(height) as usize) < LEAST_PX {
                return Err(Lack::Unreadable(format!(
                    "it has {width} x {height} px, and networks see nothing smaller than {LEAST_PX} px a side"
                )));
            }
            let shift_px = subject.shift_px(&example)?;
            Ok((example, shift_px))
        };
        let examples: Vec<Result<_, Lack>> = indices.par_iter().map(read).collect();
        let mut made = Vec::new();
        for (&index, example) in indices.iter().zip(examples) {
            if stop.load(Ordering::Relaxed) {
                all.stopped = true;
                return Ok(all);
            }
            match example {
                Ok((example, shift_px)) => {
                    let pictures = methods.iter().map(|(_, m)| m.make(&example.input));
                    let pictures = pictures.collect::<Result<Vec<_>, _>>()?;
                    made.push((index, shift_px, example.truth, pictures));
                }
                Err(Lack::Fatal(failure)) => return Err(failure),
                Err(Lack::Missing(reason) | Lack::Unreadable(reason)) => {
                    let image = subject.name(index);
                    all.left_out.push(LeftOut { image, reason });
                }
            }
            progress.add(1, false);
        }
        let score_all = |(_, _, truth, pictures): &(_, _, RgbImage, Vec<RgbImage>)| {
            let scores = pictures.par_iter().map(|picture| score(picture, truth));
            scores.collect::<Result<Vec<Scores>, _>>()
        };
        let scores: Vec<Vec<Scores>> = made
            .par_iter()
            .map(score_all)
            .collect::<Result<_, _>>()
            .map_err(|e| Failure::new(Exit::Failed, e))?;
        for ((index, shift_px, truth, pictures), scores) in made.iter().zip(scores) {
            if kept.contains(index) {
                let row = pictures.iter().chain([truth]);
                all.kept.push(row.map(|p| shrunk(p.clone())).collect());
            }
            for (k, scores) in scores.into_iter().enumerate() {
                by_method[k].push(Row {
                    method: methods[k].0.clone(),
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

/// The factor of an input's light that fits truths best.
#[derive(Clone, Debug)]
pub(super) struct Gain {
    pub(super) factor: f64,
    /// Whose truths it was fitted to.
    pub(super) place: String,
    /// What they are there: `pair`, `train scene`.
    pub(super) kind: &'static str,
    /// Pairs.
    pub(super) images: usize,
}

/// Fits the gain to the first pairs that are there, and lists what cannot be read. `None` where there are none.
pub(super) fn fitted_gain(
    subject: &Subject,
    place: String,
    stop: &AtomicBool,
) -> Result<(Option<Gain>, Vec<LeftOut>), Failure> {
    let (mut examples, mut left_out, mut pixels) = (Vec::new(), Vec::new(), 0);
    for index in 0..subject.len() {
        if examples.len() == GAIN_PAIRS || pixels >= GAIN_PIXELS || stop.load(Ordering::Relaxed) {
            break;
        }
        match subject.read(index) {
            Ok(example) => {
                pixels += u64::from(example.input.width()) * u64::from(example.input.height());
                examples.push(example);
            }
            Err(Lack::Missing(_)) => {}
            Err(Lack::Unreadable(reason)) => left_out.push(LeftOut {
                image: subject.name(index),
                reason: format!("not among those that the gain is fitted to: {reason}"),
            }),
            Err(Lack::Fatal(failure)) => return Err(failure),
        }
    }
    if examples.is_empty() {
        return Ok((None, left_out));
    }
    let factor = best_gain(examples.iter().map(|e| (&e.input, &e.truth)));
    let gain = Gain {
        factor: factor.map_err(|e| Failure::new(Exit::Failed, anyhow!(e)))?,
        place,
        kind: match subject {
            Subject::Run(_) => "train scene",
            Subject::Pairs(_) => "pair",
        },
        images: examples.len(),
    };
    Ok((Some(gain), left_out))
}
