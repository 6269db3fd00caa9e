//! Methods: what makes a picture from an input.

use super::factor::{Factor, own_best_factor};
use super::fit::Rules;
use super::summary::INPUT;
use super::veil::VeilRule;
use image::RgbImage;
use std::error::Error;

/// Name of the row of the inputs times the best factor of each group, which is chosen on the scored pictures.
pub const GROUP_FACTOR: &str = "best factor of the group (oracle)";

/// Name of the row of the inputs times each picture's own best factor, which is chosen on the scored picture.
pub const OWN_FACTOR: &str = "own factor (oracle)";

/// An input of a method.
#[derive(Clone, Copy)]
pub struct Given<'a> {
    /// Place of the picture in its subject.
    pub index: usize,
    pub input: &'a RgbImage,
    /// Size of the picture's file, px; the input may be scaled down.
    pub file_px: [u32; 2],
}

#[derive(Debug)]
pub enum Unmade {
    /// The method has no output for this picture, which is then left out for all methods.
    LeftOut(String),
    /// The method failed; no picture can be scored.
    Fatal(Box<dyn Error + Send + Sync>),
}

/// A method that makes a picture from an input.
pub trait Method: Sync {
    /// Returns the shortest accepted side, px.
    fn least_px(&self) -> u32 {
        1
    }

    /// Makes the output, which has the size of the input.
    fn make(&self, given: &Given) -> Result<RgbImage, Unmade>;
}

struct Input;

impl Method for Input {
    fn make(&self, given: &Given) -> Result<RgbImage, Unmade> {
        Ok(given.input.clone())
    }
}

impl Method for Factor {
    fn make(&self, given: &Given) -> Result<RgbImage, Unmade> {
        Ok(self.apply(given.input))
    }
}

impl Method for VeilRule {
    fn make(&self, given: &Given) -> Result<RgbImage, Unmade> {
        Ok(self.apply(given.input))
    }
}

/// What makes the pictures of a row.
#[derive(Clone, Copy)]
pub(super) enum Maker<'a> {
    Method(&'a dyn Method),
    /// An oracle, which knows the truth: the input times its own best factor.
    OwnFactor,
    /// An oracle whose factors are known only after all pictures have been read.
    GroupFactor,
}

impl Maker<'_> {
    pub(super) fn is_oracle(self) -> bool {
        !matches!(self, Self::Method(_))
    }

    pub(super) fn least_px(self) -> u32 {
        if let Self::Method(method) = self { method.least_px() } else { 1 }
    }

    /// Makes the output for a picture; `None` if it must be made later.
    pub(super) fn make(self, given: &Given, truth: &RgbImage) -> Option<Result<RgbImage, Unmade>> {
        match self {
            Self::Method(method) => Some(method.make(given)),
            Self::OwnFactor => {
                let of = own_best_factor(given.input, truth);
                let made = of.map(|(factor, _)| factor.apply(given.input));
                Some(made.map_err(|error| Unmade::Fatal(error.into())))
            }
            Self::GroupFactor => None,
        }
    }
}

/// Lists the rows of a table: the input, the rules, the oracles, and the named methods.
pub(super) fn makers<'a>(
    rules: &'a Rules,
    named: &[(String, &'a dyn Method)],
) -> Vec<(String, Maker<'a>)> {
    let mut makers = vec![(INPUT.to_owned(), Maker::Method(&Input))];
    let factor = rules.factor.as_ref();
    makers.extend(factor.map(|f| (f.row_name(), Maker::Method(f))));
    makers.extend(rules.veil.as_ref().map(|v| (v.row_name(), Maker::Method(v))));
    makers.push((GROUP_FACTOR.to_owned(), Maker::GroupFactor));
    makers.push((OWN_FACTOR.to_owned(), Maker::OwnFactor));
    makers.extend(named.iter().map(|(name, method)| (name.clone(), Maker::Method(*method))));
    makers
}

/// Lists the names of the rows before those of the named methods.
pub fn row_names(rules: &Rules) -> Vec<String> {
    makers(rules, &[]).into_iter().map(|(name, _)| name).collect()
}
