//! Decodes the files of a photograph to a sheet.

use super::relative::{self, RelativeEnds};
use super::turned::{PhotographSizes, check_turned};
use super::{center, color, depth, fill, mask};
use crate::formats::error::SceneError;
use crate::formats::files::{NamedBytes, PhotographFiles};
use crate::formats::raster::Raster;
use crate::trace::{Grid, Texture};
use glasshouse_line::{Fill, Intrinsics, Orientation, Photograph, Transfer, validate_side};
use std::path::Path;
use std::sync::Arc;

/// A continuous surface with radiance: one vertex at each pixel centre of the depth image. A clone shares its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Number of vertex columns: width of the depth image, px.
    pub width: usize,
    /// Number of vertex rows: height of the depth image, px.
    pub height: usize,
    /// 1/z of each vertex. Holes are filled, and every value is normal and above 0.
    pub grid: Arc<Grid>,
    /// True for measured vertices, false for filled vertices; row by row.
    pub valid: Arc<[bool]>,
    /// Share of filled vertices.
    pub filled_share: f64,
    /// Ends of a relative depth in metres.
    pub relative: Option<RelativeEnds>,
    /// Linear Rec.709 radiance with curve, exposure and illuminant applied: red, green, blue, 0, for 16-byte loads. The
    /// image covers the same field of view.
    pub texture: Arc<Texture>,
    /// Intrinsics in pixels of the depth image; `size` is `None`.
    pub intrinsics: Intrinsics,
    /// Mean z of the four centre pixels, as published; the nearest valid pixels replace holes.
    pub front_center_z_m: f64,
}

impl Sheet {
    /// Returns 1/z of each vertex, row by row.
    pub fn inverse_depths_per_m(&self) -> impl Iterator<Item = f32> {
        // The grid repeats a single column or row.
        let rows = self.grid.inverse_depths_per_m().chunks(self.grid.nx()).take(self.height);
        rows.flat_map(|row| &row[..self.width]).copied()
    }

    /// Returns the radiance of each texel, row by row.
    pub fn radiance(&self) -> impl Iterator<Item = &[f32; 4]> {
        self.texture.rows().flatten()
    }
}

/// The geometry of a photograph: everything but its colours. Lines that differ only in their light share it.
pub(super) struct Shape {
    width: usize,
    height: usize,
    grid: Arc<Grid>,
    valid: Arc<[bool]>,
    filled_share: f64,
    relative: Option<RelativeEnds>,
    intrinsics: Intrinsics,
    front_center_z_m: f64,
}

impl Shape {
    /// Returns the size in memory, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.grid.bytes() + self.valid.len()
    }

    /// Adds the colours. The sheet shares the geometry.
    pub(super) fn with(&self, texture: Arc<Texture>) -> Sheet {
        Sheet {
            width: self.width,
            height: self.height,
            grid: Arc::clone(&self.grid),
            valid: Arc::clone(&self.valid),
            filled_share: self.filled_share,
            relative: self.relative,
            texture,
            intrinsics: self.intrinsics,
            front_center_z_m: self.front_center_z_m,
        }
    }
}

/// Decodes the files of a photograph and fills the holes of its depth image.
///
/// A hole is a pixel that the mask excludes, or that has a metric depth of 0, below 0, NaN or infinity. A depth without
/// a normal `f32` inverse (nearer than about 3e-39 m, farther than 8.5e37 m) is an error, because a placeholder such as
/// `FLT_MAX` must not become a surface.
pub fn decode_photograph(line: &Photograph, files: &PhotographFiles) -> Result<Sheet, SceneError> {
    check_line(line, &files.color.path)?;
    let shape = decode_shape(line, files)?;
    let samples = color::decode_samples(&files.color, line.orientation)?;
    Ok(shape.with(texture(line, &files.color.path, &samples)?.into()))
}

/// Checks the numbers of the line. `path` is for errors.
pub(super) fn check_line(line: &Photograph, path: &Path) -> Result<(), SceneError> {
    validate_side("photograph", &line.clone().into())
        .map_err(|source| SceneError::Parameter { path: path.to_owned(), source })
}

/// Returns how the values of a photograph's depth file become depths.
pub(super) fn codes(line: &Photograph) -> depth::DepthCodes {
    depth::DepthCodes { unit_m: line.depth_unit_m, none_code: line.depth_none_code }
}

/// Decodes depth image and mask.
pub(super) fn decode_shape(
    line: &Photograph,
    files: &PhotographFiles,
) -> Result<Shape, SceneError> {
    let mut depth = depth::decode(&files.depth, line.orientation, codes(line))?;
    let depth_size = depth.size;
    let (width, height) = (depth.width, depth.height);
    let intrinsics = scale_intrinsics(&line.intrinsics, width, height);
    depth.project(line.depth_kind, &intrinsics);

    let mask = files.mask.as_ref().map(|file| mask::decode(file, line.orientation)).transpose()?;
    let mask_size = mask.as_ref().map(|mask| mask.size);
    let color_size = color::size(&files.color, files.color.bytes.len() as u64)?;
    check_turned(
        line,
        &PhotographSizes {
            color: (&files.color.path, color_size),
            depth: (&files.depth.path, depth_size),
            mask: files.mask.as_ref().map(|file| file.path.as_path()).zip(mask_size),
        },
    )?;
    let mut valid = check_mask(files, mask, width, height)?;
    let relative = match &line.depth_range {
        Some(range) => Some(relative::scale(
            &mut depth,
            &mut valid,
            line.depth_kind,
            range,
            &files.depth.path,
        )?),
        None => None,
    };
    let mut inverse_depth_per_m = invert(&files.depth.path, &depth, &mut valid)?;
    let hole_count = valid.iter().filter(|&&valid| !valid).count();
    let front_center_z_m = center::front_center_z_m(&depth.z_m, &valid, width, height)
        .ok_or_else(|| SceneError::NoDepth { path: files.depth.path.clone() })?;
    drop(depth);
    match line.fill {
        Fill::Smooth => fill::smooth(&mut inverse_depth_per_m, width, height),
        Fill::Far => fill::far(&mut inverse_depth_per_m),
    }
    Ok(Shape {
        width,
        height,
        grid: Grid::new(width, height, inverse_depth_per_m).into(),
        valid: valid.into(),
        filled_share: hole_count as f64 / (width * height) as f64,
        relative,
        intrinsics,
        front_center_z_m,
    })
}

/// Converts the samples of the colour image to the line's light. `path` is for errors.
pub(super) fn texture(
    line: &Photograph,
    path: &Path,
    samples: &Raster,
) -> Result<Texture, SceneError> {
    let scale = line.illuminant.map(|c| line.exposure * c);
    let color = color::expanded(path, samples, line.transfer, line.highlights, scale)?;
    Ok(Texture::from_vec(color.width, color.height, color.radiance))
}

/// Decodes width, height and pixels of a colour image in any format, with codes taken as linear. Values must be finite
/// and not negative.
pub fn decode_linear_image(file: &NamedBytes) -> Result<(usize, usize, Vec<[f32; 3]>), SceneError> {
    let color = color::decode(file, Orientation::Upright, Transfer::Linear, [1.0; 3])?;
    let pixels = color.radiance.iter().map(|&[r, g, b, _]| [r, g, b]);
    Ok((color.width, color.height, pixels.collect()))
}

/// Decodes width, height and linear radiance of an upright sRGB colour image.
pub(crate) fn decode_srgb_image(
    file: &NamedBytes,
) -> Result<(usize, usize, Vec<[f32; 4]>), SceneError> {
    let color = color::decode(file, Orientation::Upright, Transfer::Srgb, [1.0; 3])?;
    Ok((color.width, color.height, color.radiance))
}

/// Scales intrinsics to an image of `width` x `height` pixels with the same field of view.
fn scale_intrinsics(given: &Intrinsics, width: usize, height: usize) -> Intrinsics {
    let (x, y) = match given.size {
        Some([given_width, given_height]) => {
            (width as f64 / given_width as f64, height as f64 / given_height as f64)
        }
        None => (1.0, 1.0),
    };
    Intrinsics {
        fx: given.fx * x,
        fy: given.fy * y,
        cx: given.cx * x,
        cy: given.cy * y,
        size: None,
    }
}

/// Checks the size of the mask and returns its pixels. Without a mask, all pixels are valid.
fn check_mask(
    files: &PhotographFiles,
    mask: Option<mask::Mask>,
    width: usize,
    height: usize,
) -> Result<Vec<bool>, SceneError> {
    let (Some(mask), Some(file)) = (mask, &files.mask) else {
        return Ok(vec![true; width * height]);
    };
    if (mask.width, mask.height) == (width, height) {
        return Ok(mask.valid);
    }
    Err(SceneError::MaskSize {
        path: file.path.clone(),
        width: mask.width,
        height: mask.height,
        depth_path: files.depth.path.clone(),
        depth_width: width,
        depth_height: height,
    })
}

/// Computes the inverse depth of valid pixels, and 0 in holes. Clears `valid` for pixels without finite depth above 0.
pub(super) fn invert(
    path: &Path,
    depth: &depth::Depth,
    valid: &mut [bool],
) -> Result<Vec<f32>, SceneError> {
    let mut all_normal = true;
    let inverse_depth_per_m: Vec<f32> = depth
        .z_m
        .iter()
        .zip(valid.iter_mut())
        .map(|(&z_m, valid)| {
            *valid &= z_m > 0.0 && z_m < f64::INFINITY;
            let inverse = (1.0 / z_m) as f32;
            all_normal &= !*valid || inverse.is_normal();
            if *valid { inverse } else { 0.0 }
        })
        .collect();
    if all_normal {
        return Ok(inverse_depth_per_m);
    }
    let is_bad = |&at: &usize| valid[at] && !inverse_depth_per_m[at].is_normal();
    let all = 0..valid.len();
    let first = all.clone().find(is_bad).expect("the loop above found one");
    Err(SceneError::DepthRange {
        path: path.to_owned(),
        count: all.filter(is_bad).count(),
        z_m: depth.z_m[first],
        x: first % depth.width,
        y: first / depth.width,
    })
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod hostile;
