//! Tests of whole photographs: geometry of the sheet, holes, limits.

use super::*;
use crate::formats::npy::tests::npy;
use crate::formats::png_chunks::tests::with_chunk;
use crate::formats::raster::tests::{jpeg, png};
use crate::formats::upright::tests::{exif, turned_jpeg};
use glasshouse_line::Fill;
use image::metadata::Orientation as Turn;
use image::{DynamicImage, ExtendedColorType as Png};

/// Returns a photograph with focal length 10 px, centre (2, 1), no mask and linear colour.
fn line() -> Photograph {
    serde_json::from_str(
        r#"{"color":"c","depth":"d","transfer":"linear","intrinsics":{"fx":10,"fy":10,"cx":2,"cy":1}}"#,
    )
    .unwrap()
}

fn inverse_depths(sheet: &Sheet) -> Vec<f32> {
    sheet.inverse_depths_per_m().collect()
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
    assert_eq!((sheet.texture.width(), sheet.texture.height()), (2, 1));
    assert_eq!(inverse_depths(&sheet), [1.0, 0.5, 0.25, 0.125, 1.0, 1.0, 1.0, 1.0]);
    assert_eq!(
        sheet.radiance().copied().collect::<Vec<_>>(),
        [[0.0, 0.4, 0.8, 0.0], [2.0, 2.0, 2.0, 0.0]]
    );
    assert_eq!((sheet.texture.max_radiance(), sheet.filled_share), (2.0, 0.0));
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
    assert_eq!(*sheet.valid, [false, false, false, false, true, false, true, true]);
    assert_eq!(sheet.filled_share, 5.0 / 8.0);
    assert_eq!(inverse_depths(&sheet), [0.125, 0.125, 0.125, 0.125, 1.0, 0.125, 0.25, 0.125]);
    // The centre pixels are (1,0) (2,0) (1,1) (2,1). Both (1,0) and (1,1) are as near to (0,1) as to (2,1): the left
    // pixel wins.
    assert_eq!(sheet.front_center_z_m, (1.0 + 4.0 + 1.0 + 4.0) / 4.0);

    line.fill = Fill::Smooth;
    let smooth = decode_photograph(&line, &files).unwrap();
    assert!(smooth.inverse_depths_per_m().all(|w| (0.125..=1.0).contains(&w)));
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
        assert!(sheet.inverse_depths_per_m().eq(vec![0.5; count]), "{shape}");
        assert_eq!(sheet.front_center_z_m, 2.0);
    }
}

/// A JPEG and a PNG with each orientation yield the sheet of an upright PNG, bit by bit, with depth, mask and intrinsics
/// of the upright image.
#[test]
fn all_orientations_equal_their_upright_twins() {
    let (width, height) = (16, 8);
    let codes: Vec<u8> = (0..width * height * 3).map(|k| (k * k * 7 + k * 13) as u8).collect();
    let files_of = |color: NamedBytes, [width, height]: [usize; 2]| {
        let depths: Vec<f32> = (0..width * height).map(|k| 1.0 + k as f32 / 7.0).collect();
        let mask: Vec<u8> = (0..width * height).map(|k| u8::from(k % 5 != 0)).collect();
        let shape = format!("({height}, {width})");
        PhotographFiles {
            color,
            depth: npy("<f4", false, &shape, bytemuck::cast_slice(&depths)),
            mask: Some(npy("|u1", false, &shape, &mask)),
        }
    };
    let as_jpeg = jpeg(&codes, width, height);
    let as_png = png(&codes, width, height, Png::Rgb8);
    for tag in 1..=8 {
        for stored in [&as_jpeg, &as_png] {
            let mut twin = image::load_from_memory(&stored.bytes).unwrap();
            twin.apply_orientation(Turn::from_exif(tag).unwrap());
            let size = [twin.width() as usize, twin.height() as usize];
            let DynamicImage::ImageRgb8(pixels) = &twin else { panic!() };
            let upright = png(pixels.as_raw(), twin.width(), twin.height(), Png::Rgb8);
            let bytes = match stored.bytes[0] {
                0xff => turned_jpeg(&stored.bytes, tag),
                _ => with_chunk(&stored.bytes, *b"eXIf", &exif(tag)),
            };
            let turned = NamedBytes { path: stored.path.clone(), bytes };
            let expected = decode_photograph(&line(), &files_of(upright, size)).unwrap();
            let found = decode_photograph(&line(), &files_of(turned.clone(), size)).unwrap();
            assert_eq!(found, expected, "{tag}");
            // With `stored`, the tag changes nothing.
            let mut line = line();
            line.orientation = Orientation::Stored;
            let plain = files_of(stored.clone(), [16, 8]);
            let found = decode_photograph(&line, &files_of(turned.clone(), [16, 8])).unwrap();
            assert_eq!(found, decode_photograph(&line, &plain).unwrap(), "{tag}");
            // Depth of the stored rows is refused, where its size tells.
            let wrong = decode_photograph(&self::line(), &files_of(turned, [16, 8]));
            assert_eq!(wrong.is_err(), tag > 4, "{tag}");
        }
    }
}

/// The orientation of a depth image and of a mask counts, too.
#[test]
fn turned_depth_and_mask_become_upright() {
    let depths: Vec<u16> = (0..8).map(|k| 1000 + 10 * k).collect();
    let depth = png(bytemuck::cast_slice(&depths), 4, 2, Png::L16);
    let mask = png(&[255, 0, 255, 255, 255, 255, 255, 255], 4, 2, Png::L8);
    let turn = |file: &NamedBytes, tag| NamedBytes {
        path: file.path.clone(),
        bytes: with_chunk(&file.bytes, *b"eXIf", &exif(tag)),
    };
    let color = png(&[9; 8], 2, 4, Png::L8);
    // 8 is a quarter turn counterclockwise: the right column becomes the first row.
    let files = PhotographFiles { color, depth: turn(&depth, 8), mask: Some(turn(&mask, 8)) };
    let sheet = decode_photograph(&line(), &files).unwrap();
    assert_eq!((sheet.width, sheet.height), (2, 4));
    let first_rows = [1030.0f32, 1070.0, 1020.0, 1060.0].map(|z| 1.0 / z);
    assert_eq!(inverse_depths(&sheet)[..4], first_rows);
    assert_eq!(*sheet.valid, [true, true, true, true, false, true, true, true]);
}
