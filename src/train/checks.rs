//! Images on which a training shows and measures its networks.

use examples::Example;
use serde::{Deserialize, Serialize};

/// Largest number of rows of a grid of pictures.
pub(super) const MOST_SHOWN: usize = 4;

/// Pictures that choose the best checkpoint. Files of the first version lack this field and are ignored, because that
/// version chose on the split `test`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChosenOn {
    /// Scenes of the split `validation`.
    Validation,
    /// Real pairs, by the digest of their names and files.
    RealPairs(String),
}

/// Whole images on which a session shows and measures its networks.
pub struct Checks {
    /// Images whose mean PSNR chooses the best checkpoint.
    pub validation: Vec<Example>,
    /// Training images for the grids of pictures; empty if there are validation images.
    pub shown: Vec<Example>,
    /// What [`Self::validation`] is; `None` if it is empty.
    pub chosen_on: Option<ChosenOn>,
}

impl Checks {
    /// Returns the name of the grids in the events.
    pub(super) fn tag(&self) -> &'static str {
        if self.validation.is_empty() { "training" } else { "validation" }
    }
}
