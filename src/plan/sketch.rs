//! `depth` of a source of pictures without depth images: the shape that scenes assume.

use super::draw::Draw;
use glasshouse_line::param::Param;
use glasshouse_line::{CAMERA_HEIGHT_M, HORIZON, Sketch};
use schemars::JsonSchema;
use serde::Deserialize;

/// `depth`: the assumed shape of a source's pictures.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "depth must be \"sketch\", { plane_m = .. } or { wall_m = .., camera_height_m = .., horizon = .. }"
)]
pub enum SketchRecipe {
    /// `"sketch"`: a ground 1.5 m below the camera, the horizon in the middle, and a wall at 5 to 50 m.
    Word(SketchWord),
    /// A plane at right angles to the axis.
    Plane {
        /// Its depth, m.
        plane_m: Param,
    },
    /// A ground before a wall.
    Ground {
        /// Depth of the wall, m. Default 5 to 50, with a uniform logarithm.
        #[serde(default = "wall_m")]
        wall_m: Param,
        /// Height of the camera above the ground, m. Default 1.5.
        #[serde(default = "camera_height_m")]
        camera_height_m: Param,
        /// Row of the horizon, as a share of the height from above. Default 0.5.
        #[serde(default = "horizon")]
        horizon: Param,
    },
}

/// The word of a [`SketchRecipe`] with all defaults.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SketchWord {
    /// All defaults.
    Sketch,
}

fn wall_m() -> Param {
    Param::LogUniform([5.0, 50.0])
}

fn camera_height_m() -> Param {
    Param::Constant(CAMERA_HEIGHT_M)
}

fn horizon() -> Param {
    Param::Constant(HORIZON)
}

impl Default for SketchRecipe {
    fn default() -> Self {
        Self::Word(SketchWord::Sketch)
    }
}

impl SketchRecipe {
    /// Returns the distributions; those of the word are the defaults.
    fn numbers(&self) -> Vec<(&'static str, Param)> {
        let ground = |wall_m, camera_height_m, horizon| {
            vec![("wall_m", wall_m), ("camera_height_m", camera_height_m), ("horizon", horizon)]
        };
        match self.clone() {
            Self::Word(SketchWord::Sketch) => ground(wall_m(), camera_height_m(), horizon()),
            Self::Plane { plane_m } => vec![("plane_m", plane_m)],
            Self::Ground { wall_m, camera_height_m, horizon } => {
                ground(wall_m, camera_height_m, horizon)
            }
        }
    }

    /// Returns all numbers with their keys below `key`.
    pub(super) fn params(&self, key: &str) -> Vec<(String, Param)> {
        let numbers = self.numbers().into_iter();
        numbers.map(|(name, param)| (format!("{key}.depth.{name}"), param)).collect()
    }

    /// Draws the shape of one side, `front` or `back`.
    pub(super) fn draw(&self, side: &str, draw: Draw<'_>) -> Sketch {
        let numbers = self.numbers();
        let values: Vec<f64> = numbers
            .iter()
            .map(|(name, param)| draw.value(&format!("{side}.depth.{name}"), param))
            .collect();
        match values[..] {
            [plane_m] => Sketch::Plane { plane_m },
            [wall_m, camera_height_m, horizon] => {
                Sketch::Ground { wall_m, camera_height_m, horizon }
            }
            _ => unreachable!("a shape has one or three numbers"),
        }
    }
}
