//! Tests the low discrepancy and the independence of sample points, and the convergence of an image's error.

use crate::case::{Case, Photo, noise, whole_film};
use render::trace::{Isa, PixelSeed, sample};

/// Returns the points of one pair of dimensions (0: pixel, 1: lens) for a range of sample indices.
fn points(seed: &PixelSeed, pair: usize, range: std::ops::Range<u32>) -> Vec<[f32; 2]> {
    range.map(|i| sample(seed, i)).map(|p| [p[2 * pair], p[2 * pair + 1]]).collect()
}

#[test]
fn every_elementary_interval_of_an_aligned_block_holds_one_point() {
    let mut intervals = 0u64;
    for (scene, x, y) in [(1, 0, 0), (412, 17, 203), (u64::MAX, 4095, 1), (9, 255, 255)] {
        let seed = PixelSeed::new(scene, x, y);
        for log in 0..=10u32 {
            let size = 1 << log;
            for block in [0, 1, 5, 64, 1023] {
                for pair in 0..2 {
                    let points = points(&seed, pair, block * size..(block + 1) * size);
                    for columns_log in 0..=log {
                        let (columns, rows) = (1u32 << columns_log, size >> columns_log);
                        let mut seen = vec![false; size as usize];
                        for [u, v] in &points {
                            assert!((0.0..1.0).contains(u) && (0.0..1.0).contains(v));
                            let cell =
                                (v * rows as f32) as u32 * columns + (u * columns as f32) as u32;
                            assert!(
                                !std::mem::replace(&mut seen[cell as usize], true),
                                "two points in cell {cell} of {columns} x {rows}"
                            );
                        }
                        intervals += u64::from(size);
                    }
                }
            }
        }
    }
    println!("{intervals} elementary intervals, each with one point");
}

#[test]
fn a_sample_depends_on_its_arguments_alone() {
    let seed = PixelSeed::new(3, 8, 9);
    let forward: Vec<_> = (0..64).map(|i| sample(&seed, i)).collect();
    for i in (0..64).rev() {
        assert_eq!(sample(&PixelSeed::new(3, 8, 9), i), forward[i as usize]);
    }
    for other in [PixelSeed::new(4, 8, 9), PixelSeed::new(3, 9, 8), PixelSeed::new(3, 8, 10)] {
        assert_ne!(sample(&other, 0), forward[0]);
    }
}

/// If the lens point were a function of the pixel point, the samples would hit few of the 4x4x4x4 cells; independent
/// points hit 256 (1 - 1/e) = 162 on average.
#[test]
fn pixel_and_lens_points_are_independent() {
    const PIXELS: u32 = 64;
    let (mut met, mut products) = (0, [0.0; 4]);
    for pixel in 0..PIXELS {
        let seed = PixelSeed::new(5, pixel % 8, pixel / 8);
        let mut cells = [false; 256];
        for i in 0..256 {
            let p = sample(&seed, i);
            let cell = p.iter().fold(0, |cell, v| cell * 4 + (v * 4.0) as usize);
            cells[cell] = true;
            for (k, (a, b)) in [(0, 2), (0, 3), (1, 2), (1, 3)].into_iter().enumerate() {
                products[k] += f64::from((p[a] - 0.5) * (p[b] - 0.5)) * 12.0;
            }
        }
        met += cells.iter().filter(|c| **c).count();
    }
    let mean = met as f64 / f64::from(PIXELS);
    let correlations = products.map(|p| p / f64::from(256 * PIXELS));
    println!("cells met {mean:.1} (independent 162), correlations {correlations:.4?}");
    assert!((mean - 162.0).abs() < 10.0);
    // The standard deviation of each correlation of independent points is 1 / sqrt(256 * 64) = 0.008.
    assert!(correlations.iter().all(|c| c.abs() < 0.04));
}

/// The error of every layer at 256 samples is below a third of its error at 16 samples.
#[test]
fn error_falls_with_samples() {
    let relief = |key: u64, size: [usize; 2]| {
        let depth = move |i: usize, j: usize| 0.8 + 2.5 * noise(i / 4, j / 4, key).round();
        Photo::new(size, [96, 96], [0.33; 2], depth, move |i, j| {
            [0, 1, 2].map(|c| noise(i / 5, j / 5, key + 3 + c))
        })
    };
    let mut case = Case::new(relief(1, [40, 40]), relief(2, [36, 36]));
    case.film = [24, 24];
    case.focus_m = 1.5;
    let render = |spp: u32, seed: u64| {
        let mut case = case.clone();
        (case.spp, case.seed) = (spp, seed);
        whole_film(&case.scene(), Isa::detect()).pixels
    };
    let reference = render(8192, 99);
    let rmse = |spp: u32| {
        let mut squares = [0.0; 4];
        for (pixel, truth) in render(spp, 1).iter().zip(&reference) {
            for layer in 0..4 {
                for c in 0..3 {
                    squares[layer] +=
                        f64::from(pixel.mean[layer][c] - truth.mean[layer][c]).powi(2);
                }
            }
        }
        squares.map(|s| (s / (3.0 * reference.len() as f64)).sqrt())
    };
    let (few, many) = (rmse(16), rmse(256));
    println!("RMSE of I, T, R~, R: 16 samples {few:?}, 256 samples {many:?}");
    for layer in 0..3 {
        assert!(many[layer] < few[layer] / 3.0);
    }
    // R is in closed form.
    assert_eq!((few[3], many[3]), (0.0, 0.0));
}
