//! Reads the images on which a training shows and measures its networks.

use super::checks::{Checks, ChosenOn, MOST_SHOWN};
use super::error::TrainError;
use super::resume::digest_of_pairs;
use super::run::{Training, of_split};
use super::session::Watcher;
use compose::{Unread, read_sized};
use examples::Example;
use examples::Picture;
use examples::{Base, ExampleError, TupleSource};
use glasshouse_line::Split;
use plan::TrainSettings;
use std::sync::Arc;

/// Largest side of the pairs that choose the best checkpoint, px; larger ones are scaled down.
const SELECT_PX: u32 = 640;

impl Checks {
    /// Reads the images of a training's checks.
    pub(super) fn of(
        training: &Training,
        settings: &TrainSettings,
        watcher: &mut dyn Watcher,
    ) -> Result<Self, TrainError> {
        let validation = validation(training, settings, watcher)?;
        let shown = if validation.is_empty() {
            first_examples(training, settings, Split::Train, MOST_SHOWN)?
        } else {
            Vec::new()
        };
        Ok(Self { validation, shown, chosen_on: ChosenOn::of(training)? })
    }
}

impl ChosenOn {
    /// Returns the images that choose the best checkpoint of a training; `None` without any.
    pub(super) fn of(training: &Training) -> Result<Option<Self>, TrainError> {
        if let Some((_, pairs)) = &training.select {
            return Ok(digest_of_pairs(pairs)?.map(Self::RealPairs));
        }
        let has_scenes = training.scenes.iter().any(|line| line.split == Split::Validation);
        Ok(has_scenes.then_some(Self::Validation))
    }
}

/// Reads the first `training.validate` pairs of `training.select`, or else whole images of as many scenes of the split
/// `validation` that have a tuple.
fn validation(
    training: &Training,
    settings: &TrainSettings,
    watcher: &mut dyn Watcher,
) -> Result<Vec<Example>, TrainError> {
    let Some((folder, pairs)) = &training.select else {
        return Ok(first_examples(training, settings, Split::Validation, training.validate)?);
    };
    let mut examples = Vec::new();
    for index in 0..pairs.len() {
        if examples.len() >= training.validate {
            break;
        }
        match read_sized(pairs, index, Some(SELECT_PX)) {
            Ok((pair, _)) => examples.push(Example {
                rows: pair.input.height() as usize,
                columns: pair.input.width() as usize,
                input: Picture::from_rgb(&pair.input).planes,
                transmission: Picture::from_rgb(&pair.truth).planes,
                glass_reflection: None,
                clean_reflection: None,
            }),
            Err(Unread::Missing(reason) | Unread::Unreadable(reason) | Unread::Damaged(reason)) => {
                watcher.warning(&format!("{} is left out: {reason}", pairs[index].name));
            }
            Err(Unread::Fatal(source)) => return Err(candle_core::Error::Wrapped(source).into()),
        }
    }
    if examples.is_empty() && training.validate > 0 {
        return Err(TrainError::NothingToSelect { folder: folder.clone() });
    }
    Ok(examples)
}

/// Reads whole images of the first `most` scenes of a split that have a tuple.
fn first_examples(
    training: &Training,
    settings: &TrainSettings,
    split: Split,
    most: usize,
) -> Result<Vec<Example>, ExampleError> {
    let source = TupleSource {
        files: Arc::clone(&training.tuples),
        lines: of_split(training.scenes, split),
        pixels: settings.pixels,
    };
    let mut examples = Vec::new();
    for index in 0..source.lines.len() {
        if examples.len() >= most {
            break;
        }
        if let Some(Base::Example(example)) = source.read(index)? {
            examples.push(example);
        }
    }
    Ok(examples)
}
