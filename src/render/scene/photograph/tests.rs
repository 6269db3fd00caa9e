//! Whole photographs: geometry of the sheet, holes, limits, and the shared oracle scene.

use super::*;
use crate::formats::NamedBytes;
use crate::formats::npy::tests::npy;
use crate::formats::raster::tests::png;
use crate::line::{DepthKind, Fill, SceneLine, Side, Transfer};
use image::ExtendedColorType as Png;
use std::path::PathBuf;

/// A line with focal length 10 px, centre (2, 1), no mask, linear colour.
fn line() -> Photograph {
    serde_json::from_str(
        r#"{"color":"c","depth":"d","transfer":"linear","intrinsics":{"fx":10,"fy":10,"cx":2,"cy":1}}"#,
    )
    .unwrap()
}

/// Depths of 4x2 pixels and a colour image of 2x1.
fn files(depths: [f32; 8]) -> PhotographFiles {
    PhotographFiles {
        color: png(&[0, 51, 102, 255, 255, 255], 2, 1, Png::Rgb8),
        depth: npy("<f4", false, "(2, 4)", bytemuck::cast_slice(&depths)),
        mask: None,
    }
}

#[test]
fn sizes_may_differ_and_intrinsics_follow_the_depth() {
    let mut line = line();
    line.depth_unit_m = 0.5;
    line.exposure = 2.0;
    line.intrinsics.size = Some([8, 8]);
    let sheet =
        decode_photograph(&line, &files([2.0, 4.0, 8.0, 16.0, 2.0, 2.0, 2.0, 2.0])).unwrap();
    assert_eq!((sheet.width, sheet.height), (4, 2));
    assert_eq!((sheet.color_width, sheet.color_height), (2, 1));
    assert_eq!(sheet.inverse_depth_per_m, [1.0, 0.5, 0.25, 0.125, 1.0, 1.0, 1.0, 1.0]);
    assert_eq!(sheet.radiance, [[0.0, 0.4, 0.8, 0.0], [2.0, 2.0, 2.0, 0.0]]);
    assert_eq!((sheet.max_radiance, sheet.filled_share), (2.0, 0.0));
    let Intrinsics { fx, fy, cx, cy, size } = sheet.intrinsics;
    assert_eq!((fx, fy, cx, cy, size), (5.0, 2.5, 1.0, 0.25, None));
    assert_eq!(sheet.front_center_z_m, (2.0 + 4.0 + 1.0 + 1.0) / 4.0);
}

#[test]
fn holes_come_from_depth_and_mask() {
    let depths = [0.0, f32::NAN, f32::INFINITY, -1.0, 1.0, 2.0, 4.0, 8.0];
    let mut files = files(depths);
    files.mask = Some(npy("|u1", false, "(2, 4, 1)", &[1, 1, 1, 1, 1, 0, 1, 1]));
    let mut line = line();
    line.fill = Fill::Far;
    let sheet = decode_photograph(&line, &files).unwrap();
    assert_eq!(sheet.valid, [false, false, false, false, true, false, true, true]);
    assert_eq!(sheet.filled_share, 5.0 / 8.0);
    assert_eq!(sheet.inverse_depth_per_m, [0.125, 0.125, 0.125, 0.125, 1.0, 0.125, 0.25, 0.125]);
    // Centre pixels (1,0) (2,0) (1,1) (2,1): (1,0) is nearest to (0,1) and (2,1) at 2, the left wins;
    // (1,1) is between (0,1) and (2,1), the left wins.
    assert_eq!(sheet.front_center_z_m, (1.0 + 4.0 + 1.0 + 4.0) / 4.0);

    line.fill = Fill::Smooth;
    let smooth = decode_photograph(&line, &files).unwrap();
    assert!(smooth.inverse_depth_per_m.iter().all(|w| (0.125..=1.0).contains(w)));
    assert_eq!(smooth.front_center_z_m, sheet.front_center_z_m);
}

#[test]
fn what_goes_to_quarantine() {
    let message = |line: &Photograph, files: &PhotographFiles| {
        decode_photograph(line, files).unwrap_err().to_string()
    };
    let good = files([1.0; 8]);
    assert!(message(&line(), &files([f32::NAN; 8])).contains("no pixel whose depth is finite"));
    let mut masked = good.clone();
    masked.mask = Some(npy("|b1", false, "(2, 4)", &[0; 8]));
    assert!(message(&line(), &masked).contains("no pixel whose depth is finite"));
    masked.mask = Some(npy("|b1", false, "(4, 2)", &[1; 8]));
    let text = message(&line(), &masked);
    assert!(text.contains("mask a.npy has 2x4 pixels, depth a.npy has 4x2"), "{text}");

    let text = message(&line(), &files([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, f32::MAX, 1.0]));
    assert!(
        text.contains("1 pixels too near or too far") && text.contains("column 2, row 1"),
        "{text}"
    );
    let mut far = files([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, f32::MAX, 1.0]);
    far.mask = Some(npy("|b1", false, "(2, 4)", &[1, 1, 1, 1, 1, 1, 0, 1]));
    assert!(decode_photograph(&line(), &far).is_ok());
    assert!(message(&line(), &files([1e-45; 8])).contains("8 pixels"));

    for (name, change) in [
        ("exposure", (|line| line.exposure = -1.0) as fn(&mut Photograph)),
        ("depth_unit_m", |line| line.depth_unit_m = 0.0),
        ("intrinsics.fx", |line| line.intrinsics.fx = f64::NAN),
        ("intrinsics.cy", |line| line.intrinsics.cy = f64::INFINITY),
        ("intrinsics.size", |line| {
            line.intrinsics.size = Some([0, 1]);
        }),
    ] {
        let mut line = line();
        change(&mut line);
        assert!(message(&line, &good).contains(name));
    }
}

#[test]
fn thin_images() {
    for (shape, count) in [("(1, 1)", 1), ("(1, 9)", 9), ("(9, 1)", 9), ("(9, 1, 1)", 9)] {
        let mut depths = vec![0.0f32; count];
        depths[count / 2] = 2.0;
        let mut files = files([1.0; 8]);
        files.depth = npy("<f4", false, shape, bytemuck::cast_slice(&depths));
        let sheet = decode_photograph(&line(), &files).unwrap();
        assert!(sheet.inverse_depth_per_m.iter().all(|&w| w == 0.5), "{shape}");
        assert_eq!(sheet.front_center_z_m, 2.0);
    }
}

/// A folder of the data that is shared between checkouts, or `None` with a line that says so.
fn shared(folder: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared").join(folder);
    if path.is_dir() {
        return Some(path);
    }
    #[allow(clippy::print_stdout, reason = "the only trace of a test that did not run")]
    {
        println!("skipped: {} is not here", path.display());
    }
    None
}

fn named(path: PathBuf) -> NamedBytes {
    NamedBytes { bytes: std::fs::read(&path).unwrap(), path }
}

#[test]
fn the_oracle_scene_is_focused_exactly() {
    let Some(folder) = shared("oracle/mitsuba") else {
        return;
    };
    let text = std::fs::read_to_string(folder.join("scene.json")).unwrap();
    let scene: SceneLine = serde_json::from_str(&text).unwrap();
    let read = |side: &Side| {
        let photograph = side.photograph().unwrap();
        let files = PhotographFiles {
            color: named(folder.join(&photograph.color)),
            depth: named(folder.join(&photograph.depth)),
            mask: None,
        };
        decode_photograph(photograph, &files).unwrap()
    };
    let front = read(&scene.front);
    assert_eq!((front.width, front.height, front.filled_share), (512, 384, 0.0));
    assert_eq!(front.front_center_z_m, 7.056411623954773);
    assert_eq!(read(&scene.back).filled_share, 0.0);
}

#[test]
fn real_photographs_become_sheets() {
    let Some(folder) = shared("data/rgbd") else {
        return;
    };
    // Folder, colour, depth, metres a unit, size, share of valid pixels (README of the data).
    for (name, color, depth, unit_m, size, valid_share) in [
        ("nyu_basement", "rgb_00000.jpg", "sync_depth_00000.png", 1e-3, (640, 480), 0.66..0.76),
        (
            "kitti_road",
            "rgb/0000000005.png",
            "depth/0000000005.png",
            1.0 / 256.0,
            (1242, 375),
            0.18..0.22,
        ),
        ("hololens_office", "images/00050.png", "depth/00050.png", 1e-3, (540, 360), 0.62..0.66),
        ("nyu_dining_npy", "rgb.npy", "depth.npy", 1.0, (224, 224), 1.0..1.1),
        ("nyu_dining_npy", "rgb.png", "depth.npy", 1.0, (224, 224), 1.0..1.1),
        ("moon_estimated", "moon.jpg", "moon.npy", 1.0, (640, 640), 0.1..1.0),
    ] {
        let mut line = line();
        line.depth_unit_m = unit_m;
        line.transfer = Transfer::Srgb;
        let files = PhotographFiles {
            color: named(folder.join(name).join(color)),
            depth: named(folder.join(name).join(depth)),
            mask: None,
        };
        let sheet = decode_photograph(&line, &files).unwrap();
        assert_eq!((sheet.width, sheet.height), size, "{name}");
        assert!(valid_share.contains(&(1.0 - sheet.filled_share)), "{name} {}", sheet.filled_share);
        assert!(sheet.max_radiance > 0.0 && sheet.max_radiance <= 1.0, "{name}");
        let valid = || sheet.inverse_depth_per_m.iter().zip(&sheet.valid).filter(|(_, v)| **v);
        let low = valid().map(|(w, _)| *w).fold(f32::INFINITY, f32::min);
        let high = valid().map(|(w, _)| *w).fold(0.0, f32::max);
        assert!(sheet.inverse_depth_per_m.iter().all(|w| (low..=high).contains(w)), "{name}");
        assert_eq!(decode_photograph(&line, &files).unwrap(), sheet, "{name}");
    }
}

/// An estimate (larger is nearer, also negative), and a disparity image without calibration, in which 0 is unknown.
#[test]
fn relative_depths_of_real_photographs_become_metres() {
    let Some(folder) = shared("data/rgbd") else {
        return;
    };
    let decode = |color: &str, depth: &str, mask: Option<&str>, range: &str| {
        let mut line = line();
        line.transfer = Transfer::Srgb;
        line.depth_kind = DepthKind::RelativeInverse;
        line.depth_range = Some(serde_json::from_str(range).unwrap());
        let named = |file: &str| named(folder.join(file));
        let files =
            PhotographFiles { color: named(color), depth: named(depth), mask: mask.map(named) };
        decode_photograph(&line, &files).unwrap()
    };
    // Rows of the upper and of the lower quarter: ground lies nearer than what is above it.
    let z_m = |sheet: &Sheet, quarter: usize| {
        let count = sheet.inverse_depth_per_m.len() / 4;
        let rows = quarter * count..(quarter + 1) * count;
        let z = sheet.inverse_depth_per_m[rows].iter().map(|w| 1.0 / f64::from(*w));
        z.sum::<f64>() / count as f64
    };
    let mean_m = |sheet: &Sheet| {
        let pixels = sheet.inverse_depth_per_m.iter().zip(&sheet.valid);
        let z: Vec<f64> = pixels.filter(|(_, v)| **v).map(|(w, _)| 1.0 / f64::from(*w)).collect();
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
    // The same with metres for the ends, and from its 16-bit form, which is cut into steps.
    let range = r#"{"near_m":3,"far_m":60,"percentiles":[1,99]}"#;
    let fine = decode(moon[0], moon[1], None, range);
    let coarse = decode(moon[0], "moon_estimated/moon.png", None, range);
    assert_eq!((fine.relative.unwrap().near_m, fine.relative.unwrap().far_m), (3.0, 60.0));
    let pairs = fine.inverse_depth_per_m.iter().zip(&coarse.inverse_depth_per_m);
    let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-4, "{worst}");

    let aloe = ["middlebury_aloe/aloeL.jpg", "middlebury_aloe/aloeGT.png"];
    let sheet = decode(aloe[0], aloe[1], Some(aloe[1]), r#"{"mean_m":1.5,"far_over_near":3}"#);
    assert!((0.03..0.04).contains(&sheet.filled_share), "{}", sheet.filled_share);
    assert!((mean_m(&sheet) / 1.5 - 1.0).abs() < 1e-6);
    assert_eq!((sheet.width, sheet.height), (1282, 1110));
}
