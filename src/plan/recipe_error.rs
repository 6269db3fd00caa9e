//! Errors of a recipe, or of a recipe with its photographs.

use glasshouse_line::ids::SceneId;
use glasshouse_line::{LineError, Split};
use render::scene::GeometryError;

/// Error of a recipe, or of its expansion with photographs.
#[derive(Debug, thiserror::Error)]
pub enum RecipeError {
    /// The file is not TOML, or has an unknown key or a value of the wrong type. The source error names the location.
    #[error("the recipe cannot be read: {0}")]
    Toml(#[from] Box<toml::de::Error>),
    #[error("recipe key {key} {problem}")]
    Key {
        /// Dotted path of the key.
        key: String,
        /// Value of the key, the problem, and the allowed values.
        problem: String,
    },
    #[error("source {source_name} has not been indexed: list its photographs before expanding")]
    NotIndexed { source_name: String },
    /// A source lists a photograph twice, so the photograph could be in both splits.
    #[error("source {source_name} lists {color} twice: list each colour image once")]
    ListedTwice { source_name: String, color: String },
    /// The source has too few photographs: splits share no photograph, and each split needs two for a pair.
    #[error(
        "source {source_name} has {found} photographs, but {splits} splits that share none need at \
         least {needed}: add photographs, or take this source out of a split (names of one file, and files of equal bytes, \
         count once)"
    )]
    TooFewImages {
        source_name: String,
        found: usize,
        /// Least number of photographs, two per split.
        needed: usize,
        /// Number of splits that draw from this source.
        splits: usize,
    },
    #[error(
        "source {source_name} has fewer than two photographs for split {split}, because other sources have its photographs \
         in other splits: add photographs, or take this source out of a split"
    )]
    SharedPhotographs { source_name: String, split: Split },
    #[error(
        "scene {id}: all {attempts} draws of {ranges} failed, the last because {source}; narrow these ranges"
    )]
    Refused {
        id: SceneId,
        attempts: u32,
        /// Parameters of the geometry with their ranges.
        ranges: String,
        source: Box<RefusedDraw>,
    },
    #[error(
        "scene {id}: {parameter} is from_source, but {photograph} has no value: add it to \"values\" in the \
         source's list, or replace from_source by a number or a distribution"
    )]
    NoValue { id: SceneId, parameter: String, photograph: String },
    #[error(
        "scene {id}: source {source_name} has no usable photograph left in split {split}: repair the invalid files, \
         or add photographs"
    )]
    NoSubstitute { id: SceneId, source_name: String, split: Split },
    #[error(
        "scene {id}: all {previews} draws, with different photographs, were rejected, the last because {reason}; widen \
         [reject], or narrow the distributions"
    )]
    NoneKept { id: String, previews: u32, reason: String },
    #[error("scene {id}: {source}")]
    Line { id: SceneId, source: LineError },
}

/// A draw whose pane, lens, film and covers do not fit together.
#[derive(Debug, thiserror::Error)]
pub enum RefusedDraw {
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    #[error(transparent)]
    Cover(#[from] CoverError),
}

/// A cover that does not fit the drawn pane.
#[derive(Clone, Copy, Debug, thiserror::Error)]
pub enum CoverError {
    #[error(
        "cover.{cover} cannot stand behind a pane with this tilt, because its directions run along the pane: reduce \
         glass.tilt_deg or cover.{cover}.view_width"
    )]
    AlongPane { cover: &'static str },
    #[error(
        "cover.photographer reaches {:.3} m beyond the pane: reduce glass.tilt_deg or cover.photographer.width_m, or increase \
         glass.distance_m or cover.photographer.distance_m", -lowest_m
    )]
    BeyondPane {
        /// Least distance of a corner from the pane's first face, m.
        lowest_m: f64,
    },
}
