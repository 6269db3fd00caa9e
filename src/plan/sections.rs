//! Draws the sections of a scene line: `film`, `camera`, `front` and `back`. `glass.rs` draws `glass`.

use super::diode::SourceImage;
use super::draw::{Draw, Drawing, nine_digits};
use super::light::{DrawnLight, SideLight, illuminant};
use super::list;
use super::recipe::Recipe;
use super::source::Source;
use glasshouse_line::keys::{At, Drawn};
use glasshouse_line::param::Param;
use glasshouse_line::{Camera, DepthKind, Film, Focus, FocusRecipe, Photograph, Side};

pub(super) fn film(recipe: &Recipe, draw: Draw<'_>) -> Film {
    Film::draw(&recipe.film, &At::section("film"), &draw)
}

pub(super) fn camera(recipe: &Recipe, draw: Draw<'_>) -> Camera {
    let mut camera = Camera::draw(&recipe.camera, &At::section("camera"), &draw);
    if let Some(param) = &recipe.camera.f_number {
        let f_number = draw.value("camera.f_number", param);
        camera.aperture_radius_m = nine_digits(camera.focal_length_mm * 1e-3 / (2.0 * f_number));
    }
    if *recipe.camera.focus.chosen(&At::section("camera.focus"), &draw) == FocusRecipe::Glass {
        let distance_m = draw.value("glass.distance_m", &recipe.glass.distance_m);
        camera.focus = Focus::Distance { distance_m };
    }
    camera
}

/// Draws the temperatures of the illuminants of front and back, K; `None` for the light of the photograph.
pub(super) fn illuminants_k(recipe: &Recipe, draw: Draw<'_>) -> [Option<f64>; 2] {
    let drawn =
        |key: &str, param: &Option<Param>| param.as_ref().map(|param| draw.value(key, param));
    let front = drawn("front.illuminant_k", &recipe.front.illuminant_k);
    let share = recipe.back.front_illuminant_share.unwrap_or(0.0);
    let is_shared = draw.unit("back.front_illuminant") < share;
    [front, if is_shared { front } else { drawn("back.illuminant_k", &recipe.back.illuminant_k) }]
}

/// Draws the exposure of a side and multiplies its light, with the illuminant, by the light that a list gives for the
/// photograph. Returns the drawn light.
pub(super) fn light(
    name: &str,
    recipe: SideLight<'_>,
    illuminant_k: Option<f64>,
    draw: Draw<'_>,
    side: &mut Side,
) -> DrawnLight {
    let (exposure, side_illuminant) = side.light_mut();
    let mut drawn = DrawnLight {
        exposure: draw.value(&format!("{name}.exposure"), recipe.exposure),
        illuminant: [1.0; 3],
    };
    *exposure *= drawn.exposure;
    if let Some(param) = recipe.exposure_ev {
        let ev = draw.value(&format!("{name}.exposure_ev"), param);
        *exposure = nine_digits(*exposure * libm::exp2(ev));
        drawn = drawn.times(libm::exp2(ev));
    }
    if let Some(kelvin) = illuminant_k {
        drawn.illuminant = illuminant(kelvin).map(nine_digits);
        for (channel, drawn) in side_illuminant.iter_mut().zip(illuminant(kelvin)) {
            *channel = nine_digits(*channel * drawn);
        }
    }
    drawn
}

/// Returns the tangents of half the film's field of view, horizontal and vertical.
pub(super) fn half_view(focal_length_mm: f64, film: &Film) -> [f64; 2] {
    let [width, height] = [f64::from(film.width), f64::from(film.height)];
    let half_diagonal_mm = libm::hypot(36.0, 24.0) / 2.0;
    let of = |side: f64| half_diagonal_mm * side / libm::hypot(width, height) / focal_length_mm;
    [of(width), of(height)]
}

pub(super) fn side((name, source): (&str, &Source), image: &SourceImage) -> Side {
    match &image.side {
        Some(side) => list::rooted(side, name),
        None => photograph((name, source), image).into(),
    }
}

fn photograph((name, source): (&str, &Source), image: &SourceImage) -> Photograph {
    let rooted = |path: &String| format!("{name}:{path}");
    Photograph {
        color: rooted(&image.color),
        depth: match &image.depth_root {
            Some(root) => format!("{root}:{}", image.depth),
            None => rooted(&image.depth),
        },
        sketch: None,
        mask: image.mask.as_ref().map(rooted),
        orientation: source.orientation,
        transfer: source.transfer,
        depth_unit_m: source.depth_unit_m,
        depth_none_code: source.depth_none_code,
        depth_kind: source.depth_kind,
        // Relative depths need a metric range, from a table of categories or from the source.
        depth_range: match source.depth_kind {
            DepthKind::Relative | DepthKind::RelativeInverse => {
                image.depth_range.or(source.depth_range)
            }
            DepthKind::Z | DepthKind::Distance => None,
        },
        intrinsics: source.intrinsics,
        exposure: 1.0,
        illuminant: [1.0; 3],
        highlights: source.highlights,
        fill: source.fill,
        apex: None,
        cards: vec![],
    }
}
