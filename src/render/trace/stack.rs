//! Optics of parallel layers of glass and gaps, such as a double pane, in closed form.
//!
//! All faces are parallel, so light leaves along its own direction d or along d mirrored, whatever it crosses. With unit
//! normal n, c = d.n the cosine of incidence, and layer l of thickness h_l and index n_l (1 for a gap), light that crosses
//! the layers m_l times leaves on the line of the unrefracted (or mirrored) ray, shifted by kappa n:
//!
//! ```text
//! kappa = (H if transmitted) - sum over l of m_l h_l gamma_l,     gamma_l = c / sqrt(n_l^2 - 1 + c^2),     H = sum of h_l
//! ```
//!
//! (see [`super::slab`], the case of one layer). An *order* is the light with one kappa: the sum over all paths that cross
//! the same length of each medium. Its weight is the sum over these paths of the product of the reflectance or transmittance
//! of each face that it meets and of exp(-a h_l / cos_l) for each passage; s and p are kept apart to the end. A coating
//! replaces the Fresnel factors of its face.
//!
//! The weights of all orders follow from one breadth-first search: light that is at the same face, has the same direction and
//! has crossed the same lengths is one state, so the number of states grows with a power of the number of reflections, not exponentially.
//! That power is the number of different media, so the search of a film is also bounded ([`search`]).

use search::{Bounds, search};
use std::collections::BTreeMap;

/// Femtometres per metre.
const FM_PER_M: f64 = 1.0e15;

/// A layer of a stack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StackLayer {
    pub thickness_m: f64,
    /// Index of refraction against air, at least 1; 1 for a gap.
    pub ior: f64,
    /// Absorption coefficient of red, green, blue, per metre; 0 for a gap.
    pub absorption_per_m: [f64; 3],
}

/// Parallel layers of glass and gaps, from the camera outwards. Face i lies before layer i, and the last face behind all.
#[derive(Clone, Debug, PartialEq)]
pub struct Stack {
    layers: Vec<StackLayer>,
    coatings: Vec<Option<Coating>>,
    /// Indices of the media, each once.
    media: Vec<f64>,
}

/// The side of a stack on which light leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Exit {
    /// To the front scene.
    Transmitted,
    /// To the back scene.
    Reflected,
}

/// Light that leaves a stack on one line: the side, and the length of the layers of each medium that it crossed.
///
/// Lengths are whole femtometres, so that equal sums are equal in every order of the layers.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct StackOrder {
    pub exit: Exit,
    lengths_fm: Vec<i64>,
}

/// A number for s and p (outer) and for red, green and blue.
type Power = [[f64; 3]; 2];

/// Reflectance of a face from the camera's side and from the other, and its transmittance.
#[derive(Clone, Copy)]
struct Face {
    r: Power,
    r_back: Power,
    t: Power,
}

impl Face {
    /// Returns the reflectance for light that travels away from the camera (`inward`) or towards it.
    fn reflected(&self, inward: bool) -> &Power {
        if inward { &self.r } else { &self.r_back }
    }
}

/// Properties of faces and layers at one cosine of incidence.
struct Optics {
    faces: Vec<Face>,
    /// Share of light that remains after one passage through each layer.
    tau: Vec<[f64; 3]>,
}

impl Stack {
    /// Makes a stack of one or more layers. `coatings` holds one entry for each face, so it is one longer than `layers`.
    ///
    /// Panics if there is no layer, or if the numbers of layers and faces do not match.
    pub fn new(layers: Vec<StackLayer>, coatings: Vec<Option<Coating>>) -> Self {
        assert!(!layers.is_empty(), "a stack has layers");
        assert!(coatings.len() == layers.len() + 1, "a stack has one more face than layers");
        let mut media: Vec<f64> = vec![];
        for layer in &layers {
            if !media.contains(&layer.ior) {
                media.push(layer.ior);
            }
        }
        Self { layers, coatings, media }
    }

    /// Returns the layers, from the camera outwards.
    pub fn layers(&self) -> &[StackLayer] {
        &self.layers
    }

    /// Returns the coating of each face.
    pub fn coatings(&self) -> &[Option<Coating>] {
        &self.coatings
    }

    /// Returns the thickness of all layers together, m.
    pub fn thickness_m(&self) -> f64 {
        self.layers.iter().map(|layer| layer.thickness_m).sum()
    }

    /// Returns the order of the light that crosses each layer once.
    pub fn straight(&self) -> StackOrder {
        let mut lengths_fm = vec![0; self.media.len()];
        self.layers.iter().for_each(|layer| self.cross(layer, &mut lengths_fm));
        StackOrder { exit: Exit::Transmitted, lengths_fm }
    }

    /// Returns the lengths of each medium that light of an order crosses: pairs of index and length, m.
    pub fn crossed(&self, order: &StackOrder) -> Vec<(f64, f64)> {
        let lengths = self.media.iter().zip(&order.lengths_fm);
        lengths.map(|(&ior, &fm)| (ior, fm as f64 / FM_PER_M)).collect()
    }

    /// Returns the indices of refraction before and behind a face, from the camera outwards.
    pub fn iors(&self, face: usize) -> [f64; 2] {
        [face.checked_sub(1), Some(face)]
            .map(|layer| layer.and_then(|l| self.layers.get(l)).map_or(1.0, |layer| layer.ior))
    }

    /// Returns the distance of a face from face 0, m.
    pub fn depth_m(&self, face: usize) -> f64 {
        self.layers[..face].iter().map(|layer| layer.thickness_m).sum()
    }

    /// Returns the largest index of refraction.
    pub fn largest_ior(&self) -> f64 {
        self.media.iter().copied().fold(1.0, f64::max)
    }

    /// True if colours differ: glass that absorbs, or a coating with different shares.
    pub fn is_coloured(&self) -> bool {
        let differs = |of: &[f64; 3]| of[0] != of[1] || of[1] != of[2];
        self.layers.iter().any(|layer| differs(&layer.absorption_per_m))
            || self.coatings.iter().flatten().any(Coating::is_coloured)
    }

    /// Returns the shift of an order's line along the normal at cosine of incidence `cos_i` in (0, 1], m.
    pub fn kappa_m(&self, order: &StackOrder, cos_i: f64) -> f64 {
        let thickness_m = match order.exit {
            Exit::Transmitted => self.thickness_m(),
            Exit::Reflected => 0.0,
        };
        shift_m(thickness_m, &self.crossed(order), cos_i)
    }

    /// Computes the weights of all orders for unpolarised light, for each colour, at each of `cosines` of incidence, in
    /// (0, 1]. Drops states that have less than the share `least` of the incident light at all cosines, and paths that cross more
    /// than `most` layers.
    pub fn weights(
        &self,
        cosines: &[f64],
        least: f64,
        most: usize,
    ) -> BTreeMap<StackOrder, Vec<[f64; 3]>> {
        let bounds = Bounds { least, most_passages: most, most_states: usize::MAX };
        search(self, cosines, &bounds).weights
    }

    /// Computes the sums of the weights of all reflected and of all transmitted orders, for each colour, by adding one face
    /// after the other, beginning with the last.
    pub fn totals(&self, cos_i: f64) -> [[f64; 3]; 2] {
        let Optics { faces, tau } = self.optics(cos_i);
        let Face { r: mut reflected, t: mut transmitted, .. } = faces[self.layers.len()];
        for face in (0..self.layers.len()).rev() {
            let Face { r, r_back, t } = faces[face];
            for q in 0..2 {
                for c in 0..3 {
                    let square = tau[face][c] * tau[face][c];
                    let rounds = 1.0 - r_back[q][c] * square * reflected[q][c];
                    transmitted[q][c] *= t[q][c] * tau[face][c] / rounds;
                    reflected[q][c] =
                        r[q][c] + t[q][c] * t[q][c] * square * reflected[q][c] / rounds;
                }
            }
        }
        [reflected, transmitted].map(|[s, p]| [0, 1, 2].map(|c| 0.5 * (s[c] + p[c])))
    }

    /// Adds the thickness of a layer to the lengths that light has crossed.
    fn cross(&self, layer: &StackLayer, lengths_fm: &mut [i64]) {
        let medium = self.media.iter().position(|ior| *ior == layer.ior);
        lengths_fm[medium.expect("each layer has a medium")] +=
            (layer.thickness_m * FM_PER_M).round() as i64;
    }

    /// Computes the properties of faces and layers.
    fn optics(&self, cos_i: f64) -> Optics {
        Optics { faces: self.faces(cos_i), tau: self.tau(cos_i) }
    }

    /// Computes reflectance and transmittance of each face.
    fn faces(&self, cos_i: f64) -> Vec<Face> {
        let of = |(face, coating): (usize, &Option<Coating>)| {
            let Some(coating) = coating else {
                let (r, t) = fresnel(self.iors(face), cos_i);
                return Face { r, r_back: r, t };
            };
            Face {
                r: [coating.reflectance.at(cos_i); 2],
                r_back: [coating.reflectance_back.at(cos_i); 2],
                t: [coating.transmittance.at(cos_i); 2],
            }
        };
        self.coatings.iter().enumerate().map(of).collect()
    }

    /// Computes the share of light that remains after one passage through each layer.
    fn tau(&self, cos_i: f64) -> Vec<[f64; 3]> {
        let of = |layer: &StackLayer| {
            let length_m = layer.thickness_m / cos_in(layer.ior, cos_i);
            layer.absorption_per_m.map(|a| libm::exp(-a * length_m))
        };
        self.layers.iter().map(of).collect()
    }
}

/// Returns the shift of the line of light that crosses the lengths `crossed_m` of media (pairs of index and length), m.
/// `thickness_m` is that of all layers for transmitted, and 0 for reflected light.
pub(super) fn shift_m(thickness_m: f64, crossed: &[(f64, f64)], cos_i: f64) -> f64 {
    thickness_m - crossed.iter().map(|(ior, length_m)| length_m * gamma(*ior, cos_i)).sum::<f64>()
}

/// Returns n cos of the ray's angle in a medium of index n.
fn depth_part(ior: f64, cos_i: f64) -> f64 {
    (ior * ior - 1.0 + cos_i * cos_i).sqrt()
}

/// Returns the cosine of the ray's angle in a medium.
fn cos_in(ior: f64, cos_i: f64) -> f64 {
    depth_part(ior, cos_i) / ior
}

fn gamma(ior: f64, cos_i: f64) -> f64 {
    cos_i / depth_part(ior, cos_i)
}

/// Computes reflectance and transmittance of the face between media of the indices n_1 and n_2, without cancellation:
/// with a = n_1 cos_1 and b = n_2 cos_2, R_s = ((a - b) / (a + b))^2, and R_p is the same with a / n_1^2 and b / n_2^2 (Hecht,
/// *Optics*, 5th ed., eq. 4.34 and 4.40).
fn fresnel([before, behind]: [f64; 2], cos_i: f64) -> (Power, Power) {
    let part = |ior: f64| depth_part(ior, cos_i);
    let of = |a: f64, b: f64| {
        let sum = (a + b) * (a + b);
        [(a - b) * (a - b) / sum, 4.0 * a * b / sum]
    };
    let s = of(part(before), part(behind));
    let p = of(part(before) / (before * before), part(behind) / (behind * behind));
    let all = |k: usize| [[s[k]; 3], [p[k]; 3]];
    (all(0), all(1))
}

fn product(a: &Power, b: &Power) -> Power {
    [0, 1].map(|q| [0, 1, 2].map(|c| a[q][c] * b[q][c]))
}

mod coating;
mod paths;
mod search;
mod select;
mod table;

pub use coating::Coating;
pub use table::{StackOptics, StackTable};

#[cfg(test)]
mod tests;
