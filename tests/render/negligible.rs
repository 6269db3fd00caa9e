//! Features of a pane around the movement of a line below which they are off.

use crate::estimate::render_example;
use glasshouse_line::layer::Layer;
use render::merge::Tuple;
use std::path::Path;

/// Movement below which a feature is off, px.
const LEAST_PX: f64 = 1.0e-3;

/// Makes the keys of a pane with this value of a feature.
type Glass = fn(f64) -> String;

/// A pane of one layer.
const PLAIN: &str = r#""thickness_m":0.006,"ior":1.52"#;

/// Returns a double pane, with these keys in its gap.
fn double(gap: &str) -> String {
    let glass = r#"{"glass_m":0.004,"ior":1.52}"#;
    format!(r#""layers":[{glass},{{"gap_m":0.012{gap}}},{glass}]"#)
}

fn render(folder: &Path, glass: &str) -> Tuple {
    render_example(folder, [64, 48], |[front, back]| {
        format!(
            r#"{{"schema":"glasshouse.scene/1","id":"negligible","seed":5,
                "film":{{"width":48,"height":32,"spp":64}},
                "camera":{{"focal_length_mm":55.0,"aperture_radius_m":0.005,"focus":{{"distance_m":3.0}}}},
                "glass":{{"distance_m":0.3,"tilt_deg":[8,25],{glass}}},
                "front":{{{front}}},"back":{{{back}}}}}"#
        )
    })
}

#[test]
fn tiny_features_are_off_and_the_next_larger_hardly_show() {
    let folder = tempfile::tempdir().unwrap();
    let features: [(&str, Glass); 5] = [
        ("roughness", |v| format!(r#"{PLAIN},"roughness":{v:e}"#)),
        ("roughness", |v| format!(r#"{},"roughness":{v:e}"#, double(""))),
        ("wave", |v| {
            let wave = format!(r#"{{"amplitude_m":{v:e},"length_m":0.3,"direction_deg":20}}"#);
            format!(r#"{PLAIN},"wave":{wave}"#)
        }),
        ("wedge", |v| double(&format!(r#","wedge_deg":[{v:e},{v:e}]"#))),
        // A bend is tiny if its radius is large.
        ("bow", |v| format!(r#"{PLAIN},"bow_radius_m":{:e}"#, 1.0 / v)),
    ];
    for (name, glass) in features {
        let stated = |tuple: &Tuple| {
            let negligible = tuple.record.facts.negligible;
            let of = [
                ("roughness", negligible.roughness),
                ("wave", negligible.wave),
                ("wedge", negligible.wedge),
                ("bow", negligible.bow),
            ];
            of.into_iter().find(|(of, _)| *of == name).and_then(|(_, px)| px)
        };
        let tiny = 1.0e-10;
        let at_tiny_px = stated(&render(folder.path(), &glass(tiny))).unwrap();
        let of_px = |px: f64| render(folder.path(), &glass(tiny * px / at_tiny_px));
        let is_double = glass(tiny).contains("layers");
        let without = render(folder.path(), &if is_double { double("") } else { PLAIN.to_owned() });
        let (half, twice) = (of_px(0.5 * LEAST_PX), of_px(2.0 * LEAST_PX));
        assert!((stated(&half).unwrap() / (0.5 * LEAST_PX) - 1.0).abs() < 1e-3);
        assert_eq!(stated(&twice), None);
        let facts = &twice.record.facts;
        // A photograph's texel is larger than a pixel, so lines that move by a pixel change by less than the radiance.
        let radiance = facts.max_radiance.front.max(facts.max_radiance.back);
        let moved = 2.0 * LEAST_PX * radiance;
        let misplaced = facts.dropped.front + facts.dropped.back + facts.shadowed;
        let mut largest = 0.0f64;
        for layer in Layer::ALL {
            let of = |tuple: &Tuple| tuple.layers[layer].as_flattened().to_vec();
            let (without, half, twice) = (of(&without), of(&half), of(&twice));
            assert!(without == half, "{name}: {} differs", layer.name());
            for (a, b) in without.iter().zip(&twice) {
                largest = largest.max(f64::from((a - b).abs()));
            }
        }
        println!(
            "{name}: on differs by {largest:.1e}; moved light {moved:.1e}, misplaced {misplaced:.1e}"
        );
        assert!(largest <= moved + misplaced, "{name}");
        assert!(largest > 0.0, "{name} is off");
    }
}
