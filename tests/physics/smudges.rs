//! Smudges: pixels against the f64 renderer, closed forms of the light that they take, and the limits of clean and smeared panes.

use crate::case::{Apex, CLEAN, Case, GLASS, I, T, bumpy, noise};
use crate::pixels::compare;
use crate::stack::coated_double_pane;
use glam::DVec3;
use render::trace::{Smear, Smudges};

/// Smudges of a case, whose pattern lies along the axes of the pane.
#[derive(Clone, Debug)]
pub(crate) struct Smudged {
    pub(crate) smear: Smear,
    /// Number of columns and of rows of the pattern.
    pub(crate) size: [usize; 2],
    /// Covered shares, row by row.
    pub(crate) shares: Vec<f32>,
    pub(crate) texel_m: f64,
    /// Texel coordinates of the pivot.
    pub(crate) pivot: [f64; 2],
    pub(crate) repeats: bool,
}

impl Smudged {
    /// Makes smudges that are the same everywhere.
    fn even(smear: Smear) -> Self {
        Self {
            smear,
            size: [1, 1],
            shares: vec![1.0],
            texel_m: 1.0,
            pivot: [0.0; 2],
            repeats: true,
        }
    }

    /// Makes spots of random shares, 4 mm wide.
    pub(crate) fn spotted(smear: Smear, repeats: bool) -> Self {
        let shares = (0..9 * 7).map(|q| noise(q % 9, q / 9, 5) as f32).collect();
        Self { smear, size: [9, 7], shares, texel_m: 0.004, pivot: [3.7, 2.2], repeats }
    }

    pub(crate) fn tracer(&self, axes: [DVec3; 2]) -> Smudges {
        let pattern = (self.size[0], self.shares.as_slice());
        Smudges::new(self.smear, pattern, (axes, self.texel_m, self.pivot), self.repeats)
    }

    /// Returns the share of the light that meets the smear at a point of the pane, relative to the pivot.
    pub(crate) fn share(&self, [right, down]: [DVec3; 2], from_pivot: DVec3) -> f64 {
        let at = [right, down].map(|axis| from_pivot.dot(axis) / self.texel_m);
        let [x, y] = [at[0] + self.pivot[0], at[1] + self.pivot[1]];
        let [columns, rows] = self.size.map(|n| n as f64);
        let ends = |v: f64, of: f64| v < -0.5 || v > of - 0.5;
        if !self.repeats && (ends(x, columns) || ends(y, rows)) {
            return 0.0;
        }
        let index = |v: f64, of: usize| {
            let v =
                if self.repeats { v.rem_euclid(of as f64) } else { v.clamp(0.0, of as f64 - 1.0) };
            v as usize
        };
        let mut sum = 0.0;
        for (i, j) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (column, row) = (x.floor() + i, y.floor() + j);
            let weight = (1.0 - (x - column).abs()) * (1.0 - (y - row).abs());
            let texel = index(row, self.size[1]) * self.size[0] + index(column, self.size[0]);
            sum += weight * f64::from(self.shares[texel]);
        }
        sum * self.smear.share
    }
}

const SMEAR: Smear = Smear { roughness: 0.03, share: 0.8, transmittance: 0.7 };

#[test]
fn pixels_with_smudges_match() {
    let mut case = Case::new(bumpy(11, false), bumpy(12, false));
    (case.film, case.spp) = ([13, 10], 64);
    case.smudges = Some(Smudged::spotted(SMEAR, true));
    compare("smudges", &case);
    (case.tilt_deg, case.apex) = ([14.0, -20.0], Apex::Camera);
    case.smudges = Some(Smudged::spotted(SMEAR, false));
    compare("smudges that end, tilted, camera", &case);
    case.roughness = Some(vec![0.01, 0.02]);
    case.bow_radius_m = Some(3.0);
    compare("smudges on a rough bent pane, tilted, camera", &case);
    case.bow_radius_m = None;
    case.roughness = None;
    case.stack = Some(coated_double_pane());
    compare("smudges on a coated double pane, tilted, camera", &case);
    case.wave = Some([1e-4, 0.1, 70.0]);
    compare("smudges on a coated double pane with waves, tilted, camera", &case);
}

/// A smear that covers the whole face is a rough face, and one that covers nothing is a clean one.
#[test]
fn the_limits_are_rough_and_clean_faces() {
    let mut case = Case::new(bumpy(3, false), bumpy(4, false));
    (case.film, case.tilt_deg, case.absorption_per_m) = ([11, 8], [4.0, 15.0], [6.0, 2.0, 4.0]);
    // All orders take all samples, and none join.
    case.tolerance = 0.0;
    let smear = Smear { transmittance: 1.0, share: 1.0, ..SMEAR };
    case.smudges = Some(Smudged::even(smear));
    let smeared = case.render();
    case.smudges = Some(Smudged::even(Smear { share: 0.0, ..smear }));
    let clean = case.render();
    case.smudges = None;
    for (alpha, pixels) in [(0.03, smeared), (0.0, clean)] {
        case.roughness = Some(vec![alpha, 0.0]);
        for (pixel, expected) in pixels.iter().zip(case.render()) {
            for layer in [I, T, GLASS, CLEAN] {
                for c in 0..3 {
                    let difference = pixel.mean[layer][c] - expected.mean[layer][c];
                    assert!(difference.abs() <= 1e-6, "alpha {alpha}: {difference:e}");
                }
            }
        }
    }
}

/// Between white photographs, I is 1 less what the smear takes: of the light to the front once, and of that to the back twice.
#[test]
fn smears_take_their_share_of_white_light() {
    let mut case = Case::new(bumpy(1, true), bumpy(2, true));
    (case.film, case.spp, case.tolerance) = ([6, 4], 4096, 1e-7);
    let mean = |case: &Case, layer: usize| {
        let pixels = case.render();
        pixels.iter().map(|p| f64::from(p.mean[layer][1])).sum::<f64>() / pixels.len() as f64
    };
    let back = mean(&case, GLASS);
    for (roughness, share, transmittance) in
        [(0.0, 1.0, 0.6), (0.0, 0.35, 0.0), (0.02, 0.5, 0.8), (0.02, 1.0, 1.0)]
    {
        let smear = Smear { roughness, share, transmittance };
        case.smudges = Some(Smudged::even(smear));
        let kept = |passes: i32| 1.0 - share * (1.0 - transmittance.powi(passes));
        let expected = [(1.0 - back) * kept(1) + back * kept(2), 1.0, back * kept(2)];
        for (layer, expected) in [I, T, GLASS].into_iter().zip(expected) {
            let found = mean(&case, layer);
            println!("{smear:?}, layer {layer}: {found:.6}, closed form {expected:.6}");
            assert!((found - expected).abs() < 3e-4, "{found} {expected}");
        }
    }
}
