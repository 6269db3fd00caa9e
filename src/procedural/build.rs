//! Construction of solids in local axes, such as those of a piece of furniture, a wall or a car.

use super::material::Material;
use super::shape::{Shape, Solid};
use glam::{Mat3, Vec3};

/// Upright local axes: x right, y up, z ahead.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) origin: Vec3,
    pub(super) axes: Mat3,
}

impl Frame {
    /// Creates axes at `origin`, rotated to the right by `yaw_rad`.
    pub(super) fn new(origin: Vec3, yaw_rad: f32) -> Self {
        Self { origin, axes: turned(yaw_rad) }
    }

    pub(super) fn world() -> Self {
        Self::new(Vec3::ZERO, 0.0)
    }

    /// Returns axes at a local point, rotated further to the right by `yaw_rad`.
    pub(super) fn at(&self, x: f32, y: f32, z: f32, yaw_rad: f32) -> Self {
        Self { origin: self.point(Vec3::new(x, y, z)), axes: self.axes * turned(yaw_rad) }
    }

    /// Returns the world coordinates of a local point.
    pub(super) fn point(&self, p: Vec3) -> Vec3 {
        self.origin + self.axes * p
    }
}

fn turned(yaw_rad: f32) -> Mat3 {
    let (s, c) = libm::sincosf(yaw_rad);
    Mat3::from_cols(Vec3::new(c, 0.0, -s), Vec3::Y, Vec3::new(s, 0.0, c))
}

/// The solids and bulbs of a place.
#[derive(Debug, Default)]
pub(super) struct Builder {
    pub(super) solids: Vec<Solid>,
    /// Positions of all bulbs, lit or not.
    lamps: Vec<Vec3>,
    pub(super) lamps_on: bool,
    group: u32,
    group_count: u32,
}

impl Builder {
    /// Starts a piece: solids that [`Self::clear_around`] removes together.
    pub(super) fn start_piece(&mut self) {
        self.group_count += 1;
        self.group = self.group_count;
    }

    /// Starts solids of the place itself, which [`Self::clear_around`] never removes.
    pub(super) fn start_place(&mut self) {
        self.group = 0;
    }

    /// Adds a bulb at a local point.
    pub(super) fn lamp(&mut self, frame: &Frame, at: [f32; 3]) {
        self.lamps.push(frame.point(at.into()));
    }

    /// Returns the positions of the bulbs that emit light.
    pub(super) fn lit_lamps(&self) -> &[Vec3] {
        if self.lamps_on { &self.lamps } else { &[] }
    }

    /// Removes all pieces closer to `eye` than `distance_m`.
    pub(super) fn clear_around(&mut self, eye: Vec3, distance_m: f32) {
        let near: Vec<u32> = self
            .solids
            .iter()
            .filter(|s| {
                let d = s.local(eye - s.centre).abs() - s.half();
                s.group != 0 && d.max(Vec3::ZERO).length() < distance_m
            })
            .map(|s| s.group)
            .collect();
        self.solids.retain(|s| !near.contains(&s.group));
    }

    fn push(&mut self, frame: &Frame, centre: Vec3, axes: Mat3, shape: Shape, material: Material) {
        self.solids.push(Solid {
            shape,
            centre: frame.point(centre),
            axes,
            material,
            texture_shift: centre,
            group: self.group,
        });
    }

    /// Adds a box, given its centre and size.
    pub(super) fn block(&mut self, frame: &Frame, centre: [f32; 3], size: [f32; 3], m: Material) {
        let half = Vec3::from(size) * 0.5;
        self.push(frame, centre.into(), frame.axes, Shape::Block(half), m);
    }

    /// Adds a box with the texture's origin at its centre.
    pub(super) fn panel(&mut self, frame: &Frame, centre: [f32; 3], size: [f32; 3], m: Material) {
        let [x, y, z] = centre;
        self.block(&frame.at(x, y, z, 0.0), [0.0; 3], size, m);
    }

    /// Adds an ellipsoid, given its centre and radii.
    pub(super) fn ball(&mut self, frame: &Frame, centre: [f32; 3], radii: [f32; 3], m: Material) {
        let shape = Shape::Ellipsoid(radii.into());
        self.push(frame, centre.into(), frame.axes, shape, m);
    }

    /// Adds a ragged ellipsoid of leaves.
    pub(super) fn foliage(
        &mut self,
        frame: &Frame,
        centre: [f32; 3],
        radii: [f32; 3],
        m: Material,
    ) {
        let shape = Shape::Foliage(radii.into(), m.seed);
        self.push(frame, centre.into(), frame.axes, shape, m);
    }

    /// Adds an upright round post, given its foot and its radii at the foot and at the top.
    pub(super) fn post(
        &mut self,
        frame: &Frame,
        foot: [f32; 3],
        radii: [f32; 2],
        height: f32,
        m: Material,
    ) {
        let half = 0.5 * height;
        let centre = Vec3::from(foot) + Vec3::Y * half;
        let shape = Shape::Frustum(radii[0], radii[1], half);
        self.push(frame, centre, frame.axes, shape, m);
    }

    /// Adds a round rod between two points, given its radii at both ends.
    pub(super) fn rod(
        &mut self,
        frame: &Frame,
        from: [f32; 3],
        to: [f32; 3],
        radii: [f32; 2],
        m: Material,
    ) {
        let (from, to) = (Vec3::from(from), Vec3::from(to));
        let shape = Shape::Frustum(radii[0], radii[1], 0.5 * (to - from).length());
        let axes = frame.axes * along(to - from);
        self.push(frame, 0.5 * (from + to), axes, shape, m);
    }

    /// Adds a flat leaf between two points.
    pub(super) fn leaf(
        &mut self,
        frame: &Frame,
        from: [f32; 3],
        to: [f32; 3],
        width: f32,
        m: Material,
    ) {
        let (from, to) = (Vec3::from(from), Vec3::from(to));
        let radii = Vec3::new(0.5 * width, 0.5 * (to - from).length(), 0.006);
        let axes = frame.axes * along(to - from);
        let shape = Shape::Ellipsoid(radii);
        self.push(frame, 0.5 * (from + to), axes, shape, m);
    }
}

/// Returns axes with y along `d`.
fn along(d: Vec3) -> Mat3 {
    let y = d.normalize();
    let side = if y.x.abs() < 0.9 { Vec3::X } else { Vec3::Z };
    let z = side.cross(y).normalize();
    Mat3::from_cols(y.cross(z), y, z)
}
