//! Sources of pictures with ground truth.

use super::lanczos::shrink_to;
use super::pairs::Pair;
use super::picture::read_picture;
use super::summary::ALL;
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
    /// The files are not those of their record.
    Damaged(String),
    /// The source failed; no picture can be read.
    Fatal(Box<dyn Error + Send + Sync>),
}

/// A picture or file without scores, and the reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Name of the picture, or path of its file.
    pub image: String,
    pub reason: String,
    /// True if the picture's files are not those of their record.
    #[serde(skip)]
    pub is_damaged: bool,
}

/// An ordered set of pictures with ground truths.
pub trait Subject: Sync {
    fn count(&self) -> usize;
    fn name(&self, index: usize) -> String;
    /// Returns the name of the picture's group, if it has one; never [`ALL`](crate::ALL).
    fn group(&self, _index: usize) -> Option<String> {
        None
    }
    /// Returns the name of the picture's file without its ending. Several pictures may have the same.
    fn file_stem(&self, index: usize) -> String {
        self.name(index)
    }
    /// Reads a picture and its truth, which may have different sizes.
    fn read(&self, index: usize) -> Result<WithTruth, Unread>;
    /// True if pictures and truths are aligned by construction, so that their shifts need no measurement.
    fn is_aligned(&self) -> bool;
}

/// Reads a picture and its truth, checks that their sizes are equal, and scales both down to `longest_px`, if given.
/// Also returns the size of the files, px.
pub fn read_sized(
    subject: &dyn Subject,
    index: usize,
    longest_px: Option<u32>,
) -> Result<(WithTruth, [u32; 2]), Unread> {
    let WithTruth { input, truth } = subject.read(index)?;
    let ([w, h], [tw, th]) = (size(&input), size(&truth));
    if [w, h] != [tw, th] {
        return Err(Unread::Unreadable(format!(
            "the picture has {w} x {h} px, but its truth has {tw} x {th} px; crop or scale one to the other's size"
        )));
    }
    let scaled = |picture| match longest_px {
        Some(longest_px) => shrink_to(picture, longest_px),
        None => picture,
    };
    Ok((WithTruth { input: scaled(input), truth: scaled(truth) }, [w, h]))
}

/// Reads a picture and its truth at the size of their files. See [`read_sized`].
pub(super) fn read(subject: &dyn Subject, index: usize) -> Result<WithTruth, Unread> {
    read_sized(subject, index, None).map(|(pair, _)| pair)
}

fn size(picture: &RgbImage) -> [u32; 2] {
    [picture.width(), picture.height()]
}

impl Pair {
    /// Reads the picture and its truth.
    pub(super) fn read(&self) -> Result<WithTruth, Unread> {
        let read = |path| read_picture(path).map_err(|e| Unread::Unreadable(e.to_string()));
        Ok(WithTruth { input: read(&self.blended)?, truth: read(&self.transmission)? })
    }

    /// Returns the name of the blended picture's file without its ending.
    pub(super) fn file_stem(&self) -> String {
        let stem = self.blended.file_stem().unwrap_or_default();
        stem.to_string_lossy().into_owned()
    }
}

impl Subject for Vec<Pair> {
    fn count(&self) -> usize {
        self.len()
    }

    fn name(&self, index: usize) -> String {
        self[index].name.clone()
    }

    /// Returns the folder with which the name begins: `real20` of `real20/4`.
    fn group(&self, index: usize) -> Option<String> {
        let (group, _) = self[index].name.split_once('/')?;
        // The name of the group of all pictures is taken.
        Some(if group == ALL { format!("{group}/") } else { group.to_owned() })
    }

    fn file_stem(&self, index: usize) -> String {
        self[index].file_stem()
    }

    fn read(&self, index: usize) -> Result<WithTruth, Unread> {
        self[index].read()
    }

    fn is_aligned(&self) -> bool {
        false
    }
}
