//! Traces a bundle of one order against a mesh, with the same weights as against a grid.

use super::super::camera::{CameraBlock, Pixel};
use super::super::lanes::LANES;
use super::super::lines::{Path, points};
use super::super::means::{NOTHING, Sums};
use super::super::scene::Scene;
use super::super::shade::{absorbed, weights};
use super::super::slab::Order;
use super::super::tile::Isa;
use super::project::Mesh;

pub(in super::super) struct Bundle<'a> {
    pub(in super::super) pixel: &'a Pixel,
    pub(in super::super) camera: &'a CameraBlock,
    pub(in super::super) path: Path,
    /// Order of the bundle; `None` is R's pinhole path, with weight 1.
    pub(in super::super) order: Option<Order>,
    /// Number of the block's samples in the first quarter of the pixel's samples, in the first half, and in total.
    pub(in super::super) ends: [u32; 3],
}

/// Returns the sums of a bundle's weighted radiance and the number of its misses. A miss is black. Order t_0 also adds
/// its unweighted radiance to `transmission`.
///
/// This function is never inlined, because the loops of scenes without meshes must not contain its code. Therefore it
/// selects the instruction set itself.
#[inline(never)]
pub(in super::super) fn follow(
    scene: &Scene,
    mesh: &Mesh,
    bundle: &Bundle,
    isa: Isa,
    transmission: &mut Sums,
) -> (Sums, u64) {
    match isa {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling a function compiled for AVX2")]
        Isa::Avx2 if std::arch::is_x86_feature_detected!("avx2") => {
            // SAFETY: the check above found AVX2 on this machine.
            unsafe { follow_avx2(scene, mesh, bundle, transmission) }
        }
        _ => follow_lanes(scene, mesh, bundle, transmission),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn follow_avx2(
    scene: &Scene,
    mesh: &Mesh,
    bundle: &Bundle,
    transmission: &mut Sums,
) -> (Sums, u64) {
    follow_lanes(scene, mesh, bundle, transmission)
}

#[inline(always)]
fn follow_lanes(
    scene: &Scene,
    mesh: &Mesh,
    bundle: &Bundle,
    transmission: &mut Sums,
) -> (Sums, u64) {
    let &Bundle { pixel, camera, path, order, ends: [quarter, half, count] } = bundle;
    let center = pixel.center.map(|v| v as f32);
    let normal = scene.slab.normal.as_vec3().to_array();
    let relative = match path {
        Path::Lens { .. } => &camera.direction,
        Path::Pinhole => &camera.film,
    };
    let mut sums = NOTHING;
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
        let weight =
            order.map_or([[1.0; LANES]; 3], |order| colour_weights(scene, camera, order, g));
        for l in 0..in_group {
            misses += u64::from(seen.w[l] == 0.0);
            let sample = (g * LANES + l) as u32;
            let part = usize::from(sample >= quarter) + usize::from(sample >= half);
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

/// Computes the weights of an order for group `g`: red, green, blue.
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
    if !slab.absorbs_in(order) {
        return [weight; 3];
    }
    slab.absorption_per_m.map(|a| {
        let optical_depth = (a * slab.thickness_m) as f32;
        absorbed(&weight, order, optical_depth, &camera.inverse_cos_t[g])
    })
}
