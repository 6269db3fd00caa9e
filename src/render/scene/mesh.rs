//! Decodes the file of a mesh to triangles in the capture camera's coordinates.

use super::transfer;
use crate::formats::error::SceneError;
use crate::formats::files::NamedBytes;
use crate::formats::ply;
use crate::trace::MAX_COORDINATE_M;
use glam::{DMat3, DVec3};
use glasshouse_line::MeshFile;

/// A triangle mesh with radiance at its vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygons {
    /// Positions in the capture camera's coordinates (+x right, +y down, +z forward).
    pub vertices_m: Vec<DVec3>,
    /// Linear Rec.709 radiance of each vertex with exposure and illuminant applied: red, green, blue, 0.
    pub radiance: Vec<[f32; 4]>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Number of faces with fewer than three corners, which were left out.
    pub empty_faces: u64,
    /// Largest radiance of any channel.
    pub max_radiance: f32,
}

/// Decodes a mesh's file. Polygons become fans of triangles, colours become linear radiance, and coordinates become
/// metres in the capture camera's coordinates.
pub fn decode_mesh(line: &MeshFile, file: &NamedBytes) -> Result<Polygons, SceneError> {
    let ply::Ply { mut vertices, colors, triangles, empty_faces } = ply::decode(file)?;
    let (rotation, translation) = line.pose.map_or((DMat3::IDENTITY, DVec3::ZERO), |pose| {
        let rows = DMat3::from_cols_array_2d(&pose.rotation);
        (rows.transpose(), DVec3::from_array(pose.translation_m))
    });
    for (index, vertex) in vertices.iter_mut().enumerate() {
        let placed = rotation * (*vertex * line.unit_m) + translation;
        let is_within = placed.is_finite() && placed.abs().max_element() <= MAX_COORDINATE_M;
        if !is_within {
            return Err(file.bad_element(
                format!("vertex {index}"),
                format!("is {:e} m from the capture camera", placed.length()),
                "meshes reach at most 1e7 m along an axis: check unit_m and pose",
            ));
        }
        *vertex = placed;
    }
    let mut max_radiance = 0.0f32;
    let mut radiance = Vec::with_capacity(colors.len());
    for (index, color) in colors.iter().enumerate() {
        let mut pixel = [0.0f32; 4];
        for k in 0..3 {
            let linear =
                transfer::to_linear(line.transfer, color[k]) * (line.exposure * line.illuminant[k]);
            if !(0.0..=f64::from(f32::MAX)).contains(&linear) {
                return Err(file.bad_element(
                    format!("vertex {index}"),
                    format!("has the radiance {linear:e} (colour {})", color[k]),
                    "radiance is finite and not negative: repair the file, or lower the exposure",
                ));
            }
            pixel[k] = linear as f32;
            max_radiance = max_radiance.max(pixel[k]);
        }
        radiance.push(pixel);
    }
    Ok(Polygons { vertices_m: vertices, radiance, triangles, empty_faces, max_radiance })
}
