//! Damaged and random files in every role of a photograph give an error or a sheet, never a panic.

use super::*;
use crate::formats::NamedBytes;
use crate::formats::exr_raster::tests::{exr, exr_coded};
use crate::formats::npy::tests::npy;
use crate::formats::npz::tests::npz;
use crate::formats::raster::tests::{jpeg, png, repair_png};
use crate::formats::tiff_depth::tests::tiff;
use ::exr::prelude::{Blocks, Compression, Encoding, FlatSamples, LineOrder, Vec2};
use ::tiff::encoder::colortype::{Gray16, Gray32Float};
use image::ExtendedColorType as Png;
use proptest::prelude::*;
use zip::CompressionMethod::Deflated;

/// Decodes the bytes as colour, depth and mask beside valid files, and checks the sheet or the error.
fn decode_everywhere(bytes: &[u8]) {
    let line: Photograph = serde_json::from_str(
        r#"{"color":"c","depth":"d","intrinsics":{"fx":10,"fy":10,"cx":2,"cy":1}}"#,
    )
    .unwrap();
    let bad = NamedBytes { path: "bad".into(), bytes: bytes.to_vec() };
    let good = PhotographFiles {
        color: png(&[9], 1, 1, Png::L8),
        depth: npy("<f4", false, "(2, 3)", bytemuck::cast_slice(&[1.0f32; 6])),
        mask: None,
    };
    let as_color = PhotographFiles { color: bad.clone(), ..good.clone() };
    let as_depth = PhotographFiles { depth: bad.clone(), ..good.clone() };
    let as_mask = PhotographFiles { mask: Some(bad), ..good };
    for files in [as_color, as_depth, as_mask] {
        match decode_photograph(&line, &files) {
            Ok(sheet) => {
                let count = sheet.width * sheet.height;
                assert_eq!(
                    (sheet.inverse_depths_per_m().count(), sheet.valid.len()),
                    (count, count)
                );
                let texels = sheet.texture.width() * sheet.texture.height();
                assert_eq!(sheet.radiance().count(), texels);
                assert!(sheet.inverse_depths_per_m().all(|w| w.is_normal() && w > 0.0));
                assert!(sheet.texture.max_radiance().is_finite() && sheet.front_center_z_m > 0.0);
            }
            // A mask of zeros is a valid file but leaves no depth.
            Err(SceneError::NoDepth { .. }) => {}
            Err(error) => assert!(error.to_string().contains("bad"), "{error}"),
        }
    }
}

/// Returns small valid files of most formats.
fn seeds() -> Vec<Vec<u8>> {
    let floats = || FlatSamples::F32(vec![0.5; 6]);
    let halves = || FlatSamples::F16(vec![::exr::prelude::f16::ONE; 6]);
    let ramp: Vec<u8> = (1..=48).collect();
    let mut seeds: Vec<Vec<u8>> = [
        png(&ramp[..6], 3, 2, Png::L8),
        png(&ramp[..12], 3, 2, Png::L16),
        png(&ramp[..18], 3, 2, Png::Rgb8),
        png(&ramp, 3, 2, Png::Rgba16),
        jpeg(&ramp[..18], 3, 2),
        exr(3, 2, &[("R", floats()), ("G", halves()), ("B", floats())]),
        exr(3, 2, &[("Z", floats())]),
        npy("<f4", false, "(2, 3)", &ramp[..24]),
        npy(">f8", true, "(2, 3, 1)", &ramp),
        npy("|u1", false, "(2, 3, 3)", &ramp[..18]),
        npy("|b1", false, "(1, 2, 3)", &ramp[..6]),
        npz(&[("a.npy", &npy("<u2", false, "(2, 3)", &ramp[..12]).bytes)], Deflated),
        tiff::<Gray16>(1, &[1, 2, 65535]),
        tiff::<Gray32Float>(1, &[0.5, 2.0, 4.0]),
    ]
    .into_iter()
    .map(|file| file.bytes)
    .collect();
    for (compression, blocks) in [
        (Compression::Uncompressed, Blocks::ScanLines),
        (Compression::RLE, Blocks::Tiles(Vec2(2, 2))),
        (Compression::ZIP16, Blocks::ScanLines),
        (Compression::PXR24, Blocks::Tiles(Vec2(64, 64))),
        (Compression::B44, Blocks::ScanLines),
    ] {
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        seeds.push(exr_coded(3, 2, &[("Y", halves()), ("A", floats())], encoding).bytes);
    }
    seeds.extend(
        [
            &b"P1\n3 2\n1 0 1 0 1 0\n"[..],
            b"P2 3 2 255 1 2 3 4 5 6",
            b"P3 1 1 65535 1 2 3",
            b"P4 3 2 \xa0\x40",
            b"P5 3 2 65535 abcdefghijkl",
            b"P6 3 2 255 abcdefghijklmnopqr",
            b"#?RGBE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 1 +X 2\n\x80\x40\x20\x81\x10\x20\x30\x80",
            b"P7\nWIDTH 3\nHEIGHT 2\nDEPTH 1\nMAXVAL 255\nTUPLTYPE GRAYSCALE\nENDHDR\nabcdef",
        ]
        .map(<[u8]>::to_vec),
    );
    seeds
}

#[test]
fn no_prefix_of_a_file_causes_a_panic() {
    for seed in seeds() {
        for length in 0..seed.len() {
            decode_everywhere(&seed[..length]);
        }
        decode_everywhere(&seed);
    }
}

#[test]
fn no_changed_byte_causes_a_panic() {
    for seed in seeds() {
        for at in 0..seed.len() {
            for value in [0, 1, 0x7f, 0x80, 0xff, seed[at] ^ 1, seed[at] ^ 0x10, b'9'] {
                let mut bytes = seed.clone();
                bytes[at] = value;
                repair_png(&mut bytes);
                decode_everywhere(&bytes);
            }
        }
    }
}

#[test]
fn the_seeds_are_valid_files() {
    for (index, seed) in seeds().into_iter().enumerate() {
        let file = NamedBytes { path: format!("seed {index}").into(), bytes: seed };
        let line = glasshouse_line::Transfer::Srgb;
        let as_color = super::color::decode(&file, Orientation::Upright, line, [1.0; 3]).is_ok();
        let as_depth =
            super::depth::decode(&file, Orientation::Upright, super::depth::DepthCodes::PLAIN)
                .is_ok();
        assert!(
            as_color || as_depth || super::mask::decode(&file, Orientation::Upright).is_ok(),
            "seed {index}"
        );
    }
}

#[test]
fn no_wrong_size_causes_a_panic() {
    let ihdr = |width: u32, height: u32| {
        let mut bytes = png(&[1; 18], 3, 2, Png::Rgb8).bytes;
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        repair_png(&mut bytes);
        bytes
    };
    let window = |x: i32, y: i32| {
        let mut bytes = exr(3, 2, &[("Z", FlatSamples::F32(vec![0.5; 6]))]).bytes;
        let name = b"dataWindow\0box2i\0";
        let at =
            bytes.windows(name.len()).position(|found| found == name).unwrap() + name.len() + 4;
        bytes[at + 8..at + 12].copy_from_slice(&x.to_le_bytes());
        bytes[at + 12..at + 16].copy_from_slice(&y.to_le_bytes());
        bytes
    };
    let sizes = [0, 1, 16_384, 16_385, 0x7fff_ffff, u32::MAX];
    for (a, b) in sizes.into_iter().flat_map(|a| sizes.map(|b| (a, b))) {
        decode_everywhere(&ihdr(a, b));
        decode_everywhere(&window(a.cast_signed(), b.cast_signed()));
        decode_everywhere(format!("P5 {a} {b} 255 abc").as_bytes());
        decode_everywhere(format!("P2 {a} {b} 65535 1 2 3").as_bytes());
        decode_everywhere(&npy("<f8", false, &format!("({a}, {b})"), &[0; 8]).bytes);
        decode_everywhere(&npy("<f8", true, &format!("({a}, {b}, 4)"), &[0; 8]).bytes);
    }
    decode_everywhere(&window(8_191, 8_191));
    decode_everywhere(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{'descr': '<f4'");
    decode_everywhere(
        &npy("<f4", false, "(18446744073709551615, 18446744073709551615)", &[]).bytes,
    );
    let nan = f32::NAN.to_le_bytes().repeat(6);
    decode_everywhere(&npy("<f4", false, "(2, 3)", &nan).bytes);
    decode_everywhere(&exr(3, 2, &[("Y", FlatSamples::F32(vec![f32::NAN; 6]))]).bytes);
}

/// Number of random cases, which take a fraction of a second. A single run of 500,000 cases found no panic.
const PROPTEST_CASES: u32 = 2000;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(PROPTEST_CASES))]

    #[test]
    fn no_random_damage_causes_a_panic(
        seed in any::<prop::sample::Index>(),
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0u8..4), 1..8),
    ) {
        let seeds = seeds();
        let mut bytes = seeds[seed.index(seeds.len())].clone();
        for (at, value, kind) in edits {
            let at = at.index(bytes.len());
            match kind {
                0 => bytes.insert(at, value),
                1 if bytes.len() > 1 => { bytes.remove(at); }
                2 => { let tail = bytes[at..].to_vec(); bytes.extend(tail); }
                _ => bytes[at] = value,
            }
            bytes.truncate(4096);
        }
        repair_png(&mut bytes);
        decode_everywhere(&bytes);
    }

    #[test]
    fn no_random_bytes_after_magic_bytes_cause_a_panic(
        magic in 0usize..5, tail in proptest::collection::vec(any::<u8>(), 0..200),
    ) {
        let magics: [&[u8]; 5] = [
            b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"P6 ", b"\x76\x2f\x31\x01\x02\0\0\0", b"\x93NUMPY\x01\0",
        ];
        decode_everywhere(&[magics[magic], &tail].concat());
    }
}
