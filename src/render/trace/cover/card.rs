//! A flat picture with transparent parts.

use super::super::lanes::{LANES, Lane, floor, max, min};
use super::super::texture::Texture;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// A rectangle with a picture, in the lens's coordinates (of the mirrored world, for the back).
#[derive(Clone, Debug)]
pub struct Card {
    /// Normal of the rectangle, and the product of it with a point of the rectangle.
    normal: Vec3,
    height_m: f32,
    /// Gradients of the picture's coordinates, and the coordinates of the origin. The picture covers [0, 1] x [0, 1].
    gradients: [Vec3; 2],
    at_origin: [f32; 2],
    /// Tangents `[least, most]` between which the lens's centre sees the card, across and down, and the least z of the card.
    pub(in super::super) seen: [[f64; 2]; 2],
    pub(in super::super) nearest_z_m: f64,
    /// Radiance times alpha, and alpha.
    picture: Arc<Texture>,
}

impl Card {
    /// Makes a card from its upper left corner, its upper and its left edge, and its picture: radiance times alpha, and alpha.
    pub fn new(corner: DVec3, across: DVec3, down: DVec3, picture: Arc<Texture>) -> Self {
        let normal = across.cross(down).normalize();
        let gradients = [across, down].map(|edge| edge / edge.length_squared());
        let corners = [corner, corner + across, corner + down, corner + across + down];
        let nearest_z_m = corners.iter().fold(f64::INFINITY, |z, corner| z.min(corner.z));
        let mut seen = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for corner in corners {
            for (seen, along) in seen.iter_mut().zip([corner.x, corner.y]) {
                let tangent = along / corner.z;
                *seen = [seen[0].min(tangent), seen[1].max(tangent)];
            }
        }
        Self {
            normal: normal.as_vec3(),
            height_m: normal.dot(corner) as f32,
            gradients: gradients.map(DVec3::as_vec3),
            at_origin: gradients.map(|gradient| -gradient.dot(corner) as f32),
            seen,
            nearest_z_m,
            picture,
        }
    }

    /// Returns the largest radiance of any colour.
    pub(in super::super) fn max_radiance(&self) -> f32 {
        self.picture.max_radiance()
    }

    /// Finds the places at which sixteen rays meet the card before `surface_z_m`: coordinates of the picture, and 1 for a hit
    /// or 0. The rays have these points in the plane z = 0, and the directions (x, y, 1).
    #[inline(always)]
    pub(in super::super) fn hits(
        &self,
        point: &[Lane; 2],
        direction: &[Lane; 2],
        surface_z_m: &Lane,
    ) -> ([Lane; 2], [u32; LANES]) {
        let (n, [across, down]) = (self.normal, self.gradients);
        let (mut at, mut hit) = ([[0.0; LANES]; 2], [0; LANES]);
        for l in 0..LANES {
            let (px, py, dx, dy) = (point[0][l], point[1][l], direction[0][l], direction[1][l]);
            let z = (self.height_m - (px * n.x + py * n.y)) / (dx * n.x + dy * n.y + n.z);
            let (x, y) = (px + z * dx, py + z * dy);
            let u = x * across.x + y * across.y + z * across.z + self.at_origin[0];
            let v = x * down.x + y * down.y + z * down.z + self.at_origin[1];
            let is_on = (0.0..=1.0).contains(&u) & (0.0..=1.0).contains(&v);
            hit[l] = u32::from(is_on & (z > 0.0) & (z < surface_z_m[l]));
            (at[0][l], at[1][l]) = (u, v);
        }
        (at, hit)
    }

    /// Interpolates radiance times alpha, and alpha, between the four nearest pixel centres.
    #[inline(always)]
    pub(in super::super) fn texel(&self, u: f32, v: f32) -> [f32; 4] {
        let picture = &self.picture;
        let (width, height) = (picture.width(), picture.height());
        let ((i, right), (j, below)) = (texel_at(u, width), texel_at(v, height));
        let cell = (j * picture.stride() + i) as u32;
        #[allow(unsafe_code, reason = "see Texture::quad")]
        // SAFETY: i < width and j < height.
        let (upper, lower) = unsafe {
            let [upper, lower] = picture.quad(cell);
            (&*upper, &*lower)
        };
        // Neither `map` nor a closure: the compiler does not always inline them, and then compiles them for the baseline.
        let mut texel = [0.0; 4];
        for k in 0..4 {
            let above = upper[k] * (1.0 - right) + upper[4 + k] * right;
            texel[k] =
                above * (1.0 - below) + (lower[k] * (1.0 - right) + lower[4 + k] * right) * below;
        }
        texel
    }
}

/// Returns the texel before a coordinate of the picture, and how far behind its centre the coordinate is.
#[inline(always)]
fn texel_at(at: f32, size: usize) -> (usize, f32) {
    let at = min(max(at * size as f32 - 0.5, 0.0), (size - 1) as f32);
    let (whole, index) = floor(at);
    (index as usize, at - whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_is_hit_before_the_surface_and_interpolated_between_pixel_centres() {
        // Two columns, black and white, at z = 2 m, from x = -1 to 1 and y = 0 to 1; the second is half transparent.
        let texels = [[0.0, 0.0, 0.0, 1.0], [0.5, 0.5, 0.5, 0.5]];
        let picture = Arc::new(Texture::new(2, 1, &texels));
        let card = Card::new(DVec3::new(-1.0, 0.0, 2.0), DVec3::X * 2.0, DVec3::Y, picture);
        assert_eq!((card.seen, card.nearest_z_m), ([[-0.5, 0.5], [0.0, 0.5]], 2.0));
        let mut direction = [[0.0; LANES]; 2];
        direction[0] = std::array::from_fn(|l| -0.7 + 0.1 * l as f32);
        direction[1] = [0.125; LANES];
        let far = [f32::INFINITY; LANES];
        let (at, hit) = card.hits(&[[0.0; LANES]; 2], &direction, &far);
        for l in 0..LANES {
            let u = 0.5 + direction[0][l];
            assert_eq!(hit[l], u32::from((0.0..=1.0).contains(&u)), "{u}");
            assert!((at[0][l] - u).abs() < 1e-6 && (at[1][l] - 0.25).abs() < 1e-6);
        }
        let (_, hit) = card.hits(&[[0.0; LANES]; 2], &direction, &[1.9; LANES]);
        assert_eq!(hit, [0; LANES]);
        assert_eq!(card.texel(0.1, 0.7), texels[0]);
        assert_eq!(card.texel(1.0, 1.0), texels[1]);
        assert_eq!(card.texel(0.5, 0.0), [0.25, 0.25, 0.25, 0.75]);
    }
}
