//! Noise maps add up to the stated errors, and only the report depends on them.

use crate::report::{LAYERS, finished, report};
use crate::support::markup::{all, strictly};
use crate::support::outputs::{exr_channels, files, tuple_record};
use crate::support::program::{run, text};
use crate::support::scenes::SCENES;
use serde_json::json;

#[test]
fn noise_maps_add_up_to_the_stated_errors() {
    let folder = finished();
    let folder = folder.path();
    let maps = files(&folder.join("noise"));
    assert_eq!(maps.len(), SCENES);
    for map in &maps {
        let record = tuple_record(folder, map.file_stem().unwrap().to_str().unwrap());
        let channels = exr_channels(&folder.join("noise").join(map));
        let names: Vec<&String> = channels.keys().collect();
        // R, the last layer, is in closed form.
        let mut expected = [LAYERS[0], LAYERS[1], LAYERS[2]];
        expected.sort_unstable();
        assert_eq!(names, expected);
        for (name, (kind, bits)) in channels {
            assert_eq!((kind, bits.len()), ("half", 48 * 32));
            let value = |bits: u32| f64::from(exr::prelude::f16::from_bits(bits as u16).to_f32());
            let sum: f64 = bits.iter().map(|&b| value(b).powi(2)).sum();
            let rms = (sum / (48.0 * 32.0)).sqrt();
            let stated = record["layers"][&name]["error_rms"].as_f64().unwrap();
            assert!((rms / stated - 1.0).abs() < 0.01, "{name}: {rms} {stated}");
        }
    }

    // The report leaves out missing and damaged maps, and a run without maps and logs is still complete.
    let first = folder.join("noise").join(&maps[0]);
    std::fs::write(&first, b"no picture").unwrap();
    std::fs::remove_file(folder.join("noise").join(&maps[1])).unwrap();
    let (page, said) = report(folder, 0, &[]);
    assert_eq!(said["noise_maps"], SCENES - 2);
    assert_eq!(page.matches("Its noise map cannot be read").count(), 1);
    assert_eq!(page.matches("It has no noise map").count(), 1);
    std::fs::remove_dir_all(folder.join("noise")).unwrap();
    std::fs::remove_dir_all(folder.join("logs")).unwrap();
    let (page, said) = report(folder, 0, &[]);
    assert_eq!((&said["noise_maps"], &said["logs"]), (&json!(0), &json!(0)));
    assert_eq!(page.matches("It has no noise map").count(), SCENES);
    assert!(page.contains("No worker has left its log yet"));
    let again = run(&["work", text(folder), "--json"]).expect(0).json();
    assert_eq!(again["already_merged"], SCENES);
    assert!(!folder.join("logs").exists(), "an idle worker writes no log");
}

#[test]
fn a_repeated_scene_has_the_same_map() {
    let folder = finished();
    let folder = folder.path();
    let map = folder.join("noise/train-sample-000001.exr");
    let before = std::fs::read(&map).unwrap();
    run(&["retry", text(folder), "train-sample-000001", "--anew"]).expect(0);
    assert!(!map.exists());
    run(&["work", text(folder), "-j", "1"]).expect(0);
    assert_eq!(std::fs::read(&map).unwrap(), before);
    assert_eq!(files(&folder.join("logs")).len(), 2);
    // One scene was traced twice, so the sum of the logs is not its cost, and the plot leaves it out.
    let (page, _) = report(folder, 0, &[]);
    assert_eq!(all(&strictly(&page), "#errors circle").len(), 3 * (SCENES - 1));
    run(&["audit", text(folder), "--share", "1", "-q"]).expect(0);
}
