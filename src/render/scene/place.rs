//! A decoded side and its position.

use super::error::AssembleError;
use super::mesh::Polygons;
use super::photograph::Sheet;
use super::relative::RelativeEnds;
use crate::trace::{MAX_COORDINATE_M, Mesh, NEAR_M, Texture};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The surface of one side, decoded from its files.
#[derive(Clone)]
pub enum Decoded {
    Sheet(Sheet),
    Mesh(Polygons),
}

impl From<Sheet> for Decoded {
    fn from(sheet: Sheet) -> Self {
        Self::Sheet(sheet)
    }
}

impl From<Polygons> for Decoded {
    fn from(mesh: Polygons) -> Self {
        Self::Mesh(mesh)
    }
}

/// One side, decoded from its files.
#[derive(Clone)]
pub struct DecodedSide {
    pub surface: Decoded,
    /// Pictures of the side's cards, in the order of the line.
    pub cards: Vec<Arc<Texture>>,
}

impl<T: Into<Decoded>> From<T> for DecodedSide {
    /// Makes a side without cards.
    fn from(surface: T) -> Self {
        Self { surface: surface.into(), cards: vec![] }
    }
}

impl DecodedSide {
    /// Returns the largest linear radiance of the surface and of the cards. An alpha below 1 mixes both, and adds none.
    pub(super) fn max_radiance(&self) -> f64 {
        let cards = self.cards.iter().map(|card| brightest(card));
        cards.fold(self.surface.max_radiance(), f64::max)
    }
}

/// Returns the largest radiance of a card's texels, before its alpha.
fn brightest(card: &Texture) -> f64 {
    let of = |&[r, g, b, alpha]: &[f32; 4]| f64::from(r.max(g).max(b)) / f64::from(alpha);
    card.rows().flatten().filter(|texel| texel[3] > 0.0).map(of).fold(0.0, f64::max)
}

/// One side: a sheet in capture coordinates, which gets its pose later, or a mesh in the lens's coordinates.
pub(super) enum Placed {
    Sheet(Sheet),
    Mesh(Box<PlacedMesh>),
}

/// A mesh in the lens's coordinates (of the mirrored world, for the back).
pub(super) struct PlacedMesh {
    pub(super) mesh: Mesh,
    /// The vertices that triangles use.
    pub(super) vertices_m: Vec<DVec3>,
    facts: MeshFacts,
}

/// Counts of a mesh's triangles and faces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeshFacts {
    /// Number of triangles that are traced, at least in part.
    pub traced: u64,
    /// Number of dropped triangles with two corners at one point, and of faces with fewer than three corners.
    pub degenerate: u64,
    /// Number of dropped triangles that are wholly behind the near plane of the lens.
    pub behind: u64,
}

impl Decoded {
    pub(super) fn max_radiance(&self) -> f64 {
        f64::from(match self {
            Self::Sheet(sheet) => sheet.texture.max_radiance(),
            Self::Mesh(mesh) => mesh.max_radiance,
        })
    }

    /// Moves a mesh by `transform`, from capture coordinates to the lens's; sheets stay unchanged. Rays start within
    /// about `lateral_m` of the axis.
    pub(super) fn place(
        self,
        side: &'static str,
        transform: impl Fn(DVec3) -> DVec3,
        lateral_m: f64,
    ) -> Result<Placed, AssembleError> {
        let polygons = match self {
            Self::Sheet(sheet) => return Ok(Placed::Sheet(sheet)),
            Self::Mesh(polygons) => polygons,
        };
        let Polygons { mut vertices_m, radiance, triangles, empty_faces, .. } = polygons;
        let mut reach_m = 0.0f64;
        for vertex in &mut vertices_m {
            *vertex = transform(*vertex);
            reach_m = reach_m.max(vertex.abs().max_element());
        }
        if reach_m > MAX_COORDINATE_M {
            return Err(AssembleError::MeshReach { side, reach_m });
        }
        let mesh = Mesh::new(&vertices_m, radiance, &triangles, lateral_m);
        let counts = mesh.counts();
        if counts.traced == 0 {
            return Err(AssembleError::MeshUnseen { side, triangles: triangles.len() });
        }
        let mut is_used = vec![false; vertices_m.len()];
        for &corner in triangles.iter().flatten() {
            is_used[corner as usize] = true;
        }
        let mut is_used = is_used.into_iter();
        vertices_m.retain(|_| is_used.next().unwrap_or(false));
        Ok(Placed::Mesh(Box::new(PlacedMesh {
            mesh,
            vertices_m,
            facts: MeshFacts {
                traced: counts.traced,
                degenerate: counts.degenerate + empty_faces,
                behind: counts.behind,
            },
        })))
    }
}

impl Placed {
    pub(super) fn filled_share(&self) -> f64 {
        match self {
            Self::Sheet(sheet) => sheet.filled_share,
            Self::Mesh(_) => 0.0,
        }
    }

    /// Returns the least distance of a surface along the axis of its camera, m.
    pub(super) fn nearest_m(&self) -> f64 {
        match self {
            Self::Sheet(sheet) => 1.0 / f64::from(sheet.grid.extremes()[1]),
            // Triangles are cut at the near plane.
            Self::Mesh(placed) => {
                placed.vertices_m.iter().map(|v| v.z).fold(f64::INFINITY, f64::min).max(NEAR_M)
            }
        }
    }

    pub(super) fn relative(&self) -> Option<RelativeEnds> {
        match self {
            Self::Sheet(sheet) => sheet.relative,
            Self::Mesh(_) => None,
        }
    }

    pub(super) fn mesh_facts(&self) -> Option<MeshFacts> {
        match self {
            Self::Sheet(_) => None,
            Self::Mesh(placed) => Some(placed.facts),
        }
    }

    /// Returns the z of the focus `front_center` or `back_center`. `transform` maps a sheet's capture coordinates to
    /// the lens's; meshes are already in the lens's coordinates.
    pub(super) fn center_z_m(
        &self,
        side: &'static str,
        transform: impl Fn(DVec3) -> DVec3,
    ) -> Result<f64, AssembleError> {
        let z_m = match self {
            Self::Sheet(sheet) => Some(transform(DVec3::Z * sheet.front_center_z_m).z),
            Self::Mesh(placed) => placed.mesh.axis_depth_m(),
        };
        z_m.filter(|z| *z > 0.0).ok_or(AssembleError::NoFocus { side })
    }
}
