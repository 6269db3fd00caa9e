//! Sources of pictures with ground truth.

use super::pairs::Pair;
use super::picture::read_picture;
use image::RgbImage;
use serde::Serialize;
use std::error::Error;

/// A picture and its ground truth, of one size.
pub struct WithTruth {
    pub input: RgbImage,
    pub truth: RgbImage,
}

#[derive(Debug)]
pub enum Unread {
    Missing(String),
    Unreadable(String),
    /// The source failed; no picture can be read.
    Fatal(Box<dyn Error + Send + Sync>),
}

/// A picture without scores.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Name or file.
    pub image: String,
    pub reason: String,
}

/// Pictures with their truths, in order.
pub trait Subject: Sync {
    fn count(&self) -> usize;
    fn name(&self, index: usize) -> String;
    /// Reads a picture; `read` checks it.
    fn read(&self, index: usize) -> Result<WithTruth, Unread>;
    /// Pictures and truths are aligned by construction, so no shift is measured.
    fn is_aligned(&self) -> bool;
    /// Kind of a picture: `pair`, `train scene`.
    fn kind(&self) -> &'static str;
}

/// Reads a pair and checks its sizes.
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
