//! Digests of photographs. If a digest changes, procedural sets, smoke runs and their figures also change.

use super::{SamplePhotograph, listing, render};

/// First 16 digits of the BLAKE3 digest of each photograph's colour, depth and mask, at 96 x 72 px.
const DIGESTS: [&str; 8] = [
    "4fcb366fdf4a3425",
    "ae64d134767c4b25",
    "c767ef52e1b015b3",
    "0cb7ce10d6df21a2",
    "5d30fa628b477061",
    "43dac94e9339ca41",
    "c2e15c64ce74356a",
    "27f80579f011196c",
];

/// The same of the first two photographs with textured surfaces.
const TEXTURED: [&str; 2] = ["4704d8b2c5b8f5d7", "9401b2b25e66f1ea"];

#[test]
fn photographs_are_pinned() {
    assert_eq!(digests(&listing(8, 2020)), DIGESTS);
}

#[test]
fn textured_photographs_are_pinned() {
    let mut photographs = listing(2, 2020);
    for photograph in &mut photographs {
        photograph.is_textured = true;
    }
    assert_eq!(digests(&photographs), TEXTURED);
}

fn digests(photographs: &[SamplePhotograph]) -> Vec<String> {
    photographs
        .iter()
        .map(|photograph| {
            let rgbd = render(photograph, 96, 72);
            let mut digest = blake3::Hasher::new();
            digest.update(&rgbd.rgb);
            digest.update(bytemuck::cast_slice(&rgbd.depth_m));
            for &is_valid in &rgbd.valid {
                digest.update(&[u8::from(is_valid)]);
            }
            digest.finalize().to_hex()[..16].to_owned()
        })
        .collect()
}
