//! A mesh's corners in projective space.

use super::super::lanes::{LANES, max};
use super::tree::Tree;
use super::woop::{Corners, Hits, Rays};
use glam::DVec3;

/// Near plane, m: parts nearer to the lens, or behind it, are cut off.
pub const NEAR_M: f64 = 1.0e-3;

/// Largest magnitude of a vertex's coordinates, m: the boxes' areas stay finite in f32.
pub const MAX_COORDINATE_M: f64 = 1.0e7;

/// A triangle mesh as the tracer sees it: in the lens's coordinates, or its mirror image's for the back.
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
    /// Traced, in whole or in part.
    pub traced: u64,
    /// Two corners at the same place: nothing to see.
    pub degenerate: u64,
    /// Wholly behind the near plane.
    pub behind: u64,
}

/// Sixteen first hits.
pub(super) struct Seen {
    /// Inverse depths; 0 where nothing was met.
    pub(super) w: [f32; LANES],
    /// Red, green, blue, 0; black where nothing was met.
    pub(super) radiance: [[f32; 4]; LANES],
}

impl Mesh {
    /// A mesh of `vertices` (metres; +z is where the lens looks), their `radiance` (red, green, blue, 0) and
    /// `triangles` (indices of three vertices, seen from both sides).
    ///
    /// `lateral_m` is about how far rays start from the axis (aperture, shift in the glass): it shapes the tree, and
    /// changes its speed alone. Panics if an index has no vertex, or a coordinate is not within
    /// [`MAX_COORDINATE_M`].
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

    /// Counts of the triangles.
    pub fn counts(&self) -> MeshCounts {
        self.counts
    }

    /// z of the first surface on the optical axis, m; `None` if there is none.
    pub fn axis_depth_m(&self) -> Option<f64> {
        let rays = Rays::new([[0.0; LANES]; 2], [[0.0; LANES]; 2], self.tree.top());
        let w = self.first_hits(&rays, 1).w[0];
        (w > 0.0).then(|| 1.0 / f64::from(w))
    }

    /// First hits of the first `count` of sixteen rays.
    #[inline(always)]
    pub(super) fn first_hits(&self, rays: &Rays, count: usize) -> Hits {
        self.tree.first_hits(rays, count)
    }

    /// First hits of the first `count` rays with directions (`d`, 1) through points `p` of the plane z = 0.
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

    /// Radiance at a hit: linear on the triangle in space, whose weights are lambda_k w_k / w of the projective ones.
    /// Written as differences, so that a triangle of one colour has exactly that colour.
    #[inline(always)]
    fn radiance_at(&self, hits: &Hits, l: usize) -> [f32; 4] {
        let triangle = hits.triangle[l] as usize;
        let [_, b, c] = self.tree.corners(triangle);
        let [at, bt, ct] = self.corners[triangle].map(|i| self.radiance[i as usize]);
        let scale = 1.0 / hits.w[l];
        let (weight_b, weight_c) = (hits.b[l] * b[2] * scale, hits.c[l] * c[2] * scale);
        std::array::from_fn(|k| {
            let value = at[k] + (weight_b * (bt[k] - at[k]) + weight_c * (ct[k] - at[k]));
            // Rounding may pass black by an ulp.
            max(value, 0.0)
        })
    }
}

/// (x/z, y/z, 1/z), for points in front of the near plane.
fn project(v: DVec3) -> [f32; 3] {
    [(v.x / v.z) as f32, (v.y / v.z) as f32, (1.0 / v.z) as f32]
}

/// Cuts triangles at the near plane.
struct Clip<'a> {
    vertices: &'a [DVec3],
    /// Of the vertices, then of the new ones.
    points: Vec<[f32; 3]>,
    radiance: Vec<[f32; 4]>,
    triangles: Vec<[u32; 3]>,
}

impl Clip<'_> {
    /// Adds the part of the triangle in front of the near plane; `false` if there is none.
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
                // Always from the seen end: triangles that share the edge get the same point, bit by bit.
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

    /// The point of an edge in the near plane, as a new vertex.
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
