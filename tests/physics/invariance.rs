//! Bits depend only on scene and samples, not on instruction set, tiles or other layers; ranges of samples merge.

use crate::case::{Apex, Case, Photo, noise, whole_film};
use crate::cover::{noisy_card, small_window};
use crate::mesh::rooms;
use crate::panes::pane;
use crate::stack::{coated_double_pane, double_pane};
use glasshouse_line::layer::{Layer, PerLayer};
use render::trace::{Isa, PixelMeans, Scene, Tile, trace_tile};

fn rough(key: u64) -> Photo {
    let depth = move |i: usize, j: usize| 0.9 + 2.0 * noise(i / 2, j / 2, key);
    Photo::new([40, 30], [64, 48], [0.3; 2], depth, move |i, j| {
        [0, 1, 2].map(|c| noise(i, j, key + c))
    })
}

fn cases() -> Vec<Case> {
    let mut case = Case::new(rough(1), rough(2));
    case.film = [131, 70];
    case.spp = 16;
    let mut tilted = case.clone();
    tilted.tilt_deg = [14.0, -20.0];
    tilted.apex = Apex::Camera;
    tilted.gaussian = true;
    tilted.absorption_per_m = [1.0, 2.0, 3.0];
    let mut absorbing = tilted.clone();
    absorbing.apex = Apex::Mirror;
    absorbing.focus_m = f64::INFINITY;
    let mut stacked = tilted.clone();
    stacked.stack = Some(coated_double_pane());
    let mut clear = case.clone();
    clear.stack = Some(double_pane());
    let mut covered = case.clone();
    covered.covered.edges = Some(small_window());
    covered.covered.cards = [0.8, 0.3].map(|z_m| vec![noisy_card(z_m, [0.02, 0.0], 0.2, 4)]);
    let mut bent = absorbing.clone();
    (bent.bow_radius_m, bent.covered) = (Some(-6.0), covered.covered.clone());
    let mut scattering = tilted.clone();
    scattering.roughness = Some(vec![0.03, 0.1]);
    let mut frosted = stacked.clone();
    (frosted.roughness, frosted.covered) = (Some(vec![0.02; 4]), covered.covered.clone());
    let mut rough_bent = bent.clone();
    rough_bent.roughness = Some(vec![0.01; 2]);
    vec![case, tilted, absorbing, stacked, clear, covered, bent, scattering, frosted, rough_bent]
}

pub(crate) fn bits(pixels: &[PixelMeans]) -> Vec<u32> {
    pixels.iter().flat_map(PixelMeans::values).map(f32::to_bits).collect()
}

/// Returns the film traced in square tiles of `side` px.
pub(crate) fn tiled(scene: &Scene, side: u32, isa: Isa) -> Vec<PixelMeans> {
    let (w, h) = (scene.film.width, scene.film.height);
    let mut film = vec![PixelMeans::default(); (w * h) as usize];
    for y in (0..h).step_by(side as usize) {
        for x in (0..w).step_by(side as usize) {
            let (width, height) = (side.min(w - x), side.min(h - y));
            let tile = Tile { x, y, width, height };
            let result = trace_tile(scene, tile, 0..scene.spp, isa);
            for (row, pixels) in result.pixels.chunks(width as usize).enumerate() {
                let start = ((y + row as u32) * w + x) as usize;
                film[start..start + width as usize].copy_from_slice(pixels);
            }
        }
    }
    film
}

#[test]
fn instruction_sets_and_tiles_give_the_same_bits() {
    let fastest = Isa::detect();
    let available: Vec<Isa> = Isa::ALL.into_iter().filter(|isa| isa.is_available()).collect();
    println!("instruction sets: {available:?}");
    let sheets = cases().into_iter().map(|case| case.scene());
    for scene in sheets.chain(cases().iter().map(rooms)) {
        let whole = bits(&whole_film(&scene, Isa::Baseline).pixels);
        for isa in &available {
            assert!(whole == bits(&whole_film(&scene, *isa).pixels), "{isa:?}");
        }
        for side in [16, 64, 100] {
            assert!(whole == bits(&tiled(&scene, side, fastest)), "tiles of {side}");
        }
    }
}

/// Waves, wedges, smudges, coatings and roughness, in tiles from a single pixel on.
#[test]
fn random_panes_have_the_same_bits_in_tiles_of_any_size() {
    for number in 0..16 {
        let (mut case, _) = pane(number);
        (case.film, case.spp) = ([19, 13], 16);
        let scene = case.scene();
        let whole = bits(&whole_film(&scene, Isa::Baseline).pixels);
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            for side in [1, 7, 16_384] {
                let tiles = bits(&tiled(&scene, side, isa));
                assert!(whole == tiles, "pane {number}, {isa:?}, tiles of {side}");
            }
        }
    }
}

/// The sides of the film are not multiples of a cell's side; tiles consist of one or more cells.
#[test]
fn adaptive_pixels_depend_on_neither_tiles_nor_instruction_sets() {
    for mut case in cases() {
        (case.film, case.spp) = ([43, 21], 256);
        for mut scene in [case.scene(), rooms(&case)] {
            // Lowers the target until some cells take more than the 16 samples of the first round.
            let mut target = 0.08;
            let result = loop {
                scene.target_error = Some(target);
                let result = whole_film(&scene, Isa::Baseline);
                if result.sample_sums.unwrap()[Layer::Input] > 16 * 43 * 21 {
                    break result;
                }
                target *= 0.5;
            };
            assert!(result.sample_sums.unwrap()[Layer::Input] < 256 * 43 * 21);
            let whole = bits(&result.pixels);
            assert!(whole == bits(&whole_film(&scene, Isa::detect()).pixels));
            for side in [8, 16, 24, 64] {
                let tiles = bits(&tiled(&scene, side, Isa::detect()));
                assert!(whole == tiles, "tiles of {side}");
            }
        }
    }
}

/// A layer does not depend on the choice of the others.
#[test]
fn layers_are_the_same_without_the_others() {
    for mut case in cases() {
        case.film = [19, 13];
        let mut scene = case.scene();
        let whole = whole_film(&scene, Isa::detect());
        for chosen in 1..15u32 {
            scene.layers = PerLayer::of(|layer| (chosen >> layer as u32) & 1 == 1);
            let some = whole_film(&scene, Isa::detect());
            for layer in 0..4 {
                let asked = scene.layers.0[layer];
                let kept = u32::from(asked) * whole.samples.0[layer];
                assert_eq!(some.samples.0[layer], kept);
                for (q, pixel) in some.pixels.iter().enumerate() {
                    let all = &whole.pixels[q];
                    let parts = [pixel.mean, pixel.half, pixel.quarter];
                    for (part, all) in parts.iter().zip([all.mean, all.half, all.quarter]) {
                        let expected = if asked { all[layer] } else { [0.0; 3] };
                        assert_eq!(part[layer], expected, "layers {chosen:04b}, {layer}");
                    }
                }
            }
        }
    }
}

#[test]
fn powers_of_two_of_samples_render() {
    for mut case in cases() {
        case.film = [6, 5];
        for spp in [1, 2, 4, 8, 16, 64, 256, 1024] {
            case.spp = spp;
            let scene = case.scene();
            let result = whole_film(&scene, Isa::Baseline);
            assert!(bits(&result.pixels) == bits(&whole_film(&scene, Isa::detect()).pixels));
            let block = spp.min(256);
            let reflected = scene.orders.back[0]
                .samples_of_block(block, scene.zones.least(scene.orders.front.len()))
                * (spp / block);
            assert_eq!(result.samples.0[..3], [spp, spp, reflected]);
            for pixel in &result.pixels {
                let mut values = pixel.values();
                assert!(values.all(|v| (0.0..=1.001).contains(&v)));
                if spp == 1 {
                    assert_eq!(pixel.mean, pixel.half);
                }
            }
        }
    }
}

/// The weighted mean of four ranges of 256 equals the mean of 1,024; except in R, the mean of the first two is `half`.
#[test]
fn ranges_of_256_merge() {
    for mut case in cases() {
        case.film = [5, 4];
        case.spp = 1024;
        let scene = case.scene();
        let tile = Tile { x: 0, y: 0, width: 5, height: 4 };
        let whole = trace_tile(&scene, tile, 0..1024, Isa::detect());
        let parts: Vec<_> = (0..4)
            .map(|k| trace_tile(&scene, tile, k * 256..(k + 1) * 256, Isa::detect()))
            .collect();
        for layer in 0..4 {
            let counts: Vec<u32> = parts.iter().map(|p| p.samples.0[layer]).collect();
            assert_eq!(counts.iter().sum::<u32>(), whole.samples.0[layer]);
            assert_eq!(parts.iter().map(|p| p.paths.0[layer]).sum::<u64>(), whole.paths.0[layer]);
            assert_eq!(parts.iter().map(|p| p.misses.0[layer]).sum::<u64>(), whole.misses.0[layer]);
            if whole.samples.0[layer] == 0 {
                // The first range has all of a layer in closed form.
                let of = |pixels: &[PixelMeans]| {
                    pixels.iter().map(|p| p.mean[layer]).collect::<Vec<_>>()
                };
                assert_eq!(of(&whole.pixels), of(&parts[0].pixels));
                assert!(of(&parts[1].pixels).as_flattened().iter().all(|v| *v == 0.0));
                continue;
            }
            for (q, pixel) in whole.pixels.iter().enumerate() {
                for c in 0..3 {
                    let sum: f64 = (0..4)
                        .map(|k| {
                            f64::from(parts[k].pixels[q].mean[layer][c]) * f64::from(counts[k])
                        })
                        .sum();
                    let mean = sum / f64::from(whole.samples.0[layer]);
                    assert!((mean - f64::from(pixel.mean[layer][c])).abs() < 1e-7);
                    if layer < 3 {
                        let half = 0.5
                            * (f64::from(parts[0].pixels[q].mean[layer][c])
                                + f64::from(parts[1].pixels[q].mean[layer][c]));
                        assert!((half - f64::from(pixel.half[layer][c])).abs() < 1e-7);
                    }
                }
            }
        }
    }
}
