//! Traces a bundle against a mesh, with the same weights as against a grid.

use super::super::bundle::{
    Bundle, Feeds, Row, smudge_factor, weights_alone, weights_with_dropped,
};
use super::super::isa::Isa;
use super::super::lanes::{CHUNK, LANES};
use super::super::lines::Path;
use super::super::means::LaneSums;
use super::super::overlay::Overlay;
use super::super::scene::Scene;
use super::project::{Mesh, Seen};

// Samples and pixels of a chunk change places.
const _: () = assert!(CHUNK == LANES);

/// Adds a bundle's weighted radiance to `sums`; order t_0 also adds its unweighted radiance to `transmission`. Returns each
/// pixel's number of misses. A miss is black.
///
/// This function is never inlined, because the loops of scenes without meshes must not contain its code. Therefore it
/// selects the instruction set itself.
#[inline(never)]
pub(in super::super) fn follow(
    scene: &Scene,
    mesh: &Mesh,
    bundle: &Bundle,
    isa: Isa,
    sums: &mut LaneSums,
    transmission: &mut LaneSums,
) -> [u32; LANES] {
    match isa {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calling a function compiled for AVX2")]
        Isa::Avx2 | Isa::Avx512 if Isa::Avx2.is_available() => {
            // SAFETY: the check above found AVX2 on this machine.
            unsafe { follow_avx2(scene, mesh, bundle, sums, transmission) }
        }
        _ => follow_lanes(scene, mesh, bundle, sums, transmission),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn follow_avx2(
    scene: &Scene,
    mesh: &Mesh,
    bundle: &Bundle,
    sums: &mut LaneSums,
    transmission: &mut LaneSums,
) -> [u32; LANES] {
    follow_lanes(scene, mesh, bundle, sums, transmission)
}

#[inline(always)]
fn follow_lanes(
    scene: &Scene,
    mesh: &Mesh,
    bundle: &Bundle,
    sums: &mut LaneSums,
    transmission: &mut LaneSums,
) -> [u32; LANES] {
    let &Bundle { camera, rows, feeds, ends: [quarter, half, count], .. } = bundle;
    let normal = scene.slab.normal.as_vec3().to_array();
    // The rays of one pixel lie closer together than those of sixteen, so that they meet fewer boxes. A pixel with sixteen
    // samples therefore has its own group of rays.
    let by_pixel = count == CHUNK;
    let place = |s: usize, l: usize| if by_pixel { (l, s) } else { (s, l) };
    let mut directions = [[[0f32; LANES]; 2]; CHUNK];
    let mut starts = [[[0f32; LANES]; 2]; CHUNK];
    for (s, row) in rows.iter().enumerate() {
        let [point, direction] = bundle.rays(scene, normal, row);
        for l in 0..LANES {
            let (group, lane) = place(s, l);
            for k in 0..2 {
                directions[group][k][lane] = direction[k][l];
                starts[group][k][lane] = point[k][l];
            }
        }
    }
    let mut seen = [const { Seen::NOTHING }; CHUNK];
    for group in 0..count {
        seen[group] = mesh.see(directions[group], starts[group], LANES);
    }
    let is_covered = bundle.is_covered(scene);
    let mut overlay = Overlay::new();
    if is_covered {
        let is_t_0 = bundle.is_t_0();
        let samples = rows.iter().map(|row| row.sample);
        overlay.begin(&scene.cover, bundle.entries(), is_t_0, samples);
        for (s, row) in rows.iter().enumerate() {
            let [point, direction] = bundle.rays(scene, normal, row);
            let z_m = std::array::from_fn(|l| {
                let (group, lane) = place(s, l);
                1.0 / seen[group].w[lane]
            });
            overlay.lay(bundle.cards(scene), s, &point, &direction, &z_m);
        }
    }
    let mut misses = [0; LANES];
    for (s, row) in rows.iter().enumerate() {
        let mut weight = colour_weights(scene, bundle, row);
        if let Some(factor) = smudge_factor(scene, camera, row) {
            for l in 0..LANES {
                (0..3).for_each(|c| weight[c][l] *= factor[l]);
            }
        }
        if row.is_t_0() {
            for l in (0..LANES).filter(|l| camera.entries.glass[row.sample][*l] == 0.0) {
                (0..3).for_each(|c| weight[c][l] = 1.0);
            }
        }
        let part = usize::from(s >= quarter) + usize::from(s >= half);
        for l in 0..LANES {
            let (group, lane) = place(s, l);
            let (through, added) = (overlay.through[s][l], overlay.added[s][l]);
            misses[l] += u32::from(seen[group].w[lane] == 0.0 && through > 0.0);
            for k in 0..3 {
                let radiance = f64::from(seen[group].radiance[lane][k] * through + added[k]);
                if feeds != Feeds::Bare {
                    sums[part][l][k] += radiance * f64::from(weight[k][l]);
                }
                if feeds != Feeds::Order {
                    transmission[part][l][k] += radiance;
                }
            }
        }
    }
    misses
}

/// Computes the weights of a row: red, green, blue.
#[inline(always)]
fn colour_weights(scene: &Scene, bundle: &Bundle, row: &Row<'_>) -> [[f32; LANES]; 3] {
    let (camera, s) = (bundle.camera, row.sample);
    if let Path::Stack(table) = row.path {
        let colours: [[f32; 4]; LANES] = std::array::from_fn(|l| table.colours(camera, s, l));
        return [0, 1, 2].map(|c| colours.map(|colour| colour[c]));
    }
    let rays = match row.path {
        Path::Rough(way) => Some((&camera.rough, way)),
        Path::Smeared(way) => Some((&camera.smeared, way)),
        _ => None,
    };
    if let Some((rays, way)) = rays {
        let weight = rays.weights(way);
        return if rays.is_coloured {
            [weight[0][s], weight[1][s], weight[2][s]]
        } else {
            [weight[0][s]; 3]
        };
    }
    if row.carries_dropped {
        return weights_with_dropped(scene, camera, row);
    }
    let is_coloured = row.order.is_some_and(|order| scene.slab.absorbs_in(order));
    weights_alone(scene, camera, row, is_coloured)
}
