//! Labels: coverage, depth of the front, and ghosts, compared with f64 code; they change no light.

use crate::case::{Case, GLASS, bumpy, whole_film};
use crate::cover::{Edges, Place, noisy_card};
use crate::invariance::bits;
use crate::reference::Reference;
use crate::stack::double_pane;
use glam::DVec3;
use glasshouse_line::label::{Label, LabelSet};
use render::trace::{Isa, Order, PixelSeed, sample};

fn all_labels() -> LabelSet {
    let mut labels = LabelSet::default();
    for label in [Label::Coverage, Label::FrontDepth, Label::Ghosts] {
        assert!(labels.insert(label));
    }
    labels
}

fn window() -> Case {
    let mut case = Case::new(bumpy(3, false), bumpy(4, false));
    (case.film, case.spp, case.tilt_deg) = ([23, 18], 64, [4.0, 12.0]);
    case.covered.edges = Some(Edges {
        x_m: [-0.05, 0.06],
        y_m: [-0.04, 0.05],
        frame_m: 0.01,
        frame_radiance: [0.3, 0.2, 0.1],
    });
    case.covered.cards = [vec![noisy_card(0.7, [0.1, 0.0], 0.4, 3)], vec![]];
    case
}

/// Layers keep their bits, in every kind of pane; tiles and instruction sets change no label.
#[test]
fn labels_change_no_layer_and_do_not_depend_on_tiles() {
    let mut double = window();
    double.stack = Some(double_pane());
    let mut rough = window();
    rough.roughness = Some(vec![0.02; 2]);
    let mut bent = window();
    bent.bow_radius_m = Some(4.0);
    for case in [window(), double, rough, bent] {
        let plain = whole_film(&case.scene(), Isa::Baseline);
        assert!(plain.labels.is_empty());
        let labelled = Case { labels: all_labels(), ..case };
        let scene = labelled.scene();
        let whole = whole_film(&scene, Isa::detect());
        assert!(bits(&plain.pixels) == bits(&whole.pixels));
        assert_eq!(whole_film(&scene, Isa::Baseline).labels, whole.labels);
        let tile = render::trace::Tile { x: 9, y: 6, width: 11, height: 7 };
        let part = render::trace::trace_tile(&scene, tile, 0..scene.spp, Isa::detect());
        for (label, values) in &part.labels {
            let channels = label.channels().len();
            for (q, value) in values.chunks(channels).enumerate() {
                let (x, y) = (9 + q % 11, 6 + q / 11);
                let at = (y * 23 + x) * channels;
                assert_eq!(value, &whole.labels[label][at..at + channels], "{label}");
            }
        }
        // Later samples have no depth of their own.
        let later = render::trace::trace_tile(&scene, tile, 32..64, Isa::detect());
        assert!(!later.labels.contains_key(&Label::FrontDepth));
        assert!(later.labels.contains_key(&Label::Coverage));
    }
}

/// Coverage is the share of the camera samples that the f64 camera sees meet glass.
#[test]
fn coverage_counts_the_rays_that_meet_glass() {
    let case = Case { labels: all_labels(), ..window() };
    let scene = case.scene();
    let found = &whole_film(&scene, Isa::detect()).labels[&Label::Coverage];
    let reference = Reference::new(&case, &scene);
    let (mut inside, mut partial, mut off) = (0, 0, 0);
    for y in 0..18u32 {
        for x in 0..23u32 {
            let seed = PixelSeed::new(scene.seed, x, y);
            let meets = (0..case.spp).filter(|s| {
                let (_, lens, d) = reference.camera(x, y, sample(&seed, *s));
                case.covered.place(&case, lens, d) == Place::Glass
            });
            let expected = meets.count() as f64 / f64::from(case.spp);
            let found = f64::from(found[(y * 23 + x) as usize]);
            // A ray within rounding of an edge may fall on its other side.
            off += u32::from(found != expected);
            assert!((found - expected).abs() <= 1.0 / f64::from(case.spp));
            inside += u32::from(expected == 1.0);
            partial += u32::from(expected > 0.0 && expected < 1.0);
        }
    }
    assert!(inside > 20 && partial > 20 && off < 3, "{inside} {partial} {off}");
    // Without an outline, every ray meets the glass.
    let mut open = case.clone();
    open.covered.edges = None;
    let labels = whole_film(&open.scene(), Isa::detect()).labels;
    assert!(labels[&Label::Coverage].iter().all(|v| *v == 1.0));
}

/// The depth is that of the first surface on the line of t_0 of the central ray, in f64.
#[test]
fn front_depth_is_that_of_the_central_ray() {
    let mut plain = window();
    plain.covered = crate::cover::Covered::default();
    let mut double = plain.clone();
    double.stack = Some(double_pane());
    let mut bent = plain.clone();
    bent.bow_radius_m = Some(-4.0);
    for case in [plain, double, bent] {
        let case = Case { labels: all_labels(), ..case };
        let scene = case.scene();
        let found = &whole_film(&scene, Isa::detect()).labels[&Label::FrontDepth];
        let reference = Reference::new(&case, &scene);
        let mut far = 0;
        for (q, found) in found.iter().enumerate() {
            let (x, y) = ((q % 23) as f64 + 0.5, (q / 23) as f64 + 0.5);
            let d = reference.pinhole(x, y).normalize();
            let z = reference.front_depth_m(Order::Transmitted(0), DVec3::ZERO, d);
            // A ray may fall on the other side of a depth edge.
            far += u32::from((f64::from(*found) / z - 1.0).abs() > 1e-5);
        }
        assert!(far <= 2, "{far} of {}", found.len());
    }
    // Frames and opaque parts of cards are nearer than the surface.
    let case = Case { labels: all_labels(), ..window() };
    let depth = &whole_film(&case.scene(), Isa::detect()).labels[&Label::FrontDepth];
    let share = |least: f32, most: f32| {
        depth.iter().filter(|z| (least..most).contains(*z)).count() as f64 / depth.len() as f64
    };
    assert!(share(0.25, 0.4) > 0.05 && share(0.699, 0.701) > 0.02 && share(1.0, 3.1) > 0.3);
}

/// R~ is the order r_0 plus the ghosts.
#[test]
fn ghosts_are_the_reflection_without_its_first_order() {
    let mut double = window();
    double.stack = Some(double_pane());
    let mut rough = window();
    rough.roughness = Some(vec![0.02; 2]);
    let mut adaptive = window();
    adaptive.spp = 256;
    for (case, target_error) in
        [(window(), None), (double, None), (rough, None), (adaptive, Some(5e-3))]
    {
        let case = Case { labels: all_labels(), ..case };
        let mut scene = case.scene();
        scene.target_error = target_error;
        let all = whole_film(&scene, Isa::detect());
        // With `first_reflection_alone`, I has the same rays, so an adaptive scene takes as many samples.
        scene.first_reflection_alone = true;
        let first = whole_film(&scene, Isa::detect());
        let mut brightest = 0f32;
        for (q, (all_of, first_of)) in all.pixels.iter().zip(&first.pixels).enumerate() {
            for c in 0..3 {
                let ghosts = all.labels[&Label::Ghosts][3 * q + c];
                let sum = first_of.mean[GLASS][c] + ghosts;
                if target_error.is_none() {
                    assert!((sum - all_of.mean[GLASS][c]).abs() <= 1e-6 * (1.0 + sum));
                }
                assert!(ghosts >= 0.0 && ghosts <= all_of.mean[GLASS][c]);
                brightest = brightest.max(ghosts);
            }
        }
        assert!(brightest > 0.01, "{brightest}");
    }
}
