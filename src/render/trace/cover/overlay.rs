//! Effects of outline, frame and cards on the rays of a bundle.

use super::super::camera::CHUNK;
use super::super::fetch::{Factors, Hits};
use super::super::lanes::{LANES, Lane};
use super::super::lines::Path;
use super::super::means::LaneSums;
use super::super::patch::Patch;
use super::super::scene::Scene;
use super::super::slab::Order;
use super::{Card, Cover, Entries};

/// Shares of the surface's radiance that reach the rays of a bundle, and radiance of the frame and of cards.
pub(in super::super) struct Overlay {
    /// Share of the surface's radiance.
    pub(in super::super) through: [Lane; CHUNK],
    /// Radiance of the frame and of cards. The fourth number of a colour is padding.
    pub(in super::super) added: [[[f32; 4]; LANES]; CHUNK],
}

/// True if rays of `patch` along `path` may meet one of the `cards`.
///
/// A line to the point X of a card has the direction d = (X - p) / X_z, with its point p in the plane of the lens: a lens point,
/// shifted by at most `kappa (1 + |d|)`. The film point is d plus the lens point over the focus distance.
pub(in super::super) fn meets(
    scene: &Scene,
    cards: &[Card],
    patch: &Patch,
    path: Path<'_>,
) -> bool {
    if cards.is_empty() {
        return false;
    }
    let (aperture_m, inverse_focus_per_m) = match path {
        Path::Pinhole => (0.0, 0.0),
        // Nothing bounds the directions.
        Path::Bent(..) | Path::BentPinhole(_) => return true,
        _ => (scene.lens.aperture_radius_m, scene.lens.inverse_focus_per_m),
    };
    let spread = aperture_m * inverse_focus_per_m;
    let radius_px = scene.film.filter_radius_px();
    let film = [0, 1].map(|k| {
        let reach = scene.film.pixel_tangent()[k] * radius_px;
        [patch.exact_center[k][0] - reach, patch.exact_center[k][LANES - 1] + reach]
    });
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
    pub(in super::super) fn new() -> Box<Self> {
        Box::new(Self { through: [[1.0; LANES]; CHUNK], added: [[[0.0; 4]; LANES]; CHUNK] })
    }

    /// Begins with the outline and the frame, for `count` samples along `order` (`None`: R's pinhole path).
    #[inline(always)]
    pub(in super::super) fn begin(
        &mut self,
        cover: &Cover,
        entries: &Entries,
        order: Option<Order>,
        count: usize,
    ) {
        let of_frame = cover.outline.as_ref().map_or([0.0; 3], |outline| outline.frame_radiance);
        for s in 0..count {
            if order == Some(Order::Transmitted(0)) {
                for l in 0..LANES {
                    let frame = entries.frame[s][l];
                    self.through[s][l] = 1.0 - frame;
                    self.added[s][l] =
                        [frame * of_frame[0], frame * of_frame[1], frame * of_frame[2], 0.0];
                }
            } else {
                self.through[s] = entries.glass[s];
                self.added[s] = [[0.0; 4]; LANES];
            }
        }
    }

    /// Lays the cards over the surface for sample `s`, which has these points in the plane z = 0, directions (x, y, 1), and z
    /// of the surface.
    #[inline(always)]
    pub(in super::super) fn lay(
        &mut self,
        cards: &[Card],
        s: usize,
        point: &[Lane; 2],
        direction: &[Lane; 2],
        surface_z_m: &Lane,
    ) {
        // Neither the frame nor rays that end at the edge show a card.
        let ends = self.through[s].map(|through| through == 0.0);
        for card in cards {
            let (at, hit) = card.hits(point, direction, surface_z_m);
            if hit.iter().all(|hit| *hit == 0) {
                continue;
            }
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
    }

    /// Adds the weighted radiance of frame and cards to the three parts of `sums`, which begin at `ends`; with `bare`, also the
    /// unweighted radiance to it.
    #[inline(always)]
    pub(in super::super) fn add(
        &self,
        hits: &Hits,
        factors: Factors,
        ends: [usize; 3],
        sums: &mut LaneSums,
        mut bare: Option<&mut LaneSums>,
    ) {
        for s in 0..ends[2] {
            let part = usize::from(s >= ends[0]) + usize::from(s >= ends[1]);
            for l in 0..LANES {
                let added = self.added[s][l];
                for c in 0..3 {
                    let factor = match factors {
                        Factors::One => 1.0,
                        Factors::Grey => hits.grey[s][l],
                        Factors::Colour => hits.colour[s][l][c],
                    };
                    sums[part][l][c] += f64::from(added[c] * factor);
                    if let Some(bare) = bare.as_deref_mut() {
                        bare[part][l][c] += f64::from(added[c]);
                    }
                }
            }
        }
    }
}
