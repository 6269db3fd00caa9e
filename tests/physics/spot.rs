//! A lens spreads the light of one bright texel over the circle of confusion without changing its energy.

use crate::case::{Case, GLASS, Photo, T};
use render::trace::{Isa, Tile, trace_tile};

const TAN: f64 = 0.3;
const TEXELS: usize = 31;

/// Makes a black plane with one texel of `radiance` in the middle.
fn spot(depth_m: f64, radiance: f64) -> Photo {
    let middle = TEXELS / 2;
    let colour =
        move |i: usize, j: usize| [if i == middle && j == middle { radiance } else { 0.0 }; 3];
    Photo::new([8, 8], [TEXELS, TEXELS], [TAN; 2], |_, _| depth_m, colour)
}

fn case(depth_m: f64, focus_m: f64, aperture_m: f64) -> Case {
    let mut case = Case::new(spot(depth_m, 1.0), spot(depth_m, 1.0));
    case.film = [48, 48];
    case.spp = 4096;
    (case.focus_m, case.aperture_m) = (focus_m, aperture_m);
    case
}

/// Order k adds w_k (texel's area in film pixels) (Z / (Z - kappa_k))^2 to the sum over pixels; in T, the weight is 1.
#[test]
fn energy_does_not_depend_on_the_lens() {
    for (depth_m, focus_m, aperture_m) in [
        (2.0, 1.0, 0.00893),
        (2.0, 2.0, 0.00893),
        (1.0, 4.0, 0.03),
        (3.0, f64::INFINITY, 0.02),
        (2.0, 1.0, 0.0),
    ] {
        let case = case(depth_m, focus_m, aperture_m);
        let pixels = case.render();
        let sum = |layer: usize| pixels.iter().map(|p| f64::from(p.mean[layer][0])).sum::<f64>();
        let texel_px =
            2.0 * TAN / TEXELS as f64 * f64::from(case.film[0]) / (2.0 * case.tan_half_fov()[0]);
        let magnified = |kappa: f64| (texel_px * depth_m / (depth_m - kappa)).powi(2);
        let t = magnified(0.01 * (1.0 - 1.0 / 1.6));
        let r = (0.6f64 / 2.6).powi(2);
        let weights = [r, (1.0 - r).powi(2) * r, (1.0 - r).powi(2) * r.powi(3)];
        let glass: f64 = (0..3).map(|k| weights[k] * magnified(-0.02 / 1.6 * k as f64)).sum();
        let (t_off, r_off) = (sum(T) / t - 1.0, sum(GLASS) / glass - 1.0);
        println!(
            "Z {depth_m}, focus {focus_m}, aperture {aperture_m}: T {t_off:.1e}, R~ {r_off:.1e}"
        );
        assert!(t_off.abs() < 4e-3 && r_off.abs() < 4e-3);
    }
}

/// The second moment of the spot equals the sum of those of a uniform disc, a pixel and a texel.
#[test]
fn circle_of_confusion_has_the_expected_radius() {
    for (depth_m, focus_m) in [(2.0, 1.0), (1.0, 4.0), (5.0, f64::INFINITY)] {
        let mut case = case(depth_m, focus_m, 0.02);
        case.film = [129, 129];
        case.spp = 16_384;
        let fine = |i: usize, j: usize| [if i == 64 && j == 64 { 1.0 } else { 0.0 }; 3];
        case.front = Photo::new([8, 8], [129, 129], [TAN; 2], |_, _| depth_m, fine);
        let tile = Tile { x: 57, y: 57, width: 15, height: 15 };
        let pixels = trace_tile(&case.scene(), tile, 0..case.spp, Isa::detect()).pixels;
        let per_tangent = f64::from(case.film[0]) / (2.0 * case.tan_half_fov()[0]);
        let kappa = 0.01 * (1.0 - 1.0 / 1.6);
        let inverse_focus = 1.0 / focus_m;
        let radius = 0.02 * (1.0 / (depth_m - kappa) - inverse_focus).abs() * per_tangent;
        // The variance along an axis is radius^2 / 4 (disc) plus 1/12 (pixel) plus texel^2 / 6 (the texel's hat).
        let (mut mass, mut second) = (0.0, 0.0);
        for (q, pixel) in pixels.iter().enumerate() {
            let x = f64::from(q as u32 % tile.width) - 7.0;
            let value = f64::from(pixel.mean[T][0]);
            mass += value;
            second += value * x * x;
        }
        let texel_px = 2.0 * TAN / 129.0 * per_tangent;
        let blur = second / mass - 1.0 / 12.0 - texel_px * texel_px / 6.0;
        let measured = 2.0 * blur.sqrt();
        println!("Z {depth_m}, focus {focus_m}: radius {measured:.4} px, expected {radius:.4} px");
        assert!((measured / radius - 1.0).abs() < 0.01);
    }
}

/// With the paper's lens, the disc of a light of 1e6 has the expected radius and energy, with and without glass.
#[test]
fn discs_have_the_expected_radii() {
    for (depth_m, focus_m, ior, expected_px) in [
        (2.0, 1.0, 1.0, 2.0549),
        (2.0, 1.0, 1.6, 2.0510),
        (1.0, 4.0, 1.0, 3.0823),
        (1.0, 4.0, 1.6, 3.0978),
        (5.0, f64::INFINITY, 1.0, 0.822),
    ] {
        let mut case = case(depth_m, focus_m, 0.00893);
        case.film = [256, 256];
        case.ior = ior;
        case.spp = 65_536;
        // The spectrum of a two-pixel texel's hat is 0 at the pixels' frequency: a sum over pixels equals the integral.
        const TEXEL_PX: f64 = 2.0;
        const SEEDS: u64 = 2;
        let fine = |i: usize, j: usize| [if i == 1 && j == 1 { 1e6 } else { 0.0 }; 3];
        let per_tangent = 256.0 / (2.0 * case.tan_half_fov()[0]);
        let tan = 3.0 * TEXEL_PX / per_tangent / 2.0;
        case.front = Photo::new([3, 3], [3, 3], [tan; 2], |_, _| depth_m, fine);
        let tile = Tile { x: 122, y: 122, width: 12, height: 12 };
        // T needs only the first order.
        case.tolerance = 1e7;
        let (mut mass, mut second) = (0.0, 0.0);
        for seed in 0..SEEDS {
            case.seed = seed;
            let pixels = trace_tile(&case.scene(), tile, 0..case.spp, Isa::detect()).pixels;
            for (q, pixel) in pixels.iter().enumerate() {
                let value = f64::from(pixel.mean[T][0]) / SEEDS as f64;
                let [x, y] = [q % 12, q / 12].map(|k| k as f64 - 5.5);
                mass += value;
                second += value * (x * x + y * y) / 2.0;
            }
        }
        // The variance along an axis is radius^2 / 4 (disc) plus 1/12 (pixel) plus texel^2 / 6 (the texel's hat).
        let kappa = 0.01 * (1.0 - 1.0 / ior);
        let texel_px = TEXEL_PX * depth_m / (depth_m - kappa);
        let blur = second / mass - 1.0 / 12.0 - texel_px * texel_px / 6.0;
        let radius_px = 2.0 * blur.sqrt();
        // For every lens, the energy is the radiance times the texel's area.
        let energy = mass / (1e6 * texel_px * texel_px);
        println!(
            "Z {depth_m}, focus {focus_m}, index {ior}: {radius_px:.4} px ({expected_px} expected), energy {energy:.5}"
        );
        assert!((radius_px - expected_px).abs() < 1e-3);
        assert!((energy - 1.0).abs() < 1e-3);
    }
}

/// Through a pinhole, the two brightest images in R~ are sharp and 2 h gamma tan_i apart in the pane's plane.
#[test]
fn pinhole_reflection_has_two_bright_sharp_images() {
    let mut case = case(2.0, 2.0, 0.0);
    case.film = [256, 8];
    case.thickness_m = 0.2;
    // The bright column of texels is off-centre, where the ghost is displaced.
    let fine = |i: usize, _: usize| [if i == 20 { 1.0 } else { 0.0 }; 3];
    case.back = Photo::new([8, 8], [101, 5], [0.4; 2], |_, _| 2.0, fine);
    let pixels = case.render();
    let row = &pixels[4 * 256..5 * 256];
    let peaks: Vec<(f64, f64)> = {
        let value = |x: usize| f64::from(row[x].mean[GLASS][0]);
        let mut peaks = vec![];
        let mut x = 0;
        while x < 256 {
            let (mut mass, mut place) = (0.0, 0.0);
            while x < 256 && value(x) > 5e-5 {
                mass += value(x);
                place += value(x) * (x as f64 + 0.5);
                x += 1;
            }
            if mass > 0.0 {
                peaks.push((place / mass, mass));
            }
            x += 1;
        }
        peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
        peaks
    };
    let [tx, _] = case.tan_half_fov();
    let tangent = |place: f64| (2.0 * place / 256.0 - 1.0) * tx;
    // Mirrored x of the column's centre, m.
    let x_m = -((20.5 / 101.0) * 2.0 - 1.0) * 0.4 * 2.0;
    assert!((tangent(peaks[0].0) - x_m / 2.0).abs() < 3e-4, "{peaks:?}");
    let p = tangent(peaks[1].0);
    let gamma = 1.0 / (1.6f64 * 1.6 + (1.6 * 1.6 - 1.0) * p * p).sqrt();
    // The ghost's line is longer by 2 h gamma, and meets the plane at the same point p (Z + 2 h gamma).
    assert!((p * (2.0 + 0.4 * gamma) - x_m).abs() < 1e-3, "{peaks:?}");
    println!("two images at {:.3} and {:.3} px, {} in all", peaks[0].0, peaks[1].0, peaks.len());
}
