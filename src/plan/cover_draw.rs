//! Draws the covers of a scene line: cards that clear the pane, and the frame of the window.

use super::cover::{CoverRecipe, FrameRecipe, PhotographerRecipe, ScreenRecipe};
use super::draw::{Draw, Drawing, nine_digits};
use super::light::DrawnLight;
use super::procedural_inputs::cover_path;
use super::recipe_error::CoverError;
use super::sections::half_view;
use glasshouse_line::{Card, Outline, SceneLine, Transfer};
use procedural::{CAMERA_ROW, CoverKind};
use render::trace::Slab;

/// Least cosine between the pane's normal and the direction to a corner of a card, with which the card may stand behind the pane.
const LEAST_COS: f64 = 0.05;

/// The covers of a scene: its draws and its light.
pub(super) struct SceneCover<'a> {
    pub(super) recipe: &'a CoverRecipe,
    /// The scene's first draw, which decides what it has.
    pub(super) first: Draw<'a>,
    /// Light of `[front]` and `[back]`.
    pub(super) light: [DrawnLight; 2],
    /// Numbers of cards that front and back have from their source.
    pub(super) own_cards: [usize; 2],
}

impl SceneCover<'_> {
    /// Draws cards and frame for the film, the camera and the pane of `line`, in place of those of earlier draws.
    pub(super) fn draw(&self, draw: Draw<'_>, line: &mut SceneLine) -> Result<(), CoverError> {
        line.front.cards_mut().truncate(self.own_cards[0]);
        line.back.cards_mut().truncate(self.own_cards[1]);
        for (kind, recipe) in self.recipe.screens() {
            if self.has(kind.name(), recipe.share) {
                let card = self.screen(draw, line, kind, recipe)?;
                line.front.cards_mut().push(card);
            }
        }
        if let Some(recipe) = &self.recipe.photographer
            && self.has(CoverKind::Photographer.name(), recipe.share)
        {
            let card = self.photographer(draw, line, recipe)?;
            line.back.cards_mut().push(card);
        }
        if let Some(recipe) = &self.recipe.frame
            && self.has("frame", recipe.share)
        {
            line.glass.outline = Some(frame(draw, line, recipe));
        }
        Ok(())
    }

    /// True if the scene has the cover with this name.
    fn has(&self, name: &str, share: f64) -> bool {
        self.first.unit(&format!("cover.{name}.share")) < share
    }

    fn card(&self, draw: Draw<'_>, line: &SceneLine, kind: CoverKind, place: &Place) -> Card {
        let pictures = self.recipe.pictures;
        let key = format!("cover.{}.picture", kind.name());
        let index = ((draw.unit(&key) * f64::from(pictures)) as u32).min(pictures - 1);
        Card {
            color: cover_path(line.split, kind, index),
            distance_m: nine_digits(place.distance_m),
            center_m: place.center_m.map(nine_digits),
            width_m: nine_digits(place.width_m),
            transfer: Transfer::Srgb,
            exposure: nine_digits(place.light.exposure),
            illuminant: place.light.illuminant,
        }
    }

    /// Places a card in the view behind the pane, so far away that its nearest corner keeps the drawn distance from the pane.
    fn screen(
        &self,
        draw: Draw<'_>,
        line: &SceneLine,
        kind: CoverKind,
        recipe: &ScreenRecipe,
    ) -> Result<Card, CoverError> {
        let value = |key: &str| {
            draw.value(&format!("cover.{}.{key}", kind.name()), &recipe.param(kind, key))
        };
        // Tangents at the card's centre and half its size, seen from the lens.
        let view = half_view(line.camera.focal_length_mm, &line.film);
        let center = [value("view_x") * view[0], value("view_y") * view[1]];
        let half_width = value("view_width") * view[0];
        let half = [half_width, half_width / f64::from(kind.aspect())];
        let pane = Pane::of(line);
        let corners = corners(center, half).map(|[x, y]| pane.along([x, y, 1.0]));
        let least = corners.into_iter().fold(f64::INFINITY, f64::min);
        if least < LEAST_COS {
            return Err(CoverError::AlongPane { cover: kind.name() });
        }
        let distance_m = (pane.distance_m + pane.thickness_m + value("gap_m")) / least;
        let light = self.light[0].times(value("exposure"));
        let center_m = center.map(|tangent| tangent * distance_m);
        let place = Place { distance_m, center_m, width_m: 2.0 * half_width * distance_m, light };
        Ok(self.card(draw, line, kind, &place))
    }

    /// Places the person behind the lens, with the camera in the picture at the lens.
    fn photographer(
        &self,
        draw: Draw<'_>,
        line: &SceneLine,
        recipe: &PhotographerRecipe,
    ) -> Result<Card, CoverError> {
        let value = |key: &str, param| draw.value(&format!("cover.photographer.{key}"), param);
        let distance_m = value("distance_m", &recipe.distance_m);
        let width_m = value("width_m", &recipe.width_m);
        let height_m = width_m / f64::from(CoverKind::Photographer.aspect());
        let [right, down] = [0, 1].map(|k| value(&format!("offset_m[{k}]"), &recipe.offset_m[k]));
        let center_m = [right, down + (0.5 - f64::from(CAMERA_ROW)) * height_m];
        let pane = Pane::of(line);
        let heights = corners(center_m, [0.5 * width_m, 0.5 * height_m])
            .map(|[x, y]| pane.distance_m - pane.along([x, y, -distance_m]));
        let lowest_m = heights.into_iter().fold(f64::INFINITY, f64::min);
        if lowest_m <= 0.0 {
            return Err(CoverError::BeyondPane { lowest_m });
        }
        let light = self.light[1].times(value("exposure", &recipe.exposure));
        let place = Place { distance_m, center_m, width_m, light };
        Ok(self.card(draw, line, CoverKind::Photographer, &place))
    }
}

/// Position, size and light of a card.
struct Place {
    distance_m: f64,
    center_m: [f64; 2],
    width_m: f64,
    light: DrawnLight,
}

/// The faces of a pane.
struct Pane {
    normal: [f64; 3],
    /// Distance of the first face from the lens along the normal.
    distance_m: f64,
    thickness_m: f64,
}

impl Pane {
    fn of(line: &SceneLine) -> Self {
        let normal = Slab::tilted_normal(line.glass.tilt_deg);
        Self {
            normal: [normal.x, normal.y, normal.z],
            distance_m: line.glass.distance_m * normal.z,
            thickness_m: line.glass.total_thickness_m(),
        }
    }

    /// Returns the length of `point` along the normal.
    fn along(&self, point: [f64; 3]) -> f64 {
        self.normal.iter().zip(point).map(|(n, p)| n * p).sum()
    }
}

fn corners([x, y]: [f64; 2], [dx, dy]: [f64; 2]) -> [[f64; 2]; 4] {
    [[x - dx, y - dy], [x + dx, y - dy], [x - dx, y + dy], [x + dx, y + dy]]
}

/// Draws the edges of the glass and its frame.
fn frame(draw: Draw<'_>, line: &SceneLine, recipe: &FrameRecipe) -> Outline {
    let value = |key: &str, param| draw.value(&format!("cover.frame.{key}"), param);
    let view = half_view(line.camera.focal_length_mm, &line.film);
    let edge = |axis: usize, side: usize| {
        let (key, params) = [("view_x", &recipe.view_x), ("view_y", &recipe.view_y)][axis];
        let of_view = value(&format!("{key}[{side}]"), &params[side]);
        nine_digits(of_view * view[axis] * line.glass.distance_m)
    };
    Outline {
        x_m: [edge(0, 0), edge(0, 1)],
        y_m: [edge(1, 0), edge(1, 1)],
        frame_m: value("frame_m", &recipe.frame_m),
        frame_radiance: [value("frame_radiance", &recipe.frame_radiance); 3],
    }
}
