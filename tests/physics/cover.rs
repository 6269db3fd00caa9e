//! Panes that end inside the picture, frames and cards: light is kept, layers stay consistent, and edges are as sharp as the lens
//! leaves them.

use crate::case::{CLEAN, Case, GLASS, I, Photo, T, bumpy, noise, whole_film};
use crate::furnace::assert_only_the_reflection_differs;
use glam::{DMat3, DVec3};
use render::trace::{Card, Cover, Isa, Outline, Texture};
use std::sync::Arc;

/// Objects that cover a part of the picture, in the world's coordinates.
#[derive(Clone, Debug, Default)]
pub(crate) struct Covered {
    pub(crate) edges: Option<Edges>,
    /// Cards of the front and of the back, the farthest first.
    pub(crate) cards: [Vec<Flat>; 2],
}

/// Edges of the pane, and its frame.
#[derive(Clone, Debug)]
pub(crate) struct Edges {
    pub(crate) x_m: [f64; 2],
    pub(crate) y_m: [f64; 2],
    pub(crate) frame_m: f64,
    pub(crate) frame_radiance: [f32; 3],
}

/// A place at which a camera ray meets the pane's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Place {
    Glass,
    Frame,
    Beside,
}

/// A card in a plane of constant z, with radiance times alpha, and alpha.
#[derive(Clone, Debug)]
pub(crate) struct Flat {
    /// Distance before the lens (front) or behind it (back).
    pub(crate) distance_m: f64,
    pub(crate) center_m: [f64; 2],
    pub(crate) width_m: f64,
    pub(crate) size: [usize; 2],
    pub(crate) texels: Vec<[f32; 4]>,
}

/// Returns the rotation of the pane's axes.
fn rotation(tilt_deg: [f64; 2]) -> DMat3 {
    let [pitch, yaw] = tilt_deg.map(f64::to_radians);
    DMat3::from_rotation_y(yaw) * DMat3::from_rotation_x(pitch)
}

impl Covered {
    /// Returns the place at which a ray meets the pane's plane.
    pub(crate) fn place(&self, case: &Case, origin: DVec3, d: DVec3) -> Place {
        let Some(edges) = &self.edges else {
            return Place::Glass;
        };
        let (normal, distance_m) = case.pane();
        let point = origin + (distance_m - origin.dot(normal)) / d.dot(normal) * d;
        let at = rotation(case.tilt_deg).transpose() * (point - case.distance_m * DVec3::Z);
        let beyond = |v: f64, [lo, hi]: [f64; 2]| f64::max(lo - v, v - hi);
        let beyond_m = beyond(at.x, edges.x_m).max(beyond(at.y, edges.y_m));
        match beyond_m {
            _ if beyond_m <= 0.0 => Place::Glass,
            _ if beyond_m <= edges.frame_m => Place::Frame,
            _ => Place::Beside,
        }
    }

    /// Makes the tracer's cover.
    pub(crate) fn cover(&self, case: &Case) -> Cover {
        let axes = rotation(case.tilt_deg);
        let (normal, distance_m) = case.pane();
        let mirrored = |d: DVec3| d - 2.0 * d.dot(normal) * normal;
        let [front, back] = [false, true].map(|is_back| {
            let cards = self.cards[usize::from(is_back)].iter().map(|card| {
                let [corner, across, down] = card.edges(is_back);
                let texture = Texture::new(card.size[0], card.size[1], &card.texels);
                if is_back {
                    let corner = mirrored(corner) + 2.0 * distance_m * normal;
                    Card::new(corner, mirrored(across), mirrored(down), Arc::new(texture))
                } else {
                    Card::new(corner, across, down, Arc::new(texture))
                }
            });
            cards.collect()
        });
        let outline = self.edges.as_ref().map(|edges| Outline {
            axes: [axes.x_axis, axes.y_axis],
            distance_m: case.distance_m,
            glass_m: [edges.x_m, edges.y_m],
            frame_m: edges.frame_m,
            frame_radiance: edges.frame_radiance,
        });
        Cover { outline, cards: [front, back] }
    }
}

impl Flat {
    /// Returns the upper left corner, the upper and the left edge in the world.
    fn edges(&self, is_back: bool) -> [DVec3; 3] {
        let height_m = self.width_m * self.size[1] as f64 / self.size[0] as f64;
        let (side, z) = if is_back { (-1.0, -self.distance_m) } else { (1.0, self.distance_m) };
        let [x, y] = self.center_m;
        [
            DVec3::new(x - side * 0.5 * self.width_m, y - 0.5 * height_m, z),
            DVec3::X * (side * self.width_m),
            DVec3::Y * height_m,
        ]
    }

    /// Returns the position of a ray's point on the card, in lengths of `d`, and the radiance times alpha and alpha there.
    pub(crate) fn seen(&self, is_back: bool, origin: DVec3, d: DVec3) -> Option<(f64, [f64; 4])> {
        let [corner, across, down] = self.edges(is_back);
        let t = (corner.z - origin.z) / d.z;
        let at = origin + t * d - corner;
        let (u, v) =
            (at.dot(across) / across.length_squared(), at.dot(down) / down.length_squared());
        let unit = 0.0..=1.0;
        if t <= 0.0 || !unit.contains(&u) || !unit.contains(&v) {
            return None;
        }
        let [columns, rows] = self.size;
        let along = |at: f64, n: usize| (at * n as f64 - 0.5).clamp(0.0, n as f64 - 1.0);
        let (x, y) = (along(u, columns), along(v, rows));
        let (i, j) = (x as usize, y as usize);
        let (i1, j1) = ((i + 1).min(columns - 1), (j + 1).min(rows - 1));
        let (fx, fy) = (x - i as f64, y - j as f64);
        let texel = |i: usize, j: usize, k: usize| f64::from(self.texels[j * columns + i][k]);
        let mix = |k: usize| {
            (texel(i, j, k) * (1.0 - fx) + texel(i1, j, k) * fx) * (1.0 - fy)
                + (texel(i, j1, k) * (1.0 - fx) + texel(i1, j1, k) * fx) * fy
        };
        Some((t, [mix(0), mix(1), mix(2), mix(3)]))
    }
}

/// Makes a card with noise for colour and alpha.
pub(crate) fn noisy_card(distance_m: f64, center_m: [f64; 2], width_m: f64, key: u64) -> Flat {
    let size = [7, 5];
    let texel = |q: usize| {
        let alpha = (1.5 * noise(q, 3, key) - 0.2).clamp(0.0, 1.0);
        let colour = |c: u64| (noise(q, 7, key + c) * alpha) as f32;
        [colour(1), colour(2), colour(3), alpha as f32]
    };
    let texels = (0..size[0] * size[1]).map(texel).collect();
    Flat { distance_m, center_m, width_m, size, texels }
}

pub(crate) fn small_window() -> Edges {
    Edges { x_m: [-0.05, 0.06], y_m: [-0.04, 0.05], frame_m: 0.015, frame_radiance: [1.0; 3] }
}

/// Everything is white: photographs, frame and cards. Where the camera looks past the glass, it sees no reflection.
#[test]
fn a_white_window_is_white() {
    let mut case = Case::new(bumpy(1, true), bumpy(2, true));
    case.film = [24, 20];
    case.covered.edges = Some(small_window());
    let white = Flat { texels: vec![[1.0; 4]; 35], ..noisy_card(0.7, [0.02, 0.01], 0.1, 1) };
    let veil = Flat { texels: vec![[0.4; 4]; 35], distance_m: 0.5, ..white.clone() };
    case.covered.cards = [vec![white.clone(), veil.clone()], vec![white, veil]];
    case.tolerance = 0.0;
    for tilt_deg in [[0.0, 0.0], [8.0, -25.0]] {
        case.tilt_deg = tilt_deg;
        let pixels = case.render();
        for pixel in &pixels {
            for c in 0..3 {
                assert!((f64::from(pixel.mean[I][c]) - 1.0).abs() < 1e-5, "{pixel:?}");
                assert!((pixel.mean[T][c] - 1.0).abs() < 1e-6);
            }
        }
        let beside = pixels.iter().filter(|pixel| pixel.mean[CLEAN] == [0.0; 3]).count();
        let glass = pixels.iter().filter(|pixel| pixel.mean[CLEAN][0] > 0.999).count();
        println!("tilt {tilt_deg:?}: {glass} pixels of glass, {beside} beside it");
        assert!(glass > 50 && beside > 50);
        assert!(pixels.iter().any(|pixel| pixel.mean[GLASS] == [0.0; 3]));
    }
}

/// A frame that the pane does not show, and a card that no ray meets, change no bit, on either instruction set; nor does a
/// transparent card.
#[test]
fn cover_out_of_sight_changes_no_bit() {
    let mut plain = Case::new(bumpy(3, false), bumpy(4, false));
    (plain.film, plain.tilt_deg) = ([13, 9], [4.0, 12.0]);
    let mut case = plain.clone();
    case.covered.edges = Some(Edges { x_m: [-2.0, 2.0], y_m: [-2.0, 2.0], ..small_window() });
    let far_off = noisy_card(0.6, [3.0, 0.0], 0.5, 5);
    let clear = Flat { texels: vec![[0.0; 4]; 35], ..noisy_card(0.8, [0.0, 0.0], 2.0, 5) };
    case.covered.cards = [vec![clear.clone(), far_off.clone()], vec![clear, far_off]];
    let expected = plain.render();
    for isa in [Isa::detect(), Isa::Baseline] {
        for (pixel, expected) in whole_film(&case.scene(), isa).pixels.iter().zip(&expected) {
            // R is sampled, because its closed form knows no cards.
            assert_eq!(pixel.mean[..3], expected.mean[..3]);
            let r = [pixel, expected].map(|pixel| f64::from(pixel.mean[CLEAN][0]));
            assert!((r[0] - r[1]).abs() < 2e-2, "{r:?}");
        }
    }
}

/// I less R~ is what the front shows through the glass and beside it, whatever the back is.
#[test]
fn input_minus_reflection_is_the_covered_front() {
    let mut case = Case::new(bumpy(3, false), bumpy(4, false));
    (case.film, case.tilt_deg, case.absorption_per_m) = ([21, 15], [5.0, -15.0], [3.0, 0.0, 9.0]);
    case.covered.edges = Some(Edges { frame_radiance: [0.3, 0.2, 0.7], ..small_window() });
    case.covered.cards =
        [vec![noisy_card(0.9, [0.0, 0.0], 0.2, 8)], vec![noisy_card(0.3, [0.1, 0.0], 0.4, 9)]];
    assert_only_the_reflection_differs(&case);
}

/// The penumbra of an opaque card's straight edge is the share of the lens disc on one side of a chord.
#[test]
fn a_penumbra_is_the_integral_over_the_lens() {
    let mut case = Case::new(Photo::flat(40.0, [1.0; 3]), Photo::flat(40.0, [0.0; 3]));
    (case.film, case.spp) = ([64, 4], 65_536);
    (case.aperture_m, case.focus_m) = (0.02, 3.0);
    (case.thickness_m, case.ior, case.focal_length_mm) = (0.0, 1.0, 400.0);
    // The left edge of the black card is at x = 0.013 m.
    let (z_m, edge_m) = (0.8, 0.013);
    let card = Flat {
        texels: vec![[0.0, 0.0, 0.0, 1.0]; 35],
        ..noisy_card(z_m, [edge_m + 1.0, 0.0], 2.0, 0)
    };
    case.covered.cards[0] = vec![card];
    let tangent = |x: f64| (2.0 * x / 64.0 - 1.0) * case.tan_half_fov()[0];
    // The point at z is f z + a (1 - z / focus) for lens point a: visible are lens points left of a chord.
    let visible = |f: f64| {
        let chord = (edge_m - f * z_m) / (1.0 - z_m / case.focus_m) / case.aperture_m;
        let t = chord.clamp(-1.0, 1.0);
        0.5 + (t * (1.0 - t * t).sqrt() + t.asin()) / std::f64::consts::PI
    };
    let pixels = case.render();
    let (mut partial, mut worst) = (0, 0f64);
    for x in 0..64 {
        let points = 200;
        let at = |k: usize| x as f64 + (k as f64 + 0.5) / points as f64;
        let expected = (0..points).map(|k| visible(tangent(at(k)))).sum::<f64>() / points as f64;
        let of_rows = (0..4).map(|y| f64::from(pixels[64 * y + x].mean[T][0]));
        let mean = of_rows.sum::<f64>() / 4.0;
        worst = worst.max((mean - expected).abs());
        partial += usize::from(expected > 0.02 && expected < 0.98);
    }
    println!("{partial} pixels in the penumbra, error at most {worst:.1e}");
    assert!(partial > 15 && worst < 6e-4, "{partial}, {worst}");
}
