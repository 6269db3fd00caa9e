//! Pictures with their truths, from wherever they are.

use super::pairs::Pair;
use super::picture::read_picture;
use image::RgbImage;
use serde::Serialize;
use std::error::Error;

/// A picture, and what it should become. Both have the same size.
pub struct WithTruth {
    /// The picture as it is.
    pub input: RgbImage,
    /// The picture as it should be.
    pub truth: RgbImage,
}

/// Why a picture was not read.
#[derive(Debug)]
pub enum Unread {
    /// It was not made yet.
    Missing(String),
    /// It is there, and of no use.
    Unreadable(String),
    /// No picture can be read any more.
    Fatal(Box<dyn Error + Send + Sync>),
}

/// A picture that was not scored, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Its name, or its file.
    pub image: String,
    /// What is wrong with it.
    pub reason: String,
}

/// Pictures with their truths, in order.
pub trait Subject: Sync {
    fn count(&self) -> usize;
    /// What a picture is called.
    fn name(&self, index: usize) -> String;
    /// Reads a picture; `read` checks it.
    fn read(&self, index: usize) -> Result<WithTruth, Unread>;
    /// Every truth lies exactly on its picture, so that no shift is measured.
    fn is_aligned(&self) -> bool;
    /// What one of them is: `pair`, `train scene`.
    fn kind(&self) -> &'static str;
}

/// A picture and its truth of equal size.
pub(super) fn read(subject: &dyn Subject, index: usize) -> Result<WithTruth, Unread> {
    let pair = subject.read(index)?;
    let ([w, h], [tw, th]) = (size(&pair.input), size(&pair.truth));
    if [w, h] == [tw, th] {
        return Ok(pair);
    }
    Err(Unread::Unreadable(format!(
        "the picture has {w} x {h} px, its truth {tw} x {th} px; crop or scale one to the other's size"
    )))
}

fn size(picture: &RgbImage) -> [u32; 2] {
    [picture.width(), picture.height()]
}

impl Subject for Vec<Pair> {
    fn count(&self) -> usize {
        self.len()
    }

    fn name(&self, index: usize) -> String {
        self[index].name.clone()
    }

    fn read(&self, index: usize) -> Result<WithTruth, Unread> {
        let read = |path| read_picture(path).map_err(|e| Unread::Unreadable(e.to_string()));
        Ok(WithTruth {
            input: read(&self[index].blended)?,
            truth: read(&self[index].transmission)?,
        })
    }

    fn is_aligned(&self) -> bool {
        false
    }

    fn kind(&self) -> &'static str {
        "pair"
    }
}
