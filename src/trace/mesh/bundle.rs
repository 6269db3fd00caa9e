//! The estimator's part for a mesh: one order's bundle, hit by hit, with the weights of the grid's path.

use super::super::camera::{CameraBlock, Pixel};
use super::super::lanes::LANES;
use super::super::lines::{Path, points};
use super::super::scene::Scene;
use super::super::shade::{Sums, absorbed, weights};
use super::super::slab::Order;
use super::project::Mesh;

/// Sums of the weighted radiance of one bundle's first `count` samples, of which `half` belong to the first half, and
/// how many met nothing: those see black. Order t_0 also feeds `transmission` with bare radiance; no `order` is R's
/// pinhole path, of weight 1.
#[inline(always)]
pub(in super::super) fn follow(
    scene: &Scene,
    mesh: &Mesh,
    (pixel, camera): (&Pixel, &CameraBlock),
    (path, order): (Path, Option<Order>),
    (count, half): (u32, u32),
    transmission: &mut Sums,
) -> (Sums, u64) {
    let center = pixel.center.map(|v| v as f32);
    let normal = scene.slab.normal.as_vec3().to_array();
    let relative = match path {
        Path::Lens { .. } => &camera.direction,
        Path::Pinhole => &camera.film,
    };
    let mut sums: Sums = [[0.0; 3]; 2];
    let mut misses = 0;
    for g in 0..(count as usize).div_ceil(LANES) {
        let mut d = [[0f32; LANES]; 2];
        for k in 0..2 {
            for l in 0..LANES {
                d[k][l] = center[k] + relative[k][g][l];
            }
        }
        let p = points(path, center, normal, camera, g);
        let in_group = (count as usize - g * LANES).min(LANES);
        let seen = mesh.see(d, p, in_group);
        let weight = order.map_or([[1.0; LANES]; 3], |order| {
            colour_weights(scene, camera, order, g)
        });
        for l in 0..in_group {
            misses += u64::from(seen.w[l] == 0.0);
            let part = usize::from(g * LANES + l >= half as usize);
            for k in 0..3 {
                let radiance = f64::from(seen.radiance[l][k]);
                sums[part][k] += radiance * f64::from(weight[k][l]);
                if order == Some(Order::Transmitted(0)) {
                    transmission[part][k] += radiance;
                }
            }
        }
    }
    (sums, misses)
}

/// Weights of an order for group `g`: red, green, blue.
#[inline(always)]
fn colour_weights(
    scene: &Scene,
    camera: &CameraBlock,
    order: Order,
    g: usize,
) -> [[f32; LANES]; 3] {
    let ([rs, rp], [ts, tp]) = (&camera.reflectance, &camera.transmittance);
    let weight = weights(order, [&rs[g], &rp[g]], [&ts[g], &tp[g]]);
    let slab = &scene.slab;
    if !slab.absorbs() {
        return [weight; 3];
    }
    slab.absorption_per_m.map(|a| {
        let optical_depth = (a * slab.thickness_m) as f32;
        absorbed(&weight, order, optical_depth, &camera.inverse_cos_t[g])
    })
}
