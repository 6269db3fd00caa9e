//! Converts a placed side to a surface of the tracer. A sheet gets its pose and its grid.

use super::error::{AssembleError, MAX_TRAVEL_PX};
use super::geometry::BackCamera;
use super::photograph::Sheet;
use super::place::Placed;
use crate::trace::{Pose, Slab, Surface, View};
use glam::DVec3;
use glasshouse_line::{Apex, SceneLine};

/// Makes the surface seen through the pane. Lens rays start within `reach_m` of the axis.
pub(super) fn front_surface(placed: Placed, reach_m: f64) -> Result<Surface, AssembleError> {
    match placed {
        Placed::Mesh(placed) => Ok(placed.mesh.into()),
        Placed::Sheet(sheet) => {
            let pose = Pose::Aligned { extra_m: 0.0 };
            Ok(view("front", sheet, pose, 1.0, reach_m)?.into())
        }
    }
}

/// Makes the surface reflected in the pane; `directions` are those of camera rays.
pub(super) fn back_surface(
    placed: Placed,
    line: &SceneLine,
    slab: &Slab,
    camera: &BackCamera,
    directions: &[DVec3],
    reach_m: f64,
) -> Result<Surface, AssembleError> {
    match placed {
        Placed::Mesh(placed) => Ok(placed.mesh.into()),
        Placed::Sheet(sheet) => {
            let pose = back_pose(line, slab, camera, directions)?;
            let extra_m = match camera.apex {
                Apex::Mirror => 0.0,
                Apex::Camera => camera.twice_distance_m(),
            };
            // An aligned pose mirrors x by the sign of the focal length; a general pose contains the mirroring.
            let sign = if matches!(pose, Pose::Aligned { .. }) { -1.0 } else { 1.0 };
            Ok(view("back", sheet, pose, sign, reach_m + extra_m)?.into())
        }
    }
}

/// Computes the pose of the back photograph's capture camera in the mirrored world.
fn back_pose(
    line: &SceneLine,
    slab: &Slab,
    camera: &BackCamera,
    directions: &[DVec3],
) -> Result<Pose, AssembleError> {
    match camera.apex {
        Apex::Mirror => Ok(Pose::Aligned { extra_m: 0.0 }),
        Apex::Camera if !slab.is_tilted() => {
            Ok(Pose::Aligned { extra_m: camera.twice_distance_m() })
        }
        Apex::Camera => {
            let (rotation, translation_m) = camera.capture_from_lens();
            let angle = |d: &DVec3| (rotation * *d).normalize().z.clamp(-1.0, 1.0);
            let cos = directions.iter().map(angle).fold(1.0, f64::min);
            let angle_deg = libm::acos(cos).to_degrees();
            if angle_deg > 85.0 {
                return Err(AssembleError::LooksAway { tilt_deg: line.glass.tilt_deg, angle_deg });
            }
            Ok(Pose::General { rotation, translation_m })
        }
    }
}

fn view(
    side: &'static str,
    sheet: Sheet,
    pose: Pose,
    sign: f64,
    reach_m: f64,
) -> Result<View, AssembleError> {
    let k = sheet.intrinsics;
    let w = f64::from(sheet.grid.extremes()[1]);
    let travel_px = k.fx.max(k.fy) * reach_m * w;
    if travel_px > MAX_TRAVEL_PX {
        return Err(AssembleError::Travel { side, nearest_m: 1.0 / w, travel_px });
    }
    Ok(View {
        grid: sheet.grid,
        texture: sheet.texture,
        focal_px: [sign * k.fx, k.fy],
        principal: [k.cx - 0.5, k.cy - 0.5],
        pose,
        photograph_size: (sheet.width, sheet.height),
    })
}
