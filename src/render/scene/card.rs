//! Decodes the pictures of cards, and places cards in the lens's coordinates.

use super::color;
use super::error::AssembleError;
use super::geometry::BackCamera;
use crate::formats::error::SceneError;
use crate::formats::files::NamedBytes;
use crate::line::Card as CardLine;
use crate::trace::{Card, Slab, Texture};
use glam::DVec3;
use std::sync::Arc;

/// Decodes the picture of a card: radiance times alpha, and alpha. Interpolation mixes these products, so that the colour of a
/// transparent texel does not bleed.
pub(super) fn decode_card(card: &CardLine, file: &NamedBytes) -> Result<Arc<Texture>, SceneError> {
    let scale = card.illuminant.map(|c| card.exposure * c);
    let (mut color, alpha) = color::decode_with_alpha(file, card.transfer, scale)?;
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
