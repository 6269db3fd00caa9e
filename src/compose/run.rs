//! Scores every picture of a subject by every method.

use super::align::shift_px;
use super::error::EvaluateError;
use super::fit_gain::Gain;
use super::gain::apply_gain;
use super::score::{Scores, score};
use super::subject::{LeftOut, Subject, Unread, WithTruth, read};
use super::table::Row;
use image::RgbImage;
use rayon::prelude::*;
use std::error::Error;
use std::sync::atomic::{AtomicBool, Ordering};

/// Largest number of pictures in memory at once, with the outputs of all methods.
const AT_ONCE: usize = 8;
/// Largest number of pictures kept for the grid.
const KEPT: usize = 4;

/// A method that makes a picture from an input.
pub trait Method: Sync {
    /// Returns the shortest accepted side, px.
    fn least_px(&self) -> u32 {
        1
    }

    /// Makes the output, which has the size of the input.
    fn make(&self, input: &RgbImage) -> Result<RgbImage, Box<dyn Error + Send + Sync>>;
}

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

#[derive(Default)]
pub struct Scored {
    /// Names of the methods: `input`, the gain (if it was fitted), and the given methods.
    pub methods: Vec<String>,
    /// Rows in the order of the methods, then of the pictures; empty if the run was stopped.
    pub rows: Vec<Row>,
    pub left_out: Vec<LeftOut>,
    /// Reduced outputs of every method, and the truth, for some evenly spaced pictures.
    pub kept: Vec<Vec<RgbImage>>,
    pub done: usize,
    /// True if the stop flag ended the run early.
    pub stopped: bool,
}

/// Scores every picture unprocessed, with the gain and by every method. Leaves out unreadable or small pictures for all
/// methods, so that all means are over the same pictures. Calls `on_picture` for each; `shrink` reduces kept pictures.
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
                all.kept.push(row.map(|picture| shrink(picture.clone())).collect());
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

/// Reads a picture, checks its size, and measures the shift of its truth, px; `None` if the subject is aligned.
fn readable(
    subject: &dyn Subject,
    index: usize,
    least_px: u32,
) -> Result<(WithTruth, Option<f64>), Unread> {
    let pair = read(subject, index)?;
    let (width, height) = pair.input.dimensions();
    if width.min(height) < least_px {
        return Err(Unread::Unreadable(format!(
            "it has {width} x {height} px, but networks need at least {least_px} px per side"
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MethodMeans, Pair, fit_gain};
    use image::Rgb;
    use std::cell::Cell;
    use std::path::Path;

    /// A method that changes the first pixel of the input.
    struct Spot;

    impl Method for Spot {
        fn least_px(&self) -> u32 {
            16
        }

        fn make(&self, input: &RgbImage) -> Result<RgbImage, Box<dyn Error + Send + Sync>> {
            let mut picture = input.clone();
            picture.put_pixel(0, 0, Rgb([255, 0, 0]));
            Ok(picture)
        }
    }

    struct Broken;

    impl Method for Broken {
        fn make(&self, _: &RgbImage) -> Result<RgbImage, Box<dyn Error + Send + Sync>> {
            Err("out of order".into())
        }
    }

    fn save(
        folder: &Path,
        name: &str,
        [width, height]: [u32; 2],
        scale: f64,
    ) -> std::path::PathBuf {
        let path = folder.join(format!("{name}.png"));
        let value = |v: u32| (f64::from(40 + v % 160) * scale) as u8;
        RgbImage::from_fn(width, height, |x, y| Rgb([x * 7, y * 9, x * y].map(value)))
            .save(&path)
            .unwrap();
        path
    }

    /// Makes five pairs: equal pictures, a darker input, small pictures, different sizes, and a missing input.
    fn pairs(folder: &Path) -> Vec<Pair> {
        let sizes = [
            ("equal", [24, 20], [24, 20], 1.0),
            ("dark", [24, 20], [24, 20], 0.8),
            ("small", [24, 12], [24, 12], 1.0),
            ("cropped", [24, 20], [23, 20], 1.0),
            ("lost", [24, 20], [24, 20], 1.0),
        ];
        let pair = |(name, input, truth, scale): (&str, _, _, _)| Pair {
            name: name.to_owned(),
            blended: save(folder, &format!("{name}-input"), input, scale),
            transmission: save(folder, &format!("{name}-truth"), truth, 1.0),
            reflection: None,
            clean_reflection: None,
        };
        let pairs: Vec<Pair> = sizes.into_iter().map(pair).collect();
        std::fs::remove_file(&pairs[4].blended).unwrap();
        pairs
    }

    #[test]
    fn every_picture_is_scored_by_every_method() {
        let folder = tempfile::tempdir().unwrap();
        let pairs = pairs(folder.path());
        let stop = AtomicBool::new(false);
        let (gain, left_out) = fit_gain(&pairs, "here".to_owned(), &stop).unwrap();
        let gain = gain.unwrap();
        assert_eq!((gain.images, gain.kind, left_out.len()), (3, "pair", 2));
        assert!((1.0..2.0).contains(&gain.factor), "{}", gain.factor);
        let seen = Cell::new(0);
        let on_picture = || seen.set(seen.get() + 1);
        let named: [(String, &dyn Method); 1] = [("spot".to_owned(), &Spot)];
        let shrink = |picture: RgbImage| picture;
        let scored = run(&pairs, Some(&gain), &named, &shrink, &on_picture, &stop).unwrap();
        assert_eq!(scored.methods, ["input", gain.row_name().as_str(), "spot"]);
        let rows: Vec<(&str, &str)> =
            scored.rows.iter().map(|row| (row.method.as_str(), row.image.as_str())).collect();
        assert_eq!(rows.len(), 3 * 2);
        assert_eq!(rows[..2], [("input", "equal"), ("input", "dark")]);
        let left_out: Vec<&str> = scored.left_out.iter().map(|l| l.image.as_str()).collect();
        assert_eq!(left_out, ["small", "cropped", "lost"]);
        assert!(scored.left_out[0].reason.contains("at least 16 px"));
        assert_eq!((seen.get(), scored.done, scored.stopped), (5, 5, false));
        // A row has the pictures of three methods and the truth.
        assert!(scored.kept.iter().all(|row| row.len() == 4));
        let json = serde_json::to_value(MethodMeans::of("input", &scored.rows)).unwrap();
        assert_eq!((&json["images"], &json["psnr_colour_db"]), (&2.into(), &"inf".into()));
        let spot = MethodMeans::of("spot", &scored.rows);
        assert!(spot.all.scores.psnr_colour_db.is_finite() && spot.aligned.is_some());
    }

    #[test]
    fn a_failing_method_and_a_stop_end_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let pairs = pairs(folder.path());
        let shrink = |picture: RgbImage| picture;
        let broken: [(String, &dyn Method); 1] = [("broken".to_owned(), &Broken)];
        let run = |named: &[(String, &dyn Method)], stop: bool| {
            run(&pairs, None, named, &shrink, &|| {}, &AtomicBool::new(stop))
        };
        let error = run(&broken, false).err().unwrap();
        assert_eq!(error.to_string(), "out of order");
        let stopped = run(&[], true).unwrap();
        assert!(stopped.stopped && stopped.rows.is_empty() && stopped.done == 0);
    }
}
