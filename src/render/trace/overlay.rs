//! Effects of outline, frame and cards on the rays of a bundle.

use super::cover::{Card, Cover, Entries, Outline};
use super::fetch::{Factors, Hits};
use super::lanes::{CHUNK, LANES, Lane};
use super::lines::Path;
use super::means::LaneSums;
use super::patch::Patch;
use super::scene::{Lens, Scene};

/// Shares of the surface's radiance that reach the rays of a bundle, and radiance of the frame and of cards.
pub(super) struct Overlay {
    /// Share of the surface's radiance.
    pub(super) through: [Lane; CHUNK],
    /// Radiance of the frame and of cards. The fourth number of a colour is padding.
    pub(super) added: [[[f32; 4]; LANES]; CHUNK],
}

/// True if all rays of R in a patch meet glass, and no card of the back.
pub(super) fn shows_all_of_back(scene: &Scene, patch: &Patch) -> bool {
    let outline = scene.cover.outline.as_ref();
    let is_glass = |outline: &Outline| {
        outline.fills(&scene.slab, &Lens::PINHOLE, patch.film_bounds(scene)) == Some(true)
    };
    outline.is_none_or(is_glass) && !meets(scene, &scene.cover.cards[1], patch, Path::Pinhole)
}

/// True if rays of `patch` along a path in closed form may meet one of the `cards`.
///
/// A line to the point X of a card has the direction d = (X - p) / X_z, with its point p in the plane of the lens: a lens point,
/// shifted by at most `kappa (1 + |d|)`. The film point is d plus the lens point over the focus distance.
pub(super) fn meets(scene: &Scene, cards: &[Card], patch: &Patch, path: Path<'_>) -> bool {
    if cards.is_empty() {
        return false;
    }
    let lens = if path.is_pinhole() { Lens::PINHOLE } else { scene.lens };
    let Lens { aperture_radius_m: aperture_m, inverse_focus_per_m } = lens;
    let spread = aperture_m * inverse_focus_per_m;
    let film = patch.film_bounds(scene);
    let steepest = film.iter().flatten().fold(0.0, |most, v| v.abs().max(most)) + spread;
    let point_m = aperture_m + path.largest_shift_m() * (1.0 + steepest);
    cards.iter().any(|card| {
        // A tilted pane may mirror a part of a card behind the lens; then its tangents are no bounds.
        if card.nearest_z_m <= 0.0 {
            return true;
        }
        // The margin covers the rounding of directions to f32.
        let margin = point_m / card.nearest_z_m + spread + 1.0e-5;
        (0..2).all(|k| {
            film[k][0] <= card.seen[k][1] + margin && film[k][1] >= card.seen[k][0] - margin
        })
    })
}

impl Overlay {
    pub(super) fn new() -> Box<Self> {
        Box::new(Self { through: [[1.0; LANES]; CHUNK], added: [[[0.0; 4]; LANES]; CHUNK] })
    }

    /// Begins with the outline and the frame, for rows of these samples of a chunk; t_0 alone sees the frame.
    #[inline(always)]
    pub(super) fn begin(
        &mut self,
        cover: &Cover,
        entries: &Entries,
        is_t_0: bool,
        samples: impl Iterator<Item = usize>,
    ) {
        let of_frame = cover.outline.as_ref().map_or([0.0; 3], |outline| outline.frame_radiance);
        for (r, s) in samples.enumerate() {
            if is_t_0 {
                for l in 0..LANES {
                    let frame = entries.frame[s][l];
                    self.through[r][l] = 1.0 - frame;
                    self.added[r][l] =
                        [frame * of_frame[0], frame * of_frame[1], frame * of_frame[2], 0.0];
                }
            } else {
                self.through[r] = entries.glass[s];
                self.added[r] = [[0.0; 4]; LANES];
            }
        }
    }

    /// Lays the cards over the surface for row `s`, which has these points in the plane z = 0, directions (x, y, 1), and z
    /// of the surface. Returns false if no ray meets a card.
    #[inline(always)]
    pub(super) fn lay(
        &mut self,
        cards: &[Card],
        s: usize,
        point: &[Lane; 2],
        direction: &[Lane; 2],
        surface_z_m: &Lane,
    ) -> bool {
        let mut meets = false;
        // Neither the frame nor rays that end at the edge show a card.
        let mut ends = [false; LANES];
        for l in 0..LANES {
            ends[l] = self.through[s][l] == 0.0;
        }
        for card in cards {
            let (at, hit) = card.hits(point, direction, surface_z_m);
            if hit.iter().all(|hit| *hit == 0) {
                continue;
            }
            meets = true;
            for l in 0..LANES {
                if hit[l] == 1 && !ends[l] {
                    let [r, g, b, alpha] = card.texel(at[0][l], at[1][l]);
                    let rest = 1.0 - alpha;
                    self.through[s][l] *= rest;
                    let added = &mut self.added[s][l];
                    *added = [added[0] * rest + r, added[1] * rest + g, added[2] * rest + b, 0.0];
                }
            }
        }
        meets
    }

    /// Adds the weighted radiance of frame and cards to the three parts of `sums`, which begin at `ends`; with `bare`, also the
    /// unweighted radiance to it.
    #[inline(always)]
    pub(super) fn add(
        &self,
        hits: &Hits,
        factors: Factors,
        ends: [usize; 3],
        sums: &mut LaneSums,
        mut bare: Option<&mut LaneSums>,
    ) {
        for (part, samples) in
            [0..ends[0], ends[0]..ends[1], ends[1]..ends[2]].into_iter().enumerate()
        {
            for l in 0..if samples.is_empty() { 0 } else { LANES } {
                let (mut weighted, mut plain) = ([0f32; 4], [0f32; 4]);
                for s in samples.clone() {
                    let added = &self.added[s][l];
                    let factor = match factors {
                        Factors::One => [1.0; 4],
                        Factors::Grey => [hits.grey[s][l]; 4],
                        Factors::Colour => hits.colour[s][l],
                    };
                    for k in 0..4 {
                        weighted[k] += added[k] * factor[k];
                        plain[k] += added[k];
                    }
                }
                for k in 0..4 {
                    sums[part][l][k] += f64::from(weighted[k]);
                    if let Some(bare) = bare.as_deref_mut() {
                        bare[part][l][k] += f64::from(plain[k]);
                    }
                }
            }
        }
    }
}
