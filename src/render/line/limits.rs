//! The range of every number of a scene line: one table for lines and for recipes.

#![allow(
    missing_docs,
    reason = "each constant is named after the field that it limits"
)]

use std::ops::{Bound, RangeBounds};

/// The values that a field may have.
#[derive(Clone, Copy, Debug)]
pub struct Limit {
    range: (Bound<f64>, Bound<f64>),
    /// The same range in words, as it follows "must be".
    pub allowed: &'static str,
}

impl Limit {
    const fn new(least: Bound<f64>, most: Bound<f64>, allowed: &'static str) -> Self {
        Self {
            range: (least, most),
            allowed,
        }
    }

    /// Whether `value` is allowed. Never true for NaN or an infinity.
    pub fn contains(&self, value: f64) -> bool {
        value.is_finite() && self.range.contains(&value)
    }
}

pub const ABOVE_0: Limit = Limit::new(Bound::Excluded(0.0), Bound::Unbounded, "finite and above 0");
const FROM_0: Limit = Limit::new(
    Bound::Included(0.0),
    Bound::Unbounded,
    "finite and at least 0",
);

/// Width and height, px.
pub const FILM_SIDE: Limit = Limit::new(
    Bound::Included(1.0),
    Bound::Included(16_384.0),
    "1 to 16384 px",
);
/// Samples a pixel; [`is_sample_count`] has the rest of the rule.
pub const SPP: Limit = Limit::new(
    Bound::Included(1.0),
    Bound::Included(65_536.0),
    "a power of two from 1 to 65536",
);
/// Stops.
pub const EXPOSURE_EV: Limit = Limit::new(
    Bound::Included(-30.0),
    Bound::Included(30.0),
    "-30 to 30 stops",
);
/// Where the light of a black body has no negative channel and its formula holds.
pub const ILLUMINANT_K: Limit = Limit::new(
    Bound::Included(2000.0),
    Bound::Included(25_000.0),
    "2000 to 25000 K",
);
pub const F_NUMBER: Limit = ABOVE_0;
pub const PERCENTILE: Limit = Limit::new(
    Bound::Excluded(0.0),
    Bound::Included(100.0),
    "above 0 and at most 100",
);
pub const ORDER_TOLERANCE: Limit = FROM_0;
pub const TARGET_ERROR: Limit = ABOVE_0;
pub const FOCAL_LENGTH_MM: Limit = ABOVE_0;
pub const APERTURE_RADIUS_M: Limit = FROM_0;
pub const FOCUS_DISTANCE_M: Limit = ABOVE_0;
pub const GLASS_DISTANCE_M: Limit = ABOVE_0;
pub const THICKNESS_M: Limit = FROM_0;
pub const IOR: Limit = Limit::new(Bound::Included(1.0), Bound::Included(10.0), "1 to 10");
pub const ABSORPTION_PER_M: Limit = FROM_0;
pub const TILT_DEG: Limit = Limit::new(
    Bound::Excluded(-90.0),
    Bound::Excluded(90.0),
    "above -90 and below 90 degrees",
);
pub const DEPTH_UNIT_M: Limit = ABOVE_0;
pub const MESH_UNIT_M: Limit = ABOVE_0;
/// Each part of a mesh's translation, m: what the tracer takes.
pub const TRANSLATION_M: Limit = Limit::new(
    Bound::Included(-1.0e7),
    Bound::Included(1.0e7),
    "-1e7 to 1e7",
);
/// The ends and the mean of a relative depth, m.
pub const RELATIVE_DEPTH_M: Limit = Limit::new(
    Bound::Included(1.0e-3),
    Bound::Included(1.0e6),
    "0.001 to 1e6 m",
);
pub const FAR_OVER_NEAR: Limit = Limit::new(
    Bound::Excluded(1.0),
    Bound::Included(1.0e6),
    "above 1, and 1e6 at most",
);
pub const PERCENT: Limit = Limit::new(Bound::Included(0.0), Bound::Included(100.0), "0 to 100");
pub const EXPOSURE: Limit = FROM_0;
/// Where the curve for clipped highlights begins, linear.
pub const BELOW_WHITE: Limit = Limit::new(
    Bound::Included(0.0),
    Bound::Excluded(1.0),
    "0 or more and below 1",
);
/// What white becomes, linear.
pub const WHITE_BECOMES: Limit =
    Limit::new(Bound::Included(1.0), Bound::Included(1.0e6), "1 to 1e6");
/// The sphere of a panorama without a depth map, m.
pub const PANORAMA_DEPTH_M: Limit = Limit::new(
    Bound::Included(1.0e-3),
    Bound::Included(1.0e6),
    "0.001 to 1e6 m",
);
pub const YAW_DEG: Limit = Limit::new(
    Bound::Included(-360.0),
    Bound::Included(360.0),
    "-360 to 360 degrees",
);
pub const PITCH_DEG: Limit = Limit::new(
    Bound::Included(-90.0),
    Bound::Included(90.0),
    "-90 to 90 degrees",
);
/// fx and fy, px.
pub const FOCAL_LENGTH_PX: Limit = ABOVE_0;
/// cx and cy, px.
pub const PRINCIPAL_POINT_PX: Limit = Limit::new(Bound::Unbounded, Bound::Unbounded, "finite");
/// Each side of `intrinsics.size`, px.
pub const IMAGE_SIDE: Limit = Limit::new(
    Bound::Included(1.0),
    Bound::Included(4_294_967_295.0),
    "at least 1 px",
);

/// Whether `spp` is a sample count that scrambled Sobol points serve in full: a power of two.
pub fn is_sample_count(spp: f64) -> bool {
    SPP.contains(spp) && spp.fract() == 0.0 && (spp as u32).is_power_of_two()
}
