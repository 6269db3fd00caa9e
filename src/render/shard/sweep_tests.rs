//! Keeps the bits of the tracer for many numbers of samples and sizes of films, which the golden scenes do not cover.

use super::golden_scenes::variant;
use crate::trace::{Isa, Scene, Tile, trace_tile};

/// Golden scenes, and the digests of their pixels with all films and numbers of samples below.
const KEPT: [(&str, &str); 6] = [
    ("mirror", "2074ef844c24641a970c4d317da5e809f50440ecb461166943fd64a2510bb352"),
    ("camera", "7d9c5f23bb8eca836d20d564b5218d88a572ad64e954e3f33f66c94c82c15c37"),
    ("tilted-absorbing", "e0c6f39faba6c91a592376fe45fc3d3e9b683c1ecafbea34d2e339f950e52e1c"),
    ("tilted-camera-gaussian", "22657ce53312bf2e6a796e40bfa9a9285ba1aeb44c1268c90daa7e1f789fd6e3"),
    ("pinhole", "df6c18a5e1daa4948d8e1ea37f96af9917ae5b78ab4e54c024e094b68bb0b793"),
    ("steep", "648a55285fdf1b5a7e3e409f0ae62d1f97494f66ade5847ea515773434f29bba"),
];

/// Widths and heights of films, px: also no multiples of the side of a patch, and smaller than a patch.
const FILMS_PX: [[u32; 2]; 3] = [[16, 10], [13, 7], [3, 9]];

/// Traces two tiles, cut at column `cut`, and returns the pixels of the whole film in rows.
fn film(scene: &Scene, cut: u32, isa: Isa) -> Vec<f32> {
    let (width, height) = (scene.film.width, scene.film.height);
    let trace = |x: u32, width: u32| {
        let tile = Tile { x, y: 0, width, height };
        trace_tile(scene, tile, 0..scene.spp, isa).pixels
    };
    let (left, right) = (trace(0, cut), trace(cut, width - cut));
    let mut values = Vec::new();
    for y in 0..height as usize {
        for (pixels, width) in [(&left, cut as usize), (&right, (width - cut) as usize)] {
            for pixel in &pixels[y * width..][..width] {
                values.extend(pixel.values());
            }
        }
    }
    values
}

#[test]
fn bits_are_kept_for_all_numbers_of_samples_films_and_cuts() {
    let mut found = Vec::new();
    for (name, _) in KEPT {
        let mut hasher = blake3::Hasher::new();
        for film_px in FILMS_PX {
            for spp in (0..=10).map(|log2| 1 << log2) {
                let scene = variant(name, film_px, spp);
                let values = film(&scene, 0, Isa::detect());
                for value in &values {
                    hasher.update(&value.to_le_bytes());
                }
                let bits =
                    |values: Vec<f32>| values.into_iter().map(f32::to_bits).collect::<Vec<_>>();
                let expected = bits(values);
                let cut = bits(film(&scene, film_px[0] / 2 + 1, Isa::Baseline));
                assert!(
                    cut == expected,
                    "{name}, {film_px:?} px, {spp} samples: tiles change bits"
                );
            }
        }
        found.push((name, hasher.finalize().to_hex().to_string()));
    }
    let kept = KEPT.map(|(name, digest)| (name, digest.to_owned()));
    assert_eq!(found, kept, "pixels have changed: see golden.rs");
}
