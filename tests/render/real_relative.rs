//! Converts relative depths of public photographs to metres by the depth range of the line.

use crate::real_sets::find_sets;
use glasshouse_line::Photograph;
use render::formats::{NamedBytes, PhotographFiles};
use render::scene::{Sheet, decode_photograph};

/// Decodes an estimate (larger values are nearer) and an uncalibrated disparity image (0 is unknown).
#[test]
fn relative_depths_of_real_photographs_become_metres() {
    let Some(folder) = find_sets() else { return };
    let decode = |color: &str, depth: &str, mask: Option<&str>, range: &str| {
        let line: Photograph = serde_json::from_str(&format!(
            r#"{{"color":"c","depth":"d","depth_kind":"relative_inverse","depth_range":{range},
            "intrinsics":{{"fx":10,"fy":10,"cx":2,"cy":1}}}}"#
        ))
        .unwrap();
        let named = |file: &str| {
            let path = folder.join(file);
            NamedBytes { bytes: std::fs::read(&path).unwrap(), path }
        };
        let files =
            PhotographFiles { color: named(color), depth: named(depth), mask: mask.map(named) };
        decode_photograph(&line, &files).unwrap()
    };
    // Mean depth of a quarter of the rows, to compare the ground with the upper rows.
    let z_m = |sheet: &Sheet, quarter: usize| {
        let count = sheet.valid.len() / 4;
        let rows = sheet.inverse_depths_per_m().skip(quarter * count).take(count);
        let z = rows.map(|w| 1.0 / f64::from(w));
        z.sum::<f64>() / count as f64
    };
    let mean_m = |sheet: &Sheet| {
        let pixels = sheet.inverse_depths_per_m().zip(&*sheet.valid);
        let z: Vec<f64> = pixels.filter(|(_, v)| **v).map(|(w, _)| 1.0 / f64::from(w)).collect();
        z.iter().sum::<f64>() / z.len() as f64
    };

    let moon = ["moon_estimated/moon.jpg", "moon_estimated/moon.npy"];
    let sheet = decode(moon[0], moon[1], None, r#"{"mean_m":12.0}"#);
    assert_eq!(sheet.filled_share, 0.0);
    assert!((mean_m(&sheet) / 12.0 - 1.0).abs() < 1e-6);
    let ends = sheet.relative.unwrap();
    assert!((ends.far_m / ends.near_m - 8.0).abs() < 1e-9, "{ends:?}");
    assert!(ends.clamped_share > 0.0 && ends.clamped_share < 0.05, "{ends:?}");
    assert!(z_m(&sheet, 0) > 2.0 * z_m(&sheet, 3));
    // With a range in metres, the estimate equals its 16-bit form, except for quantisation.
    let range = r#"{"near_m":3,"far_m":60,"percentiles":[1,99]}"#;
    let fine = decode(moon[0], moon[1], None, range);
    let coarse = decode(moon[0], "moon_estimated/moon.png", None, range);
    assert_eq!((fine.relative.unwrap().near_m, fine.relative.unwrap().far_m), (3.0, 60.0));
    let pairs = fine.inverse_depths_per_m().zip(coarse.inverse_depths_per_m());
    let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-4, "{worst}");

    let aloe = ["middlebury_aloe/aloeL.jpg", "middlebury_aloe/aloeGT.png"];
    let sheet = decode(aloe[0], aloe[1], Some(aloe[1]), r#"{"mean_m":1.5,"far_over_near":3}"#);
    assert!((0.03..0.04).contains(&sheet.filled_share), "{}", sheet.filled_share);
    assert!((mean_m(&sheet) / 1.5 - 1.0).abs() < 1e-6);
    assert_eq!((sheet.width, sheet.height), (1282, 1110));
}
