//! Values of `"from_source"` parameters, from the photographs' records.

use super::draw::nine_digits;
use super::pair::Pair;
use super::recipe::Recipe;
use super::recipe_error::RecipeError;
use super::sections::half_view;
use glasshouse_line::ids::SceneId;
use glasshouse_line::keys::Number;
use glasshouse_line::param::Param;
use glasshouse_line::{Film, Photograph, Side};
use std::collections::BTreeMap;

/// Finds the values of all `"from_source"` parameters: `back.*` in the back's record, others in the front's. If
/// the record lacks the focal length, computes it from the front photograph with [`focal_length_mm`].
pub(super) fn source_values(
    recipe: &Recipe,
    id: &SceneId,
    pair: Pair<'_>,
    front: &Side,
    film: &Film,
) -> Result<BTreeMap<String, f64>, RecipeError> {
    let mut values = BTreeMap::new();
    for Number { path: name, param, .. } in recipe.numbers() {
        if *param != Param::FromSource {
            continue;
        }
        let image = if name.starts_with("back.") { pair.back } else { pair.front };
        let own = || match (name.as_str(), front) {
            ("camera.focal_length_mm", Side::Photograph(photograph)) => {
                Some(nine_digits(focal_length_mm(photograph, film)))
            }
            _ => None,
        };
        let value = image.values.get(&name).copied().or_else(own);
        let value = value.ok_or_else(|| RecipeError::NoValue {
            id: id.clone(),
            parameter: name.clone(),
            photograph: image.color.clone(),
        })?;
        values.insert(name, value);
    }
    Ok(values)
}

/// Computes the shortest focal length with which the film shows nothing outside the photograph.
///
/// As a tangent, a film's half field of view is `hypot(36, 24) / (2 f) * side / diagonal`. A photograph's is the
/// distance of the nearer border from the principal point, divided by the focal length. Intrinsics without a size are
/// assumed to have the principal point in the middle.
fn focal_length_mm(photograph: &Photograph, film: &Film) -> f64 {
    let camera = &photograph.intrinsics;
    let size = camera.size.map_or([2.0 * camera.cx, 2.0 * camera.cy], |s| s.map(f64::from));
    let seen = |middle: f64, side: f64, focal: f64| middle.min(side - middle) / focal;
    let tan = [seen(camera.cx, size[0], camera.fx), seen(camera.cy, size[1], camera.fy)];
    // At the focal length of 1 mm, the film's tangents are larger by the factor of the focal length.
    let [width, height] = half_view(1.0, film);
    (width / tan[0]).max(height / tan[1])
}
