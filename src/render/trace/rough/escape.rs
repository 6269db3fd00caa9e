//! How the light behind a cut divides between the sides of a pane, without random numbers: as behind smooth faces.
//!
//! A ray keeps n sin of its angle behind parallel smooth faces, so its rounds between the faces before and behind it are a geometric
//! series. Facets would change the light of the few rays behind a cut a little more; that light is stated as dropped. Light that smooth
//! faces would never let out leaves on the sides that let out light along the normal, in the proportion of their transmittances.

use super::super::stack::Exit;
use super::faces::{Faces, Ray};
use super::paths::Meeting;

/// Reflectance and transmittance of one or more faces for s and p, for each colour.
#[derive(Clone, Copy)]
struct Shares {
    reflected: [[f64; 3]; 2],
    passed: [[f64; 3]; 2],
}

impl Shares {
    fn each(of: impl Fn(usize, usize) -> (f64, f64)) -> Self {
        let mut shares = Self { reflected: [[0.0; 3]; 2], passed: [[0.0; 3]; 2] };
        for q in 0..2 {
            for c in 0..3 {
                (shares.reflected[q][c], shares.passed[q][c]) = of(q, c);
            }
        }
        shares
    }

    /// Puts a face before these, with a layer of the transmittance `tau` between: light meets `face` from outside and comes back to it as
    /// to `inside`.
    fn behind(&self, face: &Self, inside: &Self, tau: [f64; 3]) -> Self {
        Self::each(|q, c| {
            let (through, back) = (face.passed[q][c] * tau[c], self.reflected[q][c] * tau[c]);
            let rounds =
                sum_of_rounds(inside.reflected[q][c] * tau[c] * self.reflected[q][c] * tau[c]);
            let reflected = face.reflected[q][c] + through * back * face.passed[q][c] * rounds;
            (reflected, through * self.passed[q][c] * rounds)
        })
    }
}

/// Returns 1 / (1 - `share`), the sum of all powers; 0 if no light gets lost, so that none leaves either.
fn sum_of_rounds(share: f64) -> f64 {
    if share < 1.0 - 1e-12 { 1.0 / (1.0 - share) } else { 0.0 }
}

/// The light of a ray that leaves to the front and to the back, for each colour.
#[derive(Clone, Copy, Default)]
pub(super) struct Escaped {
    pub(super) left: [[f64; 3]; 2],
    /// The part of both that smooth faces would never let out.
    pub(super) trapped: [f64; 3],
}

impl Faces<'_> {
    /// Divides the light of a ray behind a meeting, whose layer it has crossed. `cos_i` is that of the camera ray.
    pub(super) fn escape(&self, ray: &Ray, meeting: Meeting, cos_i: f64) -> Escaped {
        let mut escaped = Escaped::default();
        let Some(next) = meeting.next_face(self.stack.layers().len()) else {
            escaped.left[usize::from(meeting.exit() == Exit::Reflected)] = ray.weights();
            return escaped;
        };
        let layer = next.min(meeting.face);
        let ior = self.stack.layers()[layer].ior;
        let sine_2 = ior * ior * (1.0 - ray.direction.z * ray.direction.z).max(0.0);
        let shares = self.shares(layer, meeting.goes_inward(), sine_2, cos_i);
        let mut along_normal = None;
        for q in 0..2 {
            for c in 0..3 {
                let light = 0.5 * ray.power[q][c];
                let mut of = [shares[0][q][c], shares[1][q][c]];
                if of == [0.0; 2] && light > 0.0 {
                    let shares = along_normal.get_or_insert_with(|| {
                        self.shares(layer, meeting.goes_inward(), 0.0, cos_i)
                    });
                    of = [shares[0][q][c], shares[1][q][c]];
                    let all = of[0] + of[1];
                    of = of.map(|share| if all > 0.0 { share / all } else { 0.0 });
                    escaped.trapped[c] += light * (of[0] + of[1]);
                }
                (0..2).for_each(|side| escaped.left[side][c] += light * of[side]);
            }
        }
        escaped
    }

    /// Returns the shares of the light at the end of a layer that leave to the front and to the back, for s and p and each colour.
    /// `sine_2` is the square of n sin of the ray's angle.
    fn shares(&self, layer: usize, inward: bool, sine_2: f64, cos_i: f64) -> [[[f64; 3]; 2]; 2] {
        let last = self.stack.layers().len();
        let face = |face: usize, inward: bool| self.smooth(face, inward, sine_2, cos_i);
        let tau = |layer: usize| {
            let layer = &self.stack.layers()[layer];
            let cosine = (1.0 - sine_2 / (layer.ior * layer.ior)).max(0.0).sqrt();
            layer.absorption_per_m.map(|a| libm::exp(-a * layer.thickness_m / cosine.max(1e-9)))
        };
        let mut behind = face(last, true);
        for k in (layer + 1..last).rev() {
            behind = behind.behind(&face(k, true), &face(k, false), tau(k));
        }
        let mut before = face(0, false);
        for k in 1..=layer {
            before = before.behind(&face(k, false), &face(k, true), tau(k - 1));
        }
        let tau = tau(layer);
        let (ahead, back) = if inward { (behind, before) } else { (before, behind) };
        let mut shares = [[[0.0; 3]; 2]; 2];
        for q in 0..2 {
            for c in 0..3 {
                let turned = ahead.reflected[q][c] * tau[c];
                let rounds = sum_of_rounds(turned * back.reflected[q][c] * tau[c]);
                shares[usize::from(!inward)][q][c] = ahead.passed[q][c] * rounds;
                shares[usize::from(inward)][q][c] = turned * back.passed[q][c] * rounds;
            }
        }
        shares
    }

    /// Returns the shares of a smooth face. One that reflects totally keeps what its coating would let pass.
    fn smooth(&self, face: usize, inward: bool, sine_2: f64, cos_i: f64) -> Shares {
        let [near, far] = self.stack.iors(face);
        let [a, b] = [near, far].map(|ior| ior * ior - sine_2);
        let is_total = a <= 0.0 || b <= 0.0;
        if let Some(coating) = &self.stack.coatings()[face] {
            let [passed, reflected] =
                [false, true].map(|reflects| coating.share(inward, reflects).at(cos_i));
            return Shares::each(|_, c| {
                if is_total { (reflected[c] + passed[c], 0.0) } else { (reflected[c], passed[c]) }
            });
        }
        if is_total {
            return Shares::each(|_, _| (1.0, 0.0));
        }
        let [a, b] = [a.sqrt(), b.sqrt()];
        // The cosines times the indices, divided by the squares of these for p.
        let of_polarisation = [[a, b], [a / (near * near), b / (far * far)]];
        Shares::each(|q, _| {
            let [a, b] = of_polarisation[q];
            let sum = (a + b) * (a + b);
            ((a - b) * (a - b) / sum, 4.0 * a * b / sum)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::faces::At;
    use super::*;
    use crate::trace::{Coating, Stack, StackLayer};

    fn stack(absorption_per_m: [f64; 3]) -> Stack {
        let layer = |thickness_m, ior| StackLayer { thickness_m, ior, absorption_per_m };
        let coating = Coating::constant([0.3, 0.2, 0.1], [0.7, 0.8, 0.9]);
        Stack::new(
            vec![layer(0.004, 1.52), layer(0.01, 1.0), layer(0.006, 1.7)],
            vec![None, None, Some(coating), None],
        )
    }

    /// Light that enters through face 0 leaves like all light of the stack, and none of clear layers is lost, also at angles at
    /// which it cannot leave the glass.
    #[test]
    fn light_behind_the_first_face_leaves_like_that_of_the_stack() {
        for absorption_per_m in [[0.0; 3], [3.0, 20.0, 80.0]] {
            let stack = stack(absorption_per_m);
            let faces = Faces::parallel(&stack, &[0.0; 4], 1e-6);
            for cos_i in [0.05, 0.3, 0.7, 1.0] {
                let camera = &faces.camera_rays(cos_i, 0, 1)[0];
                let at = At { face: 0, inward: true, cos_i };
                let [entered, reflected] = faces.split(camera, at, [0.0; 2]).map(|(ray, _)| ray);
                let meeting = |reflects| Meeting { face: 0, inward: true, reflects };
                let Escaped { left: [front, back], trapped } =
                    faces.escape(&entered, meeting(false), cos_i);
                let at_once = faces.escape(&reflected, meeting(true), cos_i).left[1];
                let [all_back, all_front] = stack.totals(cos_i);
                for c in 0..3 {
                    assert!((front[c] - all_front[c]).abs() < 1e-12, "{cos_i}");
                    assert!((back[c] + at_once[c] - all_back[c]).abs() < 1e-12, "{cos_i}");
                }
                assert_eq!(trapped, [0.0; 3]);
            }
        }
        let stack = stack([0.0; 3]);
        let faces = Faces::parallel(&stack, &[0.0; 4], 1e-6);
        for cos in [0.02, 0.2, 0.5, 0.74, 0.76, 1.0] {
            for (face, inward, reflects) in [(1, true, true), (0, false, true), (3, true, true)] {
                let meeting = Meeting { face, inward, reflects };
                let escaped = faces.escape(&faces.camera_rays(cos, 0, 1)[0], meeting, 0.8);
                for c in 0..3 {
                    let all = escaped.left[0][c] + escaped.left[1][c];
                    assert!((all - 1.0).abs() < 1e-9, "cosine {cos}, face {face}: {all}");
                }
            }
        }
    }
}
