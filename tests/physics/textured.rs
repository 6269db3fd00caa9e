//! Random panes between coloured, textured photographs, in which light in a wrong place shows.

use crate::case::{Case, I, bumpy, noise};
use crate::panes::pane;
use crate::reference::Reference;
use crate::rough::RoughReference;
use render::trace::PixelSeed;

/// Number of panes.
const PANES: usize = 40;

/// Returns a random pane between textured photographs.
fn textured(number: usize) -> Case {
    let (mut case, _) = pane(number);
    (case.front, case.back) = (bumpy(1, false), bumpy(2, false));
    case
}

/// Walks of random choices follow all light to its end, in f64. Where they differ from the tracer, the plan states it.
#[test]
fn misplaced_and_lost_light_is_stated() {
    for number in 0..PANES {
        let mut case = textured(number);
        (case.film, case.spp) = ([4, 4], 512);
        let scene = case.scene();
        let pixels = case.render();
        let reference = Reference::new(&case, &scene);
        let walker = RoughReference::of_any(&case);
        let (mut sums, mut squares) = ([0.0; 3], [0.0; 3]);
        let mut count = 0.0;
        for (q, pixel) in (0..).zip(&pixels) {
            let (x, y) = (q % 4, q / 4);
            let seed = PixelSeed::new(scene.seed, x, y);
            for s in 0..case.spp {
                let choice = |k: usize| noise(q as usize * 4096 + s as usize, k, 991);
                let walked = reference.walked(&walker, [x, y], (&seed, s), choice);
                for c in 0..3 {
                    let difference = walked[c] - f64::from(pixel.mean[I][c]);
                    sums[c] += difference;
                    squares[c] += difference * difference;
                }
                count += 1.0;
            }
        }
        let orders = &scene.orders;
        let stated = orders.dropped.iter().sum::<f64>() + orders.shadowed;
        for c in 0..3 {
            let noise = (squares[c] / count).sqrt() / f64::sqrt(count);
            let difference = sums[c] / count;
            println!("pane {number}: {difference:+.1e}, stated {stated:.1e}, noise {noise:.1e}");
            assert!(difference.abs() <= stated + 4.0 * noise + 1e-5, "pane {number}");
        }
    }
}

/// Returns the mean square over pixels and colours.
fn mean_square(of: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = of.fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
    sum / count
}

/// 256 times as many samples leave at most a tenth of the error, and at most a quarter in the worst seed.
#[test]
#[ignore = "takes 10 minutes"]
fn errors_shrink_with_the_number_of_samples() {
    const SEEDS: u64 = 16;
    let mut ratios = vec![];
    for number in 0..PANES {
        let pictures = [64, 16_384].map(|spp| -> Vec<Vec<f64>> {
            let of_seed = |seed| {
                let mut case = textured(number);
                (case.film, case.spp, case.seed) = ([4, 4], spp, 100 + seed);
                let pixels = case.render();
                pixels.iter().flat_map(|pixel| pixel.mean[I].map(f64::from)).collect()
            };
            (0..SEEDS).map(of_seed).collect()
        });
        let n = SEEDS as f64;
        let mean: Vec<f64> = (0..pictures[1][0].len())
            .map(|k| pictures[1].iter().map(|picture| picture[k]).sum::<f64>() / n)
            .collect();
        let error = |picture: &Vec<f64>| {
            mean_square(picture.iter().zip(&mean).map(|(value, mean)| value - mean)).sqrt()
        };
        let errors = pictures.map(|of| of.iter().map(error).collect::<Vec<f64>>());
        let [few, many] = errors.each_ref().map(|of| mean_square(of.iter().copied()).sqrt());
        let worst = errors[1].iter().copied().fold(0.0, f64::max);
        println!(
            "pane {number}: error {few:.2e} with 64 samples, {many:.2e} with 16,384: {:.4}, worst seed {:.4}",
            many / few,
            worst / few
        );
        ratios.push((number, many / few, worst / few));
    }
    for (number, ratio, worst) in ratios {
        assert!(ratio <= 0.1 && worst <= 0.25, "pane {number}: {ratio}, worst seed {worst}");
    }
}
