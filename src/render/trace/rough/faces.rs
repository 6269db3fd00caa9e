//! Rays from face to face of a pane, in f64: how the search and the measurement of paths follow light.

use super::super::stack::Stack;
use super::facet::Face;
use super::paths::Meeting;
use glam::{DMat3, DVec3};

/// Step of the phases at which rays meet waves, in turns: the golden ratio spreads any number of them evenly.
const PHASE_STEP_TURNS: f64 = 0.618_033_988_749_895;

/// A ray in the pane's axes, with its weights for s and p, and for each colour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) direction: DVec3,
    /// Phase of the waves where it is, in turns.
    phase_turns: f64,
    pub(super) power: [[f64; 3]; 2],
}

impl Ray {
    /// Makes a ray that carries all light.
    pub(super) fn new(direction: DVec3) -> Self {
        Self { direction, phase_turns: 0.0, power: [[1.0; 3]; 2] }
    }

    /// Returns the ray without its light.
    pub(super) fn dark(&self) -> Self {
        Self { power: [[0.0; 3]; 2], ..*self }
    }

    /// Returns the weights of the colours for unpolarised light.
    pub(super) fn weights(&self) -> [f64; 3] {
        let [s, p] = &self.power;
        [0, 1, 2].map(|c| 0.5 * (s[c] + p[c]))
    }
}

/// Waves of the faces, in the pane's axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crests {
    pub(super) across: DVec3,
    pub(super) largest_slope: f64,
    pub(super) length_m: f64,
}

/// A pane with the roughness and the shape of its faces.
#[derive(Clone, Copy, Debug)]
pub(super) struct Faces<'a> {
    pub(super) stack: &'a Stack,
    pub(super) alphas: &'a [f64],
    /// Least cosine of a direction to a face's normal with which light goes on.
    pub(super) least_cos: f64,
    /// The axes of each face in those of the pane; none if all are parallel.
    pub(super) turned: &'a [DMat3],
    pub(super) crests: Option<Crests>,
    /// Unit vector in the pane's plane to which camera rays travel.
    pub(super) azimuth: DVec3,
}

/// A meeting with a face, and the cosine of the camera ray, on which coatings depend.
#[derive(Clone, Copy, Debug)]
pub(super) struct At {
    pub(super) face: usize,
    pub(super) inward: bool,
    pub(super) cos_i: f64,
}

impl Faces<'_> {
    /// Makes parallel faces.
    #[cfg(test)]
    pub(super) fn parallel<'a>(stack: &'a Stack, alphas: &'a [f64], least_cos: f64) -> Faces<'a> {
        Faces { stack, alphas, least_cos, turned: &[], crests: None, azimuth: DVec3::X }
    }

    /// Makes the camera rays `first .. first + count` at this cosine of incidence.
    pub(super) fn camera_rays(&self, cos: f64, first: u32, count: usize) -> Vec<Ray> {
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let direction = self.azimuth * sin + DVec3::Z * cos;
        let of = |k| {
            let phase_turns = f64::from(first + k) * PHASE_STEP_TURNS;
            Ray { phase_turns, ..Ray::new(direction) }
        };
        (0..count as u32).map(of).collect()
    }

    /// Returns the axes of a face where a ray meets it; `None` if these are the pane's.
    fn frame(&self, ray: &Ray, face: usize) -> Option<DMat3> {
        let turned = self.turned.get(face).copied();
        let Some(Crests { across, largest_slope, .. }) = self.crests else { return turned };
        let slope = largest_slope * libm::cos(std::f64::consts::TAU * ray.phase_turns);
        let normal = (DVec3::Z - slope * across).normalize();
        let first = (DVec3::X - normal * normal.x).normalize();
        let waved = DMat3::from_cols(first, normal.cross(first), normal);
        Some(turned.map_or(waved, |turned| turned * waved))
    }

    /// Returns the direction of a ray in the axes of a face; `None` if it does not reach the face, which is turned away.
    pub(super) fn meet(&self, ray: &Ray, at: At) -> Option<DVec3> {
        let d = ray.direction;
        let d = self.frame(ray, at.face).map_or(d, |frame| frame.transpose() * d);
        let sign = if at.inward { 1.0 } else { -1.0 };
        (d.z * sign > self.least_cos).then_some(d)
    }

    /// Splits a ray at a facet of a face: into the light that passes it and the light that it reflects, each with the transmittance of the
    /// layer behind. A ray that does not reach the face has no light behind it.
    pub(super) fn split(&self, ray: &Ray, at: At, facet: [f64; 2]) -> [(Ray, [f64; 3]); 2] {
        let Some(d) = self.meet(ray, at) else {
            return [(ray.dark(), [1.0; 3]); 2];
        };
        let (frame, coating) = (self.frame(ray, at.face), self.coating(at));
        let leaving = self.face(at).split(d, facet);
        [false, true].map(|reflects| {
            let of = &leaving[usize::from(reflects)];
            let direction = frame.map_or(of.direction, |frame| frame * of.direction);
            let meeting = Meeting { face: at.face, inward: at.inward, reflects };
            let mut out = Ray { direction, ..*ray };
            let mut tau = [1.0; 3];
            if let Some(next) = meeting.next_face(self.stack.layers().len()) {
                let layer = &self.stack.layers()[next.min(at.face)];
                let way_m = layer.thickness_m / direction.z.abs();
                tau = layer.absorption_per_m.map(|a| libm::exp(-a * way_m));
                if let Some(Crests { across, length_m, .. }) = self.crests {
                    out.phase_turns += way_m * direction.dot(across) / length_m;
                }
            }
            let kind = of.kind(reflects);
            let coated = coating.map(|shares| kind.map_or([0.0; 3], |kind| shares[kind]));
            for (power, fresnel) in out.power.iter_mut().zip(of.fresnel) {
                let shares = coated.unwrap_or([fresnel; 3]);
                (0..3).for_each(|c| power[c] *= shares[c] * of.passes * tau[c]);
            }
            (out, tau)
        })
    }

    /// Returns a face as facets see it.
    pub(super) fn face(&self, at: At) -> Face {
        let [near, far] = self.stack.iors(at.face);
        let iors = if at.inward { [near, far] } else { [far, near] };
        Face { alpha: self.alphas[at.face], iors, least_cos: self.least_cos }
    }

    /// Returns a coating's shares of light that passes it, that it reflects, and that is reflected totally; these keep what the coating
    /// would let pass.
    pub(super) fn coating(&self, at: At) -> Option<[[f64; 3]; 3]> {
        let coating = self.stack.coatings()[at.face].as_ref()?;
        let [passed, reflected] =
            [false, true].map(|reflects| coating.share(at.inward, reflects).at(at.cos_i));
        Some([passed, reflected, [0, 1, 2].map(|c| reflected[c] + passed[c])])
    }
}
