//! Compares the stated errors of tuples with their differences from a reference of 8,192 samples.

use glasshouse_line::layer::Layer;
use glasshouse_line::{Roots, parse_scene};
use render::Loaded;
use render::merge::Tuple;
use render::trace::Isa;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Renders a scene of two procedural photographs of this size, given the keys of its sides.
pub(crate) fn render_example(
    folder: &Path,
    size: [u32; 2],
    scene: impl FnOnce([String; 2]) -> String,
) -> Tuple {
    let [width, height] = size;
    let photographs = procedural::listing(2, 7);
    let sides = [0, 1].map(|index: usize| {
        let p = &photographs[index];
        if !folder.join(p.color_path()).is_file() {
            procedural::write(folder, p, width, height).unwrap();
        }
        let intrinsics = serde_json::to_string(&procedural::intrinsics(width, height)).unwrap();
        format!(
            r#""color":"{}","depth":"{}","mask":"{}","intrinsics":{intrinsics}"#,
            p.color_path().display(),
            p.depth_path().display(),
            p.mask_path().display()
        )
    });
    let line = parse_scene(&scene(sides)).unwrap();
    let loaded = Loaded::read(line, &Roots::default(), folder).unwrap();
    loaded.tuple(32, Isa::detect(), &AtomicBool::new(false), &|| {}).unwrap().unwrap()
}

fn render(folder: &Path, apex: &str, spp: u32, seed: u64) -> Tuple {
    render_example(folder, [256, 192], |[front, back]| {
        format!(
            r#"{{"schema":"glasshouse.scene/1","id":"estimate","seed":{seed},
                "film":{{"width":64,"height":64,"spp":{spp}}},
                "camera":{{"focal_length_mm":55.0,"aperture_radius_m":0.02,"focus":{{"distance_m":3.0}}}},
                "glass":{{"distance_m":0.3,"thickness_m":0.01,"ior":1.6}},
                "front":{{{front}}},"back":{{{back},"apex":"{apex}"}}}}"#
        )
    })
}

#[test]
fn stated_errors_are_close_to_true_errors() {
    let folder = tempfile::tempdir().unwrap();
    // 64 and 256 samples are one range, and 1,024 are several.
    for (apex, spp) in [("mirror", 64), ("mirror", 1024), ("camera", 256), ("camera", 1024)] {
        let reference = render(folder.path(), apex, 8192, 1);
        let tuple = render(folder.path(), apex, spp, 2);
        for layer in Layer::ALL {
            let name = layer.name();
            let (a, b) =
                (tuple.layers[layer].as_flattened(), reference.layers[layer].as_flattened());
            let square = |(a, b): (&f32, &f32)| f64::from(a - b) * f64::from(a - b);
            let error = (a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64).sqrt();
            let stated = tuple.record.layers[name].error_rms.unwrap();
            println!("apex {apex}, {spp} samples, {name}: true {error:.2e}, stated {stated:.2e}");
            if apex == "mirror" && layer == Layer::CleanReflection {
                // In closed form, all seeds have the same bits.
                assert_eq!((stated, error), (0.0, 0.0));
                continue;
            }
            let ratio = stated / error;
            if layer == Layer::CleanReflection {
                // Edges without a lens converge faster than the estimate assumes, so it is too large.
                assert!(
                    (0.9..1.8).contains(&ratio),
                    "{apex} {spp}: stated {stated:e}, true {error:e}"
                );
                continue;
            }
            assert!((0.8..1.2).contains(&ratio), "{spp} {name}: stated {stated:e}, true {error:e}");
        }
    }
}
