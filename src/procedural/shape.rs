//! Solids with closed-form intersections: blocks, ellipsoids, frustums, foliage.

use super::camera::Ray;
use super::material::Material;
use super::noise::noise3;
use glam::{Mat3, Vec3};

/// Least ray parameter of an intersection. Smaller values belong to the surface that the ray starts from.
const NEAREST: f32 = 1e-3;

/// A shape in its own axes, centred at the origin.
#[derive(Clone, Copy, Debug)]
pub(super) enum Shape {
    /// A box with these half sizes.
    Block(Vec3),
    /// An ellipsoid with these radii.
    Ellipsoid(Vec3),
    /// A frustum along y: radius at the bottom, radius at the top, half the height.
    Frustum(f32, f32, f32),
    /// An ellipsoid with these radii and with holes like those between leaves, drawn from this seed.
    Foliage(Vec3, i32),
}

/// A placed shape with its material.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solid {
    pub(super) shape: Shape,
    pub(super) centre: Vec3,
    /// Columns are the shape's axes in the world.
    pub(super) axes: Mat3,
    pub(super) material: Material,
    /// Offset of the texture's origin, so that textures continue across neighbours.
    pub(super) texture_shift: Vec3,
    /// Number of the piece that the solid belongs to; 0 is the place itself.
    pub(super) group: u32,
}

impl Solid {
    /// Converts a world vector to the shape's axes.
    pub(super) fn local(&self, v: Vec3) -> Vec3 {
        let a = &self.axes;
        Vec3::new(v.dot(a.x_axis), v.dot(a.y_axis), v.dot(a.z_axis))
    }

    /// Returns half the sizes of the box around the shape, in the shape's axes.
    pub(super) fn half(&self) -> Vec3 {
        match self.shape {
            Shape::Block(half) => half,
            Shape::Ellipsoid(radii) | Shape::Foliage(radii, _) => radii,
            Shape::Frustum(bottom, top, half_height) => {
                let r = bottom.max(top);
                Vec3::new(r, half_height, r)
            }
        }
    }

    /// Returns half the sizes of the box around the shape, in the world's axes.
    pub(super) fn world_half(&self) -> Vec3 {
        let h = self.half();
        let a = &self.axes;
        a.x_axis.abs() * h.x + a.y_axis.abs() * h.y + a.z_axis.abs() * h.z
    }

    /// Returns the smallest ray parameter below `t_max` at which the ray enters the solid or, in foliage, meets a leaf.
    #[inline]
    pub(super) fn intersect(&self, ray: &Ray, t_max: f32) -> Option<f32> {
        let o = self.local(ray.origin - self.centre);
        let d = self.local(ray.direction);
        match self.shape {
            Shape::Block(half) => block(o, d, half, t_max),
            Shape::Ellipsoid(radii) => {
                let (near, _) = ellipsoid(o / radii, d / radii)?;
                (near > NEAREST && near < t_max).then_some(near)
            }
            Shape::Frustum(bottom, top, half_height) => {
                frustum(o, d, [bottom, top, half_height], t_max)
            }
            Shape::Foliage(radii, seed) => {
                let (near, far) = ellipsoid(o / radii, d / radii)?;
                let leaf = |t: f32| {
                    let p = (o + d * t) * 15.0;
                    noise3(p, seed) > 0.47
                };
                if near > NEAREST && near < t_max && leaf(near) {
                    return Some(near);
                }
                (far > NEAREST && far < t_max && leaf(far)).then_some(far)
            }
        }
    }

    /// Returns the outward normal at a surface point, both in the shape's axes.
    pub(super) fn normal(&self, p: Vec3) -> Vec3 {
        match self.shape {
            Shape::Block(half) => {
                let q = p / half;
                let a = q.abs();
                if a.x >= a.y && a.x >= a.z {
                    Vec3::new(q.x.signum(), 0.0, 0.0)
                } else if a.y >= a.z {
                    Vec3::new(0.0, q.y.signum(), 0.0)
                } else {
                    Vec3::new(0.0, 0.0, q.z.signum())
                }
            }
            Shape::Ellipsoid(radii) | Shape::Foliage(radii, _) => (p / (radii * radii)).normalize(),
            Shape::Frustum(bottom, top, half_height) => {
                if p.y.abs() > half_height * 0.9999 {
                    return Vec3::new(0.0, p.y.signum(), 0.0);
                }
                let slope = (bottom - top) / (2.0 * half_height);
                let r = (p.x * p.x + p.z * p.z).sqrt().max(1e-6);
                Vec3::new(p.x / r, slope, p.z / r).normalize()
            }
        }
    }
}

/// Returns the parameters at which a ray enters and leaves a box; its corners are relative to the ray's origin.
///
/// Comparisons take one instruction each, unlike `f32::min`. The result for a ray exactly in a face is unspecified.
#[inline]
pub(super) fn slabs(low: Vec3, high: Vec3, inverse: Vec3) -> (f32, f32) {
    let less = |a: f32, b: f32| if a < b { a } else { b };
    let more = |a: f32, b: f32| if a > b { a } else { b };
    let (a, b) = (low * inverse, high * inverse);
    let near = more(more(less(a.x, b.x), less(a.y, b.y)), less(a.z, b.z));
    let far = less(less(more(a.x, b.x), more(a.y, b.y)), more(a.z, b.z));
    (near, far)
}

#[inline]
fn block(o: Vec3, d: Vec3, half: Vec3, t_max: f32) -> Option<f32> {
    let (near, far) = slabs(-half - o, half - o, d.recip());
    (near <= far && near > NEAREST && near < t_max).then_some(near)
}

/// Returns both parameters at which a line meets the unit sphere; `None` if it misses the sphere.
#[inline]
fn ellipsoid(o: Vec3, d: Vec3) -> Option<(f32, f32)> {
    let a = d.dot(d);
    // Parameters relative to the point nearest to the centre stay precise for small, far spheres.
    let t0 = -o.dot(d) / a;
    let nearest = o + d * t0;
    let under = 1.0 - nearest.dot(nearest);
    if under < 0.0 {
        return None;
    }
    let half_chord = (under / a).sqrt();
    Some((t0 - half_chord, t0 + half_chord))
}

fn frustum(o: Vec3, d: Vec3, [bottom, top, half_height]: [f32; 3], t_max: f32) -> Option<f32> {
    let mut best = t_max;
    let slope = (top - bottom) / (2.0 * half_height);
    let radius_at_o = 0.5 * (bottom + top) + slope * o.y;
    let radius_per_t = slope * d.y;
    let a = d.x * d.x + d.z * d.z - radius_per_t * radius_per_t;
    let b = o.x * d.x + o.z * d.z - radius_at_o * radius_per_t;
    let c = o.x * o.x + o.z * o.z - radius_at_o * radius_at_o;
    let under = b * b - a * c;
    if under > 0.0 && a.abs() > 1e-12 {
        let root = under.sqrt();
        for t in [(-b - root) / a, (-b + root) / a] {
            let y = o.y + t * d.y;
            if t > NEAREST && t < best && y.abs() <= half_height && c > 0.0 {
                best = t;
            }
        }
    }
    if d.y != 0.0 {
        let (cap_y, cap_r) = if d.y < 0.0 { (half_height, top) } else { (-half_height, bottom) };
        let t = (cap_y - o.y) / d.y;
        let (x, z) = (o.x + t * d.x, o.z + t * d.z);
        if t > NEAREST && t < best && x * x + z * z <= cap_r * cap_r {
            best = t;
        }
    }
    (best < t_max).then_some(best)
}
