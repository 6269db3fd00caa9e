//! Shares of coated faces, as functions of the cosine of the camera ray's incidence: facets change Fresnel's shares, but not those of
//! coatings.

use super::super::lanes::{LANES, Lane, floor, max, min};
use glasshouse_line::curve::Curve;

/// Steps of the cosine from 0 to 1. Linear interpolation between them is exact to some 1e-6 for a coating with rows every ten degrees. With 256 steps, the
/// kinks between them were above what closed forms of waves and wedges may miss.
const STEPS: u32 = 1024;

/// The shares of light that passes a coating and that it reflects, in one direction.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Coat([Share; 2]);

/// A share at equal steps of the cosine, or at all angles.
#[derive(Clone, Debug, PartialEq)]
struct Share(Vec<[f32; 3]>);

/// The shares of a coat for sixteen rays: of light that passes and that is reflected, for each colour.
pub(super) type CoatLanes = [[Lane; 3]; 2];

impl Coat {
    pub(super) fn new(shares: [&Curve; 2]) -> Self {
        Self(shares.map(|share| {
            let steps = if share.is_constant() { 0 } else { STEPS };
            let at = |i| share.at(f64::from(i) / f64::from(STEPS)).map(|share| share as f32);
            Share((0..=steps).map(at).collect())
        }))
    }

    /// Finds the shares at these cosines.
    #[inline(always)]
    pub(super) fn find(&self, cosines: &Lane, lanes: &mut CoatLanes) {
        let (mut index, mut within) = ([0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            let at = min(max(cosines[l], 0.0), 1.0) * STEPS as f32;
            index[l] = min(floor(at).0, (STEPS - 1) as f32) as i32;
            within[l] = at - index[l] as f32;
        }
        for (lanes, Share(rows)) in lanes.iter_mut().zip(&self.0) {
            if let [row] = rows[..] {
                *lanes = row.map(|share| [share; LANES]);
                continue;
            }
            for l in 0..LANES {
                let (from, to) = (&rows[index[l] as usize], &rows[index[l] as usize + 1]);
                for c in 0..3 {
                    lanes[c][l] = from[c] + (to[c] - from[c]) * within[l];
                }
            }
        }
    }
}
