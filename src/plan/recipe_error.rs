//! What can be wrong with a recipe, or with the photographs at hand.

use render::ids::SceneId;
use render::line::LineError;
use render::line::Split;
use render::scene::GeometryError;

/// A recipe that cannot be used, or that cannot be expanded with the photographs at hand.
#[derive(Debug, thiserror::Error)]
pub enum RecipeError {
    /// Not TOML, an unknown key, or a value of the wrong kind; the source names the place.
    #[error("the recipe cannot be read: {0}")]
    Toml(#[from] Box<toml::de::Error>),
    /// A value that a recipe may not have.
    #[error("recipe key {key} {problem}")]
    Key {
        /// The key, with dots.
        key: String,
        /// Its value, what is wrong with it, and what is right.
        problem: String,
    },
    /// `expand` was not told which photographs a source has.
    #[error("source {source_name} has not been indexed: list its photographs before expanding")]
    NotIndexed {
        /// The source.
        source_name: String,
    },
    /// A photograph listed twice could reach both splits.
    #[error("source {source_name} lists {color} twice: list each colour image once")]
    ListedTwice {
        /// The source.
        source_name: String,
        /// The colour image.
        color: String,
    },
    /// Splits may not share photographs, and a pair needs two.
    #[error(
        "source {source_name} has {found} photographs, but {splits} splits that share none need at \
         least {needed}: add photographs, or take this source out of a split"
    )]
    TooFewImages {
        /// The source.
        source_name: String,
        /// What there is.
        found: usize,
        /// Two a split.
        needed: usize,
        /// Splits that draw from this source.
        splits: usize,
    },
    /// No pane drawn for this scene can be looked through.
    #[error(
        "scene {id}: {attempts} draws of {ranges} were all refused, at last because {source}; narrow \
         these ranges"
    )]
    Refused {
        /// The scene.
        id: SceneId,
        /// How often it was drawn.
        attempts: u32,
        /// The parameters that decide it, with their ranges.
        ranges: String,
        /// Why the last draw was refused.
        source: GeometryError,
    },
    /// A photograph's record does not have what a recipe takes from it.
    #[error(
        "scene {id}: {parameter} is from_source, but {photograph} does not say it: give it under \"values\" in the \
         source's list, or write a number or a distribution"
    )]
    NoValue {
        /// The scene.
        id: SceneId,
        /// The recipe's key.
        parameter: String,
        /// The photograph.
        photograph: String,
    },
    /// All photographs that could stand in for one that is left out are left out, too.
    #[error(
        "scene {id}: source {source_name} has no usable photograph left in split {split}: repair the files that \
         are wrong, or add photographs"
    )]
    NoStandIn {
        /// The scene.
        id: SceneId,
        /// The source.
        source_name: String,
        /// The split.
        split: Split,
    },
    /// Every draw of a scene was rejected.
    #[error(
        "scene {id}: none of {looks} draws, with different photographs, was kept, the last because {reason}; widen \
         [reject], or narrow the distributions"
    )]
    NoneKept {
        /// The scene.
        id: String,
        /// How often it was looked at.
        looks: u32,
        /// Why the last was not kept.
        reason: String,
    },
    /// A drawn line that is not sound.
    #[error("scene {id}: {source}")]
    Line {
        /// The scene.
        id: SceneId,
        /// Which field.
        source: LineError,
    },
}
