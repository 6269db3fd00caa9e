//! Writes rays, hits and vertices to plain files, so that other ray tracers can do exactly the same work.

use super::error::BenchError;
use render::atomic_file;
use render::trace::{BundleProbe, View};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Schema name of `rays.json`.
const SCHEMA: &str = "glasshouse.rays/1";

/// A folder of ray classes.
pub struct RayDump {
    dir: PathBuf,
    classes: Vec<Class>,
}

/// One class in `rays.json`.
#[derive(Clone, Debug, Serialize)]
struct Class {
    name: String,
    count: usize,
    /// Number of vertices across and down. Two triangles form a quad, split from (i + 1, j) to (i, j + 1).
    nx: usize,
    ny: usize,
    /// File of little-endian f32: `[ox, oy, oz, dx, dy, dz]` of each ray, m, in capture coordinates; oz is 0, dz is 1.
    rays: String,
    /// File of little-endian f32: z of each ray's hit, m.
    hits: String,
    /// File of little-endian f32: `[x, y, z]` of each vertex, row by row, in metres.
    vertices: String,
    /// Speed of the intersection alone in the run that wrote the dump, millions of rays per second.
    kernel_mrays_per_s: f64,
}

impl RayDump {
    /// Starts a dump; creates `dir`.
    pub fn new(dir: &Path) -> Result<Self, BenchError> {
        atomic_file::create_dir(dir)?;
        Ok(Self { dir: dir.to_owned(), classes: Vec::new() })
    }

    /// Writes one class: its rays, the depths of its hits and its sheet's vertices. `hits` are inverse depths, 1/m.
    pub fn add(
        &mut self,
        name: &str,
        probe: &BundleProbe,
        hits: &[f32],
        kernel_mrays_per_s: f64,
    ) -> Result<(), BenchError> {
        let view = probe.view();
        let rays: Vec<f32> =
            probe.rays().iter().flat_map(|ray| [ray.origin, ray.direction]).flatten().collect();
        let depths: Vec<f32> = hits.iter().map(|w| 1.0 / w).collect();
        // Classes of one side share a sheet. Each class gets a copy, so that it is self-contained.
        let class = Class {
            name: name.to_owned(),
            count: hits.len(),
            nx: view.grid.nx(),
            ny: view.grid.ny(),
            rays: format!("{name}.rays"),
            hits: format!("{name}.hits"),
            vertices: format!("{name}.vertices"),
            kernel_mrays_per_s,
        };
        self.write(&class.rays, &rays)?;
        self.write(&class.hits, &depths)?;
        self.write(&class.vertices, &vertices(view))?;
        self.classes.push(class);
        Ok(())
    }

    /// Writes `rays.json` and returns its path.
    pub fn finish(self) -> Result<PathBuf, BenchError> {
        let list = serde_json::json!({ "schema": SCHEMA, "classes": self.classes });
        let path = self.dir.join("rays.json");
        atomic_file::write(&path, format!("{list:#}\n").as_bytes())?;
        Ok(path)
    }

    fn write(&self, name: &str, values: &[f32]) -> Result<(), BenchError> {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        atomic_file::write_relaxed(&self.dir.join(name), &bytes)?;
        Ok(())
    }
}

/// Returns the vertices of a sheet in the frame of its capture camera, m.
fn vertices(view: &View) -> Vec<f32> {
    let [fx, fy] = view.focal_px.map(f64::abs);
    let [cx, cy] = view.principal;
    let nx = view.grid.nx();
    let vertex = |(q, w): (usize, &f32)| {
        let z = 1.0 / f64::from(*w);
        let (i, j) = ((q % nx) as f64, (q / nx) as f64);
        [(i - cx) / fx * z, (j - cy) / fy * z, z].map(|v| v as f32)
    };
    let w = view.grid.inverse_depths_per_m();
    w.iter().enumerate().flat_map(vertex).collect()
}
