//! The model of a photograph: solids, lights, sky, camera.

use super::camera::Pose;
use super::shape::Solid;
use super::sky::Sky;
use glam::Vec3;

/// An open window: a rectangle that emits light to one side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    pub(super) centre: Vec3,
    pub(super) half_u: Vec3,
    pub(super) half_v: Vec3,
    pub(super) normal: Vec3,
    pub(super) radiance: Vec3,
}

/// A small round lamp.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bulb {
    pub(super) centre: Vec3,
    pub(super) radius_m: f32,
    /// Irradiance times squared distance.
    pub(super) intensity: Vec3,
}

/// All light sources of a place, and its ambient light.
#[derive(Clone, Debug)]
pub(super) struct Lights {
    pub(super) sun_direction: Vec3,
    /// Irradiance of the sun on a perpendicular surface; zero without sun.
    pub(super) sun: Vec3,
    pub(super) openings: Vec<Opening>,
    pub(super) bulbs: Vec<Bulb>,
    /// Ambient radiance from above and from below.
    pub(super) ambient_up: Vec3,
    pub(super) ambient_down: Vec3,
    /// Length of ambient rays, m.
    pub(super) ambient_reach_m: f32,
}

/// A place with its lights, sky and camera pose, and the picture's brightness and depth range.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub(super) solids: Vec<Solid>,
    pub(super) lights: Lights,
    pub(super) sky: Sky,
    pub(super) pose: Pose,
    /// Target mean of the picture's sRGB codes, 0..1.
    pub(super) brightness: f32,
    /// Largest depth of the scanner, m.
    pub(super) range_m: f32,
}
