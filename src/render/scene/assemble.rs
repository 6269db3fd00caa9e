//! Two sheets or meshes, a pane, a lens and a film become a [`trace::Scene`], or a reason why they cannot.

use super::near::{MAX_TOO_NEAR_SHARE, Near};
use super::photograph::Sheet;
use super::place::{Decoded, MeshSides, Placed};
use super::relative::RelativeSides;
use crate::line::{Apex, Filter, Focus, FocusAt, LineError, ReflectionOrders, SceneLine, refuse};
use crate::trace::{
    FilmPlane, FilterTable, Grid, Lens, MAX_COORDINATE_M, Order, OrderPlan, Pose, Sampling, Scene,
    Slab, Texture, View,
};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// Largest travel of a ray over a depth image, px: beyond it f32 cell indices would not be exact.
const MAX_TRAVEL_PX: f64 = 4_194_304.0;

/// Why a scene cannot be traced.
#[derive(Debug, thiserror::Error)]
pub enum AssembleError {
    /// The pane cannot be looked through.
    #[error(transparent)]
    Line(#[from] LineError),
    /// Surfaces stand between the lens and the pane.
    #[error(
        "{side} photograph: {:.2} % of its valid depth pixels are nearer than the pane at {distance_m} m \
         (nearest surface {nearest_m:.3} m, at most {:.0} % may be): move the pane nearer \
         (glass.distance_m), take another photograph, or check {side}.depth_unit_m", share * 100.0,
        MAX_TOO_NEAR_SHARE * 100.0
    )]
    TooNear {
        /// `front` or `back`.
        side: &'static str,
        /// Share of the valid pixels.
        share: f64,
        /// The pane's distance.
        distance_m: f64,
        /// Smallest valid depth.
        nearest_m: f64,
    },
    /// Vertices stand between the lens and the pane.
    #[error(
        "{side} mesh: {:.2} % of its vertices in the field of view are nearer than the pane at {distance_m} m \
         (nearest {nearest_m:.3} m, at most {:.0} % may be): move the pane nearer (glass.distance_m), or check \
         {side}.unit_m and {side}.pose", share * 100.0, MAX_TOO_NEAR_SHARE * 100.0
    )]
    MeshTooNear {
        /// `front` or `back`.
        side: &'static str,
        /// Share of the vertices in the field of view.
        share: f64,
        /// The pane's distance.
        distance_m: f64,
        /// Smallest distance from the lens along the axis.
        nearest_m: f64,
    },
    /// A mesh of which nothing can be seen.
    #[error(
        "{side} mesh: none of its {triangles} triangles is in front of the lens: check {side}.unit_m, {side}.pose \
         (the camera looks along +z, +y is down) and the apex"
    )]
    MeshUnseen {
        /// `front` or `back`.
        side: &'static str,
        /// How many there are.
        triangles: usize,
    },
    /// A mesh beyond what the tracer takes.
    #[error(
        "{side} mesh: it reaches {reach_m:e} m from the lens along an axis (limit {MAX_COORDINATE_M:e}): check \
         {side}.unit_m, {side}.pose and glass.distance_m"
    )]
    MeshReach {
        /// `front` or `back`.
        side: &'static str,
        /// Largest coordinate.
        reach_m: f64,
    },
    /// Nothing to focus on.
    #[error(
        "camera.focus is {side}_center, but the ray through the film's centre meets nothing of the {side}: write a \
         distance_m, or check {side}.pose"
    )]
    NoFocus {
        /// `front` or `back`.
        side: &'static str,
    },
    /// A surface so near that a lens ray would cross millions of depth pixels.
    #[error(
        "{side} photograph: a surface {nearest_m:e} m from the capture camera makes lens rays cross {travel_px:.0} \
         depth pixels (limit {MAX_TRAVEL_PX}): mask such pixels, or check {side}.depth_unit_m"
    )]
    Travel {
        /// `front` or `back`.
        side: &'static str,
        /// Smallest depth.
        nearest_m: f64,
        /// Travel.
        travel_px: f64,
    },
    /// With apex `camera` a tilted pane shows what the back photograph's camera could not see.
    #[error(
        "the pane's tilt {tilt_deg:?} degrees turns the reflected view {angle_deg:.1} degrees away from the back \
         photograph's axis (limit 85): tilt less, or use \"apex\": \"mirror\""
    )]
    LooksAway {
        /// The tilt.
        tilt_deg: [f64; 2],
        /// Largest angle.
        angle_deg: f64,
    },
}

/// What was found out about a scene on the way; goes into partials and `tuple.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFacts {
    /// Focus distance; `null` is infinity.
    pub focus_distance_m: Option<f64>,
    /// Orders of the glass that were followed.
    pub orders: Vec<OrderFact>,
    /// Bound of what the dropped orders would add, linear radiance: to I from the front, to I and R~ from the back.
    pub dropped_tail: Sides,
    /// Share of depth pixels that were holes and were filled.
    pub filled_share: Sides,
    /// Of the sides whose depth is relative: the metres that it was given.
    #[serde(default, skip_serializing_if = "RelativeSides::is_empty")]
    pub relative_depth: RelativeSides,
    /// Share of valid depth pixels nearer than the pane (they are seen all the same).
    pub too_near_share: Sides,
    /// Largest linear radiance.
    pub max_radiance: Sides,
    /// Of the sides that are meshes.
    #[serde(default, skip_serializing_if = "MeshSides::is_empty")]
    pub meshes: MeshSides,
}

/// One value for each side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sides {
    /// Of the front.
    pub front: f64,
    /// Of the back.
    pub back: f64,
}

/// An order that was followed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrderFact {
    /// `t0`, `t1`, ..., `r0`, `r1`, ...
    pub order: String,
    /// Largest weight over the film.
    pub max_weight: f64,
    /// Samples a pixel.
    pub samples: u32,
}

/// Makes the scene.
pub fn assemble(
    line: &SceneLine,
    front: impl Into<Decoded>,
    back: impl Into<Decoded>,
) -> Result<(Scene, SceneFacts), AssembleError> {
    let (front, back): (Decoded, Decoded) = (front.into(), back.into());
    let max_radiance = Sides {
        front: front.max_radiance(),
        back: back.max_radiance(),
    };
    let lateral_m = line.camera.aperture_radius_m + line.glass.thickness_m;
    // The front's coordinates are the lens's: a mesh can be focused on before anything else is known.
    let front = front.place("front", |x| x, lateral_m)?;
    let slab = slab(line);
    let normal = slab.normal;
    let mirror = mirror(&slab);
    let twice = slab.normal * (2.0 * slab.plane_distance_m);
    let apex = line.back.apex().unwrap_or_default();
    let into_mirrored_world = |x: DVec3| match apex {
        Apex::Mirror => DVec3::new(-x.x, x.y, x.z),
        Apex::Camera => mirror * DVec3::new(-x.x, x.y, -x.z) + twice,
    };
    let back = back.place("back", into_mirrored_world, lateral_m)?;
    let focus_distance_m = match line.camera.focus {
        Focus::Distance { distance_m } => Some(distance_m),
        Focus::At {
            at: FocusAt::FrontCenter,
        } => Some(front.center_z_m("front", |x| x)?),
        Focus::At {
            at: FocusAt::BackCenter,
        } => Some(back.center_z_m("back", into_mirrored_world)?),
        Focus::At {
            at: FocusAt::Infinity,
        } => None,
    };
    let lens = Lens {
        aperture_radius_m: line.camera.aperture_radius_m,
        inverse_focus_per_m: focus_distance_m.map_or(0.0, |z| 1.0 / z),
    };
    refuse(line, lens.inverse_focus_per_m)?;

    let film = film_plane(line);
    let directions = film_directions(film_reach(&film, &lens));
    let cosines: Vec<f64> = directions
        .iter()
        .map(|d| d.normalize().dot(normal))
        .collect();
    let orders = OrderPlan::new(
        &slab,
        &cosines,
        [max_radiance.front, max_radiance.back],
        line.film.order_tolerance,
    );

    let near = Near {
        slab: &slab,
        distance_m: line.glass.distance_m,
        reach: film_reach(&film, &lens),
    };
    let too_near_share = Sides {
        front: near.share("front", &front, |p| p.dot(normal))?,
        back: near.share("back", &back, |p| match apex {
            Apex::Mirror => DVec3::new(-p.x, p.y, p.z).dot(normal),
            // The surface must stay on the camera's side of the pane: mirror it there to measure alike.
            Apex::Camera => 2.0 * slab.plane_distance_m - DVec3::new(-p.x, p.y, -p.z).dot(normal),
        })?,
    };
    let facts = SceneFacts {
        focus_distance_m,
        orders: order_facts(&orders, line.film.spp),
        dropped_tail: Sides {
            front: orders.front_tail,
            back: orders.back_tail,
        },
        filled_share: Sides {
            front: front.filled_share(),
            back: back.filled_share(),
        },
        relative_depth: RelativeSides {
            front: front.relative(),
            back: back.relative(),
        },
        too_near_share,
        max_radiance,
        meshes: MeshSides {
            front: front.mesh_facts(),
            back: back.mesh_facts(),
        },
    };
    let reach_m = lens.aperture_radius_m + 40.0 * slab.thickness_m;
    let front = match front {
        Placed::Mesh(placed) => placed.mesh.into(),
        Placed::Sheet(sheet) => {
            view("front", sheet, Pose::Aligned { extra_m: 0.0 }, 1.0, reach_m)?.into()
        }
    };
    let back = match back {
        Placed::Mesh(placed) => placed.mesh.into(),
        Placed::Sheet(sheet) => {
            let pose = pose(line, &slab, apex, &directions)?;
            let extra_m = if apex == Apex::Camera {
                2.0 * slab.plane_distance_m
            } else {
                0.0
            };
            // In the aligned poses the mirrored x is in the sign of the focal length; a general pose holds it itself.
            let sign = if matches!(pose, Pose::Aligned { .. }) {
                -1.0
            } else {
                1.0
            };
            view("back", sheet, pose, sign, reach_m + extra_m)?.into()
        }
    };
    let scene = Scene {
        seed: line.seed,
        sampling: Sampling::Sobol,
        spp: line.film.spp,
        target_error: line.film.target_error,
        layers: line.film.layers.asked(),
        first_reflection_alone: line.film.glass_reflection_orders == ReflectionOrders::First,
        film,
        lens,
        slab,
        orders,
        front,
        back,
    };
    Ok((scene, facts))
}

/// The pane of a line.
pub(super) fn slab(line: &SceneLine) -> Slab {
    let normal = if line.glass.tilt_deg == [0.0, 0.0] {
        DVec3::Z
    } else {
        Slab::tilted_normal(line.glass.tilt_deg)
    };
    Slab {
        normal,
        plane_distance_m: line.glass.distance_m * normal.z,
        thickness_m: line.glass.thickness_m,
        ior: line.glass.ior,
        absorption_per_m: line.glass.absorption_per_m,
    }
}

/// The film of a line.
pub(super) fn film_plane(line: &SceneLine) -> FilmPlane {
    FilmPlane {
        width: line.film.width,
        height: line.film.height,
        tan_half_fov: FilmPlane::tan_half_fov(
            line.film.width,
            line.film.height,
            line.camera.focal_length_mm,
        ),
        filter: match line.film.filter {
            Filter::Box => None,
            Filter::Gaussian => Some(FilterTable::gaussian()),
        },
    }
}

/// Tangents of half the field of view, widened by the lens and the filter.
pub(super) fn film_reach(film: &FilmPlane, lens: &Lens) -> [f64; 2] {
    let spread = lens.aperture_radius_m * lens.inverse_focus_per_m;
    let beyond = film.filter.as_ref().map_or(0.0, FilterTable::radius_px);
    let pixel = film.pixel_tangent();
    [0, 1].map(|k| film.tan_half_fov[k] + beyond * pixel[k] + spread)
}

/// A dense set of camera directions: a grid over the film's reach.
pub(super) fn film_directions(reach: [f64; 2]) -> Vec<DVec3> {
    const STEPS: u32 = 32;
    let at = |i: u32| 2.0 * f64::from(i) / f64::from(STEPS) - 1.0;
    (0..=STEPS)
        .flat_map(|j| (0..=STEPS).map(move |i| DVec3::new(at(i) * reach[0], at(j) * reach[1], 1.0)))
        .collect()
}

/// H = I - 2 n n^T.
pub(super) fn mirror(slab: &Slab) -> DMat3 {
    let n = slab.normal;
    DMat3::IDENTITY - DMat3::from_cols(n * n.x, n * n.y, n * n.z) * 2.0
}

/// Where the back photograph's capture camera stands in the mirrored world.
fn pose(
    line: &SceneLine,
    slab: &Slab,
    apex: Apex,
    directions: &[DVec3],
) -> Result<Pose, AssembleError> {
    match apex {
        // The capture camera is the lens's own mirror image: in the mirrored world it is the lens, whatever the tilt.
        Apex::Mirror => Ok(Pose::Aligned { extra_m: 0.0 }),
        Apex::Camera if !slab.is_tilted() => Ok(Pose::Aligned {
            extra_m: 2.0 * slab.plane_distance_m,
        }),
        Apex::Camera => {
            // x = H x' + 2 D n mirrors the mirrored world back, H = I - 2 n n^T; then diag(-1, 1, -1) turns.
            let n = slab.normal;
            let turn = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0));
            let rotation = turn * mirror(slab);
            let angle = |d: &DVec3| (rotation * *d).normalize().z.clamp(-1.0, 1.0);
            let cos = directions.iter().map(angle).fold(1.0, f64::min);
            let angle_deg = libm::acos(cos).to_degrees();
            if angle_deg > 85.0 {
                return Err(AssembleError::LooksAway {
                    tilt_deg: line.glass.tilt_deg,
                    angle_deg,
                });
            }
            Ok(Pose::General {
                rotation,
                translation_m: turn * (n * (2.0 * slab.plane_distance_m)),
            })
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
    let texture = Texture::from_vec(sheet.color_width, sheet.color_height, sheet.radiance);
    let grid = Grid::new(sheet.width, sheet.height, sheet.inverse_depth_per_m);
    let w = f64::from(grid.extremes()[1]);
    let travel_px = k.fx.max(k.fy) * reach_m * w;
    if travel_px > MAX_TRAVEL_PX {
        return Err(AssembleError::Travel {
            side,
            nearest_m: 1.0 / w,
            travel_px,
        });
    }
    Ok(View {
        grid,
        texture,
        focal_px: [sign * k.fx, k.fy],
        principal: [k.cx - 0.5, k.cy - 0.5],
        pose,
        photograph_size: (sheet.width, sheet.height),
    })
}

fn order_facts(orders: &OrderPlan, spp: u32) -> Vec<OrderFact> {
    let block = spp.min(crate::trace::BLOCK as u32);
    let all = orders.front.iter().chain(&orders.back);
    all.map(|followed| OrderFact {
        order: match followed.order {
            Order::Transmitted(k) => format!("t{k}"),
            Order::Reflected(k) => format!("r{k}"),
        },
        max_weight: followed.max_weight,
        samples: followed.samples_of_block(block) * (spp / block),
    })
    .collect()
}
