//! Sources of pictures with ground truth.

use super::pairs::Pair;
use super::picture::read_picture;
use image::RgbImage;
use serde::Serialize;
use std::error::Error;

/// A picture and its ground truth.
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

/// A picture or file without scores, and the reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Name of the picture, or path of its file.
    pub image: String,
    pub reason: String,
}

/// An ordered set of pictures with ground truths.
pub trait Subject: Sync {
    fn count(&self) -> usize;
    fn name(&self, index: usize) -> String;
    /// Reads a picture and its truth, which may have different sizes.
    fn read(&self, index: usize) -> Result<WithTruth, Unread>;
    /// True if pictures and truths are aligned by construction, so that their shifts need no measurement.
    fn is_aligned(&self) -> bool;
    /// Returns the noun for a picture: `pair` or `train scene`.
    fn kind(&self) -> &'static str;
}

/// Reads a picture and its truth, and checks that their sizes are equal.
pub(super) fn read(subject: &dyn Subject, index: usize) -> Result<WithTruth, Unread> {
    let pair = subject.read(index)?;
    let ([w, h], [tw, th]) = (size(&pair.input), size(&pair.truth));
    if [w, h] == [tw, th] {
        return Ok(pair);
    }
    Err(Unread::Unreadable(format!(
        "the picture has {w} x {h} px, but its truth has {tw} x {th} px; crop or scale one to the other's size"
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
