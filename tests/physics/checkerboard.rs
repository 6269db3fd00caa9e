//! R of a checkerboard with fields of one texel, averaged over boxes of m texels, has a closed form.

use crate::case::{CLEAN, Case, Photo};

/// Integrates the triangle wave (period 2, 1 at even and -1 at odd integers) from 0 to `x`; the result has period 2.
fn integral(x: f64) -> f64 {
    let r = x.abs() % 2.0;
    let value = if r <= 1.0 { r - r * r } else { (r - 1.0) * (r - 2.0) };
    value * x.signum()
}

/// Returns the mean of the wave over a box of `m` texels around `c`.
fn mean(c: f64, m: f64) -> f64 {
    (integral(c + m / 2.0) - integral(c - m / 2.0)) / m
}

#[test]
fn means_match_values_computed_by_hand() {
    for (c, m, expected) in
        [(0.0, 1.0, 0.5), (0.0, 2.0, 0.0), (0.0, 3.0, -1.0 / 6.0), (0.3, 1.7, 0.070_588)]
    {
        assert!((mean(c, m) - expected).abs() < 1e-6);
    }
}

#[test]
fn clean_reflection_is_the_box_filtered_photograph() {
    for (texels, pixels) in [(12usize, 12u32), (24, 12), (36, 12), (17, 10), (12, 40)] {
        let board = |i: usize, j: usize| [f64::from(u8::from((i + j).is_multiple_of(2))); 3];
        let tan = Case::new(Photo::flat(1.0, [0.0; 3]), Photo::flat(1.0, [0.0; 3])).tan_half_fov();
        let back = Photo::new([5, 6], [texels, texels], tan, |i, _| 1.0 + i as f64, board);
        let mut case = Case::new(Photo::flat(1.0, [0.0; 3]), back);
        case.film = [pixels; 2];
        case.spp = 4096;
        case.tilt_deg = [0.0, 20.0];
        let m = texels as f64 / f64::from(pixels);
        let center = |k: u32| (f64::from(k) + 0.5) * m - 0.5;
        let mut worst = 0f64;
        let rendered = case.render();
        for y in 0..pixels {
            for x in 0..pixels {
                let (cu, cv) = (center(pixels - 1 - x), center(y));
                // Within half a texel of the border, the photograph is constant.
                let inside = |c: f64| c - m / 2.0 >= 0.0 && c + m / 2.0 <= texels as f64 - 1.0;
                if inside(cu) && inside(cv) {
                    let expected = 0.5 + 0.5 * mean(cu, m) * mean(cv, m);
                    let value = rendered[(y * pixels + x) as usize].mean[CLEAN][0];
                    worst = worst.max((f64::from(value) - expected).abs());
                }
            }
        }
        println!("checkerboard, {m:.2} texels a pixel: {worst:.1e}");
        // R takes 1,024 points over at most three texels.
        assert!(worst < 3e-3);
    }
}
