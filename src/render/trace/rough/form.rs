//! Rays behind smooth waves and wedges in closed form.
//!
//! Over a small area of the film, the ray of a camera sample leaves a path close to where it would leave flat faces: what waves and wedges
//! change is smooth in its direction, in its place on the pane, and in the phase phi of the waves there. So in each zone of the film ([`super::super::zones`]),
//! each way has the form
//!
//! ```text
//! y(d, a, phi) = p_3(d) + q(a, d) + p_2(d) cos phi + p_2'(d) sin phi + p_1(d) cos 2 phi + p_1'(d) sin 2 phi
//! ```
//!
//! with polynomials p_k of degree k in the direction d and a bilinear q in the lens point a and (1, d), for
//! - the turn of the direction, out minus in, tangents,
//! - the offset at the depth z_e at which the camera ray meets the plane of face 0: the distance between the two rays there, m,
//! - the negative logarithm of the weight of each colour, which is a product of shares of faces.
//!
//! Both rays are close at z_e, so that errors of the turn do not grow with the distance to z = 0 and back. The coefficients are least squares over rays that are
//! followed from face to face; others check them. A zone whose rays have no form this good, because the waves are short or light is
//! totally reflected in a part of it, follows its rays.

use super::super::camera::concentric_disc;
use super::super::isa::Isa;
use super::super::lanes::{CHUNK, LANES, Lane, exp_neg};
use super::super::patch::Patch;
use super::super::sampler::{PixelSeed, SeedLanes, sample};
use super::super::scene::{FilmPlane, Scene};
use super::super::wave::{WaveLanes, sin_cos_turns};
use super::super::zones::ZONE_PX;
use super::RoughPane;
use super::rays::{CameraRays, RoughRays};
use glam::{DVec3, Vec3};
use std::sync::OnceLock;

/// Number of terms without waves: the polynomials of the direction, and those of the lens point.
pub(super) const STILL: usize = 16;
/// The same with waves.
pub(super) const WAVED: usize = 34;
/// Numbers of a way: turn, offset and the weights.
const NUMBERS: usize = 7;

/// Samples of a chunk that are fitted, and all with those that check the fit.
const FITTED: usize = 12;
const TRIED: usize = 16;
/// Largest RMS error of lines, px, on surfaces at any distance behind the pane.
const MOST_PX: f32 = 1.0e-3;
/// The same on finer films, tangents: that of rays that are followed in f32.
const MOST_TANGENT: f32 = 1.0e-6;
/// Largest error of a weight, as a part of it; above `STRONG`, as a part of that.
const MOST_OF_WEIGHT: f32 = 1.0e-4;
const STRONG: f32 = 0.1;
/// Part of a term that others do not explain, below which it is left out: its factor would be rounding alone.
const LEAST_PART: f64 = 1.0e-5;

/// Forms of a scene's zones, which are found when a zone is entered.
#[derive(Default)]
pub struct Forms {
    columns: u32,
    zones: Vec<OnceLock<Option<Box<Form>>>>,
}

impl Forms {
    /// Makes room for the forms of a film.
    pub(in super::super) fn new(film: &FilmPlane) -> Self {
        let [columns, rows] = [film.width, film.height].map(|px| px.div_ceil(ZONE_PX));
        let zones = (0..columns * rows).map(|_| OnceLock::new()).collect();
        Self { columns, zones }
    }

    /// Returns the form of the zone of pixel (`x`, `y`) for the scene's pane; `None` if its rays have to be followed.
    pub(in super::super) fn of(
        &self,
        scene: &Scene,
        pane: &RoughPane,
        [x, y]: [u32; 2],
    ) -> Option<&Form> {
        if !pane.has_forms() {
            return None;
        }
        let zone = [x, y].map(|px| px / ZONE_PX);
        let cell = self.zones.get((zone[1] * self.columns + zone[0]) as usize)?;
        cell.get_or_init(|| Form::fit(scene, pane, zone).map(Box::new)).as_deref()
    }
}

/// The forms of all ways in a zone.
pub(in super::super) struct Form {
    /// Direction of the zone's centre, and half the range of directions, tangents.
    center: [f32; 2],
    reach: [f32; 2],
    /// 1 / radius of the aperture; 0 for a pinhole.
    per_aperture: f32,
    /// Normal of the plane of face 0, and its distance from the lens along the normal, m.
    normal: Vec3,
    plane_m: f32,
    /// Waves in the lens's coordinates, and the distance of the pivot along the optical axis, m.
    wave: Option<WaveLanes>,
    pivot_m: f32,
    /// Factors of the terms of each way's numbers.
    ways: Vec<[[f32; WAVED]; NUMBERS]>,
}

impl Form {
    /// Finds the form of a zone.
    fn fit(scene: &Scene, pane: &RoughPane, zone: [u32; 2]) -> Option<Self> {
        let film = &scene.film;
        let last = [film.width, film.height];
        let beyond_px = film.filter_radius_px() - 0.5;
        let edges = zone.map(|of| of * ZONE_PX);
        let [from, to] = [
            [0, 1].map(|k| f64::from(edges[k]) - beyond_px),
            [0, 1].map(|k| f64::from((edges[k] + ZONE_PX).min(last[k])) + beyond_px),
        ]
        .map(|[x, y]| film.tangent(x, y));
        let spread = scene.lens.aperture_radius_m * scene.lens.inverse_focus_per_m;
        let aperture_m = scene.lens.aperture_radius_m;
        let mut form = Self {
            center: [0, 1].map(|k| (0.5 * (from[k] + to[k])) as f32),
            reach: [0, 1].map(|k| (0.5 * (to[k] - from[k]) + spread) as f32),
            per_aperture: if aperture_m > 0.0 { (1.0 / aperture_m) as f32 } else { 0.0 },
            normal: scene.slab.normal.as_vec3(),
            plane_m: scene.slab.plane_distance_m as f32,
            wave: scene.wave.as_ref().map(|wave| wave.lanes([DVec3::X, DVec3::Y, DVec3::Z])),
            pivot_m: pane.distance_m,
            ways: vec![],
        };
        let patch = Patch {
            corner: edges,
            seeds: SeedLanes::new(|_| PixelSeed::new(0, 0, 0)),
            center: form.center.map(|v| [v; LANES]),
            exact_center: form.center.map(|v| [f64::from(v); LANES]),
        };
        let [mut direction, mut lens] = [[[[0.0; LANES]; CHUNK]; 2]; 2];
        let focus_per_m = scene.lens.inverse_focus_per_m as f32;
        for (s, l) in (0..TRIED).flat_map(|s| (0..LANES).map(move |l| (s, l))) {
            let [u, v, a, b] = sample(&PixelSeed::new(0, 0, 0), (s * LANES + l) as u32);
            let (x, y) = concentric_disc(a, b);
            for (k, (film, disc)) in [(u, x), (v, y)].into_iter().enumerate() {
                // The density of Chebyshev's points, which are dense at the edges, keeps errors there small.
                let at = -libm::cosf(std::f32::consts::PI * film);
                lens[k][s][l] = disc * aperture_m as f32;
                direction[k][s][l] =
                    at * (form.reach[k] - spread as f32) - lens[k][s][l] * focus_per_m;
            }
        }
        let taken = vec![TRIED; pane.ways()];
        let mut camera = CameraRays {
            patch: &patch,
            sampling: scene.sampling,
            direction: &direction,
            lens: &lens,
            taken: &taken,
            form: None,
        };
        let isa = Isa::detect();
        let mut followed = RoughRays::new();
        followed.begin(0, TRIED);
        followed.follow(pane, &camera, isa);
        form.solve(pane, &camera, &followed);
        camera.form = Some(&form);
        let mut formed = RoughRays::new();
        formed.begin(0, TRIED);
        formed.follow(pane, &camera, isa);
        let is_close = (0..pane.joined.count)
            .all(|way| form.is_close(&camera, [&followed, &formed], way, film, pane.colours()));
        is_close.then_some(form)
    }

    /// True if a way's `formed` rays are close to the `followed` ones, where these check the fit.
    fn is_close(
        &self,
        camera: &CameraRays<'_>,
        [followed, formed]: [&RoughRays; 2],
        way: usize,
        film: &FilmPlane,
        colours: usize,
    ) -> bool {
        // Sums of the squares of the errors of directions and of points at the pane, across and down, tangents.
        let mut squares = [0.0; 4];
        for s in FITTED..TRIED {
            let depths_m = self.depths_m(camera, s);
            let [a, b] = [followed, formed].map(|rays| rays.rays(way, s));
            for l in 0..LANES {
                for k in 0..2 {
                    let turn = a.relative[k][l] - b.relative[k][l];
                    let near = turn + (a.point[k][l] - b.point[k][l]) / depths_m[l];
                    squares[k] += turn * turn;
                    squares[2 + k] += near * near;
                }
                for c in 0..colours {
                    let [a, b] = [followed, formed].map(|rays| rays.weights(way)[c][s][l]);
                    // Ways without light have no form.
                    if !(a > 0.0 && (a - b).abs() <= MOST_OF_WEIGHT * a.min(STRONG)) {
                        return false;
                    }
                }
            }
        }
        let pixel = film.pixel_tangent();
        let count = ((TRIED - FITTED) * LANES) as f32;
        squares.iter().enumerate().all(|(k, square)| {
            let most = (MOST_PX * pixel[k % 2] as f32).max(MOST_TANGENT);
            (square / count).sqrt() <= most
        })
    }

    /// Sets the factors to the least squares over the first rays.
    fn solve(&mut self, pane: &RoughPane, camera: &CameraRays<'_>, followed: &RoughRays) {
        let terms = if self.wave.is_some() { WAVED } else { STILL };
        let numbers = pane.joined.count * NUMBERS;
        // Each term of all rays, and the numbers of all ways of each.
        let mut of_terms = vec![vec![]; terms];
        let mut of_numbers = vec![];
        for s in 0..FITTED {
            let values = self.terms::<WAVED>(camera, s);
            let depths_m = self.depths_m(camera, s);
            for l in 0..LANES {
                of_terms.iter_mut().zip(&values).for_each(|(of, term)| of.push(f64::from(term[l])));
                let mut row = Vec::with_capacity(numbers);
                for way in 0..pane.joined.count {
                    let rays = followed.rays(way, s);
                    let turn = [0, 1].map(|k| rays.relative[k][l] - camera.direction[k][s][l]);
                    let offset = [0, 1]
                        .map(|k| (rays.point[k][l] - camera.lens[k][s][l]) + depths_m[l] * turn[k]);
                    let light = followed
                        .weights(way)
                        .each_ref()
                        .map(|of| -libm::log(f64::from(of[s][l]).max(f64::MIN_POSITIVE)));
                    row.extend(turn.into_iter().chain(offset).map(f64::from).chain(light));
                }
                of_numbers.push(row);
            }
        }
        let factors = least_squares(of_terms, &of_numbers, numbers);
        self.ways = (0..pane.joined.count)
            .map(|way| {
                std::array::from_fn(|number| {
                    std::array::from_fn(|term| {
                        factors.get(term).map_or(0.0, |of| of[way * NUMBERS + number] as f32)
                    })
                })
            })
            .collect();
    }

    /// Returns the depths at which camera rays meet the plane of face 0, m.
    #[inline(always)]
    fn depths_m(&self, camera: &CameraRays<'_>, s: usize) -> Lane {
        let mut depths_m = [0.0; LANES];
        let (n, center) = (self.normal, &camera.patch.center);
        for l in 0..LANES {
            let [x, y] = [0, 1].map(|k| center[k][l] + camera.direction[k][s][l]);
            let [ax, ay] = [0, 1].map(|k| camera.lens[k][s][l]);
            depths_m[l] = (self.plane_m - (ax * n.x + ay * n.y)) / (x * n.x + y * n.y + n.z);
        }
        depths_m
    }

    /// Computes the terms of sample `s`.
    #[inline(always)]
    fn terms<const TERMS: usize>(&self, camera: &CameraRays<'_>, s: usize) -> [Lane; TERMS] {
        let mut terms = [[0.0; LANES]; TERMS];
        let center = &camera.patch.center;
        let per_reach = self.reach.map(|reach| 1.0 / reach);
        let mut at = [[0.0; LANES]; 4];
        for k in 0..2 {
            for l in 0..LANES {
                let from = (center[k][l] - self.center[k]) + camera.direction[k][s][l];
                at[k][l] = from * per_reach[k];
                at[2 + k][l] = camera.lens[k][s][l] * self.per_aperture;
            }
        }
        let [u, v, a, b] = &at;
        for l in 0..LANES {
            let (u, v) = (u[l], v[l]);
            let powers = [1.0, u, v, u * u, u * v, v * v];
            for (term, value) in terms.iter_mut().zip(powers) {
                term[l] = value;
            }
            terms[6][l] = u * powers[3];
            terms[7][l] = v * powers[3];
            terms[8][l] = u * powers[5];
            terms[9][l] = v * powers[5];
        }
        for (k, a) in [a, b].into_iter().enumerate() {
            for l in 0..LANES {
                terms[10 + k][l] = a[l];
                terms[12 + k][l] = a[l] * u[l];
                terms[14 + k][l] = a[l] * v[l];
            }
        }
        let Some(wave) = self.wave.as_ref().filter(|_| TERMS == WAVED) else { return terms };
        let depths_m = self.depths_m(camera, s);
        let (mut point, mut turns) = ([[0.0; LANES]; 2], [0.0; LANES]);
        for k in 0..2 {
            for l in 0..LANES {
                let direction = center[k][l] + camera.direction[k][s][l];
                point[k][l] = camera.lens[k][s][l] + depths_m[l] * direction;
            }
        }
        let (mut cos, mut sin) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            turns[l] = wave.turns(Vec3::new(point[0][l], point[1][l], depths_m[l] - self.pivot_m));
        }
        for l in 0..LANES {
            (sin[l], cos[l]) = sin_cos_turns(turns[l]);
        }
        for term in 0..6 {
            for l in 0..LANES {
                let power = terms[term][l];
                terms[16 + term][l] = power * cos[l];
                terms[22 + term][l] = power * sin[l];
            }
        }
        for term in 0..3 {
            for l in 0..LANES {
                let power = terms[term][l];
                terms[28 + term][l] = power * (1.0 - 2.0 * sin[l] * sin[l]);
                terms[31 + term][l] = power * (2.0 * sin[l] * cos[l]);
            }
        }
        terms
    }
}

impl RoughPane {
    /// True if the pane's rays have forms: they meet waves or wedges, but no facets.
    fn has_forms(&self) -> bool {
        (self.has_waves || self.has_wedges) && !self.has_facets() && self.shares_t_0
    }

    /// Returns the number of colours with weights of their own.
    pub(super) fn colours(&self) -> usize {
        if self.is_coloured { 3 } else { 1 }
    }
}

impl RoughRays {
    /// Computes the rays of all ways from their forms.
    #[inline(always)]
    pub(super) fn follow_form<const TERMS: usize>(
        &mut self,
        pane: &RoughPane,
        form: &Form,
        camera: &CameraRays<'_>,
    ) {
        let most = camera.taken.iter().copied().max().unwrap_or(0);
        for s in 0..most {
            let terms = form.terms::<TERMS>(camera, s);
            let depths_m = form.depths_m(camera, s);
            for (way, (factors, taken)) in form.ways.iter().zip(camera.taken).enumerate() {
                if *taken <= s {
                    continue;
                }
                let mut numbers = [[0.0; LANES]; NUMBERS];
                let count = 4 + pane.colours();
                for (number, factors) in numbers[..count].iter_mut().zip(factors) {
                    add_terms(number, &terms, &factors[..TERMS]);
                }
                let rays = &mut self.ways[way];
                for k in 0..2 {
                    let (turn, offset) = (&numbers[k], &numbers[2 + k]);
                    let (direction, lens) = (&camera.direction[k][s], &camera.lens[k][s]);
                    for l in 0..LANES {
                        rays.relative[k][s][l] = direction[l] + turn[l];
                        rays.point[k][s][l] = lens[l] + (offset[l] - depths_m[l] * turn[l]);
                    }
                }
                for (weights, number) in rays.weight.iter_mut().zip(&numbers[4..count]) {
                    weights[s] = number.map(exp_neg);
                }
            }
        }
    }
}

/// Adds the products of terms and factors to a sum. It waits for one addition in four terms, not for each.
#[inline(always)]
fn add_terms(sum: &mut Lane, terms: &[Lane], factors: &[f32]) {
    let (of_terms, of_factors) = (terms.chunks_exact(4), factors.chunks_exact(4));
    let rest = of_terms.remainder().iter().zip(of_factors.remainder());
    for (t, f) in of_terms.zip(of_factors) {
        for l in 0..LANES {
            sum[l] += (t[0][l] * f[0] + t[1][l] * f[1]) + (t[2][l] * f[2] + t[3][l] * f[3]);
        }
    }
    for (term, factor) in rest {
        for l in 0..LANES {
            sum[l] += term[l] * factor;
        }
    }
}

/// Solves least squares by Gram and Schmidt: returns the factors of the terms for which their sums are closest to the `numbers` in each row. Terms that are sums of
/// those before them have the factor 0.
fn least_squares(mut terms: Vec<Vec<f64>>, rows: &[Vec<f64>], numbers: usize) -> Vec<Vec<f64>> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let add = |to: &mut [f64], factor: f64, of: &[f64]| {
        to.iter_mut().zip(of).for_each(|(to, of)| *to += factor * of);
    };
    let count = terms.len();
    let mut parts = vec![vec![0.0; count]; count];
    for j in 0..count {
        let (before, rest) = terms.split_at_mut(j);
        let term = &mut rest[0];
        let whole = dot(term, term).sqrt();
        for (i, other) in before.iter().enumerate() {
            parts[i][j] = dot(other, term);
            add(term, -parts[i][j], other);
        }
        let own = dot(term, term).sqrt();
        let is_new = own > LEAST_PART * whole;
        parts[j][j] = own;
        let scale = if is_new { 1.0 / own } else { 0.0 };
        for value in term {
            *value *= scale;
        }
    }
    let mut factors = vec![vec![0.0; numbers]; count];
    for j in (0..count).rev() {
        let (of_term, behind) = factors[j..].split_first_mut().expect("a term");
        for (value, row) in terms[j].iter().zip(rows) {
            add(of_term, *value, row);
        }
        for (factor, part) in behind.iter().zip(&parts[j][j + 1..]) {
            add(of_term, -part, factor);
        }
        let is_new = terms[j].iter().any(|value| *value != 0.0);
        let scale = if is_new { 1.0 / parts[j][j] } else { 0.0 };
        for value in of_term {
            *value *= scale;
        }
    }
    factors
}
