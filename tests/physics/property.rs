//! Checks bounds and invariances of random scenes with extreme depths, lights, panes, lenses and films.

use crate::case::{Apex, Case, Photo, noise, whole_film};
use crate::invariance::{bits, tiled};
use proptest::prelude::*;
use render::trace::{FollowedOrder, Isa, OrderPlan, PixelMeans};

/// Maps a uniform number to a depth, m.
fn depth(kind: u8, x: f64) -> f64 {
    match kind {
        0 => 2.0,
        1 => 0.6 + 3.0 * x,
        2 => 0.5 + (x * 3.0).floor() * 4.0,
        // Millimetres to a hundred kilometres.
        _ => 10f64.powf(-3.0 + 8.0 * x),
    }
}

/// Maps a uniform number to a radiance.
fn radiance(kind: u8, x: f64) -> f64 {
    match kind {
        0 => x,
        1 => (x * 2.0).floor(),
        2 => 0.0,
        // A few lights on a dark background.
        _ if x > 0.9 => 1e6 * x,
        _ => 0.01 * x,
    }
}

prop_compose! {
    fn photo()(
        size in [1usize..9, 1usize..9], texture in [1usize..9, 1usize..9], key in 0u64..1 << 32,
        depth_kind in 0u8..5, radiance_kind in 0u8..5, tan in [0.05f64..0.9, 0.05f64..0.9],
        shift in [-0.4f64..0.4, -0.4f64..0.4],
    ) -> Photo {
        let mut photo = Photo::new(
            size, texture, tan,
            |i, j| depth(depth_kind, noise(i, j, key)),
            |i, j| [1, 2, 3].map(|c| radiance(radiance_kind, noise(i, j, key + c))),
        );
        // Moves the principal point away from the centre.
        for k in 0..2 {
            photo.center_px[k] += shift[k] * size[k] as f64;
        }
        photo
    }
}

prop_compose! {
    fn lens()(
        focal_length_mm in 18f64..300.0, aperture_m in prop_oneof![Just(0.0), Just(0.00893), 0f64..0.04],
        focus_m in prop_oneof![Just(f64::INFINITY), 0.3f64..20.0],
    ) -> [f64; 3] { [focal_length_mm, aperture_m, focus_m] }
}

prop_compose! {
    fn pane()(
        distance_m in 0.1f64..2.0, thickness_m in prop_oneof![Just(0.0), Just(0.01), 0f64..0.1],
        ior in prop_oneof![Just(1.0), Just(1.6), 1f64..2.4],
        absorption_per_m in prop_oneof![Just([0.0; 3]), [0f64..80.0, 0f64..80.0, 0f64..80.0]],
        tilt_deg in prop_oneof![Just([0.0; 2]), [-65f64..65.0, -65f64..65.0]],
    ) -> (f64, f64, f64, [f64; 3], [f64; 2]) { (distance_m, thickness_m, ior, absorption_per_m, tilt_deg) }
}

prop_compose! {
    fn case()(
        front in photo(), back in photo(), lens in lens(), pane in pane(), film in [1u32..9, 1u32..7],
        spp_log2 in 0u32..8, gaussian: bool, is_camera: bool, seed: u64,
        tolerance in prop_oneof![Just(7.6e-5), Just(1e-9), Just(1e-2)],
    ) -> Case {
        let mut case = Case::new(front, back);
        [case.focal_length_mm, case.aperture_m, case.focus_m] = lens;
        (case.distance_m, case.thickness_m, case.ior, case.absorption_per_m, case.tilt_deg) = pane;
        (case.film, case.spp, case.gaussian, case.seed, case.tolerance) = (film, 1 << spp_log2, gaussian, seed, tolerance);
        case.apex = if is_camera { Apex::Camera } else { Apex::Mirror };
        case
    }
}

/// Returns the smallest and the largest value of any colour.
fn range(photo: &Photo) -> [f64; 2] {
    let values = photo.texels.iter().flat_map(|t| &t[..3]);
    values.fold([f64::INFINITY, 0.0], |[lo, hi], &v| [lo.min(f64::from(v)), hi.max(f64::from(v))])
}

/// Returns an upper bound of the light of thinned orders. Their means are over fewer samples than other means.
fn thinned_excess(list: &[FollowedOrder], max_radiance: f64) -> f64 {
    let thinned = list.iter().filter(|f| f.worth.is_finite());
    thinned.map(|f| f.max_weight * max_radiance * 1.01).sum()
}

/// Bound of the relative rounding error of f32 sums of at most 128 samples.
const ROUNDING: f64 = 1e-5;

fn within_bounds(
    case: &Case,
    orders: &OrderPlan,
    pixel: &[[f32; 3]; 4],
) -> Result<(), TestCaseError> {
    let [f_lo, f_hi] = range(&case.front);
    let [b_lo, b_hi] = range(&case.back);
    let excess = thinned_excess(&orders.front, f_hi) + thinned_excess(&orders.back, b_hi);
    let mixed = f_hi.max(b_hi) + excess;
    // An absorbing pane may darken all light; otherwise, only thinned orders and rough faces may lose light.
    let lost = excess + orders.shadowed;
    let floor =
        if case.absorption_per_m == [0.0; 3] { (f_lo.min(b_lo) - lost).max(0.0) } else { 0.0 };
    let bounds = [[floor, mixed], [f_lo, f_hi], [0.0, b_hi + excess], [b_lo, b_hi]];
    for (layer, [lo, hi]) in bounds.into_iter().enumerate() {
        for value in pixel[layer].map(f64::from) {
            prop_assert!(value.is_finite() && value >= 0.0);
            prop_assert!(
                value >= lo * (1.0 - ROUNDING) - ROUNDING * f_hi.max(b_hi)
                    && value <= hi * (1.0 + ROUNDING),
                "layer {layer}: {value} outside [{lo}, {hi}]"
            );
        }
    }
    Ok(())
}

fn ulps(a: f32, b: f32, scale: f32) -> f32 {
    (a - b).abs() / (scale.next_up() - scale)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn every_scene_renders_within_its_bounds(case in case()) {
        // `scene::assemble` refuses grazing rays, and a pane that cuts the lens.
        let (normal, distance_m) = case.pane();
        prop_assume!(case.steepest_cos() > f64::to_radians(85.0).cos());
        prop_assume!(distance_m > case.aperture_m * (1.0 - normal.z * normal.z).sqrt());

        let scene = case.scene();
        let whole = whole_film(&scene, Isa::Baseline);
        for pixel in &whole.pixels {
            within_bounds(&case, &scene.orders, &pixel.mean)?;
            within_bounds(&case, &scene.orders, &pixel.half)?;
        }
        for layer in 0..4 {
            prop_assert!(whole.misses.0[layer] <= whole.paths.0[layer]);
        }

        // Bits depend on neither the instruction set nor the tiles.
        prop_assert!(whole == whole_film(&scene, Isa::detect()));
        for side in [1, 3] {
            prop_assert!(bits(&whole.pixels) == bits(&tiled(&scene, side, Isa::detect())));
        }

        // Input minus glass reflection is the front through the real glass.
        let mut dark = case.clone();
        dark.back.texels.fill([0.0; 4]);
        let dark_scene = dark.scene();
        prop_assert_eq!(&dark_scene.orders.front, &scene.orders.front);
        let alone: Vec<PixelMeans> = whole_film(&dark_scene, Isa::detect()).pixels;
        for (pixel, alone) in whole.pixels.iter().zip(&alone) {
            prop_assert_eq!(pixel.mean[1], alone.mean[1]);
            for c in 0..3 {
                let [i, _, reflected, _] = pixel.mean.map(|layer| layer[c]);
                prop_assert!(ulps(i - reflected, alone.mean[0][c], i) <= 1.0);
            }
        }
    }
}
