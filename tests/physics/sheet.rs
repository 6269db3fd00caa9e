//! A photograph's sheet in f64: tries every triangle or, if depths differ much, every triangle near a line.

use crate::case::Photo;
use glam::DVec3;

/// Length of the border's continuation, px.
const BORDER_PX: f64 = 4000.0;

/// A photograph's sheet in the coordinates of its camera.
pub(crate) struct Sheet<'a> {
    photo: &'a Photo,
    triangles: Vec<[DVec3; 3]>,
    /// True if depths span more than four decades; f64 is then accurate only in (u, v, 1/z).
    is_deep: bool,
}

impl<'a> Sheet<'a> {
    pub(crate) fn new(photo: &'a Photo) -> Self {
        let [nx, ny] = photo.size;
        // The depths of the outermost pixels continue beyond their centres.
        let places = |n: usize| {
            let mut places: Vec<(f64, usize)> = (0..n).map(|i| (i as f64, i)).collect();
            places.insert(0, (-BORDER_PX, 0));
            places.push((n as f64 - 1.0 + BORDER_PX, n - 1));
            places
        };
        let (columns, rows) = (places(nx), places(ny));
        let vertex = |(x, i): (f64, usize), (y, j): (f64, usize)| {
            let z = 1.0 / f64::from(photo.w[j * nx + i]);
            DVec3::new(
                (x + 0.5 - photo.center_px[0]) / photo.focal_px[0] * z,
                (y + 0.5 - photo.center_px[1]) / photo.focal_px[1] * z,
                z,
            )
        };
        let mut triangles = vec![];
        for row in rows.windows(2) {
            for column in columns.windows(2) {
                let corner = |a: usize, b: usize| vertex(column[a], row[b]);
                triangles.push([corner(0, 0), corner(1, 0), corner(0, 1)]);
                triangles.push([corner(1, 1), corner(1, 0), corner(0, 1)]);
            }
        }
        let extremes =
            photo.w.iter().fold([f32::MAX, 0.0], |[lo, hi], &w| [f32::min(lo, w), f32::max(hi, w)]);
        Self { photo, triangles, is_deep: extremes[1] > 1e4 * extremes[0] }
    }

    /// Returns the first hit of a line with the sheet: the hit with the smallest z above 0 in the sheet's coordinates.
    pub(crate) fn first_hit(&self, origin: DVec3, d: DVec3) -> Option<DVec3> {
        if self.is_deep {
            return self.first_hit_in_inverse_depth(origin, d);
        }
        let mut nearest: Option<DVec3> = None;
        for [a, b, c] in &self.triangles {
            let (ab, ac) = (*b - *a, *c - *a);
            let h = d.cross(ac);
            let det = ab.dot(h);
            if det == 0.0 {
                continue;
            }
            let from = origin - *a;
            let u = from.dot(h) / det;
            let q = from.cross(ab);
            let v = d.dot(q) / det;
            const EDGE: f64 = 1e-10;
            if u < -EDGE || v < -EDGE || u + v > 1.0 + EDGE {
                continue;
            }
            let point = origin + ac.dot(q) / det * d;
            if point.z > 0.0 && nearest.is_none_or(|n| point.z < n.z) {
                nearest = Some(point);
            }
        }
        nearest
    }

    /// Computes [`Self::first_hit`] in (u, v, w = 1/z), where the sheet is a height field over pixels with a clamped
    /// border. Tries each triangle near the line, in slices of w from near to far.
    fn first_hit_in_inverse_depth(&self, origin: DVec3, d: DVec3) -> Option<DVec3> {
        let photo = self.photo;
        let [nx, ny] = photo.size.map(|n| n as i64);
        let w_of = |i: i64, j: i64| {
            f64::from(photo.w[(j.clamp(0, ny - 1) * nx + i.clamp(0, nx - 1)) as usize])
        };
        let slope = (d.truncate()) / d.z;
        let foot = origin.truncate() - origin.z * slope;
        // Pixel centres are at integers here.
        let line = |k: usize| {
            let (f, c) = (photo.focal_px[k], photo.center_px[k] - 0.5);
            (f * slope[k] + c, f * foot[k])
        };
        let ((x, sx), (y, sy)) = (line(0), line(1));
        let all = photo.w.iter().map(|&w| f64::from(w));
        let (bottom, top) = (all.clone().fold(f64::INFINITY, f64::min), all.fold(0.0, f64::max));
        let step = 1.0 / sx.abs().max(sy.abs()).max(1e-6);
        let mut hi = top;
        loop {
            let lo = (hi - step).max(bottom);
            let range = |x: f64, s: f64| {
                let (a, b) = (x + s * lo, x + s * hi);
                (a.min(b) - 1e-6).floor() as i64..=(a.max(b) + 1e-6).floor() as i64
            };
            let mut nearest = f64::NEG_INFINITY;
            for j in range(y, sy) {
                for i in range(x, sx) {
                    let (u, v) = (x - i as f64, y - j as f64);
                    let (w00, w10) = (w_of(i, j), w_of(i + 1, j));
                    let (w01, w11) = (w_of(i, j + 1), w_of(i + 1, j + 1));
                    for (a, b, c, side) in [
                        (w00, w10 - w00, w01 - w00, 1.0),
                        (w10 + w01 - w11, w11 - w01, w11 - w10, -1.0),
                    ] {
                        let w = (a + b * u + c * v) / (1.0 - b * sx - c * sy);
                        let (u, v) = (u + sx * w, v + sy * w);
                        const EDGE: f64 = 1e-9;
                        let inside = [u, v, 1.0 - u, 1.0 - v, (1.0 - u - v) * side];
                        if inside.iter().all(|t| *t >= -EDGE) && w >= lo - 1e-12 && w <= hi + 1e-12
                        {
                            nearest = nearest.max(w);
                        }
                    }
                }
            }
            if nearest > 0.0 {
                let z = 1.0 / nearest;
                return Some((slope * z + foot).extend(z));
            }
            if lo <= bottom {
                return None;
            }
            hi = lo;
        }
    }

    /// Returns the radiance along a line, and the position of its hit in lengths of `d`.
    pub(crate) fn seen(&self, origin: DVec3, d: DVec3) -> ([f64; 3], f64) {
        if let Some(hit) = self.first_hit(origin, d) {
            return (self.radiance(hit), (hit - origin).dot(d) / d.length_squared());
        }
        // Rough faces scatter a little light along the film; it meets the border's continuation far away.
        let is_flat = d.z < 0.02 * d.length();
        assert!(is_flat, "the border continues, so every steep line meets the sheet");
        (self.radiance(DVec3::new(d.x, d.y, d.z.max(1e-4))), f64::INFINITY)
    }

    /// Returns the coordinate of a point on axis `k` of the photograph; texel centres are at integers.
    pub(crate) fn texel(&self, k: usize, point: DVec3) -> f64 {
        let photo = self.photo;
        let u = photo.focal_px[k] * point[k] / point.z + photo.center_px[k];
        u / photo.size[k] as f64 * photo.texture_size[k] as f64 - 0.5
    }

    /// Returns the photograph's radiance at a point.
    pub(crate) fn radiance(&self, point: DVec3) -> [f64; 3] {
        let photo = self.photo;
        let inside = |k: usize| self.texel(k, point).clamp(0.0, photo.texture_size[k] as f64 - 1.0);
        let (x, y) = (inside(0), inside(1));
        let [nx, ny] = photo.texture_size;
        let (i, j) = (x as usize, y as usize);
        let (i1, j1) = ((i + 1).min(nx - 1), (j + 1).min(ny - 1));
        let (fx, fy) = (x - i as f64, y - j as f64);
        [0, 1, 2].map(|c| {
            let at = |i: usize, j: usize| f64::from(photo.texels[j * nx + i][c]);
            (at(i, j) * (1.0 - fx) + at(i1, j) * fx) * (1.0 - fy)
                + (at(i, j1) * (1.0 - fx) + at(i1, j1) * fx) * fy
        })
    }
}
