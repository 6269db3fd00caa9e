//! Errors of scene assembly.

use super::check_geometry::GeometryError;
use super::view::OddView;
use crate::trace::MAX_COORDINATE_M;

/// Largest share of the valid depth pixels, or of the vertices in the field of view, that may be nearer than the pane.
pub const MAX_TOO_NEAR_SHARE: f64 = 0.01;

/// Longest allowed path of a ray over a depth image, px. The limit keeps `f32` cell indices exact.
pub(super) const MAX_TRAVEL_PX: f64 = 4_194_304.0;

/// A scene that cannot be traced. `side` is `front` or `back`.
#[derive(Debug, thiserror::Error)]
pub enum AssembleError {
    /// A pane that cannot be rendered.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// A card that touches the pane or lies on its other side.
    #[error(
        "{side}.cards[{index}] reaches {:.3} m beyond the pane, but must lie wholly on its {side} side: increase its distance_m, \
         move or shrink it, or reduce glass.tilt_deg", -lowest_m
    )]
    CardInPane {
        side: &'static str,
        /// Index of the card in the line.
        index: usize,
        /// Least distance of the card from the pane, m; negative beyond it.
        lowest_m: f64,
    },
    /// A photograph or panorama with too many depth pixels nearer than the pane.
    #[error(
        "{side} photograph: {:.2} % of its valid depth pixels are nearer than the pane at {distance_m} m \
         (nearest surface {nearest_m:.3} m, at most {:.0} % are allowed): move the pane nearer \
         (glass.distance_m), take another photograph, or check {side}.depth_unit_m", share * 100.0,
        MAX_TOO_NEAR_SHARE * 100.0
    )]
    TooNear {
        side: &'static str,
        /// Share of the valid depth pixels.
        share: f64,
        distance_m: f64,
        nearest_m: f64,
    },
    /// A photograph beside the view.
    #[error("{}", view.text(&format!("{side} photograph: no ray of the film meets it")))]
    Missed { side: &'static str, view: Box<OddView> },
    /// A mesh with too many vertices between the lens and the pane.
    #[error(
        "{side} mesh: {:.2} % of its vertices in the field of view are nearer than the pane at {distance_m} m \
         (nearest {nearest_m:.3} m, at most {:.0} % are allowed): move the pane nearer (glass.distance_m), or check \
         {side}.unit_m and {side}.pose", share * 100.0, MAX_TOO_NEAR_SHARE * 100.0
    )]
    MeshTooNear {
        side: &'static str,
        /// Share of the vertices in the field of view.
        share: f64,
        distance_m: f64,
        /// Smallest distance from the lens along the axis.
        nearest_m: f64,
    },
    /// A mesh without a usable triangle in front of the lens.
    #[error(
        "{side} mesh: none of its {triangles} triangles is in front of the lens: check {side}.unit_m, {side}.pose \
         (the camera looks along +z, +y is down) and the apex"
    )]
    MeshUnseen { side: &'static str, triangles: usize },
    /// A mesh that exceeds the tracer's largest coordinate.
    #[error(
        "{side} mesh: it reaches {reach_m:e} m from the lens along an axis (limit {MAX_COORDINATE_M:e}): check \
         {side}.unit_m, {side}.pose and glass.distance_m"
    )]
    MeshReach {
        side: &'static str,
        /// Largest coordinate of the mesh.
        reach_m: f64,
    },
    /// A focus on the centre of a side that the ray through the film's centre does not meet.
    #[error(
        "camera.focus is {side}_center, but the ray through the film's centre does not meet the {side}: write a \
         distance_m, or check {side}.pose"
    )]
    NoFocus { side: &'static str },
    /// A surface so near that a lens ray would cross millions of depth pixels.
    #[error(
        "{side} photograph: a surface {nearest_m:e} m from the capture camera makes lens rays cross {travel_px:.0} \
         depth pixels (limit {MAX_TRAVEL_PX}): mask such pixels, or check {side}.depth_unit_m"
    )]
    Travel {
        side: &'static str,
        nearest_m: f64,
        /// Depth pixels that a lens ray would cross.
        travel_px: f64,
    },
    /// A tilted pane that shows, with apex `camera`, directions more than 85 degrees from the back photograph's axis.
    #[error(
        "the pane's tilt {tilt_deg:?} degrees turns the reflected view {angle_deg:.1} degrees away from the back \
         photograph's axis (limit 85): tilt less, or use \"apex\": \"mirror\""
    )]
    LooksAway {
        tilt_deg: [f64; 2],
        /// Largest angle between the reflected view and the photograph's axis.
        angle_deg: f64,
    },
}
