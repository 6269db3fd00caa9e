//! Rendering of a model: visibility, light, antialiasing, depth.

use super::bounds::Bounds;
use super::camera::{Camera, Ray, intrinsics};
use super::hole::{self, Return};
use super::light::{Point, SoftGrid, SoftLight};
use super::listing::{Place, SamplePhotograph};
use super::model::Model;
use super::random::mix;
use super::shape::{Shape, Solid};
use super::texture::Texture;
use super::tiles::{Hit, Tiles};
use super::tone::Tone;
use super::{outdoors, room};
use glam::{Vec2, Vec3};
use glasshouse_line::Intrinsics;
use rayon::prelude::*;

/// A photograph with depth, row by row from the top left corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Rgbd {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// sRGB-coded colour, three bytes per pixel.
    pub rgb: Vec<u8>,
    /// Depth along the optical axis, m; 0 where invalid.
    pub depth_m: Vec<f32>,
    /// True for pixels with a valid depth.
    pub valid: Vec<bool>,
    /// Inverse depth of the surface at each pixel, 1/m, also in holes; 0 for the sky.
    pub inverse_depth_per_m: Vec<f32>,
}

/// Offsets of the antialiasing samples from the pixel's centre, px.
const OFFSETS: [(f32, f32); 4] =
    [(-0.125, -0.375), (0.375, -0.125), (0.125, 0.375), (-0.375, 0.125)];

/// Distance between metered pixels, px.
const METERING_STEP: usize = 16;

/// The surface at the centre of a pixel.
#[derive(Clone, Copy, Debug)]
struct Pixel {
    hit: Hit,
    normal: Vec3,
    in_sun: bool,
}

/// Renders the photograph with DIODE's camera. Equal arguments give equal bytes on all machines.
pub fn render(photograph: &SamplePhotograph, width: u32, height: u32) -> Rgbd {
    render_through(photograph, &intrinsics(width, height), width, height)
}

/// Renders the photograph with another camera; `intrinsics` are for an image of this size, px.
pub fn render_through(
    photograph: &SamplePhotograph,
    intrinsics: &Intrinsics,
    width: u32,
    height: u32,
) -> Rgbd {
    let model = match photograph.place {
        Place::Indoors => room::model(photograph),
        Place::Outdoor => outdoors::model(photograph),
    };
    let (w, h) = (width as usize, height as usize);
    let camera = Camera::new(model.pose, intrinsics);
    let bounds = Bounds::new(&model.solids);
    let tiles = Tiles::new(&model.solids, &camera, w, h);
    let place_key = mix(photograph.seed) ^ u64::from(photograph.scan);
    let texture_of =
        |solid: &Solid| Texture::new(photograph.place, place_key, solid.group, &solid.material);
    let textures = photograph.is_textured.then(|| model.solids.iter().map(texture_of).collect());
    let view = View { model: &model, camera, bounds: &bounds, tiles: &tiles, textures };
    let pixels: Vec<Option<Pixel>> =
        (0..w * h).into_par_iter().with_min_len(w).map(|k| view.pixel(k % w, k / w)).collect();
    let soft = SoftLight::new(&model.lights, &bounds);
    let grid = SoftGrid::new(&soft, w, h, |i, j| {
        let pixel = pixels[j * w + i]?;
        let ray = view.centre_ray(i, j);
        Some(point(&ray, pixel.hit, pixel.normal))
    });
    let inverse_depth_per_m =
        pixels.iter().map(|pixel| pixel.map_or(0.0, |p| 1.0 / p.hit.depth_m)).collect();
    let film = Film { view, grid, pixels, size: [w, h] };
    let tone = film.metered_tone();
    let seed = (photograph.seed as u32 ^ photograph.scan).cast_signed();

    let mut rgb = vec![0; 3 * w * h];
    let mut depth_m = vec![0.0; w * h];
    let mut valid = vec![false; w * h];
    rgb.par_chunks_mut(3 * w)
        .zip(depth_m.par_chunks_mut(w))
        .zip(valid.par_chunks_mut(w))
        .enumerate()
        .for_each(|(j, ((rgb, depth_m), valid))| {
            for i in 0..w {
                let (radiance, glass) = film.centre(i, j);
                let coded = film.antialiased(i, j, radiance, &tone);
                for (byte, c) in rgb[3 * i..3 * i + 3].iter_mut().zip(coded.to_array()) {
                    *byte = (c * 255.0 + 0.5) as u8;
                }
                if let Some(found) = film.measured_depth_m(i, j, glass, seed) {
                    (depth_m[i], valid[i]) = (found, true);
                }
            }
        });
    Rgbd { width, height, rgb, depth_m, valid, inverse_depth_per_m }
}

/// A view with the surfaces at all pixel centres.
struct Film<'a> {
    view: View<'a>,
    grid: SoftGrid<'a>,
    pixels: Vec<Option<Pixel>>,
    size: [usize; 2],
}

impl Film<'_> {
    /// Returns the radiance at a pixel's centre, and true if the pixel shows glass or sky.
    fn centre(&self, i: usize, j: usize) -> (Vec3, bool) {
        let pixel = self.pixels[j * self.size[0] + i].as_ref();
        let ray = self.view.centre_ray(i, j);
        self.view.radiance(&ray, pixel, &self.grid, i, j)
    }

    /// Returns the tone curve, metered on every [`METERING_STEP`]th pixel of every [`METERING_STEP`]th row.
    fn metered_tone(&self) -> Tone {
        let [w, h] = self.size;
        let first = METERING_STEP / 2;
        let rows = (first..h).step_by(METERING_STEP);
        let metered: Vec<Vec3> = rows
            .flat_map(|j| (first..w).step_by(METERING_STEP).map(move |i| (i, j)))
            .map(|(i, j)| self.centre(i, j).0)
            .collect();
        Tone::aimed(&metered, self.view.model.brightness)
    }

    /// Returns the four neighbours of a pixel; beyond the border, the pixel itself.
    fn neighbours(&self, i: usize, j: usize) -> [Option<Pixel>; 4] {
        let ([w, h], k) = (self.size, j * self.size[0] + i);
        [
            self.pixels[if i > 0 { k - 1 } else { k }],
            self.pixels[if i + 1 < w { k + 1 } else { k }],
            self.pixels[if j > 0 { k - w } else { k }],
            self.pixels[if j + 1 < h { k + w } else { k }],
        ]
    }

    /// Returns the sRGB-coded colour of a pixel with this radiance at its centre; at an edge, the mean of four samples.
    fn antialiased(&self, i: usize, j: usize, radiance: Vec3, tone: &Tone) -> Vec3 {
        let pixel = &self.pixels[j * self.size[0] + i];
        let around = self.neighbours(i, j);
        if !around.iter().any(|other| differs(pixel.as_ref(), other.as_ref())) {
            return tone.coded(radiance);
        }
        // If the sun lights the pixel and its neighbours, it lights all samples. Samples between unlit pixels need
        // shadow rays, because these pixels may just face away from the sun.
        let is_lit = pixel.iter().chain(around.iter().flatten()).all(|p| p.in_sun);
        let known_sun = is_lit.then_some(true);
        let mut coded = Vec3::ZERO;
        for (du, dv) in OFFSETS {
            let ray = self.view.camera.ray(i as f32 + 0.5 + du, j as f32 + 0.5 + dv);
            let seen = self.view.seen(&ray, i, j, known_sun);
            let (radiance, _) = self.view.radiance(&ray, seen.as_ref(), &self.grid, i, j);
            coded += tone.coded(radiance);
        }
        coded * 0.25
    }

    /// Returns the depth that a scanner measures at a pixel; `None` in a hole.
    fn measured_depth_m(&self, i: usize, j: usize, glass: bool, seed: i32) -> Option<f32> {
        let pixel = self.pixels[j * self.size[0] + i]?;
        let around = self.neighbours(i, j);
        let depths = || around.iter().flatten().map(|p| p.hit.depth_m);
        let direction = self.view.centre_ray(i, j).direction.normalize();
        let found = Return {
            depth_m: pixel.hit.depth_m,
            cos: -pixel.normal.dot(direction),
            glass,
            neighbours_m: (depths().fold(f32::MAX, f32::min), depths().fold(0.0, f32::max)),
        };
        let at = [i as u32, j as u32].map(u32::cast_signed);
        hole::is_valid(&found, self.view.model.range_m, at, seed).then_some(found.depth_m)
    }
}

fn point(ray: &Ray, hit: Hit, normal: Vec3) -> Point {
    Point { position: ray.at(hit.depth_m), normal, depth_m: hit.depth_m }
}

/// True if an edge runs between two neighbouring pixels.
fn differs(a: Option<&Pixel>, b: Option<&Pixel>) -> bool {
    match (a, b) {
        (None, None) => false,
        (Some(a), Some(b)) => {
            a.hit.solid != b.hit.solid || a.in_sun != b.in_sun || a.normal.dot(b.normal) < 0.8
        }
        _ => true,
    }
}

/// A model and the camera that views it.
struct View<'a> {
    model: &'a Model,
    camera: Camera,
    bounds: &'a Bounds,
    tiles: &'a Tiles,
    /// Textures of the solids; `None` for smooth ones.
    textures: Option<Vec<Texture>>,
}

impl View<'_> {
    fn centre_ray(&self, i: usize, j: usize) -> Ray {
        self.camera.ray(i as f32 + 0.5, j as f32 + 0.5)
    }

    fn pixel(&self, i: usize, j: usize) -> Option<Pixel> {
        self.seen(&self.centre_ray(i, j), i, j, None)
    }

    /// Returns the surface that a ray through pixel (i, j) meets; with `known_sun`, traces no shadow ray.
    fn seen(&self, ray: &Ray, i: usize, j: usize, known_sun: Option<bool>) -> Option<Pixel> {
        let hit = self.tiles.nearest(&self.model.solids, ray, i, j)?;
        let solid = &self.model.solids[hit.solid as usize];
        let position = ray.at(hit.depth_m);
        let mut normal = solid.axes * solid.normal(solid.local(position - solid.centre));
        if matches!(solid.shape, Shape::Foliage(..)) {
            // Leaves face upwards more than the surface of the crown.
            normal = (normal + Vec3::Y * 0.5).normalize();
        } else if normal.dot(ray.direction) > 0.0 {
            normal = -normal;
        }
        let lights = &self.model.lights;
        let in_sun = lights.sun != Vec3::ZERO && normal.dot(lights.sun_direction) > 0.0 && {
            let origin = position + normal * (1e-3 + 3e-4 * hit.depth_m);
            let direction = lights.sun_direction;
            known_sun.unwrap_or_else(|| !self.bounds.occluded(&Ray { origin, direction }, 200.0))
        };
        Some(Pixel { hit, normal, in_sun })
    }

    /// Returns the radiance along a ray, and true if the ray ends on glass or in the sky.
    fn radiance(
        &self,
        ray: &Ray,
        pixel: Option<&Pixel>,
        grid: &SoftGrid,
        i: usize,
        j: usize,
    ) -> (Vec3, bool) {
        let direction = ray.direction.normalize();
        let Some(pixel) = pixel else {
            return (self.model.sky.radiance(direction), true);
        };
        let lights = &self.model.lights;
        let solid = &self.model.solids[pixel.hit.solid as usize];
        let point = point(ray, pixel.hit, pixel.normal);
        let local = solid.local(point.position - solid.centre);
        let facing = solid.normal(local).abs();
        let p = local + solid.texture_shift;
        let uv = if facing.y > 0.7 {
            Vec2::new(p.x, p.z)
        } else if facing.x > facing.z {
            Vec2::new(p.z, p.y)
        } else {
            Vec2::new(p.x, p.y)
        };
        let cos = -direction.dot(pixel.normal);
        let footprint_m = pixel.hit.depth_m / self.camera.fx / cos.max(0.12);
        let mut surface = solid.material.surface(p, uv, footprint_m);
        if let Some(textures) = self.textures.as_ref().filter(|_| !surface.glass) {
            let factor = textures[pixel.hit.solid as usize].factor(p, footprint_m);
            surface.albedo = (surface.albedo * factor).min(Vec3::ONE);
        }
        let mut light = grid.at(i, j, &point);
        if pixel.in_sun {
            let incidence = pixel.normal.dot(lights.sun_direction);
            light += lights.sun * (incidence / core::f32::consts::PI);
        }
        let mut radiance = surface.albedo * light + surface.glow;
        if surface.gloss > 0.0 {
            let mirrored = direction + pixel.normal * (2.0 * cos);
            let grazing = 1.0 - cos.clamp(0.0, 1.0);
            let square = grazing * grazing;
            let share = surface.gloss + (0.5 - surface.gloss) * square * square * grazing;
            radiance = radiance.lerp(self.reflected(point.position, mirrored, light), share);
            if pixel.in_sun {
                let mut peak = mirrored.dot(lights.sun_direction).max(0.0);
                for _ in 0..5 {
                    peak *= peak;
                }
                radiance += lights.sun * (peak * surface.gloss * 2.0);
            }
        }
        if lights.openings.is_empty() {
            let depth_m = pixel.hit.depth_m;
            let haze = depth_m / (depth_m + 350.0);
            radiance = radiance.lerp(self.model.sky.horizon * 0.8, haze);
        }
        (radiance, surface.glass)
    }

    /// Returns the radiance that a glossy surface mirrors; ignores solids.
    fn reflected(&self, position: Vec3, direction: Vec3, light: Vec3) -> Vec3 {
        let lights = &self.model.lights;
        if lights.openings.is_empty() {
            return self.model.sky.smooth_radiance(direction.y);
        }
        let mut seen = light * 0.6;
        for opening in &lights.openings {
            let across = direction.dot(opening.normal);
            if across < -1e-3 {
                let t = (opening.centre - position).dot(opening.normal) / across;
                let at = position + direction * t - opening.centre;
                let inside = |half: Vec3| {
                    let square = half.length_squared();
                    ((1.15 - at.dot(half).abs() / square) * 3.5).clamp(0.0, 1.0)
                };
                seen += opening.radiance * (0.35 * inside(opening.half_u) * inside(opening.half_v));
            }
        }
        seen
    }
}

#[cfg(test)]
mod tests {
    use super::super::listing::{Place, listing};
    use super::*;

    #[test]
    fn bytes_do_not_depend_on_the_number_of_threads() {
        for photograph in listing(4, 11) {
            let with = |threads| {
                rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap()
                    .install(|| render(&photograph, 128, 96))
            };
            let one = with(1);
            assert_eq!(one, with(1));
            assert_eq!(one, with(2));
        }
    }

    #[test]
    fn depths_and_brightness_are_plausible() {
        for photograph in listing(32, 7) {
            let rgbd = render(&photograph, 160, 120);
            let pixel_count = 160 * 120;
            let farthest_m = match photograph.place {
                Place::Indoors => 15.0,
                Place::Outdoor => 60.0,
            };
            let mut valid_count = 0;
            for (&depth_m, &valid) in rgbd.depth_m.iter().zip(&rgbd.valid) {
                if valid {
                    assert!((0.5..=farthest_m).contains(&depth_m), "{depth_m}");
                    valid_count += 1;
                } else {
                    assert_eq!(depth_m, 0.0);
                }
            }
            let share = f64::from(valid_count) / f64::from(pixel_count);
            assert!((0.5..1.0).contains(&share), "{share} of {photograph:?}");
            let sum: u64 = rgbd.rgb.iter().map(|&c| u64::from(c)).sum();
            let mean = sum as f64 / (3.0 * 255.0) / f64::from(pixel_count);
            assert!((0.25..0.65).contains(&mean), "{mean} of {photograph:?}");
        }
    }

    /// Textures change colours alone, and make pictures sharper.
    #[test]
    fn textured_surfaces_have_the_depths_of_smooth_ones() {
        let sharpness = |rgbd: &Rgbd| {
            let rows = rgbd.rgb.chunks_exact(3 * 320);
            let steps = rows.flat_map(|row| row.windows(4).map(|w| w[0].abs_diff(w[3])));
            let sum: f64 = steps.map(f64::from).sum();
            sum / rgbd.rgb.iter().map(|&code| f64::from(code)).sum::<f64>()
        };
        let [mut smooth, mut rough] = [0.0; 2];
        for mut photograph in listing(6, 5) {
            let plain = render(&photograph, 320, 240);
            photograph.is_textured = true;
            let textured = render(&photograph, 320, 240);
            assert_eq!(plain.depth_m, textured.depth_m);
            assert_eq!(plain.valid, textured.valid);
            assert_eq!(plain.inverse_depth_per_m, textured.inverse_depth_per_m);
            smooth += sharpness(&plain);
            rough += sharpness(&textured);
        }
        let ratio = rough / smooth;
        assert!((1.25..2.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn consecutive_photographs_differ() {
        let photographs = listing(6, 2);
        for pair in photographs.windows(2) {
            assert_ne!(render(&pair[0], 64, 48).rgb, render(&pair[1], 64, 48).rgb);
        }
    }
}
