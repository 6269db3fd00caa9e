//! Numbers on the card, such as ranges of parameters and stated errors, combined part by part in a fixed order.

use glasshouse_line::Side;
use render::merge::TupleRecord;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Name and accessor of a scene parameter.
type Parameter = (&'static str, fn(&TupleRecord) -> f64);

/// Parameters on the card, in order.
pub(super) const PARAMETERS: [Parameter; 13] = [
    ("film width, px", |r| r.scene.film.width.into()),
    ("film height, px", |r| r.scene.film.height.into()),
    ("samples a pixel", |r| r.scene.film.spp.into()),
    ("focal length, mm (of a 36 x 24 mm frame)", |r| r.scene.camera.focal_length_mm),
    ("aperture radius, m", |r| r.scene.camera.aperture_radius_m),
    ("glass: distance, m", |r| r.scene.glass.distance_m),
    ("glass: thickness, m", |r| r.scene.glass.total_thickness_m()),
    ("glass: index of refraction", |r| r.scene.glass.first_glass().0),
    ("glass: absorption of red, 1/m", |r| r.scene.glass.first_glass().1[0]),
    ("glass: absorption of green, 1/m", |r| r.scene.glass.first_glass().1[1]),
    ("glass: absorption of blue, 1/m", |r| r.scene.glass.first_glass().1[2]),
    ("glass: pitch, degrees", |r| r.scene.glass.tilt_deg[0]),
    ("glass: yaw, degrees", |r| r.scene.glass.tilt_deg[1]),
];

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Numbers {
    pub(super) tuples: u64,
    /// Least and largest value of each of [`PARAMETERS`]; empty without tuples.
    pub(super) ranges: Vec<[f64; 2]>,
    pub(super) layers: BTreeMap<String, LayerNumbers>,
    /// Number of scene sides, by the named root of their files; files without a root have the key "".
    pub(super) roots: BTreeMap<String, u64>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LayerNumbers {
    /// Number of tuples with this layer.
    pub(super) images: u64,
    /// Number of tuples that state the error of this layer.
    pub(super) stated: u64,
    /// Stated RMS errors, linear.
    pub(super) error: SumAndMax,
    /// Shares of values above 1.
    pub(super) clipped: SumAndMax,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SumAndMax {
    pub(super) sum: f64,
    pub(super) max: f64,
}

impl SumAndMax {
    fn add(&mut self, other: Self) {
        self.sum += other.sum;
        self.max = self.max.max(other.max);
    }

    fn of(value: f64) -> Self {
        Self { sum: value, max: value }
    }
}

impl Numbers {
    pub(super) fn of(record: &TupleRecord) -> Self {
        let layers = record.layers.iter().map(|(name, layer)| {
            let numbers = LayerNumbers {
                images: 1,
                stated: layer.error_rms.is_some().into(),
                error: SumAndMax::of(layer.error_rms.unwrap_or(0.0)),
                clipped: SumAndMax::of(layer.clipped_share),
            };
            (name.clone(), numbers)
        });
        let mut roots = BTreeMap::new();
        for side in [&record.scene.front, &record.scene.back] {
            *roots.entry(root_of(side)).or_insert(0) += 1;
        }
        Self {
            tuples: 1,
            ranges: PARAMETERS.map(|(_, of)| [of(record); 2]).into(),
            layers: layers.collect(),
            roots,
        }
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.tuples += other.tuples;
        if self.ranges.is_empty() {
            self.ranges.clone_from(&other.ranges);
        }
        for (range, [least, largest]) in self.ranges.iter_mut().zip(&other.ranges) {
            *range = [range[0].min(*least), range[1].max(*largest)];
        }
        for (name, layer) in &other.layers {
            let sum = self.layers.entry(name.clone()).or_default();
            sum.images += layer.images;
            sum.stated += layer.stated;
            sum.error.add(layer.error);
            sum.clipped.add(layer.clipped);
        }
        for (root, sides) in &other.roots {
            *self.roots.entry(root.clone()).or_insert(0) += sides;
        }
    }
}

/// Returns the named root of a side's file, or an empty string without one.
fn root_of(side: &Side) -> String {
    let root = side.name().split_once(':').map(|(root, _)| root);
    root.unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_grow_and_sums_add_up() {
        let one = |value: f64| {
            let layer = LayerNumbers {
                images: 1,
                stated: 1,
                error: SumAndMax::of(value),
                clipped: SumAndMax::of(0.0),
            };
            Numbers {
                tuples: 1,
                ranges: vec![[value; 2]],
                layers: [("input".to_owned(), layer)].into(),
                roots: [("diode".to_owned(), 2)].into(),
            }
        };
        let mut all = Numbers::default();
        for value in [2.0, 1.0, 4.0] {
            all.add(&one(value));
        }
        assert_eq!((all.tuples, all.ranges.clone()), (3, vec![[1.0, 4.0]]));
        let layer = &all.layers["input"];
        assert_eq!([layer.error.sum, layer.error.max], [7.0, 4.0]);
        assert_eq!(all.roots["diode"], 6);
    }
}
