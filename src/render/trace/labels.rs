//! Labels of a tile that no light carries: the share of a pixel that sees glass, and the depth of the front.

use super::bundle::{Bundle, BundleRays, Feeds, Row};
use super::camera::CameraChunk;
use super::isa::{BASELINE, Isa};
use super::lanes::{CHUNK, LANES, Lane};
use super::lines::{Path, ViewLanes, smooth_path_of};
use super::means::Components;
use super::patch::Patch;
use super::scene::{Scene, Surface};
use super::slab::Order;
use super::tile::{Tile, patches};
use glasshouse_line::label::{Label, LabelImages};
use std::ops::Range;

/// Number of samples of the coverage in an adaptive scene, whose pixels have different numbers.
const ADAPTIVE_SAMPLES: u32 = 256;

/// Computes the requested labels of a tile: the coverage over `samples`, and the depth, which needs no samples, if they begin at 0.
///
/// A label costs little beside the tile's light, so its code is compiled for the baseline alone.
pub(super) fn of_tile(scene: &Scene, tile: Tile, samples: &Range<u32>) -> LabelImages {
    let mut images = LabelImages::new();
    let pixels = (tile.width * tile.height) as usize;
    let wants_depth = scene.labels.contains(Label::FrontDepth) && samples.start == 0;
    for (label, is_wanted) in [
        (Label::Coverage, scene.labels.contains(Label::Coverage)),
        (Label::FrontDepth, wants_depth),
    ] {
        if is_wanted {
            images.insert(label, vec![0.0; pixels]);
        }
    }
    if images.is_empty() {
        return images;
    }
    let mut samples = samples.clone();
    if scene.target_error.is_some() {
        samples.end = samples.end.min(ADAPTIVE_SAMPLES);
    }
    let (mut camera, mut rays) = (CameraChunk::new(), BundleRays::new());
    for y in patches(tile.y, tile.height) {
        for x in patches(tile.x, tile.width) {
            let patch = Patch::new(scene, x, y);
            let lanes = tile.lanes((x, y));
            for (label, image) in &mut images {
                let values = match label {
                    Label::Coverage => coverage(scene, &patch, &mut camera, &samples),
                    _ => front_depth(scene, &patch, &mut camera, &mut rays),
                };
                for (pixel, value) in lanes.iter().zip(values) {
                    if let Some(pixel) = pixel {
                        image[*pixel] = value;
                    }
                }
            }
        }
    }
    images
}

/// The ghosts of a tile; empty if the scene does not request them.
pub(super) struct Ghosts(Vec<f32>);

impl Ghosts {
    pub(super) fn new(scene: &Scene, pixels: usize) -> Self {
        let is_wanted = scene.labels.contains(Label::Ghosts);
        Self(vec![0.0; 3 * pixels * usize::from(is_wanted)])
    }

    /// Stores the ghosts of a pixel.
    #[inline(always)]
    pub(super) fn set(&mut self, pixel: usize, components: &Components) {
        if let Some(values) = self.0.get_mut(3 * pixel..3 * pixel + 3) {
            for c in 0..3 {
                values[c] = components.ghosts[0][c] as f32;
            }
        }
    }

    /// Adds the ghosts to the labels of their tile.
    pub(super) fn join(self, images: &mut LabelImages) {
        if !self.0.is_empty() {
            images.insert(Label::Ghosts, self.0);
        }
    }
}

/// Returns the share of the samples' rays that meet glass.
fn coverage(scene: &Scene, patch: &Patch, camera: &mut CameraChunk, samples: &Range<u32>) -> Lane {
    let Some(outline) = &scene.cover.outline else { return [1.0; LANES] };
    if let Some(is_glass) = outline.fills(&scene.slab, &scene.lens, patch.film_bounds(scene)) {
        return [f32::from(u8::from(is_glass)); LANES];
    }
    let mut met = [0.0; LANES];
    for first in samples.clone().step_by(CHUNK) {
        let count = CHUNK.min((samples.end - first) as usize);
        camera.fill(scene, patch, first, count);
        for glass in &camera.entries.glass[..count] {
            for l in 0..LANES {
                met[l] += glass[l];
            }
        }
    }
    met.map(|met| met / (samples.end - samples.start) as f32)
}

/// Returns the distance of the nearest surface of the front along the pixels' central rays, m.
fn front_depth(
    scene: &Scene,
    patch: &Patch,
    camera: &mut CameraChunk,
    rays: &mut BundleRays,
) -> Lane {
    camera.aim(scene, patch);
    let order = Order::Transmitted(0);
    let path = smooth_path_of(scene, order, 0);
    if let (Path::Rough(way), Some(pane)) = (path, &scene.rough) {
        let mut taken = vec![0; pane.ways()];
        taken[way] = 1;
        camera.scatter(scene, pane, patch, &taken, Isa::Baseline);
    }
    let row = Row { sample: 0, path, order: Some(order), carries_dropped: false };
    let bundle = Bundle {
        patch,
        camera,
        rows: &[row],
        group: (0, &[path]),
        samples: 1,
        feeds: Feeds::Bare,
        ends: [0, 0, 1],
    };
    let normal = scene.slab.normal.as_vec3().to_array();
    let [point, direction] = bundle.rays(scene, normal, &row);
    let inverse = match &scene.front {
        Surface::Sheet(view) => {
            rays.reach::<BASELINE>(scene, view, &ViewLanes::new(view, patch), &bundle)
        }
        Surface::Mesh(mesh) => mesh.inverse_depths(direction, point),
    };
    let mut z_m = inverse.map(|w| if w > 0.0 { 1.0 / w } else { f32::INFINITY });
    for card in &scene.cover.cards[0] {
        let (at, hit) = card.hits(&point, &direction, &z_m);
        for l in 0..LANES {
            if hit[l] == 1 && card.texel(at[0][l], at[1][l])[3] >= 0.5 {
                // Cards of the front are parallel to the film.
                z_m[l] = card.nearest_z_m as f32;
            }
        }
    }
    let plane_m = scene.slab.plane_distance_m as f32;
    for l in 0..LANES {
        if camera.entries.frame[0][l] == 1.0 {
            let along = patch.center[0][l] * normal[0] + patch.center[1][l] * normal[1] + normal[2];
            z_m[l] = plane_m / along;
        }
    }
    z_m
}
