//! Tests of whole photographs: geometry of the sheet, holes, limits.

use super::*;
use crate::formats::npy::tests::npy;
use crate::formats::raster::tests::png;
use crate::line::Fill;
use image::ExtendedColorType as Png;

/// Returns a photograph with focal length 10 px, centre (2, 1), no mask and linear colour.
fn line() -> Photograph {
    serde_json::from_str(
        r#"{"color":"c","depth":"d","transfer":"linear","intrinsics":{"fx":10,"fy":10,"cx":2,"cy":1}}"#,
    )
    .unwrap()
}

/// Returns a depth image of 4x2 pixels and a colour image of 2x1.
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
    // The centre pixels are (1,0) (2,0) (1,1) (2,1). Both (1,0) and (1,1) are as near to (0,1) as to (2,1): the left
    // pixel wins.
    assert_eq!(sheet.front_center_z_m, (1.0 + 4.0 + 1.0 + 4.0) / 4.0);

    line.fill = Fill::Smooth;
    let smooth = decode_photograph(&line, &files).unwrap();
    assert!(smooth.inverse_depth_per_m.iter().all(|w| (0.125..=1.0).contains(w)));
    assert_eq!(smooth.front_center_z_m, sheet.front_center_z_m);
}

#[test]
fn invalid_photographs_are_errors() {
    let message = |line: &Photograph, files: &PhotographFiles| {
        decode_photograph(line, files).unwrap_err().to_string()
    };
    let good = files([1.0; 8]);
    assert!(message(&line(), &files([f32::NAN; 8])).contains("no valid pixel with a finite depth"));
    let mut masked = good.clone();
    masked.mask = Some(npy("|b1", false, "(2, 4)", &[0; 8]));
    assert!(message(&line(), &masked).contains("no valid pixel with a finite depth"));
    masked.mask = Some(npy("|b1", false, "(4, 2)", &[1; 8]));
    let text = message(&line(), &masked);
    assert!(text.contains("mask a.npy has 2x4 pixels, but depth a.npy has 4x2"), "{text}");

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
fn images_of_one_row_or_column_are_decoded() {
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
