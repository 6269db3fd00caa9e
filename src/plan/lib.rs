//! Stage 1, *what*: a recipe (distributions) becomes a manifest (one resolved scene a line).
//!
//! ```text
//! recipe.rs, source.rs, param.rs, light.rs   what a .toml says        recipe_check.rs, recipe_schema.rs   whether it may
//! diode.rs, places.rs, list.rs               which photographs there are
//! divide.rs -> pair.rs -> cast.rs            who is in which scene, who stands in for whom
//! draw.rs, source_values.rs                  every random number, and what photographs say of themselves
//! expand.rs                                  all of it: recipe -> scene lines
//! line.rs, side.rs, side_json.rs             a scene line; photograph, panorama or mesh     jsonl.rs   manifests as text
//! validate.rs, refuse.rs                     which lines are sound, which panes cannot be looked through
//! roots.rs                                   where a line's paths lead
//! training.rs                                what is trained on the tuples, and how
//! ```
//!
//! Pure, apart from the listings of `diode.rs`, `places.rs` and `list.rs`.

pub mod cases;
mod assign;
mod check;
mod content;
mod diode;
mod split;
mod drafting;
mod draw;
mod draw_scenes;
mod expand;
mod focus;
mod inputs;
mod light;
mod list;
mod make;
mod pair;
mod param;
mod places;
mod preview;
mod recipe;
mod recipe_check;
mod recipe_error;
mod recipe_schema;
mod sample_bytes;
mod sections;
mod source;
mod source_check;
mod source_values;
mod training;

pub use assign::{Cast, Drawn, photograph_name};
pub use check::{InvalidInput, invalid_text};
pub use content::Made;
pub use diode::{Index, IndexError, Place, SourceImage, from_paths, index_paths, index_source};
pub use drafting::{DraftError, Drafted, Request, Tell, draft};
pub use draw::{Draw, nine_digits, scene_seed};
pub use draw_scenes::{RejectedScene, read_rejected, rejected_lines};
pub use expand::{Expansion, expand, expand_counted};
pub use focus::FocusRecipe;
pub use inputs::{InputFiles, LocalFiles, StoreUnavailable};
pub use light::{
    AutoExposure, LightRecipe, LuminanceScale, RejectRecipe, WhiteBalance, gains_against,
    illuminant, luminance,
};
pub use list::{LIST_NAME, ListError, PHOTOGRAPH_SCHEMA, index_list, parse_list};
pub use make::{inputs_folder, make_photographs};
pub use param::{Normal, Param};
pub use places::{
    Category, DEPTH_RANGES_SCHEMA, DepthRanges, DepthRangesError, PlacesFolders, index_places,
};
pub use recipe::{
    BackRecipe, CameraRecipe, FilmRecipe, FrontRecipe, GlassRecipe, RECIPE_SCHEMA, Recipe,
    SplitRecipe,
};
pub use recipe_error::RecipeError;
pub use recipe_schema::recipe_schema;
pub use source::{Layout, Source};
pub use training::{
    ExampleKind, FeatureSource, PixelSource, SettingError, Stage, Start, TrainRecipe, TrainSettings,
};
