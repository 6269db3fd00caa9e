//! Soft light from windows, lamps and the surroundings on a surface, with soft shadows.
//!
//! Rays are traced on a coarse grid of pixels in sixteen interleaved patterns per block of 4 x 4 grid points. A
//! blur over a block, limited to one surface, combines the patterns.

use super::bounds::Bounds;
use super::camera::Ray;
use super::model::Lights;
use glam::Vec3;
use rayon::prelude::*;

/// Distance between grid points, px.
const SPACING: usize = 4;
/// Number of patterns in a block of grid points.
const PATTERN_COUNT: usize = 16;
/// Number of ambient rays of one pattern.
const AMBIENT_RAYS: usize = 4;
/// Number of rays of one pattern to each window. (One ray goes to each bulb.)
const OPENING_RAYS: usize = 2;

/// A visible surface point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
    pub(super) depth_m: f32,
}

/// Tracer of rays from surface points to all sources of soft light.
#[derive(Debug)]
pub(super) struct SoftLight<'a> {
    lights: &'a Lights,
    bounds: &'a Bounds,
    /// Cosine-weighted directions about +z, by pattern.
    hemisphere: Vec<Vec3>,
}

impl<'a> SoftLight<'a> {
    pub(super) fn new(lights: &'a Lights, bounds: &'a Bounds) -> Self {
        let count = PATTERN_COUNT * AMBIENT_RAYS;
        let hemisphere = (0..count)
            .map(|i| {
                // A pattern takes every sixteenth ring, so that its directions alone are well distributed.
                let (pattern, ray) = (i / AMBIENT_RAYS, i % AMBIENT_RAYS);
                let n = ray * PATTERN_COUNT + pattern;
                let square = (n as f32 + 0.5) / count as f32;
                let turn = n as f32 * 0.618_034;
                let (s, c) = libm::sincosf(core::f32::consts::TAU * (turn - turn.floor()));
                let r = square.sqrt();
                Vec3::new(r * c, r * s, (1.0 - square).sqrt())
            })
            .collect();
        Self { lights, bounds, hemisphere }
    }

    /// Returns the irradiance at a point, divided by pi, from the rays of one pattern.
    fn arriving(&self, point: &Point, pattern: usize) -> Vec3 {
        let Point { position, normal, .. } = *point;
        let lights = self.lights;
        let origin = position + normal * (1e-3 + 2e-4 * point.depth_m);
        let side = if normal.x.abs() > 0.7 { Vec3::Y } else { Vec3::X };
        let u = normal.cross(side).normalize();
        let v = normal.cross(u);
        let mut sum = Vec3::ZERO;
        let first = pattern * AMBIENT_RAYS;
        for d in &self.hemisphere[first..first + AMBIENT_RAYS] {
            let direction = u * d.x + v * d.y + normal * d.z;
            let ambient = lights.ambient_down.lerp(lights.ambient_up, 0.5 + 0.5 * direction.y);
            let ray = Ray { origin, direction };
            let hidden = self.bounds.occluded(&ray, lights.ambient_reach_m);
            // An occluder reflects part of the ambient light.
            sum += ambient * if hidden { 0.3 } else { 1.0 };
        }
        let mut light = sum / AMBIENT_RAYS as f32;
        for opening in &lights.openings {
            if (origin - opening.centre).dot(opening.normal) <= 0.0 {
                continue;
            }
            let area = 4.0 * opening.half_u.length() * opening.half_v.length();
            let mut seen = 0.0;
            for ray in 0..OPENING_RAYS {
                let n = (ray * PATTERN_COUNT + pattern) as f32 + 0.5;
                let (a, b) = (n * 0.754_877_7, n * 0.569_840_3);
                let target = opening.centre
                    + opening.half_u * (2.0 * (a - a.floor()) - 1.0)
                    + opening.half_v * (2.0 * (b - b.floor()) - 1.0);
                let to = target - origin;
                let square = to.length_squared();
                let distance = square.sqrt();
                let direction = to / distance;
                let cos = direction.dot(normal);
                let cos_light = -direction.dot(opening.normal);
                if cos > 0.0 && cos_light > 0.0 {
                    let ray = Ray { origin, direction };
                    if !self.bounds.occluded(&ray, distance * 0.999) {
                        seen += cos * cos_light / (square + 0.1 * area);
                    }
                }
            }
            let share = seen * area / (OPENING_RAYS as f32 * core::f32::consts::PI);
            light += opening.radiance * share;
        }
        for bulb in &lights.bulbs {
            let offset = self.hemisphere[(pattern * 7) % self.hemisphere.len()] - Vec3::Z * 0.5;
            let to = bulb.centre + offset * (2.0 * bulb.radius_m) - origin;
            let square = to.length_squared();
            let distance = square.sqrt();
            let direction = to / distance;
            let cos = direction.dot(normal);
            let strongest = bulb.intensity.max_element() * cos / square;
            if cos > 0.0 && strongest > 0.003 {
                let ray = Ray { origin, direction };
                if !self.bounds.occluded(&ray, distance) {
                    light += bulb.intensity * (cos / (square + 0.05)) / core::f32::consts::PI;
                }
            }
        }
        light
    }
}

#[derive(Clone, Copy, Debug)]
struct Cell {
    point: Point,
    light: Vec3,
}

/// Soft light on a coarse grid of pixels.
#[derive(Debug)]
pub(super) struct SoftGrid<'a> {
    soft: &'a SoftLight<'a>,
    across: usize,
    down: usize,
    cells: Vec<Option<Cell>>,
}

impl<'a> SoftGrid<'a> {
    /// Computes the light at all grid points. `visible` returns the surface point at the centre of a pixel.
    pub(super) fn new(
        soft: &'a SoftLight<'a>,
        width: usize,
        height: usize,
        visible: impl Fn(usize, usize) -> Option<Point> + Sync,
    ) -> Self {
        let (across, down) = (width.div_ceil(SPACING), height.div_ceil(SPACING));
        let raw: Vec<Option<Cell>> = (0..across * down)
            .into_par_iter()
            .map(|index| {
                let (a, b) = (index % across, index / across);
                let i = (a * SPACING + SPACING / 2).min(width - 1);
                let j = (b * SPACING + SPACING / 2).min(height - 1);
                let point = visible(i, j)?;
                let light = soft.arriving(&point, pattern(a, b));
                Some(Cell { point, light })
            })
            .collect();
        let cells = (0..across * down)
            .into_par_iter()
            .map(|index| blurred(&raw, index, across, down))
            .collect();
        Self { soft, across, down, cells }
    }

    /// Interpolates the soft light at a surface point in pixel (i, j). Traces rays if no nearby grid point is similar.
    pub(super) fn at(&self, i: usize, j: usize, point: &Point) -> Vec3 {
        let place = |pixel: usize| (pixel as f32 - 2.0) / SPACING as f32;
        let (x, y) = (place(i).max(0.0), place(j).max(0.0));
        let (a, b) = (x as usize, y as usize);
        let (u, v) = (x - a as f32, y - b as f32);
        let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
        for (db, wv) in [(0, 1.0 - v), (1, v)] {
            for (da, wu) in [(0, 1.0 - u), (1, u)] {
                let (a, b) = ((a + da).min(self.across - 1), (b + db).min(self.down - 1));
                if let Some(cell) = &self.cells[b * self.across + a] {
                    let w = (wu * wv + 1e-3) * likeness(&cell.point, point);
                    sum += cell.light * w;
                    weight += w;
                }
            }
        }
        if weight > 0.02 {
            return sum / weight;
        }
        [1, 7, 12].into_iter().map(|k| self.soft.arriving(point, k)).sum::<Vec3>() / 3.0
    }
}

/// Returns the pattern of a grid point, from an ordered 4 x 4 dither.
fn pattern(a: usize, b: usize) -> usize {
    const ORDER: [usize; PATTERN_COUNT] = [0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5];
    ORDER[(b & 3) * 4 + (a & 3)]
}

/// Returns the similarity of two surface points, 0..1; points of one plane have similarity 1.
fn likeness(a: &Point, b: &Point) -> f32 {
    let facing = a.normal.dot(b.normal);
    if facing < 0.8 {
        return 0.0;
    }
    let off = (a.position - b.position).dot(b.normal).abs();
    let allowed = 0.015 + 0.012 * b.depth_m;
    (facing - 0.8) * 5.0 * (1.0 - off / allowed).max(0.0)
}

/// Weights of the blur along one axis. Half weights at both ends give all sixteen patterns equal weight.
const ENDS: [f32; 5] = [0.5, 1.0, 1.0, 1.0, 0.5];

fn blurred(raw: &[Option<Cell>], index: usize, across: usize, down: usize) -> Option<Cell> {
    let centre = raw[index]?;
    let (a, b) = (index % across, index / across);
    let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
    for (db, wb) in (0..).zip(ENDS) {
        for (da, wa) in (0..).zip(ENDS) {
            let (i, j) = (a + da, b + db);
            if i < 2 || j < 2 || i >= across + 2 || j >= down + 2 {
                continue;
            }
            if let Some(cell) = &raw[(j - 2) * across + i - 2] {
                let w = wa * wb * likeness(&cell.point, &centre.point);
                sum += cell.light * w;
                weight += w;
            }
        }
    }
    Some(Cell { light: sum / weight, ..centre })
}
