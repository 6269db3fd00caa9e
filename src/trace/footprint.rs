//! Where a pixel's bundle of rays can be at a given w, and from that the part of the rays worth walking.
//!
//! For one order of the glass, a ray through film point p (tangents) and lens point a is
//!
//! ```text
//! u(w) = g ((p - a wf) (1 + w e) + w a + w t),   e = add - kappa n_z,   t = kappa n_x
//!      = g (p (1 + w e) + a (w - wf (1 + w e)) + w t)
//! ```
//!
//! with g the focal length in px (signed), wf = 1/focus distance, kappa the order's shift along the normal (see
//! [`super::slab`]) and `add` the extra path of apex `camera`. It is linear in each of p, a and kappa, so over a
//! box of them its extremes are at the box's corners; and it is linear in w, so the box over a slice of w is the
//! box around the slice's two ends.

use super::grid::Grid;
use super::lanes::{max, min};
use super::walk::Span;

/// The bundle's box at w: `[u_min, v_min, u_max, v_max]` in relative grid coordinates.
pub(crate) type Bounds = [f32; 4];

/// A bundle whose box at each w is known.
pub(crate) trait Footprint {
    /// A box that holds all of the bundle's rays at inverse depth `w` (1/m).
    fn at(&self, w: f32) -> Bounds;
}

/// Slack of a box, px: covers the rounding of f32 coordinates.
const SLACK_PX: f32 = 0.01;
/// The same, relative to the coordinate.
const SLACK: f32 = 2.0e-6;

/// One axis of [`ClosedForm`].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Axis {
    /// Focal length, px; negative where the view is mirrored.
    pub(crate) focal_px: f32,
    /// Film point of the pixel's centre, tangent.
    pub(crate) center: f32,
    /// Half the film interval, tangent.
    pub(crate) half_width: f32,
    /// Relative grid coordinate of the centre's direction (w = 0).
    pub(crate) origin: f32,
    /// e and t at both ends of the order's kappa interval.
    pub(crate) ends: [[f32; 2]; 2],
}

/// The footprint of one pixel and order in closed form: no ray is looked at.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ClosedForm {
    pub(crate) axes: [Axis; 2],
    pub(crate) aperture_m: f32,
    pub(crate) inverse_focus_per_m: f32,
}

impl Footprint for ClosedForm {
    #[inline(always)]
    fn at(&self, w: f32) -> Bounds {
        let mut bounds = [0.0; 4];
        for (k, axis) in self.axes.iter().enumerate() {
            let (mut lo, mut hi) = (f32::INFINITY, f32::NEG_INFINITY);
            for [e, t] in axis.ends {
                let stretch = 1.0 + w * e;
                let middle = axis.focal_px * (axis.center * w * e + w * t);
                let reach = axis.focal_px.abs()
                    * (axis.half_width * stretch.abs()
                        + self.aperture_m * (w - self.inverse_focus_per_m * stretch).abs());
                lo = min(middle - reach, lo);
                hi = max(middle + reach, hi);
            }
            bounds[k] = axis.origin + lo - SLACK_PX - SLACK * lo.abs();
            bounds[k + 2] = axis.origin + hi + SLACK_PX + SLACK * hi.abs();
        }
        bounds
    }
}

/// A footprint from the rays themselves, for views without a closed form (a tilted pane with apex `camera`).
#[derive(Clone, Copy, Debug)]
pub(crate) struct FromRays {
    /// Bounds of the lines' origins: `[x_min, y_min, x_max, y_max]`.
    pub(crate) origin: Bounds,
    /// Bounds of their slopes.
    pub(crate) slope: Bounds,
}

impl Footprint for FromRays {
    #[inline(always)]
    fn at(&self, w: f32) -> Bounds {
        let mut bounds = [0.0; 4];
        for k in 0..4 {
            let at = self.origin[k] + w * self.slope[k];
            let slack = SLACK_PX + SLACK * (self.origin[k].abs() + (w * self.slope[k]).abs());
            bounds[k] = if k < 2 { at - slack } else { at + slack };
        }
        bounds
    }
}

/// Box around two boxes, as grid indices.
#[inline(always)]
fn hull(a: &Bounds, b: &Bounds, base: [i32; 2]) -> [i32; 4] {
    let down = |v: f32| v.floor() as i32;
    [
        down(min(a[0], b[0])).saturating_add(base[0]),
        down(min(a[1], b[1])).saturating_add(base[1]),
        down(max(a[2], b[2])).saturating_add(base[0]),
        down(max(a[3], b[3])).saturating_add(base[1]),
    ]
}

/// Travel that one slice of w may take, px.
const SLICE_PX: f32 = 8.0;
/// Slices at most in one round.
const MAX_SLICES: usize = 64;

/// The part of the bundle's rays in which the sheet lies, by marching w in slices against the pyramid.
///
/// The first slice (from near) whose largest w reaches it bounds the span from above; the first whose smallest
/// w covers it bounds the span from below. Rounds repeat while the span shrinks.
#[inline(always)]
pub(crate) fn span(grid: &Grid, base: [i32; 2], footprint: &impl Footprint) -> Span {
    let [bottom, top] = grid.extremes();
    let (mut lo, mut hi) = (bottom, top);
    for _ in 0..4 {
        let (box_lo, box_hi) = (footprint.at(lo), footprint.at(hi));
        let travel = |k: usize| (box_hi[k] - box_lo[k] + box_hi[k + 2] - box_lo[k + 2]).abs() * 0.5;
        let slices = ((max(travel(0), travel(1)) / SLICE_PX) as usize + 1).min(MAX_SLICES);
        let step = (hi - lo) / slices as f32;
        let mut new_hi = None;
        let mut new_lo = lo;
        let mut near_box = box_hi;
        for slice in 0..slices {
            let near = hi - step * slice as f32;
            let is_last = slice + 1 == slices;
            let far = if is_last {
                lo
            } else {
                hi - step * (slice + 1) as f32
            };
            let far_box = if is_last { box_lo } else { footprint.at(far) };
            let [sheet_lo, sheet_hi] = grid.bounds(hull(&near_box, &far_box, base));
            near_box = far_box;
            if new_hi.is_none() && sheet_hi >= far {
                new_hi = Some(min(near, max(sheet_hi, far)));
            }
            if sheet_lo >= far {
                new_lo = min(max(sheet_lo, far), near);
                break;
            }
        }
        let before = hi - lo;
        // Widened by some ulps: the walk starts above the sheet and ends below it whatever the rounding.
        hi = min(
            max(new_hi.unwrap_or(new_lo), new_lo) * 1.000_001,
            top * 1.000_001,
        );
        lo = max(new_lo * 0.999_999, bottom * 0.999_999);
        if hi - lo > 0.7 * before {
            break;
        }
    }
    let [x0, y0, x1, y1] = hull(&footprint.at(lo), &footprint.at(hi), base);
    let inside = x0 >= 1 && y0 >= 1 && x1 < grid.nx() as i32 - 2 && y1 < grid.ny() as i32 - 2;
    Span { hi, lo, inside }
}
