//! Projects a mesh into the lens's projective space, and clips it at the near plane.

use super::super::lanes::{LANES, max};
use super::tree::Tree;
use super::woop::{Corners, Hits, Rays};
use glam::DVec3;

/// Distance of the near plane, m. Clipping removes all parts nearer to the lens or behind it.
pub const NEAR_M: f64 = 1.0e-3;

/// Largest magnitude of a vertex's coordinates, m; it keeps the boxes' areas finite in f32.
pub const MAX_COORDINATE_M: f64 = 1.0e7;

/// A triangle mesh in the coordinates of the lens, or of the lens's mirror image for the back scene.
pub struct Mesh {
    tree: Tree,
    /// Indices into `radiance` of each triangle's corners, in the tree's order.
    corners: Vec<[u32; 3]>,
    radiance: Vec<[f32; 4]>,
    counts: MeshCounts,
}

/// Counts of a mesh's triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshCounts {
    /// Number of non-degenerate triangles that are at least partly in front of the near plane.
    pub traced: u64,
    /// Number of triangles with two equal corners.
    pub degenerate: u64,
    /// Number of non-degenerate triangles that are entirely behind the near plane.
    pub behind: u64,
}

/// First hits of sixteen rays.
pub(super) struct Seen {
    /// Inverse depths, 1/m; 0 for misses.
    pub(super) w: [f32; LANES],
    /// Red, green, blue, 0; black for misses.
    pub(super) radiance: [[f32; 4]; LANES],
}

impl Seen {
    pub(super) const NOTHING: Self = Self { w: [0.0; LANES], radiance: [[0.0; 4]; LANES] };
}

impl Mesh {
    /// Makes a mesh of `vertices` (m; the lens looks along +z), their `radiance` (red, green, blue, 0) and `triangles`
    /// (indices of three vertices, visible from both sides).
    ///
    /// `lateral_m` is the approximate distance of the rays' origins from the axis (aperture, shift in the glass). It
    /// affects the tree's shape and speed, but no hit. Panics if an index has no vertex, a vertex has no radiance or a
    /// coordinate is NaN or exceeds [`MAX_COORDINATE_M`].
    pub fn new(
        vertices: &[DVec3],
        radiance: Vec<[f32; 4]>,
        triangles: &[[u32; 3]],
        lateral_m: f64,
    ) -> Self {
        assert!(
            vertices.len() == radiance.len() && vertices.len() < i32::MAX as usize,
            "a radiance for each vertex"
        );
        assert!(
            vertices.iter().all(|v| v.abs().max_element() <= MAX_COORDINATE_M && !v.is_nan()),
            "vertices beyond {MAX_COORDINATE_M} m"
        );
        let mut clip = Clip {
            vertices,
            points: vertices.iter().map(|v| project(*v)).collect(),
            radiance,
            triangles: Vec::with_capacity(triangles.len()),
        };
        let mut counts = MeshCounts::default();
        for triangle in triangles {
            let [a, b, c] = triangle.map(|i| vertices[i as usize]);
            if a == b || b == c || c == a {
                counts.degenerate += 1;
            } else if clip.add(*triangle) {
                counts.traced += 1;
            } else {
                counts.behind += 1;
            }
        }
        let Clip { points, radiance, triangles, .. } = clip;
        let placed: Vec<Corners> =
            triangles.iter().map(|corners| corners.map(|i| points[i as usize])).collect();
        let (tree, order) = Tree::new(&placed, lateral_m);
        Self {
            tree,
            corners: order.iter().map(|&i| triangles[i as usize]).collect(),
            radiance,
            counts,
        }
    }

    /// Returns the counts of the triangles.
    pub fn counts(&self) -> MeshCounts {
        self.counts
    }

    /// Returns the z coordinate of the first surface on the optical axis, m, or `None` without a surface.
    pub fn axis_depth_m(&self) -> Option<f64> {
        let rays = Rays::new([[0.0; LANES]; 2], [[0.0; LANES]; 2], self.tree.top());
        let w = self.first_hits(&rays, 1).w[0];
        (w > 0.0).then(|| 1.0 / f64::from(w))
    }

    /// Finds the first hits of the first `count` of sixteen rays.
    #[inline(always)]
    pub(super) fn first_hits(&self, rays: &Rays, count: usize) -> Hits {
        self.tree.first_hits(rays, count)
    }

    /// Returns the inverse depths of the first hits of sixteen rays with directions (`d`, 1) through points `p` of the plane z = 0, 1/m;
    /// 0 without a hit.
    pub(in super::super) fn inverse_depths(
        &self,
        d: [[f32; LANES]; 2],
        p: [[f32; LANES]; 2],
    ) -> [f32; LANES] {
        self.first_hits(&Rays::new(d, p, self.tree.top()), LANES).w
    }

    /// Finds the first hits of the first `count` rays with directions (`d`, 1) through points `p` of the plane z = 0.
    #[inline(always)]
    pub(super) fn see(&self, d: [[f32; LANES]; 2], p: [[f32; LANES]; 2], count: usize) -> Seen {
        let hits = self.first_hits(&Rays::new(d, p, self.tree.top()), count);
        let mut radiance = [[0.0; 4]; LANES];
        for l in 0..count {
            if hits.w[l] > 0.0 {
                radiance[l] = self.radiance_at(&hits, l);
            }
        }
        Seen { w: hits.w, radiance }
    }

    /// Interpolates the radiance at a hit linearly in space: a corner of projective weight lambda_k has weight lambda_k
    /// w_k / w. Adds differences of colours, so that a triangle of one colour has exactly that colour.
    #[inline(always)]
    fn radiance_at(&self, hits: &Hits, l: usize) -> [f32; 4] {
        let triangle = hits.triangle[l] as usize;
        let [_, b, c] = self.tree.corners(triangle);
        let [at, bt, ct] = self.corners[triangle].map(|i| self.radiance[i as usize]);
        let scale = 1.0 / hits.w[l];
        let (weight_b, weight_c) = (hits.b[l] * b[2] * scale, hits.c[l] * c[2] * scale);
        std::array::from_fn(|k| {
            let value = at[k] + (weight_b * (bt[k] - at[k]) + weight_c * (ct[k] - at[k]));
            // Rounding may make black negative by an ulp.
            max(value, 0.0)
        })
    }
}

/// Returns (x/z, y/z, 1/z), which is used only for points in front of the near plane.
fn project(v: DVec3) -> [f32; 3] {
    [(v.x / v.z) as f32, (v.y / v.z) as f32, (1.0 / v.z) as f32]
}

/// Triangles clipped at the near plane.
struct Clip<'a> {
    vertices: &'a [DVec3],
    /// Projections of the vertices, then of new vertices on the near plane.
    points: Vec<[f32; 3]>,
    radiance: Vec<[f32; 4]>,
    triangles: Vec<[u32; 3]>,
}

impl Clip<'_> {
    /// Adds the part of the triangle in front of the near plane. Returns false if all of it is behind.
    fn add(&mut self, triangle: [u32; 3]) -> bool {
        let is_seen = triangle.map(|i| self.vertices[i as usize].z >= NEAR_M);
        if is_seen == [true; 3] {
            self.triangles.push(triangle);
            return true;
        }
        let mut polygon = [0; 4];
        let mut corners = 0;
        for k in 0..3 {
            let next = (k + 1) % 3;
            if is_seen[k] {
                polygon[corners] = triangle[k];
                corners += 1;
            }
            if is_seen[k] != is_seen[next] {
                // The cut starts at the visible end, so that both triangles of an edge get the same point, bit by bit.
                let (seen, hidden) = if is_seen[k] { (k, next) } else { (next, k) };
                polygon[corners] = self.cut(triangle[seen], triangle[hidden]);
                corners += 1;
            }
        }
        for k in 2..corners {
            self.triangles.push([polygon[0], polygon[k - 1], polygon[k]]);
        }
        corners >= 3
    }

    /// Adds a vertex at the point where an edge crosses the near plane. Returns the vertex's index.
    fn cut(&mut self, seen: u32, hidden: u32) -> u32 {
        let [from, to] = [seen, hidden].map(|i| self.vertices[i as usize]);
        let t = (from.z - NEAR_M) / (from.z - to.z);
        let mut point = from + (to - from) * t;
        point.z = NEAR_M;
        self.points.push(project(point));
        let [a, b] = [seen, hidden].map(|i| self.radiance[i as usize]);
        let t = t as f32;
        self.radiance.push(std::array::from_fn(|k| max(a[k] + t * (b[k] - a[k]), 0.0)));
        (self.points.len() - 1) as u32
    }
}
