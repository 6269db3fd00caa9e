//! Renders photographs of public RGB-D data sets, and compares the tuples with lookups in the photographs.

use crate::real_sets::{MOTORCYCLE_DEPTH, Photo, SETS, Set, find_sets, write_motorcycle_depth};
use crate::support::program::{run, text};
use exr::prelude::{ReadChannels, ReadLayers};
use glasshouse_line::layer::Layer;
use render::atomic_file;
use render::merge::TupleRecord;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Side of the film, px.
const FILM: usize = 256;
/// Limit of the linear RMSE between 64 samples per pixel in half floats and a lookup at 16 x 16 positions.
const LOOKUP_RMSE: f64 = 2e-3;

/// Names of a front and a back in [`SETS`], apex, and tilt of the pane, degrees.
type Pair = (&'static str, &'static str, &'static str, [f64; 2]);

/// Pairs with each set at least once in front and once behind.
const PAIRS: [Pair; 10] = [
    ("motorcycle", "basement", "mirror", [0.0, 0.0]),
    ("basement", "kitchen", "camera", [0.0, 0.0]),
    ("kitchen", "chair", "mirror", [0.0, 0.0]),
    ("chair", "office", "camera", [0.0, 0.0]),
    ("office", "road", "mirror", [0.0, 0.0]),
    ("road", "dining", "mirror", [0.0, 0.0]),
    ("dining", "motorcycle", "camera", [0.0, 0.0]),
    ("motorcycle", "road", "camera", [0.0, 0.0]),
    ("dining", "kitchen", "mirror", [10.0, 25.0]),
    ("chair", "motorcycle", "camera", [3.0, -8.0]),
];

#[test]
fn every_layout_renders_and_the_clean_reflection_is_the_photograph() {
    let Some(root) = find_sets() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scenes: Vec<Value> = PAIRS.iter().map(pair_line).collect();
    let tuples = render(&root, folder.path(), &scenes);

    println!(
        "scene                       filled front, back   miss I      T      R~     R      R's RMSE"
    );
    for (pair, scene) in PAIRS.iter().zip(&scenes) {
        let (front, back) = (set(pair.0), set(pair.1));
        let tuple = &tuples[scene["id"].as_str().unwrap()];
        let facts = &tuple.record.facts;
        let lookup = (pair.2 == "mirror").then(|| {
            let (crop, outside) = Photo::open(&root.join(back.color)).crop(back, FILM, true);
            (rmse(tuple.layer("clean_reflection"), &crop), outside)
        });
        println!(
            "{:28}{:6.2} % {:6.2} %   {}  {}",
            tuple.record.scene.id.to_string(),
            facts.filled_share.front * 100.0,
            facts.filled_share.back * 100.0,
            Layer::NAMES.map(|name| format!("{:5.2} %", tuple.miss(name) * 100.0)).join(" "),
            lookup.map_or(String::new(), |(rmse, _)| format!("{rmse:.1e}")),
        );
        tuple.assert_sound();
        // An independent reader of the depth file counts the same holes. No surface of these sets is nearer than the
        // pane.
        assert_eq!(facts.filled_share.front, front.hole_share(&root, folder.path()));
        assert_eq!(facts.filled_share.back, back.hole_share(&root, folder.path()));
        assert_eq!(facts.too_near_share.front + facts.too_near_share.back, 0.0);
        if let Some((rmse, outside)) = lookup {
            assert!(rmse <= LOOKUP_RMSE, "RMSE {rmse:e}");
            let miss = tuple.miss("clean_reflection");
            assert!((miss - outside).abs() < 1e-3, "misses {miss}, outside {outside}");
        }
        // The pane and the lens move the border of the front photograph only slightly.
        let (_, outside) = Photo::open(&root.join(front.color)).crop(front, FILM, false);
        let miss = tuple.miss("transmission");
        assert!((miss - outside).abs() < 0.01, "misses {miss}, outside {outside}");
    }
}

#[test]
fn without_glass_and_lens_the_transmission_is_the_photograph() {
    let Some(root) = find_sets() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scenes: Vec<Value> = SETS
        .iter()
        .map(|set| {
            let mut line = pair_line(&(set.name, set.name, "mirror", [0.0, 0.0]));
            line["camera"]["aperture_radius_m"] = json!(0.0);
            line["glass"] = json!({ "distance_m": 0.3, "thickness_m": 0.0, "ior": 1.0 });
            line
        })
        .collect();
    let tuples = render(&root, folder.path(), &scenes);
    for (set, scene) in SETS.iter().zip(&scenes) {
        let tuple = &tuples[scene["id"].as_str().unwrap()];
        tuple.assert_sound();
        let photo = Photo::open(&root.join(set.color));
        let (crop, outside) = photo.crop(set, FILM, false);
        let rmse = rmse(tuple.layer("transmission"), &crop);
        println!("{:12} T against the photograph: RMSE {rmse:.2e}, {outside:.4} outside", set.name);
        assert!(rmse <= LOOKUP_RMSE, "{}: RMSE {rmse:e}", set.name);
        assert!((tuple.miss("transmission") - outside).abs() < 1e-3);
        assert_eq!(tuple.layer("input"), tuple.layer("transmission"));
        assert!(tuple.layer("glass_reflection").iter().all(|p| *p == [0.0; 3]));
    }
}

fn set(name: &str) -> &'static Set {
    SETS.iter().find(|set| set.name == name).unwrap()
}

/// Makes a scene line of a pair, with the paper's camera and pane.
fn pair_line((front, back, apex, tilt_deg): &Pair) -> Value {
    let mut line = json!({
        "schema": "glasshouse.scene/1",
        "id": format!("{front}-{back}-{apex}{}", if *tilt_deg == [0.0; 2] { "" } else { "-tilt" }),
        "seed": 2020,
        "film": { "width": FILM, "height": FILM, "spp": 64 },
        "camera": { "focal_length_mm": 55.0, "aperture_radius_m": 0.00893, "focus": { "at": "front_center" } },
        "glass": { "distance_m": 0.3, "thickness_m": 0.01, "ior": 1.6, "tilt_deg": tilt_deg },
        "front": set(front).line(),
        "back": set(back).line(),
    });
    line["back"]["apex"] = json!(apex);
    line
}

/// Runs a manifest of the scenes; returns the tuples by id.
fn render(root: &Path, folder: &Path, scenes: &[Value]) -> BTreeMap<String, RealTuple> {
    write_motorcycle_depth(root, &folder.join(MOTORCYCLE_DEPTH));
    let manifest = folder.join("real.jsonl");
    let lines: Vec<String> = scenes.iter().map(Value::to_string).collect();
    atomic_file::write(&manifest, lines.join("\n").as_bytes()).unwrap();
    let out = folder.join("run");
    let root = format!("rgbd={}", root.display());
    let result = run(&["run", text(&manifest), "--json", "--root", &root, "--out", text(&out)])
        .expect(0)
        .json();
    assert_eq!(result["merged"], json!(scenes.len()), "{result}");
    assert_eq!(result["quarantined"], json!([]));
    scenes
        .iter()
        .map(|scene| scene["id"].as_str().unwrap())
        .map(|id| (id.to_owned(), RealTuple::open(&out.join("tuples").join(id))))
        .collect()
}

/// A tuple read from its files.
struct RealTuple {
    record: TupleRecord,
    layers: BTreeMap<&'static str, Vec<[f32; 3]>>,
}

impl RealTuple {
    fn open(folder: &Path) -> Self {
        let record = std::fs::read_to_string(folder.join("tuple.json")).unwrap();
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(folder.join("tuple.exr"))
            .unwrap();
        let channel = |name: &str| -> Vec<f32> {
            let mut list = image.layer_data.channel_data.list.iter();
            let found = list.find(|channel| channel.name.to_string() == name).unwrap();
            found.sample_data.values_as_f32().collect()
        };
        let layer = |name: &str| -> Vec<[f32; 3]> {
            let [r, g, b] = ["R", "G", "B"].map(|colour| channel(&format!("{name}.{colour}")));
            r.into_iter().zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect()
        };
        for name in Layer::NAMES {
            let png = image::open(folder.join(format!("{name}.png"))).unwrap();
            assert_eq!([png.width(), png.height()], [FILM as u32; 2]);
        }
        Self {
            record: serde_json::from_str(&record).unwrap(),
            layers: Layer::NAMES.map(|name| (name, layer(name))).into(),
        }
    }

    fn layer(&self, name: &str) -> &[[f32; 3]] {
        &self.layers[name]
    }

    fn miss(&self, name: &str) -> f64 {
        self.record.layers[name].miss_share
    }

    /// Asserts that no pixel is missing, NaN, infinite, negative or too bright, and that I >= R~ except for rounding.
    fn assert_sound(&self) {
        let id = &self.record.scene.id;
        let most = &self.record.facts.max_radiance;
        let bounds = [most.front + most.back, most.front, most.back, most.back];
        for (name, bound) in Layer::NAMES.into_iter().zip(bounds) {
            let values = self.layer(name).as_flattened();
            assert_eq!(values.len(), FILM * FILM * 3);
            for value in values {
                let inside = (0.0..=bound * 1.0005).contains(&f64::from(*value));
                assert!(inside, "{id} {name}: {value}, bound {bound}");
            }
        }
        let input = self.layer("input").as_flattened();
        let reflection = self.layer("glass_reflection").as_flattened();
        for (input, reflection) in input.iter().zip(reflection) {
            assert!(input - reflection >= -input / 1024.0, "{id}: {input} < {reflection}");
        }
    }
}

fn rmse(image: &[[f32; 3]], reference: &[[f64; 3]]) -> f64 {
    assert_eq!(image.len(), reference.len());
    let pairs = image.as_flattened().iter().zip(reference.as_flattened());
    let sum: f64 = pairs.map(|(a, b)| (f64::from(*a) - b).powi(2)).sum();
    (sum / (image.len() * 3) as f64).sqrt()
}
