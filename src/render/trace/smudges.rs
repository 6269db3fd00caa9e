//! Smudges on the front face of a pane: a smear that a part of the light meets.
//!
//! A pattern gives the share of the face that the smear covers around each point. Of a camera ray's light, this share meets a face with
//! the smear's roughness, and the rest the clean face: the orders of the clean pane and those of a pane that is smeared everywhere have
//! the same camera rays, with the weights 1 - share and share. What passes the smear is dimmed by its transmittance, once on the way to the front and
//! twice on the way to the back.

use super::lanes::{Lane, floor};
use super::orders::OrderPlan;
use super::rough::{RoughPane, RoughShape};
use super::stack::Stack;
use glam::{DVec3, Vec3};

/// Optics of a smear, and the share of the light that meets it where the pattern is 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smear {
    /// Beckmann's alpha of face 0 under the smear.
    pub roughness: f64,
    pub share: f64,
    /// Share of the light that passes the smear.
    pub transmittance: f64,
}

/// A smear with its pattern on the pane.
#[derive(Clone, Debug, PartialEq)]
pub struct Smudges {
    smear: Smear,
    columns: usize,
    /// Shares of the light that meets the smear, row by row.
    shares: Vec<f32>,
    /// Unit vectors of the pane, along rows and along columns of the pattern.
    axes: [DVec3; 2],
    texels_per_m: f64,
    /// Texel coordinates of the pivot; centres of texels are integers.
    pivot: [f64; 2],
    /// True if the pattern repeats; else the pane is clean beyond it.
    repeats: bool,
}

impl Smudges {
    /// Makes smudges from the smear, the number of columns and the shares of the pattern, and its axes, the size of its texels, m,
    /// and the texel coordinates of the pivot.
    pub fn new(
        smear: Smear,
        (columns, shares): (usize, &[f32]),
        (axes, texel_m, pivot): ([DVec3; 2], f64, [f64; 2]),
        repeats: bool,
    ) -> Self {
        let share = smear.share as f32;
        let shares = shares.iter().map(|covered| covered * share).collect();
        Self { smear, columns, shares, axes, texels_per_m: 1.0 / texel_m, pivot, repeats }
    }

    /// Returns the largest share of the light that meets the smear.
    fn largest_share(&self) -> f64 {
        self.shares.iter().fold(0.0, |most, share| f64::from(*share).max(most))
    }

    /// Prepares the pattern for points in coordinates with the axes `frame`, relative to the pivot.
    pub(super) fn lanes(&self, frame: [DVec3; 2]) -> SmudgeLanes {
        let row = |axis: DVec3| frame.map(|of| (self.texels_per_m * axis.dot(of)) as f32);
        let [transmittance, twice] =
            [1, 2].map(|passes| self.smear.transmittance.powi(passes) as f32);
        SmudgeLanes {
            columns: self.columns as i32,
            shares: self.shares.clone(),
            texel: self.axes.map(row),
            pivot: self.pivot.map(|v| v as f32),
            repeats: self.repeats,
            transmittance: [transmittance, twice],
        }
    }
}

/// A pane whose front face is smeared everywhere, and the pattern of smudges that says which share of the light meets it.
#[derive(Clone, Debug, PartialEq)]
pub struct SmearedPane {
    pub(super) pane: RoughPane,
    /// Orders of the pane that the tracer follows, with their largest weights where the smudges are strongest.
    pub orders: OrderPlan,
    pub(super) smudges: SmudgeLanes,
}

impl SmearedPane {
    /// Selects the paths of a pane with smudges; see [`RoughPane::new`].
    pub fn new(
        stack: &Stack,
        alphas: &[f64],
        shape: RoughShape<'_>,
        between: [f64; 2],
        max_radiance: [f64; 2],
        tolerance: f64,
        smudges: &Smudges,
    ) -> Self {
        let mut alphas = alphas.to_vec();
        alphas[0] = smudges.smear.roughness;
        let share = smudges.largest_share();
        let most = [1, 2].map(|passes| share * smudges.smear.transmittance.powi(passes));
        let radiance = [0, 1].map(|side| most[side] * max_radiance[side]);
        let (pane, mut orders) =
            RoughPane::new(stack, &alphas, shape, between, radiance, tolerance);
        let sides = [&mut orders.front, &mut orders.back];
        for (followed, most) in sides.into_iter().zip(most) {
            for followed in followed {
                followed.max_weight *= most;
            }
        }
        let smudges = smudges.lanes(pane.plane());
        Self { pane, orders, smudges }
    }

    /// Returns the paths of an order; see [`RoughPane::paths`].
    pub fn pane(&self) -> &RoughPane {
        &self.pane
    }
}

/// Smudges, ready for tracing.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SmudgeLanes {
    columns: i32,
    shares: Vec<f32>,
    /// Texel coordinates per metre along the axes of the pane's frame: those of columns, and those of rows.
    texel: [[f32; 2]; 2],
    pivot: [f32; 2],
    repeats: bool,
    /// Factors of the weights of light to the front and to the back.
    pub(super) transmittance: [f32; 2],
}

impl SmudgeLanes {
    /// Returns the factors of the weights of sixteen rays, from the `shares` of their light that meet the smear: along orders under the smear, or of the clean
    /// pane. `side` is 0 for light to the front, and 1 for that to the back.
    #[inline(always)]
    pub(super) fn factor(&self, is_smeared: bool, side: usize, shares: &Lane) -> Lane {
        let passed = self.transmittance[side];
        shares.map(|share| if is_smeared { share * passed } else { 1.0 - share })
    }

    /// Returns the share of the light that meets the smear at a point in the coordinates of the pane's frame: bilinear between the
    /// centres of texels.
    #[inline(always)]
    pub(super) fn share(&self, p: Vec3) -> f32 {
        let at = [0, 1].map(|k| self.texel[k][0] * p.x + self.texel[k][1] * p.y + self.pivot[k]);
        let rows = self.shares.len() as i32 / self.columns;
        let [(x, u), (y, v)] = at.map(|v| {
            let (whole, index) = floor(v);
            (index, v - whole)
        });
        if !self.repeats {
            let is_within = |v: f32, of: i32| (-0.5..=of as f32 - 0.5).contains(&v);
            if !(is_within(at[0], self.columns) && is_within(at[1], rows)) {
                return 0.0;
            }
        }
        let index = |v: i32, of: i32| {
            if self.repeats { v.rem_euclid(of) } else { v.clamp(0, of - 1) }
        };
        let texel = |x: i32, y: i32| {
            self.shares[(index(y, rows) * self.columns + index(x, self.columns)) as usize]
        };
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let (right, below) = (x + 1, y + 1);
        let upper = mix(texel(x, y), texel(right, y), u);
        mix(upper, mix(texel(x, below), texel(right, below), u), v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smudges(repeats: bool) -> SmudgeLanes {
        let smear = Smear { roughness: 0.05, share: 0.5, transmittance: 0.9 };
        let shares = [0.0, 0.25, 0.5, 1.0, 0.75, 0.125];
        let place = ([DVec3::X, DVec3::Y], 0.01, [1.0, 0.5]);
        Smudges::new(smear, (3, &shares), place, repeats).lanes([DVec3::X, DVec3::Y])
    }

    #[test]
    fn shares_are_bilinear_and_end_with_the_map() {
        let map = smudges(false);
        let at = |x: f32, y: f32| map.share(Vec3::new(0.01 * (x - 1.0), 0.01 * (y - 0.5), 0.0));
        let is = |x: f32, y: f32, share: f32| {
            assert!((at(x, y) - share).abs() < 1e-6, "{} at {x}, {y}", at(x, y));
        };
        is(0.0, 0.0, 0.0);
        is(0.0, 1.0, 0.5);
        is(2.0, 1.0, 0.0625);
        is(0.5, 0.0, 0.0625);
        is(0.5, 0.5, 0.25);
        // Half a texel beyond the centres, the map ends.
        is(2.45, 0.0, 0.25);
        is(2.55, 0.0, 0.0);
        is(0.0, -0.55, 0.0);
        is(0.0, 1e9, 0.0);
    }

    #[test]
    fn marks_repeat() {
        let map = smudges(true);
        let at = |x: f32, y: f32| map.share(Vec3::new(0.01 * (x - 1.0), 0.01 * (y - 0.5), 0.0));
        for (x, y) in [(0.25, 0.5), (1.7, 0.9), (2.6, 0.1)] {
            for (dx, dy) in [(3.0, 0.0), (-6.0, 2.0), (0.0, -4.0)] {
                assert!((at(x + dx, y + dy) - at(x, y)).abs() < 1e-5, "{x}, {y}");
            }
        }
        assert!((at(2.5, 0.0) - 0.125).abs() < 1e-6);
    }
}
