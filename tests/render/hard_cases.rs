//! Compares the results of `run manifests/hard-cases.jsonl` with known values, and checks the refused scenes.

use crate::hard_case_measures::{Measured, at_most, checker, farthest, radius_px, ramp, red_sum};
use crate::support::program::{run, text};
use Expected::{AtMost, Checker, RadiusPx, Ramp, RedSum, SameAs, Value};
use glasshouse_line::{SceneLine, parse_jsonl};
use render::formats::decode_exr_channels;
use std::collections::BTreeMap;
use std::path::Path;

/// Expected content of a layer.
enum Expected {
    /// Every pixel has this colour.
    Value([f64; 3]),
    /// Every value is between 0 and this limit.
    AtMost(f64),
    /// Sum of red over all pixels.
    RedSum(f64),
    /// Radius, px, of the disc of a spot in the middle of the front plane, and depth of the plane, m.
    RadiusPx(f64, f64),
    /// `middle + across_per_m X + down_per_m Y` on a plane 2.2 m away.
    Ramp([f64; 3]),
    /// A checkerboard over the film's field of view, with this number of texels per axis.
    Checker(usize),
    /// The pixels of this scene and layer.
    SameAs(&'static str, &'static str),
}

/// Scene, layer, expected content, and largest allowed deviation in the unit of the quantity.
type Check = (&'static str, &'static str, Expected, f64);

const I: &str = "input";
const T: &str = "transmission";
const GLASS: &str = "glass_reflection";
const R: &str = "clean_reflection";

/// Cases of the pane. With planes of one colour, I mixes them by the pane's totals, and T and R equal the colours.
const PANE: &[Check] = &[
    ("constant-planes", I, Value([0.739_325_84, 0.460_674_16, 0.140_449_44]), 1e-6),
    ("constant-planes", T, Value([0.8, 0.4, 0.1]), 3e-8),
    ("constant-planes", GLASS, Value([0.020_224_72, 0.101_123_60, 0.050_561_80]), 1e-6),
    ("constant-planes", R, Value([0.2, 1.0, 0.5]), 3e-8),
    // R~ has only the reflection of the front face, ((n - 1) / (n + 1))^2, and I keeps the ghosts that R~ lacks.
    ("first-reflection", I, Value([0.739_325_84, 0.460_674_16, 0.140_449_44]), 1e-6),
    ("first-reflection", GLASS, Value([0.010_650_888, 0.053_254_438, 0.026_627_219]), 1e-8),
    // The front is red and the back green: red of I is the total transmittance, and green the total reflectance.
    ("angle-30", I, Value([0.896_511_133_4, 0.103_488_866_6, 0.0]), 1e-6),
    ("angle-brewster", I, Value([0.838_911_247_6, 0.161_088_752_4, 0.0]), 1e-6),
    ("angle-80", I, Value([0.448_700_977_8, 0.551_299_022_2, 0.0]), 1e-6),
    // With any relief, white on both sides yields white pixels: only the dropped orders lose light.
    ("white-room", I, Value([1.0; 3]), 2e-4),
    ("white-room", T, Value([1.0; 3]), 0.0),
    ("white-room", R, Value([1.0; 3]), 0.0),
    // Glass with the index of air has no effect.
    ("index-1", I, SameAs("index-1", T), 0.0),
    ("index-1", GLASS, Value([0.0; 3]), 0.0),
    // A pane without thickness bends nothing.
    ("thickness-0", T, SameAs("index-1", T), 1e-6),
    ("thickness-0", GLASS, AtMost(0.11), 0.0),
];

/// Cases of the lens. For every lens, the energy of a light of 1e6, two pixels wide, is 1e6 x (2 px Z / (Z - kappa))^2.
const LENS: &[Check] = &[
    // With aperture 0 and without glass, T and I are the photograph at any focus.
    ("pinhole", I, SameAs("pinhole", T), 0.0),
    ("pinhole-focus", T, SameAs("pinhole", T), 0.0),
    // A lens does not change the mean of a ramp at any focus.
    ("ramp-near", T, Ramp([0.5, 0.2, 0.1]), 4e-5),
    ("ramp-near", R, Ramp([0.5, -0.15, 0.3]), 4e-5),
    // The same ramps, focused at infinity, from EXR files.
    ("ramp-infinity", T, Ramp([0.5, 0.2, 0.1]), 4e-5),
    ("ramp-infinity", R, Ramp([0.5, -0.15, 0.3]), 4e-5),
    // The light is 2 m away, with the focus at 1 m and without glass.
    ("light-near-focus", T, RadiusPx(2.0549, 2.0), 0.01),
    ("light-near-focus", T, RedSum(4.0e6), 1e4),
    // The light is 1 m away, with the focus at 4 m and through the pane; the radius is 3.0823 px without it.
    ("light-through-glass", T, RadiusPx(3.0978, 1.0), 0.01),
    ("light-through-glass", T, RedSum(4.030_17e6), 1e4),
    // The light is 5 m away, with the focus at infinity and without glass.
    ("light-infinity", T, RadiusPx(0.822, 5.0), 0.01),
    ("light-infinity", T, RedSum(4.0e6), 1e4),
    // The light is behind the camera: the disc of each order has the order's share of the light.
    ("light-reflected", GLASS, RedSum(4.021_166e5), 2e3),
    ("light-reflected", R, RedSum(4.0e6), 2e3),
];

const PICTURES: &[Check] = &[
    // One texel per pixel keeps a quarter of the contrast, two yield even grey, and 17 on 12 pixels yield beats.
    ("nyquist", R, Checker(12), 3e-3),
    ("nyquist-2", R, Checker(24), 3e-3),
    ("nyquist-1-4", R, Checker(17), 3e-3),
    ("photograph-1x1", T, Value([0.25, 0.5, 0.75]), 0.0),
    ("photograph-1x1", R, Value([0.75, 0.5, 0.25]), 0.0),
    // A constant depth image of one pixel, row or column has the same effect as a larger one.
    ("photograph-1xn", T, SameAs("plain", T), 1e-6),
    ("photograph-1xn", R, SameAs("plain", R), 1e-6),
    ("film-1x1", T, Value([0.25, 0.5, 0.75]), 0.0),
    ("film-1xn", T, Value([0.25, 0.5, 0.75]), 0.0),
];

const DEPTHS: &[Check] = &[
    ("plain", I, AtMost(1.0), 0.0),
    // NaN, infinite, zero and negative depths are holes; the filled plane equals the plain one.
    ("holes", I, SameAs("plain", I), 1e-6),
    ("holes", T, SameAs("plain", T), 1e-6),
    // Depths from 1 mm to 100 km: from the capture point and without glass, a pinhole renders the photograph.
    ("depth-extremes", T, SameAs("pinhole", T), 1e-6),
    // With lens and glass, values stay within the range of the photograph.
    ("depth-extremes-lens", I, AtMost(1.0), 1e-5),
    ("depth-extremes-lens", T, AtMost(1.0), 0.0),
    ("depth-extremes-lens", GLASS, AtMost(1.0), 0.0),
    ("depth-extremes-lens", R, SameAs("plain", R), 1e-6),
];

/// Scenes that must go into quarantine, and words of the reasons.
const REFUSED: [(&str, &str); 6] = [
    // Beyond 85 degrees, dozens of orders would be visible.
    ("angle-89-9", "85"),
    // The tilted pane is so near that it intersects the lens.
    ("pane-cuts-lens", "lens"),
    // More than 1 % of the depth pixels are nearer than the pane.
    ("too-near", "nearer than the pane"),
    ("no-depth-nan", "check depth_unit_m"),
    ("no-depth-negative", "check depth_unit_m"),
    // The reason names the position of the NaN.
    ("bad-radiance", "column 0, row 0"),
];

/// Pixels by scene and layer.
type Layers = BTreeMap<(String, &'static str), Vec<[f32; 3]>>;

fn read_tuples(run: &Path, lines: &[SceneLine]) -> Layers {
    let mut layers = Layers::new();
    for line in lines {
        let path = run.join("tuples").join(line.id.as_str()).join("tuple.exr");
        let Ok(bytes) = std::fs::read(path) else {
            continue;
        };
        let channels = decode_exr_channels(&bytes).unwrap();
        for name in [I, T, GLASS, R] {
            let pixels = channels.layer(name).unwrap();
            layers.insert((line.id.to_string(), name), pixels);
        }
    }
    layers
}

fn measure(line: &SceneLine, layer: &str, expected: &Expected, all: &Layers) -> Measured {
    let of = |case: &str, layer: &str| {
        let found = all.iter().find(|((id, name), _)| id == case && *name == layer);
        found.unwrap_or_else(|| panic!("no {layer} of {case}")).1
    };
    let pixels = of(line.id.as_str(), layer);
    match expected {
        Value(value) => farthest(pixels, |_, c| Some(value[c])),
        AtMost(most) => at_most(pixels, *most),
        RedSum(sum) => Measured::new(*sum, red_sum(pixels)),
        RadiusPx(radius, depth_m) => Measured::new(*radius, radius_px(line, *depth_m, pixels)),
        Ramp(terms) => farthest(pixels, |q, _| Some(ramp(line, layer == R, *terms, q))),
        Checker(texels) => farthest(pixels, |q, _| checker(line, *texels, q)),
        SameAs(case, layer) => {
            let other = of(case, layer);
            assert_eq!(pixels.len(), other.len());
            farthest(pixels, |q, c| Some(f64::from(other[q][c])))
        }
    }
}

#[test]
fn the_shipped_hard_cases_have_known_values() {
    let folder = tempfile::tempdir().unwrap();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("manifests/hard-cases.jsonl");
    let out = folder.path().join("run");
    let object = run(&["run", text(&file), "--out", text(&out), "--json"]).expect(3).json();
    assert!(out.join("report/index.html").is_file());

    let quarantined = object["quarantined"].as_array().unwrap();
    assert_eq!(quarantined.len(), REFUSED.len(), "{quarantined:?}");
    for (scene, words) in REFUSED {
        let record = quarantined.iter().find(|record| record["scene"] == scene);
        let reason = record.unwrap_or_else(|| panic!("{scene} was rendered"))["reason"].as_str();
        assert!(reason.unwrap().contains(words), "{scene}: {reason:?}");
    }

    let lines = parse_jsonl(&std::fs::read_to_string(&file).unwrap()).unwrap();
    let layers = read_tuples(&out, &lines);
    assert_eq!(layers.len(), 4 * (lines.len() - REFUSED.len()));
    let mut failed = Vec::new();
    for (case, layer, expected, bound) in [PANE, LENS, PICTURES, DEPTHS].into_iter().flatten() {
        let line = lines.iter().find(|line| line.id.as_str() == *case).unwrap();
        let Measured { expected, got, error } = measure(line, layer, expected, &layers);
        println!("{case:20} {layer:16} {expected:>14.7} {got:>14.7} {error:>8.1e} {bound:>8.1e}");
        if error.is_nan() || error > *bound {
            failed
                .push(format!("{case}, {layer}: {got} in place of {expected}, off by {error:.1e}"));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");

    // A second run has no work.
    let again = run(&["run", text(&file), "--out", text(&out), "--json"]);
    assert_eq!(again.expect(3).json()["shards_traced"], 0);
}
