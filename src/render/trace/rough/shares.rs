//! The mean shares of light at a meeting with a rough face, over all its facets.
//!
//! The facets of a few rays would miss the rare ones that hide the most light, or that let light out that others reflect totally.

use super::faces::{At, Faces, Ray};
use super::facet::Face;
use glam::DVec3;

/// Nodes of the cosine, at equal steps of its square root: hardly any light gets lost far from grazing.
const STEPS: usize = 128;
/// Slopes of facets along the plane of incidence and across it, in units of alpha: at these steps, up to `MOST_SLOPE` on both sides.
const ALONG: f64 = 0.3;
const ACROSS: f64 = 0.6;
const MOST_SLOPE: f64 = 3.6;
/// Number of slopes on each side of the edge of total reflection.
const AT_EDGE: i32 = 8;

/// Mean shares for s and p of light that passes a face, that facets reflect in part, and that they reflect totally. For a coated face, the
/// shares of the facets at which it does so.
#[derive(Clone, Copy)]
struct Shares {
    kept: [[f64; 2]; 3],
    /// What facets hide, and what leaves on the wrong side.
    lost: [[f64; 2]; 3],
}

impl Shares {
    const NONE: Self = Self { kept: [[0.0; 2]; 3], lost: [[0.0; 2]; 3] };

    fn zip(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let of = |a: &[[f64; 2]; 3], b: &[[f64; 2]; 3]| {
            [0, 1, 2].map(|kind| [0, 1].map(|q| f(a[kind][q], b[kind][q])))
        };
        Self { kept: of(&self.kept, &other.kept), lost: of(&self.lost, &other.lost) }
    }
}

/// Mean shares of faces.
#[derive(Default)]
pub(super) struct MeanShares {
    known: Vec<OfFace>,
}

/// A face, whether it is coated, and its shares at the nodes that are known.
struct OfFace {
    of: (Face, bool),
    nodes: Vec<Option<Shares>>,
}

impl MeanShares {
    /// Splits a ray at a facet, as [`Faces::split`]. Returns the ray behind each branch with the mean weights of such rays over all facets,
    /// and the mean light that gets lost; all light if the ray does not reach the face.
    pub(super) fn split(
        &mut self,
        faces: &Faces<'_>,
        ray: &Ray,
        at: At,
        facet: [f64; 2],
    ) -> ([(Ray, [f64; 3]); 2], [f64; 3]) {
        let Some(d) = faces.meet(ray, at) else {
            return ([(ray.dark(), [0.0; 3]); 2], ray.weights());
        };
        let coating = faces.coating(at);
        let Shares { kept, lost } = self.at((faces.face(at), coating.is_some()), d.z);
        let coating = coating.unwrap_or([[1.0; 3]; 3]);
        let weights = |shares: &[[f64; 2]; 3], kinds: std::ops::Range<usize>| {
            let of = |c: usize, kind: usize| {
                let [s, p] = [0, 1].map(|q| ray.power[q][c] * shares[kind][q]);
                0.5 * (s + p) * coating[kind][c]
            };
            [0, 1, 2].map(|c| kinds.clone().map(|kind| of(c, kind)).sum::<f64>())
        };
        let mut kinds = [0..1, 1..3].into_iter();
        let branches = faces.split(ray, at, facet).map(|(behind, tau)| {
            let mean = weights(&kept, kinds.next().unwrap_or_default());
            (behind, [0, 1, 2].map(|c| mean[c] * tau[c]))
        });
        (branches, weights(&lost, 0..3))
    }

    /// Returns the mean shares of light with this cosine to the normal of a face. Between nodes, a straight line is above the loss where
    /// this is convex: everywhere but at the edge of total reflection, where it is of the order of alpha^2.
    fn at(&mut self, of: (Face, bool), cos: f64) -> Shares {
        let cos = cos.abs().min(1.0);
        if of.0.alpha == 0.0 {
            return of_facets(of, ray_at(cos), &[([0.0; 2], 1.0)]);
        }
        let index = self.known.iter().position(|known| known.of == of).unwrap_or_else(|| {
            self.known.push(OfFace { of, nodes: vec![None; STEPS + 1] });
            self.known.len() - 1
        });
        let nodes = &mut self.known[index].nodes;
        let position = cos.sqrt() * STEPS as f64;
        let first = (position as usize).min(STEPS - 1);
        let [a, b] = [first, first + 1].map(|node| {
            *nodes[node].get_or_insert_with(|| {
                let root = node as f64 / STEPS as f64;
                let d = ray_at((root * root).max(of.0.least_cos));
                of_facets(of, d, &all_facets(&of.0, d))
            })
        });
        let t = position - first as f64;
        a.zip(&b, |a, b| a + (b - a) * t)
    }
}

/// Returns a direction with this cosine to the normal of a face.
fn ray_at(cos: f64) -> DVec3 {
    DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos)
}

/// Returns the slopes of facets in units of alpha, and the weights, of an integral over all facets that light with the direction `d` meets.
fn all_facets(face: &Face, d: DVec3) -> Vec<([f64; 2], f64)> {
    let steps = |step: f64| (MOST_SLOPE / step).round() as i32;
    let mut facets = vec![];
    // Both halves across are mirror images.
    for j in 0..steps(ACROSS) {
        let y = (f64::from(j) + 0.5) * ACROSS;
        let is_total = |x: f64| face.split(d, [x, y])[1].is_total;
        let mut along = vec![-MOST_SLOPE];
        for i in -steps(ALONG)..steps(ALONG) {
            let [from, to] = [i, i + 1].map(|i| f64::from(i) * ALONG);
            let reflects = is_total(from);
            if reflects != is_total(to) {
                along.extend(around_edge([from, to], |x| is_total(x) == reflects));
            }
            along.push(to);
        }
        along.sort_by(f64::total_cmp);
        for (i, x) in along.iter().enumerate() {
            let [before, behind] =
                [along[i.saturating_sub(1)], along[(i + 1).min(along.len() - 1)]];
            facets.push(([*x, y], (behind - before) * libm::exp(-x * x - y * y)));
        }
    }
    let all: f64 = facets.iter().map(|(_, weight)| weight).sum();
    facets.into_iter().map(|(facet, weight)| (facet, weight / all)).collect()
}

/// Returns slopes on both sides of the one at which total reflection begins, between these two, the closer to it the denser: light that
/// just passes such a facet leaves along the face, where most of it gets lost.
fn around_edge([from, to]: [f64; 2], is_before: impl Fn(f64) -> bool) -> Vec<f64> {
    let (mut before, mut behind) = (from, to);
    for _ in 0..30 {
        let middle = 0.5 * (before + behind);
        if is_before(middle) { before = middle } else { behind = middle }
    }
    let at = |k: i32| f64::from(k * k) / f64::from(AT_EDGE * AT_EDGE) * ALONG;
    (0..=AT_EDGE).flat_map(|k| [before - at(k), behind + at(k)]).collect()
}

/// Computes the mean shares over facets.
fn of_facets((face, is_coated): (Face, bool), d: DVec3, facets: &[([f64; 2], f64)]) -> Shares {
    let mut sums = Shares::NONE;
    for (facet, weight) in facets {
        for (branch, of) in face.split(d, *facet).iter().enumerate() {
            let Some(kind) = of.kind(branch == 1) else { continue };
            for q in 0..2 {
                let met = weight * if is_coated { 1.0 } else { of.fresnel[q] };
                sums.kept[kind][q] += met * of.passes;
                sums.lost[kind][q] += met * (1.0 - of.passes);
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::rough::facet::facet_at;
    use crate::trace::sampler::{PixelSeed, sample};

    /// No light is missing, and the shares are the means over facets that light draws.
    #[test]
    fn shares_are_means_over_drawn_facets() {
        for (iors, alpha) in [([1.0, 1.5], 0.1), ([1.5, 1.0], 0.02), ([1.6, 1.0], 0.1)] {
            let face = Face { alpha, iors, least_cos: 1e-4 };
            let mut shares = MeanShares::default();
            for cos in [0.03, 0.1, 0.3, 0.74, 0.77, 1.0] {
                let found = shares.at((face, false), cos);
                let sum = |of: &[[f64; 2]; 3], q: usize| of.iter().map(|kind| kind[q]).sum::<f64>();
                let d = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                let (mut drawn, count) = ([0.0; 2], 4096);
                for index in 0..count {
                    let [u, v, ..] = sample(&PixelSeed::new(1, 2, 3), index);
                    for of in face.split(d, facet_at([u, v])) {
                        (0..2).for_each(|q| drawn[q] += of.fresnel[q] * (1.0 - of.passes));
                    }
                }
                for q in 0..2 {
                    let [kept, lost] = [&found.kept, &found.lost].map(|of| sum(of, q));
                    assert!((kept + lost - 1.0).abs() < 1e-9, "{alpha} {cos}: {kept} {lost}");
                    let drawn = drawn[q] / f64::from(count);
                    assert!(
                        (lost - drawn).abs() < 0.05 * drawn + 2e-4,
                        "{alpha} {cos}: {lost} {drawn}"
                    );
                }
            }
        }
    }
}
