//! One side of the pane: an RGBD photograph, a panorama or a triangle mesh.

use super::card::Card;
use super::image::{Apex, Transfer};
use super::keys::{At, Keys, Row, Visit};
use super::panorama::PanoramaFile;
use super::photograph::Photograph;
use super::scene_line::Camera;
use glasshouse_keys::keys;
use schemars::JsonSchema;
use serde::Serialize;
use std::borrow::Cow;

/// One side of the pane. In JSON, the key `panorama` or `mesh` selects the variant; a photograph has neither.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Side {
    /// A colour and a depth image.
    Photograph(Photograph),
    /// An image of all directions around a point.
    Panorama(PanoramaFile),
    /// A triangle mesh with vertex colours.
    Mesh(MeshFile),
}

/// A triangle mesh, which replaces `color` and `depth`.
#[keys]
pub struct MeshFile {
    /// Path of the PLY file: relative to the manifest, or `NAME:path` under a named root.
    pub mesh: String,
    /// Transfer function of the vertex colours: `srgb` or `linear`.
    #[key(default = Transfer::Srgb, written)]
    pub transfer: Transfer,
    /// Metres per unit of the file's coordinates.
    #[key("(0, inf) m", default = 1.0, written)]
    pub unit_m: f64,
    /// Factor on linear radiance.
    #[key("[0, inf)", default = 1.0, written)]
    pub exposure: f64,
    /// Factors on red, green and blue of linear radiance: the colour of the light on this side.
    #[key("[0, inf)", default = [1.0; 3])]
    pub illuminant: [f64; 3],
    /// Pose of the mesh. Without a pose, the file has the coordinates of the capture camera.
    pub pose: Option<MeshPose>,
    /// Only for the back: position of the capture camera, `mirror` (as if missing) or `camera`.
    pub apex: Option<Apex>,
    /// Flat pictures between the pane and the surface, at most 16.
    pub cards: Vec<Card>,
}

/// A rigid transform from mesh coordinates in metres to the capture camera's (+x right, +y down, +z forward):
/// `rotation * x + translation_m`.
#[keys]
#[derive(Copy)]
pub struct MeshPose {
    /// Rows of a rotation matrix: at right angles and of length 1, to 1e-4.
    #[key("(-inf, inf)", default = MeshPose::no_rotation(), shown = "no rotation", written)]
    pub rotation: [[f64; 3]; 3],
    /// Position of the mesh's origin in capture coordinates.
    // The tracer accepts coordinates up to this limit.
    #[key("[-1e7, 1e7]", default = [0.0; 3], written)]
    pub translation_m: [f64; 3],
}

impl Keys for Side {
    fn rows(at: &At<'static>, rows: &mut Vec<Row>) {
        Photograph::rows(at, rows);
        PanoramaFile::rows(at, rows);
        MeshFile::rows(at, rows);
    }

    fn numbers(&self, at: &At<'_>, visit: &mut Visit<'_>) {
        match self {
            Self::Photograph(photograph) => photograph.numbers(at, visit),
            Self::Panorama(panorama) => panorama.numbers(at, visit),
            Self::Mesh(mesh) => mesh.numbers(at, visit),
        }
    }
}

impl MeshPose {
    pub const fn no_rotation() -> [[f64; 3]; 3] {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    }

    /// Returns the largest difference between `rotation` times its transpose and the unit matrix; infinity for a
    /// determinant that is negative, 0 or NaN.
    pub(crate) fn distortion(&self) -> f64 {
        let r = &self.rotation;
        let row = |a: usize, b: usize| (0..3).map(|k| r[a][k] * r[b][k]).sum::<f64>();
        let minor = |a: usize, b: usize| r[1][a] * r[2][b] - r[1][b] * r[2][a];
        let determinant = r[0][0] * minor(1, 2) - r[0][1] * minor(0, 2) + r[0][2] * minor(0, 1);
        // The determinant depends on every element, so a NaN in any of them also returns here.
        if determinant.is_nan() || determinant <= 0.0 {
            return f64::INFINITY;
        }
        let parts = (0..9).map(|k| (k / 3, k % 3));
        parts.map(|(a, b)| (row(a, b) - f64::from(u8::from(a == b))).abs()).fold(0.0, f64::max)
    }
}

impl Side {
    /// Returns the photograph, if the side is one.
    pub fn photograph(&self) -> Option<&Photograph> {
        match self {
            Self::Photograph(photograph) => Some(photograph),
            Self::Panorama(_) | Self::Mesh(_) => None,
        }
    }

    /// Returns the path that identifies the side: its colour image, panorama or mesh.
    pub fn name(&self) -> &str {
        match self {
            Self::Photograph(photograph) => &photograph.color,
            Self::Panorama(panorama) => &panorama.panorama,
            Self::Mesh(mesh) => &mesh.mesh,
        }
    }

    /// Returns the colour of the side's light.
    pub fn illuminant(&self) -> [f64; 3] {
        match self {
            Self::Photograph(photograph) => photograph.illuminant,
            Self::Panorama(panorama) => panorama.illuminant,
            Self::Mesh(mesh) => mesh.illuminant,
        }
    }

    /// Returns the factor on the side's linear radiance.
    pub fn exposure(&self) -> f64 {
        match self {
            Self::Photograph(photograph) => photograph.exposure,
            Self::Panorama(panorama) => panorama.exposure,
            Self::Mesh(mesh) => mesh.exposure,
        }
    }

    /// Returns mutable references to the exposure and the illuminant.
    pub fn light_mut(&mut self) -> (&mut f64, &mut [f64; 3]) {
        match self {
            Self::Photograph(photograph) => (&mut photograph.exposure, &mut photograph.illuminant),
            Self::Panorama(panorama) => (&mut panorama.exposure, &mut panorama.illuminant),
            Self::Mesh(mesh) => (&mut mesh.exposure, &mut mesh.illuminant),
        }
    }

    /// Returns the side with the camera's exposure and white balance applied to its light and to that of its cards. The light
    /// is linear, so the order of the factors does not matter.
    #[must_use]
    pub fn seen_by(&self, camera: &Camera) -> Self {
        let mut side = self.clone();
        let see = |exposure: &mut f64, illuminant: &mut [f64; 3]| {
            *exposure *= camera.exposure;
            for (channel, balance) in illuminant.iter_mut().zip(camera.white_balance) {
                *channel *= balance;
            }
        };
        for card in side.cards_mut() {
            see(&mut card.exposure, &mut card.illuminant);
        }
        let (exposure, illuminant) = side.light_mut();
        see(exposure, illuminant);
        side
    }

    /// Returns the cards of the side.
    pub fn cards(&self) -> &[Card] {
        match self {
            Self::Photograph(photograph) => &photograph.cards,
            Self::Panorama(panorama) => &panorama.cards,
            Self::Mesh(mesh) => &mesh.cards,
        }
    }

    pub fn cards_mut(&mut self) -> &mut Vec<Card> {
        match self {
            Self::Photograph(photograph) => &mut photograph.cards,
            Self::Panorama(panorama) => &mut panorama.cards,
            Self::Mesh(mesh) => &mut mesh.cards,
        }
    }

    /// Returns the side's key `apex`, the position of the capture camera; `None` if the key is missing.
    pub fn apex(&self) -> Option<Apex> {
        match self {
            Self::Photograph(photograph) => photograph.apex,
            Self::Panorama(panorama) => panorama.apex,
            Self::Mesh(mesh) => mesh.apex,
        }
    }

    pub fn set_apex(&mut self, apex: Apex) {
        match self {
            Self::Photograph(photograph) => photograph.apex = Some(apex),
            Self::Panorama(panorama) => panorama.apex = Some(apex),
            Self::Mesh(mesh) => mesh.apex = Some(apex),
        }
    }

    /// Returns the paths of all files of the side, with their JSON keys.
    pub fn paths(&self) -> Vec<(Cow<'static, str>, &str)> {
        let mut paths: Vec<(&'static str, &str)> = match self {
            Self::Photograph(p) => {
                let depth = p.sketch.is_none().then_some(&p.depth);
                [("color", Some(&p.color)), ("depth", depth), ("mask", p.mask.as_ref())]
                    .into_iter()
                    .filter_map(|(key, path)| Some((key, path?.as_str())))
                    .collect()
            }
            Self::Panorama(p) => {
                let mut paths = vec![("panorama", p.panorama.as_str())];
                paths.extend(p.depth.as_deref().map(|depth| ("depth", depth)));
                paths
            }
            Self::Mesh(mesh) => vec![("mesh", &mesh.mesh)],
        };
        let of_side = paths.drain(..).map(|(key, path)| (Cow::Borrowed(key), path));
        let cards = (0..).zip(self.cards());
        let of_cards =
            cards.map(|(index, card)| (Cow::Owned(card_key(index)), card.color.as_str()));
        of_side.chain(of_cards).collect()
    }

    /// Returns mutable references to the paths of [`Self::paths`].
    pub fn paths_mut(&mut self) -> Vec<&mut String> {
        let (mut paths, cards) = match self {
            Self::Photograph(p) => {
                let depth = p.sketch.is_none().then_some(&mut p.depth);
                let of_side = [Some(&mut p.color), depth, p.mask.as_mut()];
                (of_side.into_iter().flatten().collect(), &mut p.cards)
            }
            Self::Panorama(p) => {
                let mut paths = vec![&mut p.panorama];
                paths.extend(p.depth.as_mut());
                (paths, &mut p.cards)
            }
            Self::Mesh(mesh) => (vec![&mut mesh.mesh], &mut mesh.cards),
        };
        paths.extend(cards.iter_mut().map(|card| &mut card.color));
        paths
    }
}

/// Returns the JSON key of the picture of a side's card.
pub fn card_key(index: usize) -> String {
    format!("cards[{index}].color")
}

impl From<Photograph> for Side {
    fn from(photograph: Photograph) -> Self {
        Self::Photograph(photograph)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_rotations_are_undistorted() {
        let pose = |rotation| MeshPose { rotation, translation_m: [0.0; 3] };
        let (sin, cos) = libm::sincos(0.3);
        let turn = pose([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]);
        assert!(turn.distortion() < 1e-15);
        let mirror = pose([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!(mirror.distortion(), f64::INFINITY);
        let scaled = pose([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]]);
        assert_eq!(scaled.distortion(), 3.0);
        let broken = pose([[f64::NAN, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!(broken.distortion(), f64::INFINITY);
    }
}
