//! Features of a pane that move no line of the film by a visible length. They are off for the scene, which is then that
//! without the feature, bit for bit.
//!
//! Waves, wedges, a bend and roughness turn the normals of faces by at most a slope s. A path that meets faces with k reflections turns
//! by at most s (2 k n + 2 n) / c in air, with the largest index n and the least cosine of incidence c: 2 n s at each reflection, n s at
//! the entry and at the exit, and 1 / c by the refraction at the exit. This and the height of the faces move its point on the pane. Both
//! together bound the movement of the line over the film, from the nearest surface to infinity.

use super::geometry::{
    bow, film_reach, layers, roughness, slab, turned_faces, unfiltered_film, wave,
};
use crate::trace::Lens;
use glasshouse_line::SceneLine;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Movement below which a feature is off, px of the film.
const LEAST_PX: f64 = 1.0e-3;
/// Number of reflections of the longest path that is considered. Longer ones carry less light than a stated error.
const REFLECTIONS: f64 = 12.0;
/// Largest slope of a facet that is drawn, in units of alpha, with its shift towards the light.
const STEEPEST_FACET: f64 = 5.0;

/// Bounds of the movements of the lines, px of the film, by the features of a scene that are off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Negligible {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wave: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wedge: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bow: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness: Option<f64>,
}

impl Negligible {
    /// Finds the negligible features of a line's pane, for the pane and surfaces at `nearest_m` or more from the lens.
    pub(super) fn of(line: &SceneLine, lens: &Lens, nearest_m: f64) -> Self {
        let film = unfiltered_film(line);
        let (slab, reach) = (slab(line), film_reach(&film, lens));
        let least_cos = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]
            .map(|[x, y]: [f64; 2]| {
                let d = glam::DVec3::new(x * reach[0], y * reach[1], 1.0);
                d.normalize().dot(slab.normal)
            })
            .into_iter()
            .fold(1.0, f64::min)
            .max(1e-3);
        let stack = layers(line);
        let pane_m = slab.plane_distance_m / least_cos;
        let moves = |slope: f64, height_m: f64| {
            let turn = 2.0 * stack.largest_ior() * (REFLECTIONS + 1.0) * slope / least_cos;
            let crossed_m = (REFLECTIONS + 1.0) * stack.thickness_m();
            let on_pane_m =
                (crossed_m * turn + (REFLECTIONS + 1.0) * 2.0 * height_m) / (least_cos * least_cos);
            // A surface before the pane is met where the line is continued backwards.
            let behind = turn * (1.0 + pane_m / nearest_m) + on_pane_m / nearest_m;
            let [x, y] = reach;
            let pixel = film.pixel_tangent();
            behind * (1.0 + x * x + y * y) / pixel[0].min(pixel[1])
        };
        let off =
            |slope: f64, height_m: f64| Some(moves(slope, height_m)).filter(|px| *px <= LEAST_PX);
        // Distance of the film's points on the pane from the pivot.
        let reach_m =
            (reach[0].hypot(reach[1]) * pane_m + line.camera.aperture_radius_m) / least_cos;
        Self {
            wave: wave(line).and_then(|wave| off(wave.largest_slope(), wave.amplitude_m)),
            wedge: turned_faces(line).and_then(|faces| {
                let slope = |turned: &glam::DMat3| {
                    let normal = *turned * slab.normal;
                    normal.cross(slab.normal).length()
                };
                let slope = faces.iter().map(slope).fold(0.0, f64::max);
                off(slope, slope * reach_m)
            }),
            bow: bow(line).and_then(|bow| {
                let slope = bow.curvature_per_m.abs() * reach_m;
                off(slope, slope * reach_m)
            }),
            roughness: roughness(line).and_then(|alphas| {
                off(STEEPEST_FACET * alphas.into_iter().fold(0.0, f64::max), 0.0)
            }),
        }
    }

    /// True if no feature is off.
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Returns the line without these features.
    pub(super) fn without<'a>(&self, line: &'a SceneLine) -> Cow<'a, SceneLine> {
        if self.is_empty() {
            return Cow::Borrowed(line);
        }
        let mut line = line.clone();
        let glass = &mut line.glass;
        if self.wave.is_some() {
            glass.wave = None;
        }
        if self.wedge.is_some() {
            let mut layers = std::mem::take(&mut glass.layers);
            for layer in &mut layers {
                layer.set_wedge_deg([0.0; 2]);
            }
            glass.set_stack(&layers);
        }
        if self.bow.is_some() {
            glass.bow_radius_m = None;
        }
        if self.roughness.is_some() {
            glass.roughness = None;
        }
        Cow::Owned(line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glasshouse_line::{Roughness, Wave, published};

    type Line<'a> = &'a dyn Fn(f64) -> SceneLine;
    type Bound = fn(&Negligible) -> Option<f64>;

    const PINHOLE: Lens = Lens { aperture_radius_m: 0.0, inverse_focus_per_m: 0.0 };

    fn of(line: &SceneLine) -> Negligible {
        Negligible::of(line, &PINHOLE, 1.0)
    }

    fn with(change: impl Fn(&mut SceneLine)) -> SceneLine {
        let mut line = published();
        line.glass.tilt_deg = [5.0, 20.0];
        change(&mut line);
        line
    }

    /// A feature goes off at the threshold, and the line without it is the line that never had it.
    #[test]
    fn tiny_features_are_off() {
        let plain = with(|_| {});
        let waved = |amplitude_m: f64| {
            let wave = Wave { amplitude_m, length_m: 0.3, direction_deg: 10.0 };
            with(|line| line.glass.wave = Some(wave))
        };
        let rough = |alpha| with(|line| line.glass.roughness = Some(Roughness::All(alpha)));
        let bent = |per_m: f64| with(|line| line.glass.bow_radius_m = Some(1.0 / per_m));
        let wedged = |pitch_deg: f64| {
            with(|line| {
                let mut layers = line.glass.stack();
                layers[0].set_wedge_deg([pitch_deg, 0.0]);
                line.glass.set_stack(&layers);
            })
        };
        let lines: [Line<'_>; 4] = [&waved, &rough, &bent, &wedged];
        let bounds: [Bound; 4] =
            [|off| off.wave, |off| off.roughness, |off| off.bow, |off| off.wedge];
        for (line, bound) in lines.into_iter().zip(bounds) {
            let tiny = of(&line(1e-10));
            let threshold = 1e-10 * LEAST_PX / bound(&tiny).unwrap();
            assert_eq!(*tiny.without(&line(1e-10)), plain);
            let below = of(&line(0.5 * threshold));
            assert!((bound(&below).unwrap() / (0.5 * LEAST_PX) - 1.0).abs() < 1e-3);
            let above = of(&line(2.0 * threshold));
            assert!(above.is_empty());
            assert_eq!(*above.without(&line(threshold)), line(threshold));
        }
        assert!(of(&plain).is_empty());
    }
}
