//! Keeps the bits of the tracer for many numbers of samples and sizes of films, which the golden scenes do not cover.

use super::golden_scenes::variant;
use crate::trace::{Isa, Scene, Tile, trace_tile};

/// Golden scenes, and the digests of their pixels with all films and numbers of samples below.
const KEPT: [(&str, &str); 6] = [
    ("mirror", "9dbb2b069754e46397ba42681cc784d8bdd6be42e1e70984fb092ea35e2f0a03"),
    ("camera", "1138e19aa274c9fa48fda5bfeb8ec2393657452436577c8ed1a28ceeec7be00e"),
    ("tilted-absorbing", "9810cc71eaac9862d49631c4d6e996a31deda1323e6780ed7ee4e709657f761f"),
    ("tilted-camera-gaussian", "04f5f041f809e004b7756d0dc42cfdb590ec1fbbb75012908027b20637240ab6"),
    ("pinhole", "4d46a5c0feba59d120e5aa7370d568cb6dcb527df34d44e3e6a0bcbfd29fa0c4"),
    ("steep", "c8ca2042ec6902f6049bf96c2b851d35c4181ecb988510a49a45bc3f71855445"),
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
