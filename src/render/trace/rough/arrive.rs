//! The camera rays of a chunk at face 0, the smudges there, and the facets of their meetings.

use super::super::bent::dot;
use super::super::camera::concentric_disc;
use super::super::lanes::{CHUNK, LANES, Lane, max, min, neg_ln};
use super::super::sampler::points;
use super::super::smudges::SmudgeLanes;
use super::RoughPane;
use super::rays::{CameraRays, Facets, RoughRays};
use super::scatter::to_frame;
use glam::Vec3;

/// Largest square of a facet's coordinates in the unit disc, from which its slopes are drawn: at 1, the slopes are infinite.
const MOST_OF_DISC: f32 = 1.0 - 1.0 / 16_777_216.0;

impl RoughRays {
    /// Finds the points at which the chunk's rays meet face 0, and their unit directions.
    #[inline(always)]
    pub(super) fn arrive(&mut self, pane: &RoughPane, rays: &CameraRays<'_>) {
        let (n, kappa, center) = (pane.axes[2], pane.curvature_per_m, &rays.patch.center);
        for s in 0..self.count {
            for l in 0..LANES {
                let x = center[0][l] + rays.direction[0][s][l];
                let y = center[1][l] + rays.direction[1][s][l];
                let d = Vec3::new(x, y, 1.0) * (1.0 / (1.0 + (x * x + y * y)).sqrt());
                let p = Vec3::new(rays.lens[0][s][l], rays.lens[1][s][l], -pane.distance_m);
                // Without curvature, the root is the linear coefficient.
                let linear = kappa * dot(p, d) + dot(d, n);
                let constant = kappa * dot(p, p) + 2.0 * dot(p, n);
                let root = max(linear * linear - kappa * constant, 0.0).sqrt();
                let p = p - d * (constant / (linear + root));
                let is_flat = kappa == 0.0;
                let (p, d) =
                    if is_flat { (to_frame(pane.axes, p), to_frame(pane.axes, d)) } else { (p, d) };
                for (lanes, v) in self.arrival.iter_mut().zip([p.x, p.y, p.z, d.x, d.y, d.z]) {
                    lanes[s][l] = v;
                }
            }
        }
        if pane.has_waves {
            self.arrive_at_waves(pane);
        }
        self.has_arrived = true;
    }

    /// Finds the shares of the chunk's light that meet smudges on face 0 of a pane. Returns false if no ray meets any.
    #[inline(always)]
    pub(in super::super) fn meet_smudges(
        &mut self,
        pane: &RoughPane,
        smudges: &SmudgeLanes,
        rays: &CameraRays<'_>,
        shares: &mut [Lane; CHUNK],
    ) -> bool {
        self.arrive(pane, rays);
        let mut largest = 0.0;
        for s in 0..self.count {
            for l in 0..LANES {
                let [x, y, z] = [0, 1, 2].map(|k| self.arrival[k][s][l]);
                let mut p = Vec3::new(x, y, z);
                if pane.curvature_per_m != 0.0 {
                    p = to_frame(pane.axes, p);
                }
                shares[s][l] = smudges.share(p);
                largest = max(shares[s][l], largest);
            }
        }
        largest > 0.0
    }

    /// Moves the rays of a pane with waves from the plane of face 0 to the face.
    #[inline(always)]
    fn arrive_at_waves(&mut self, pane: &RoughPane) {
        for s in 0..self.count {
            for l in 0..LANES {
                let [px, py, pz, dx, dy, dz] =
                    self.arrival.each_mut().map(|lanes| &mut lanes[s][l]);
                let d = Vec3::new(*dx, *dy, *dz);
                let (way_m, _) = pane.wave.meet::<false>(Vec3::new(*px, *py, *pz), d);
                *px += d.x * way_m;
                *py += d.y * way_m;
                *pz += d.z * way_m;
            }
        }
    }

    /// Draws the facets of the `k`-th meeting.
    #[inline(always)]
    pub(super) fn draw(&mut self, rays: &CameraRays<'_>, k: usize) {
        while self.facets.len() <= k {
            let lanes = [[0.0; LANES]; CHUNK];
            self.facets.push((false, Facets { x: lanes, y: lanes }));
        }
        let (is_ready, facets) = &mut self.facets[k];
        if *is_ready {
            return;
        }
        *is_ready = true;
        let Facets { x, y } = facets;
        let seeds = rays.patch.seeds.of_meeting(k as u32);
        points(rays.sampling, &seeds, 0, self.first, &mut x[..self.count], &mut y[..self.count]);
        for s in 0..self.count {
            for l in 0..LANES {
                let (u, v) = concentric_disc(x[s][l], y[s][l]);
                // The square of the distance from the centre is uniform, and tan^2 = -alpha^2 ln(1 - square).
                let square = min(u * u + v * v, MOST_OF_DISC);
                let scale = (neg_ln(1.0 - square) / max(square, 1.0e-30)).sqrt();
                (x[s][l], y[s][l]) = (u * scale, v * scale);
            }
        }
    }
}
