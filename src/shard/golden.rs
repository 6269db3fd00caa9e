//! A small built-in scene whose pixels every machine must reproduce before it joins a run.

use super::spec::Golden;
use crate::trace::{
    FilmPlane, Grid, Isa, Lens, OrderPlan, Pose, Sampling, Scene, Slab, Texture, Tile, View,
    trace_tile,
};

/// Name of the built-in scene; a new one when it changes.
const NAME: &str = "builtin/1";

/// Traces the golden shard on this machine. Some milliseconds.
pub fn golden(isa: Isa) -> Golden {
    let scene = scene();
    let tile = Tile {
        x: 0,
        y: 0,
        width: scene.film.width,
        height: scene.film.height,
    };
    let result = trace_tile(&scene, tile, 0..scene.spp, isa);
    let mut hasher = blake3::Hasher::new();
    for pixel in &result.pixels {
        for value in pixel.mean.iter().chain(&pixel.half).flatten() {
            hasher.update(&value.to_le_bytes());
        }
    }
    Golden {
        scene: NAME.to_owned(),
        blake3: hasher.finalize().to_hex().to_string(),
    }
}

/// Steps in depth, a tilted and absorbing pane, a wide lens: every part of the kernel is at work.
fn scene() -> Scene {
    const SIDE: usize = 64;
    let hash = |q: usize, salt: u32| {
        let mut x = (q as u32).wrapping_mul(0x9e37_79b9) ^ salt;
        x ^= x >> 16;
        x = x.wrapping_mul(0x7feb_352d);
        x ^ (x >> 15)
    };
    let view = |salt: u32, sign: f64| {
        let block = |q: usize| (q / SIDE / 8) * 8 + q % SIDE / 8;
        let w = (0..SIDE * SIDE).map(|q| 0.1 + (hash(block(q), salt) % 1024) as f32 / 1024.0);
        let texel = |q: usize| [1, 2, 3, 4].map(|k| (hash(q, salt + k) % 256) as f32 / 255.0);
        let texels: Vec<[f32; 4]> = (0..SIDE * SIDE).map(texel).collect();
        View {
            grid: Grid::new(SIDE, SIDE, w.collect()),
            texture: Texture::new(SIDE, SIDE, &texels),
            focal_px: [sign * 80.0, 80.0],
            principal: [31.5, 31.5],
            pose: Pose::Aligned { extra_m: 0.0 },
            photograph_size: (SIDE, SIDE),
        }
    };
    let normal = Slab::tilted_normal([9.0, -14.0]);
    let slab = Slab {
        normal,
        plane_distance_m: 0.3 * normal.z,
        thickness_m: 0.01,
        ior: 1.6,
        absorption_per_m: [3.0, 1.0, 2.0],
    };
    let film = FilmPlane {
        width: 24,
        height: 16,
        tan_half_fov: FilmPlane::tan_half_fov(24, 16, 55.0),
        filter: None,
    };
    let orders = OrderPlan::new(&slab, &[1.0, 0.97, 0.9, 0.8], [1.0, 1.0], 7.6e-5);
    Scene {
        seed: 2020,
        sampling: Sampling::Sobol,
        spp: 64,
        film,
        lens: Lens {
            aperture_radius_m: 0.02,
            inverse_focus_per_m: 0.4,
        },
        slab,
        orders,
        front: view(1, 1.0).into(),
        back: view(100, -1.0).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// If this fails, pixels have changed: raise `TRACER_VERSION`, then write the new digest here.
    #[test]
    fn pixels_are_those_of_this_tracer_version() {
        assert_eq!(crate::trace::TRACER_VERSION, 2);
        assert_eq!(
            golden(Isa::Baseline).blake3,
            "193c40bdd56b334c3484c1c41e2b28131a5e11003348846a25d27a736d05a073"
        );
    }

    #[test]
    fn instruction_sets_agree() {
        assert_eq!(golden(Isa::Baseline), golden(Isa::detect()));
    }
}
