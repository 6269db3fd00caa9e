//! Images of a scene beside its four layers, which only a renderer knows.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// An image beside the layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Label {
    /// Share of a pixel's camera rays (over film and lens) that meet glass.
    Coverage,
    /// Distance of the nearest surface of the front along the optical axis, m, on the line of t_0 of the pixel's central ray. Frames
    /// and cards with alpha of 0.5 or more are surfaces. Infinite if there is none.
    FrontDepth,
    /// R~ without its order r_0.
    Ghosts,
    /// Luminance of R~ over that of I; 0 where I is black.
    ReflectedShare,
}

/// Labels and their values: pixels row by row, with the channels of a pixel together.
pub type LabelImages = BTreeMap<Label, Vec<f32>>;

impl Label {
    /// All labels, in order.
    pub const ALL: [Self; 4] =
        [Self::Coverage, Self::FrontDepth, Self::Ghosts, Self::ReflectedShare];

    /// Names of all labels, in order.
    pub const NAMES: [&'static str; 4] = [
        Self::Coverage.name(),
        Self::FrontDepth.name(),
        Self::Ghosts.name(),
        Self::ReflectedShare.name(),
    ];

    /// Returns the name in files, keys and flags.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Coverage => "coverage",
            Self::FrontDepth => "front_depth",
            Self::Ghosts => "ghosts",
            Self::ReflectedShare => "reflected_share",
        }
    }

    /// Returns the names of the channels in OpenEXR files.
    pub const fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Coverage | Self::ReflectedShare => &["Y"],
            Self::FrontDepth => &["Z"],
            Self::Ghosts => &["R", "G", "B"],
        }
    }

    /// Returns the label with that name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|label| label.name() == name)
    }

    /// True if the label follows from the finished layers, without tracing.
    pub const fn is_derived(self) -> bool {
        matches!(self, Self::ReflectedShare)
    }
}

impl std::fmt::Display for Label {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// A set of labels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LabelSet(u8);

impl LabelSet {
    /// True if the set contains the label.
    #[inline(always)]
    pub fn contains(self, label: Label) -> bool {
        self.0 & (1 << label as u8) != 0
    }

    /// Adds a label. Returns false if the set contains it already.
    pub fn insert(&mut self, label: Label) -> bool {
        let is_new = !self.contains(label);
        self.0 |= 1 << label as u8;
        is_new
    }

    /// Iterates over the labels, in order.
    pub fn iter(self) -> impl Iterator<Item = Label> {
        Label::ALL.into_iter().filter(move |label| self.contains(*label))
    }
}

/// Returns the share of R~ in the luminance (Rec. 709) of each pixel of I.
pub fn reflected_share(input: &[[f32; 3]], glass_reflection: &[[f32; 3]]) -> Vec<f32> {
    let luminance =
        |[r, g, b]: [f32; 3]| 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b);
    let share = |(input, reflection): (&[f32; 3], &[f32; 3])| {
        let (whole, part) = (luminance(*input), luminance(*reflection));
        if whole > 0.0 { (part / whole).min(1.0) as f32 } else { 0.0 }
    };
    input.iter().zip(glass_reflection).map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_and_their_names_round_trip() {
        for (label, name) in Label::ALL.into_iter().zip(Label::NAMES) {
            assert_eq!((label.name(), Label::from_name(name)), (name, Some(label)));
            assert_eq!(serde_json::to_string(&label).unwrap(), format!("{name:?}"));
        }
        assert_eq!(Label::from_name("input"), None);
    }

    #[test]
    fn a_share_is_that_of_the_luminance() {
        let input = [[1.0, 1.0, 1.0], [0.0; 3], [0.5, 0.0, 0.0]];
        let reflection = [[0.0, 1.0, 0.0], [0.0; 3], [0.5, 0.0, 0.0]];
        assert_eq!(reflected_share(&input, &reflection), [0.7152, 0.0, 1.0]);
    }
}
