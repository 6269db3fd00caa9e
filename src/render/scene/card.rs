//! Decodes the pictures of cards, and places cards in the lens's coordinates.

use super::color;
use super::error::AssembleError;
use super::geometry::BackCamera;
use crate::formats::error::SceneError;
use crate::formats::raster::Raster;
use crate::trace::{Card, Slab, Texture};
use glam::DVec3;
use glasshouse_line::Card as CardLine;
use std::path::Path;
use std::sync::Arc;

/// Converts the samples of a card's picture: radiance times alpha, and alpha. Interpolation mixes these products, so that the colour of a
/// transparent texel does not bleed.
pub(super) fn card_texture(
    card: &CardLine,
    path: &Path,
    samples: &Raster,
) -> Result<Arc<Texture>, SceneError> {
    let scale = card.illuminant.map(|c| card.exposure * c);
    let (mut color, alpha) = color::with_alpha(path, samples, card.transfer, scale)?;
    for (index, texel) in color.radiance.iter_mut().enumerate() {
        let alpha = alpha.as_ref().map_or(1.0, |alpha| alpha[index]);
        *texel = [texel[0] * alpha, texel[1] * alpha, texel[2] * alpha, alpha];
    }
    Ok(Texture::from_vec(color.width, color.height, color.radiance).into())
}

/// Places the cards of the front, the farthest first.
pub(super) fn front_cards(
    lines: &[CardLine],
    pictures: &[Arc<Texture>],
    slab: &Slab,
) -> Result<Vec<Card>, AssembleError> {
    place(lines, pictures, |index, card, picture| {
        let [x, y] = card.center_m;
        let half = half_size_m(card, picture);
        let corner = DVec3::new(x - half[0], y - half[1], card.distance_m);
        let [across, down] = [DVec3::X * (2.0 * half[0]), DVec3::Y * (2.0 * half[1])];
        let height_m = |p: DVec3| p.dot(slab.normal) - slab.plane_distance_m - slab.thickness_m;
        clear("front", index, corner, [across, down], height_m)?;
        Ok(Card::new(corner, across, down, Arc::clone(picture)))
    })
}

/// Places the cards of the back in the mirrored world, the farthest first.
pub(super) fn back_cards(
    lines: &[CardLine],
    pictures: &[Arc<Texture>],
    slab: &Slab,
    camera: &BackCamera,
) -> Result<Vec<Card>, AssembleError> {
    place(lines, pictures, |index, card, picture| {
        let [x, y] = card.center_m;
        let half = half_size_m(card, picture);
        // The card faces the pane, so that its first column is at the larger x.
        let corner = DVec3::new(x + half[0], y - half[1], -card.distance_m);
        let [across, down] = [DVec3::X * (-2.0 * half[0]), DVec3::Y * (2.0 * half[1])];
        let height_m = |p: DVec3| slab.plane_distance_m - p.dot(slab.normal);
        clear("back", index, corner, [across, down], height_m)?;
        let [across, down] = [across, down].map(|v| camera.mirrored_direction(v));
        Ok(Card::new(camera.mirrored_point(corner), across, down, Arc::clone(picture)))
    })
}

fn place(
    lines: &[CardLine],
    pictures: &[Arc<Texture>],
    of: impl Fn(usize, &CardLine, &Arc<Texture>) -> Result<Card, AssembleError>,
) -> Result<Vec<Card>, AssembleError> {
    let mut farthest: Vec<usize> = (0..lines.len()).collect();
    // The sort is stable: of two cards at one distance, the later one is on top.
    farthest.sort_by(|a, b| lines[*b].distance_m.total_cmp(&lines[*a].distance_m));
    farthest.into_iter().map(|index| of(index, &lines[index], &pictures[index])).collect()
}

fn half_size_m(card: &CardLine, picture: &Texture) -> [f64; 2] {
    let half = 0.5 * card.width_m;
    [half, half * picture.height() as f64 / picture.width() as f64]
}

/// Refuses a card that is not wholly on its side of the pane. `height_m` is the distance of a point from the pane.
fn clear(
    side: &'static str,
    index: usize,
    corner: DVec3,
    [across, down]: [DVec3; 2],
    height_m: impl Fn(DVec3) -> f64,
) -> Result<(), AssembleError> {
    let corners = [corner, corner + across, corner + down, corner + across + down];
    let lowest_m = corners.into_iter().map(height_m).fold(f64::INFINITY, f64::min);
    // This comparison is false for NaN, so that NaN is refused, too.
    if lowest_m > 0.0 { Ok(()) } else { Err(AssembleError::CardInPane { side, index, lowest_m }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glasshouse_line::Apex;

    /// Places a card of 0.5 m, on either side of a pane at 0.3 m that is turned about the vertical.
    fn placed(is_back: bool, distance_m: f64, x_m: f64, yaw_deg: f64) -> Result<(), String> {
        let card = format!(
            r#"{{"color":"c.png","distance_m":{distance_m},"center_m":[{x_m},0],"width_m":0.5}}"#
        );
        let lines = [serde_json::from_str(&card).unwrap()];
        let pictures = [Arc::new(Texture::from_vec(2, 1, vec![[1.0; 4]; 2]))];
        let normal = Slab::tilted_normal([0.0, yaw_deg]);
        let slab = Slab {
            normal,
            plane_distance_m: 0.3 * normal.z,
            thickness_m: 0.01,
            ior: 1.5,
            absorption_per_m: [0.0; 3],
        };
        let camera = BackCamera::new(Apex::Mirror, &slab);
        let cards = if is_back {
            back_cards(&lines, &pictures, &slab, &camera)
        } else {
            front_cards(&lines, &pictures, &slab)
        };
        cards.map(|_| ()).map_err(|error| error.to_string())
    }

    #[test]
    fn cards_stay_on_their_side_of_the_pane() {
        placed(false, 0.32, 0.0, 0.0).unwrap();
        placed(false, 0.5, 0.0, 30.0).unwrap();
        placed(true, 0.01, 0.0, 30.0).unwrap();
        // At x = -0.25, a pane with a yaw of 30 degrees is 0.144 m farther away; at x = 1, it is 0.58 m nearer.
        for (is_back, distance_m, x_m, yaw_deg, message) in [
            (false, 0.305, 0.0, 0.0, "front.cards[0] reaches 0.005 m beyond the pane"),
            (false, 0.4, 0.0, 30.0, "front.cards[0] reaches 0.048 m beyond the pane"),
            (true, 0.1, 0.75, 30.0, "back.cards[0] reaches 0.154 m beyond the pane"),
        ] {
            let error = placed(is_back, distance_m, x_m, yaw_deg).unwrap_err();
            assert!(error.starts_with(message), "{error}");
            assert!(error.contains("increase its distance_m, move or shrink it, or reduce"));
        }
    }
}
