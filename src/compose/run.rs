//! Scores every picture of a subject by every method.

use super::align::shift_px;
use super::code_sums::CodeSums;
use super::error::EvaluateError;
use super::factor::{Factor, best_factor_of_group};
use super::fit::Rules;
use super::method::{GROUP_FACTOR, Given, Maker, Method, Unmade, makers};
use super::per_image::Row;
use super::score::{Scores, score};
use super::subject::{LeftOut, Subject, Unread, WithTruth, read_sized};
use super::summary::groups;
use image::RgbImage;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Largest number of pictures in memory at once, with the outputs of all methods.
const AT_ONCE: usize = 8;
/// Largest number of pictures kept for the grid.
const KEPT: usize = 4;

/// What is scored.
pub struct Setting<'a> {
    pub subject: &'a dyn Subject,
    /// Length to which the longest sides of larger pictures and truths are scaled down, px; `None` for no scaling.
    pub longest_px: Option<u32>,
    pub rules: &'a Rules,
    /// Further methods with the names of their rows.
    pub methods: &'a [(String, &'a dyn Method)],
}

#[derive(Default)]
pub struct Scored {
    /// Rows in the order of the methods, then of the pictures; empty if the run was stopped. The rows of
    /// [`GROUP_FACTOR`] are in the order of [`Self::group_factors`], then of the pictures.
    pub rows: Vec<Row>,
    pub left_out: Vec<LeftOut>,
    /// Names of the columns of [`Self::kept`], without the truth: all methods but oracles.
    pub columns: Vec<String>,
    /// Reduced outputs of each column's method, and the truth, for some evenly spaced pictures.
    pub kept: Vec<Vec<RgbImage>>,
    /// Best factor of the input for each group.
    pub group_factors: Vec<(String, Factor)>,
    pub done: usize,
    /// True if the stop flag ended the run early.
    pub stopped: bool,
}

/// Outputs of a picture by every maker; `None` if an output must be made later.
struct Made {
    index: usize,
    shift_px: Option<f64>,
    pair: WithTruth,
    outputs: Vec<Option<RgbImage>>,
}

/// Scores every picture by all methods: unprocessed, by the rules, by the oracles and by the given methods. Leaves out
/// unreadable and small pictures, and those without an output, for all methods, so that all means are over the same
/// pictures. Calls `on_picture` for each; `shrink` reduces kept pictures.
pub fn run(
    setting: &Setting,
    shrink: &dyn Fn(RgbImage) -> RgbImage,
    on_picture: &dyn Fn(),
    stop: &AtomicBool,
) -> Result<Scored, EvaluateError> {
    let Setting { subject, rules, methods, .. } = *setting;
    let makers = makers(rules, methods);
    let shown = |maker: &Maker| !maker.is_oracle();
    let mut all = Scored::default();
    let columns = makers.iter().filter(|(_, maker)| shown(maker));
    all.columns = columns.map(|(name, _)| name.clone()).collect();
    let mut by_method: Vec<Vec<Row>> = makers.iter().map(|_| Vec::new()).collect();
    let mut sums = Vec::new();
    let least_px = makers.iter().map(|(_, maker)| maker.least_px()).max().unwrap_or(1);
    let count = subject.count();
    let of_kept = count.min(KEPT);
    let kept: Vec<usize> = (0..of_kept).map(|k| k * count / of_kept).collect();
    let order: Vec<usize> = (0..count).collect();
    for indices in order.chunks(AT_ONCE) {
        let read = |&index: &usize| readable(setting, index, least_px);
        let found: Vec<Result<_, Unread>> = indices.par_iter().map(read).collect();
        let mut made = Vec::new();
        for (&index, found) in indices.iter().zip(found) {
            if stop.load(Ordering::Relaxed) {
                all.stopped = true;
                return Ok(all);
            }
            match found.map(|readable| outputs(index, readable, &makers)) {
                Ok(Ok(of_picture)) => made.push(of_picture),
                Ok(Err(Unmade::Fatal(error))) => return Err(EvaluateError::Method(error)),
                Err(Unread::Fatal(error)) => return Err(EvaluateError::Subject(error)),
                Ok(Err(Unmade::LeftOut(reason)))
                | Err(Unread::Missing(reason) | Unread::Unreadable(reason)) => {
                    let image = subject.name(index);
                    all.left_out.push(LeftOut { image, reason, is_damaged: false });
                }
                Err(Unread::Damaged(reason)) => {
                    let image = subject.name(index);
                    all.left_out.push(LeftOut { image, reason, is_damaged: true });
                }
            }
            all.done += 1;
            on_picture();
        }
        let score_all = |made: &Made| {
            let scores = made.outputs.par_iter().map(|output| {
                let scores = output.as_ref().map(|output| score(output, &made.pair.truth));
                scores.transpose()
            });
            let scores: Vec<Option<Scores>> = scores.collect::<Result<_, _>>()?;
            Ok((scores, CodeSums::of(&made.pair.input, &made.pair.truth)?))
        };
        let scores: Result<Vec<_>, EvaluateError> = made.par_iter().map(score_all).collect();
        for (made, (scores, sums_of_input)) in made.into_iter().zip(scores?) {
            for ((rows, scores), (name, maker)) in by_method.iter_mut().zip(scores).zip(&makers) {
                rows.extend(scores.map(|scores| Row {
                    method: name.clone(),
                    oracle: maker.is_oracle(),
                    image: subject.name(made.index),
                    group: subject.group(made.index),
                    only_for: None,
                    width: made.pair.truth.width(),
                    height: made.pair.truth.height(),
                    shift_px: made.shift_px,
                    scores,
                }));
            }
            if kept.contains(&made.index) {
                let outputs = made.outputs.into_iter().zip(&makers);
                let outputs = outputs.filter(|(_, (_, maker))| shown(maker));
                let row = outputs.filter_map(|(output, _)| output).chain([made.pair.truth]);
                all.kept.push(row.map(shrink).collect());
            }
            sums.push((made.index, sums_of_input));
        }
    }
    if let Some(place) = makers.iter().position(|(_, maker)| matches!(maker, Maker::GroupFactor)) {
        let rows = group_factor_rows(setting, &by_method[0], &sums, &mut all, stop)?;
        by_method[place] = rows;
    }
    all.rows = if all.stopped { Vec::new() } else { by_method.into_iter().flatten().collect() };
    Ok(all)
}

/// Makes the outputs of a picture by all makers.
fn outputs(
    index: usize,
    (pair, file_px, shift_px): Readable,
    makers: &[(String, Maker)],
) -> Result<Made, Unmade> {
    let given = Given { index, input: &pair.input, file_px };
    let outputs = makers.iter().map(|(_, maker)| maker.make(&given, &pair.truth).transpose());
    let outputs = outputs.collect::<Result<_, _>>()?;
    Ok(Made { index, shift_px, pair, outputs })
}

/// A picture and its truth, the size of its file, px, and the shift of its truth, px.
type Readable = (WithTruth, [u32; 2], Option<f64>);

/// Reads a picture, checks its size, and measures the shift of its truth, px; `None` if the subject is aligned.
fn readable(setting: &Setting, index: usize, least_px: u32) -> Result<Readable, Unread> {
    let (pair, file_px) = read_sized(setting.subject, index, setting.longest_px)?;
    let (width, height) = pair.input.dimensions();
    if width.min(height) < least_px {
        return Err(Unread::Unreadable(format!(
            "it has {width} x {height} px, but networks need at least {least_px} px per side"
        )));
    }
    if setting.subject.is_aligned() {
        return Ok((pair, file_px, None));
    }
    match shift_px(&pair.input, &pair.truth) {
        Ok(shift) => Ok((pair, file_px, Some(shift.length_px()))),
        Err(error) => Err(Unread::Unreadable(error.to_string())),
    }
}

/// Finds the best factor of each group, and reads the pictures again to score them after these factors. `inputs` and
/// `sums` are the rows and the sums of the unchanged pictures.
fn group_factor_rows(
    setting: &Setting,
    inputs: &[Row],
    sums: &[(usize, CodeSums)],
    all: &mut Scored,
    stop: &AtomicBool,
) -> Result<Vec<Row>, EvaluateError> {
    let mut rows = Vec::new();
    for group in groups(inputs) {
        let of_group: Vec<(&Row, &(usize, CodeSums))> =
            inputs.iter().zip(sums).filter(|(row, _)| row.counts_for(&group)).collect();
        let sums: Vec<&CodeSums> = of_group.iter().map(|(_, (_, sums))| sums).collect();
        let factor = best_factor_of_group(&sums);
        let row = |(input, (index, _)): &(&Row, &(usize, CodeSums))| {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let again = read_sized(setting.subject, *index, setting.longest_px);
            let (pair, _) = again.map_err(|error| match error {
                Unread::Fatal(error) => EvaluateError::Subject(error),
                Unread::Missing(reason) | Unread::Unreadable(reason) | Unread::Damaged(reason) => {
                    let image = setting.subject.name(*index);
                    EvaluateError::Changed { image, reason }
                }
            })?;
            let scores = score(&factor.apply(&pair.input), &pair.truth)?;
            let (method, only_for) = (GROUP_FACTOR.to_owned(), Some(group.clone()));
            Ok(Some(Row { method, oracle: true, only_for, scores, ..(*input).clone() }))
        };
        let of_group: Vec<Option<Row>> =
            of_group.par_iter().map(row).collect::<Result<_, EvaluateError>>()?;
        all.stopped |= of_group.iter().any(Option::is_none);
        rows.extend(of_group.into_iter().flatten());
        all.group_factors.push((group, factor));
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{OWN_FACTOR, Pair, VeilRule, fit_baselines, summaries};
    use image::Rgb;
    use std::cell::Cell;
    use std::path::Path;

    /// A method that changes the first pixel of the input.
    struct Spot;

    impl Method for Spot {
        fn least_px(&self) -> u32 {
            16
        }

        fn make(&self, given: &Given) -> Result<RgbImage, Unmade> {
            let mut picture = given.input.clone();
            picture.put_pixel(0, 0, Rgb([255, 0, 0]));
            Ok(picture)
        }
    }

    struct Broken;

    impl Method for Broken {
        fn make(&self, _: &Given) -> Result<RgbImage, Unmade> {
            Err(Unmade::Fatal("out of order".into()))
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

    fn methods(rows: &[Row]) -> Vec<&str> {
        let mut methods: Vec<&str> = rows.iter().map(|row| row.method.as_str()).collect();
        methods.dedup();
        methods
    }

    #[test]
    fn every_picture_is_scored_by_every_method() {
        let folder = tempfile::tempdir().unwrap();
        let pairs = pairs(folder.path());
        let stop = AtomicBool::new(false);
        let (baselines, left_out) = fit_baselines(&pairs, "here".to_owned(), &stop).unwrap();
        let baselines = baselines.unwrap();
        assert_eq!((baselines.images, left_out.len()), (3, 2));
        assert!((1.0..2.0).contains(&baselines.factor.0), "{baselines:?}");
        let rules = Rules::new(Some(baselines), None, Some(VeilRule { g: 1.1, k: 0.5 }));
        let seen = Cell::new(0);
        let on_picture = || seen.set(seen.get() + 1);
        let setting = Setting {
            subject: &pairs,
            longest_px: None,
            rules: &rules,
            methods: &[("spot".to_owned(), &Spot)],
        };
        let scored = run(&setting, &|picture| picture, &on_picture, &stop).unwrap();
        let factor = rules.factor.unwrap().row_name();
        let veil = "veil rule 1.10, 0.50";
        assert_eq!(scored.columns, ["input", &factor, veil, "spot"]);
        let expected = ["input", &factor, veil, GROUP_FACTOR, OWN_FACTOR, "spot"];
        assert_eq!(methods(&scored.rows), expected);
        assert_eq!(scored.rows.len(), 6 * 2);
        let left_out: Vec<&str> = scored.left_out.iter().map(|l| l.image.as_str()).collect();
        assert_eq!(left_out, ["small", "cropped", "lost"]);
        assert!(scored.left_out[0].reason.contains("at least 16 px"));
        assert_eq!((seen.get(), scored.done, scored.stopped), (5, 5, false));
        // A row has the pictures of four methods and the truth.
        assert!(scored.kept.iter().all(|row| row.len() == 5));
        let found = summaries(&scored.rows, Some(veil), &[]);
        assert!(found.iter().all(|row| row.all.count == 2 && row.group == "all"));
        let psnrs_db = |row: usize| {
            let scores = found[row].all.scores;
            (scores.psnr_colour_db, scores.psnr_own_factor_db)
        };
        // The first picture equals its truth; the second one is darker.
        assert_eq!(psnrs_db(0), (f64::INFINITY, f64::INFINITY));
        assert!(psnrs_db(5).0.is_finite() && found[5].aligned.is_some());
        let of = |method: &str| -> Vec<&Row> {
            scored.rows.iter().filter(|row| row.method == method).collect()
        };
        let (input, own) = (of("input")[1].scores, of(OWN_FACTOR)[1].scores);
        assert!((own.psnr_colour_db - input.psnr_own_factor_db).abs() < 1e-9);
        assert!(own.psnr_colour_db > input.psnr_colour_db + 3.0);
    }

    #[test]
    fn groups_have_their_own_best_factors() {
        let folder = tempfile::tempdir().unwrap();
        let mut pairs = pairs(folder.path());
        pairs.truncate(2);
        for (pair, name) in pairs.iter_mut().zip(["bright/1", "dark/1"]) {
            pair.name = name.to_owned();
        }
        let setting = Setting {
            subject: &pairs,
            longest_px: Some(12),
            rules: &Rules::default(),
            methods: &[],
        };
        let stop = AtomicBool::new(false);
        let scored = run(&setting, &|picture| picture, &|| {}, &stop).unwrap();
        assert!(scored.rows.iter().all(|row| [row.width, row.height] == [12, 10]));
        let groups: Vec<&str> = scored.group_factors.iter().map(|(g, _)| g.as_str()).collect();
        assert_eq!(groups, ["all", "bright", "dark"]);
        let [all, bright, dark] = [0, 1, 2].map(|k| scored.group_factors[k].1.0);
        assert!(bright == 1.0 && dark > 1.3 && (bright..=dark).contains(&all), "{all} {dark}");
        // The rows of a group have its factor.
        let of = |method: &str, only_for: Option<&str>| -> Vec<f64> {
            let of_method = scored.rows.iter().filter(|row| row.method == method);
            let rows = of_method.filter(|row| row.only_for.as_deref() == only_for);
            rows.map(|row| row.scores.psnr_colour_db).collect()
        };
        assert_eq!(of(GROUP_FACTOR, Some("dark")), of(OWN_FACTOR, None)[1..]);
        assert_eq!(of(GROUP_FACTOR, Some("bright")), [f64::INFINITY]);
        assert_eq!(of(GROUP_FACTOR, Some("all")).len(), 2);
    }

    #[test]
    fn a_failing_method_and_a_stop_end_the_run() {
        let folder = tempfile::tempdir().unwrap();
        let pairs = pairs(folder.path());
        let broken: [(String, &dyn Method); 1] = [("broken".to_owned(), &Broken)];
        let run = |methods: &[(String, &dyn Method)], stop: bool| {
            let rules = Rules::default();
            let setting = Setting { subject: &pairs, longest_px: None, rules: &rules, methods };
            run(&setting, &|picture| picture, &|| {}, &AtomicBool::new(stop))
        };
        let error = run(&broken, false).err().unwrap();
        assert_eq!(error.to_string(), "out of order");
        let stopped = run(&[], true).unwrap();
        assert!(stopped.stopped && stopped.rows.is_empty() && stopped.done == 0);
    }
}
