//! A place ready to be photographed: solids, lights, sky, camera.

use super::camera::{Camera, Pose};
use super::listing::{Place, SamplePhotograph};
use super::shape::Solid;
use super::sky::Sky;
use super::{outdoors, room};
use glam::Vec3;
use render::line::Intrinsics;

/// A rectangle that shines to one side: an open window.
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
    /// Intensity, so that irradiance is this over the squared distance.
    pub(super) intensity: Vec3,
}

/// Everything that shines.
#[derive(Clone, Debug)]
pub(super) struct Lights {
    pub(super) sun_direction: Vec3,
    /// Irradiance of the sun at right angles; zero without one.
    pub(super) sun: Vec3,
    pub(super) openings: Vec<Opening>,
    pub(super) bulbs: Vec<Bulb>,
    /// Ambient radiance from above and from below.
    pub(super) ambient_up: Vec3,
    pub(super) ambient_down: Vec3,
    /// How far ambient rays look for something that hides the rest.
    pub(super) ambient_reach_m: f32,
}

/// A place, its lights and its camera.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub(super) solids: Vec<Solid>,
    pub(super) lights: Lights,
    pub(super) sky: Sky,
    pub(super) pose: Pose,
    /// Mean of the sRGB-coded picture that the exposure aims at.
    pub(super) brightness: f32,
    /// Depth beyond which the scanner sees nothing.
    pub(super) range_m: f32,
}

impl Model {
    /// The model of one photograph.
    pub(super) fn new(photograph: &SamplePhotograph) -> Self {
        match photograph.place {
            Place::Indoors => room::model(photograph),
            Place::Outdoor => outdoors::model(photograph),
        }
    }

    pub(super) fn camera(&self, intrinsics: &Intrinsics) -> Camera {
        Camera::new(self.pose, intrinsics)
    }
}
