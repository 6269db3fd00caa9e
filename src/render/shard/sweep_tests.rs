//! Keeps the bits of the tracer for many numbers of samples and sizes of films, which the golden scenes do not cover.

use super::golden_scenes::variant;
use crate::trace::{Isa, Scene, Tile, trace_tile};

/// Golden scenes, and the digests of their pixels with all films and numbers of samples below.
const KEPT: [(&str, &str); 6] = [
    ("mirror", "f285b2eb4285fef9eee2b0e114c84246dfe8457179247f41ecfa9893abb73dda"),
    ("camera", "43681a457971a1870c9a43e6d501331c3a0712eb8e38aad6414812e299e869c0"),
    ("tilted-absorbing", "c11efe27314116b7eb6db5e42559341a3198d1267d1a0888c6c5d4d789694e3e"),
    ("tilted-camera-gaussian", "6c0499a2b607abb707340448e4f9866ef8909fb61eccc0b65e08c025b091ef3c"),
    ("pinhole", "50e89d9dd146fc7194f5d97e6d103ac069501ca13ccee97455454117f4a53ede"),
    ("steep", "60abc6706127b7497a6038654a386807878962a15f0f23d49746de4ad23b8a46"),
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
