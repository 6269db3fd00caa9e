//! Roughness of the faces of a pane.

use super::keys::{At, Drawing, Drawn, Keys, Row, Visit, VisitParams};
use super::param::Param;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Beckmann's alpha, the tangent at which the density of the facets' slopes has fallen to 1/e: one value, or one for each face from
/// the camera outwards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "glass.roughness must be a number, or a list of numbers with one for each face"
)]
pub enum Roughness {
    All(f64),
    Faces(Vec<f64>),
}

impl Roughness {
    /// Returns the values of a pane with `faces` faces; `None` if the list has another length.
    pub fn of_faces(&self, faces: usize) -> Option<Vec<f64>> {
        match self {
            Self::All(alpha) => Some(vec![*alpha; faces]),
            Self::Faces(alphas) => (alphas.len() == faces).then(|| alphas.clone()),
        }
    }

    /// Returns the given values.
    pub fn values(&self) -> &[f64] {
        match self {
            Self::All(alpha) => std::slice::from_ref(alpha),
            Self::Faces(alphas) => alphas,
        }
    }

    /// Returns the largest value, 0 if there is none.
    pub fn largest(&self) -> f64 {
        self.values().iter().copied().fold(0.0, f64::max)
    }
}

impl Keys for Roughness {
    fn rows(at: &At<'static>, rows: &mut Vec<Row>) {
        f64::rows(at, rows);
    }

    fn numbers(&self, at: &At<'_>, visit: &mut Visit<'_>) {
        match self {
            Self::All(alpha) => alpha.numbers(at, visit),
            Self::Faces(alphas) => alphas.numbers(at, visit),
        }
    }
}

/// A recipe has one roughness for all faces.
impl Drawn for Roughness {
    type Recipe = Param;

    fn params<'r>(recipe: &'r Param, at: &At<'_>, visit: &mut VisitParams<'_, 'r>) {
        f64::params(recipe, at, visit);
    }

    fn draw(recipe: &Param, at: &At<'_>, draw: &dyn Drawing) -> Self {
        Self::All(f64::draw(recipe, at, draw))
    }
}
