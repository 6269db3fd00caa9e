//! Planning: turns a recipe (distributions) into scene lines (`glasshouse_line`), one resolved scene per line.
//!
//! ```text
//! recipe, source, numbers, glass, light, train_recipe, training   the TOML file; its keys are those of glasshouse_line
//! recipe_check, source_check, glass_check, cover_check, training_check, recipe_schema   its rules
//! sketch                                          assumed shapes of pictures without depth
//! sensor, sensor_model, sensor_check              the camera of the photographs, and the sensors of sensors.toml
//! cover, cover_draw                               what stands in the way of the window
//! diode, places, list, folder                     list the photographs of a source
//! copies                                          photographs with several names
//! split -> pair -> assign                         photographs to splits, pairs and scenes; substitutes for excluded ones
//! draw, source_values, sections -> expand         random numbers, values of photographs; scene lines
//! preview, draw_scenes                            previews for exposure, white balance and rejection
//! procedural_inputs, cost                         procedural pictures of a recipe; bytes and core time of a run
//! inputs, request, check, content -> drafting     a recipe or manifest -> checked scenes: the entry point, `draft`
//! ```
//!
//! All modules are pure, except the listings (`diode`, `places`), `check`, `content`, `drafting`, `draw_scenes`,
//! `inputs` and `procedural_inputs`, which read or write files. The trait `InputFiles` also reads files in stores.

mod assign;
mod check;
mod content;
mod copies;
mod cost;
mod cover;
mod cover_check;
mod cover_draw;
#[cfg(test)]
mod cover_tests;
mod diode;
mod drafting;
mod draw;
mod draw_scenes;
mod expand;
mod folder;
mod glass;
mod glass_check;
#[cfg(test)]
mod glass_tests;
#[cfg(test)]
mod glazing_films_tests;
#[cfg(test)]
mod glazing_tests;
mod inputs;
mod light;
mod limits;
#[cfg(test)]
mod limits_tests;
mod list;
mod numbers;
#[cfg(test)]
mod one_photograph_tests;
mod pair;
mod places;
mod preset;
mod preview;
mod procedural_inputs;
mod recipe;
mod recipe_check;
mod recipe_error;
mod recipe_schema;
mod request;
mod rooting;
mod sections;
mod sensor;
mod sensor_check;
mod sensor_file;
mod sensor_model;
#[cfg(test)]
mod sensor_tests;
mod sketch;
mod source;
mod source_check;
mod source_values;
mod split;
mod train_recipe;
mod training;
mod training_check;

pub use check::{InvalidInput, invalid_text};
pub use cost::{Calibration, Cost, Estimate, cost};
pub use diode::{FolderError, IndexError};
pub use drafting::{Drafted, draft};
pub use draw_scenes::{RejectedScene, read_rejected, rejected_lines};
pub use folder::{FolderOptions, FolderPicture, FolderPictures, folder_pictures};
pub use inputs::{InputFiles, LocalFiles, StoreUnavailable};
pub use list::{PHOTOGRAPH_SCHEMA, parse_list};
pub use places::{DEPTH_RANGES_SCHEMA, DepthRanges};
pub use preset::Preset;
pub use procedural::Place;
pub use procedural_inputs::{ProceduralInput, make_inputs};
pub use recipe::{RECIPE_SCHEMA, Recipe};
pub use recipe_error::{CoverError, RecipeError, RefusedDraw};
pub use recipe_schema::recipe_schema;
pub use request::{BeginWriting, DraftError, Progress, Request};
pub use sensor::SensorRecipe;
pub use sensor_file::SensorFile;
pub use sensor_model::{NoiseModel, SensorModel, SensorModels, sensor_models};
pub use train_recipe::{
    SeededTraining, TrainRecipe, Trainings, check_training_name, name_without_seed,
};
pub use training::{
    ExampleKind, FREE, FeatureSource, FeatureStyle, NetworkKind, OptimizerKind, PixelSource,
    ScheduleKind, Stage, Start, TrainSettings,
};
pub use training_check::SettingError;
