//! Probes export the kernel's own rays and samples.

use super::*;

/// The rays that a probe exports in the capture camera's frame hit the sheet at the kernel's hits, on every instruction
/// set, and the counts of the walks are consistent.
#[test]
fn probed_rays_have_the_hits_of_the_kernel() {
    let (mut tested, mut cells) = (0, 0);
    for (tilt_deg, general) in [([0.0, 0.0], false), ([-10.0, 15.0], true)] {
        let scene = scene(tilt_deg, general, false, 2.0);
        for order in [Some(Order::Transmitted(0)), Some(Order::Reflected(1)), None] {
            let probe = BundleProbe::new(&scene, order, 40).expect("a grid to walk");
            let (mut hits, mut again) = (vec![0.0; probe.len()], vec![0.0; probe.len()]);
            probe.intersect(Isa::Baseline, &mut hits);
            probe.intersect(Isa::detect(), &mut again);
            assert_eq!(hits, again);
            let view = probe.view();
            let rays = probe.rays();
            assert_eq!(rays.len(), hits.len());
            for (ray, w) in rays.iter().zip(&hits) {
                let on = |k: usize, v: f32| f64::from(v) * view.focal_px[k].abs();
                let absolute = [
                    on(0, ray.direction[0]) + view.principal[0],
                    on(1, ray.direction[1]) + view.principal[1],
                    on(0, ray.origin[0]),
                    on(1, ray.origin[1]),
                ];
                assert_eq!((ray.origin[2], ray.direction[2]), (0.0, 1.0));
                assert!(agrees(&view.grid, absolute, f64::from(*w)), "{order:?} {absolute:?}: {w}");
                tested += 1;
            }
            let count = probe.count(&hits);
            assert_eq!((count.rays, count.groups * 16), (hits.len() as u64, count.rays));
            assert!(count.cells >= count.rays);
            cells += count.cells;
            assert!(count.rounds * 16 >= count.cells && count.rounds <= count.cells);
        }
    }
    println!("{tested} rays, {cells} cells");
    assert!(cells > tested, "some rays must cross several cells");
    let mut aligned = scene([0.0, 0.0], false, false, 2.0);
    let Surface::Sheet(back) = &mut aligned.back else {
        panic!("the back surface must be a sheet");
    };
    back.pose = Pose::Aligned { extra_m: 0.0 };
    assert!(BundleProbe::new(&aligned, None, 40).is_none());
}

#[test]
fn probed_samples_equal_the_definition() {
    let seeds: [PixelSeed; LANES] = std::array::from_fn(|l| PixelSeed::new(4, 5 + l as u32, 6));
    let samples = sample_patch(Sampling::Sobol, &seeds, 512, Isa::detect());
    for (s, l) in (0..CHUNK).flat_map(|s| (0..LANES).map(move |l| (s, l))) {
        let expected = sample(&seeds[l], 512 + s as u32);
        assert_eq!([0, 1, 2, 3].map(|k| samples[k][s][l]), expected);
    }
    let independent = |isa| sample_patch(Sampling::Independent, &seeds, 512, isa);
    assert_eq!(independent(Isa::Baseline), independent(Isa::detect()));
    assert_ne!(independent(Isa::Baseline), samples);
}
