//! The capture camera: intrinsics as in DIODE or for PLACES365, and a pose.

use glam::Vec3;
use glasshouse_line::Intrinsics;

/// Returns DIODE's intrinsics, scaled from 1024 x 768 px to this size.
pub fn intrinsics(width: u32, height: u32) -> Intrinsics {
    let (sx, sy) = (f64::from(width) / 1024.0, f64::from(height) / 768.0);
    Intrinsics {
        fx: 886.81 * sx,
        fy: 927.06 * sy,
        cx: 512.0 * sx,
        cy: 384.0 * sy,
        size: Some([width, height]),
    }
}

/// Returns intrinsics with a field of view of 60 degrees across and down, as in the paper's recipe for PLACES365.
pub fn places_intrinsics(width: u32, height: u32) -> Intrinsics {
    let (w, h) = (f64::from(width), f64::from(height));
    // 0.5 / tan(30 degrees)
    let focal_length = 0.5 * 3f64.sqrt();
    Intrinsics {
        fx: focal_length * w,
        fy: focal_length * h,
        cx: 0.5 * w,
        cy: 0.5 * h,
        size: Some([width, height]),
    }
}

/// A ray. `direction` may have any length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) origin: Vec3,
    pub(super) direction: Vec3,
}

impl Ray {
    pub(super) fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// A camera's pose. The world's y axis points up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    pub(super) position: Vec3,
    pub(super) right: Vec3,
    pub(super) up: Vec3,
    pub(super) ahead: Vec3,
}

impl Pose {
    /// Creates a pose that looks along +z, rotated to the right by `yaw_rad` and up by `pitch_rad`.
    pub(super) fn new(position: Vec3, yaw_rad: f32, pitch_rad: f32) -> Self {
        let (sy, cy) = libm::sincosf(yaw_rad);
        let (sp, cp) = libm::sincosf(pitch_rad);
        Self {
            position,
            right: Vec3::new(cy, 0.0, -sy),
            up: Vec3::new(-sy * sp, cp, -cy * sp),
            ahead: Vec3::new(sy * cp, sp, cy * cp),
        }
    }
}

/// A pose with intrinsics.
#[derive(Clone, Copy, Debug)]
pub(super) struct Camera {
    pub(super) pose: Pose,
    pub(super) fx: f32,
    pub(super) fy: f32,
    pub(super) cx: f32,
    pub(super) cy: f32,
}

impl Camera {
    pub(super) fn new(pose: Pose, i: &Intrinsics) -> Self {
        Self { pose, fx: i.fx as f32, fy: i.fy as f32, cx: i.cx as f32, cy: i.cy as f32 }
    }

    /// Returns the ray through the image point (u, v), px. The ray's parameter is the depth along the optical axis.
    pub(super) fn ray(&self, u: f32, v: f32) -> Ray {
        let (x, y) = ((u - self.cx) / self.fx, (self.cy - v) / self.fy);
        Ray {
            origin: self.pose.position,
            direction: self.pose.ahead + self.pose.right * x + self.pose.up * y,
        }
    }

    /// Returns a point in camera axes: right, up, ahead.
    pub(super) fn local(&self, point: Vec3) -> Vec3 {
        let d = point - self.pose.position;
        Vec3::new(d.dot(self.pose.right), d.dot(self.pose.up), d.dot(self.pose.ahead))
    }
}
