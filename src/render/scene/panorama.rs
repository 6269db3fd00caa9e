//! Converts the visible part of a panorama to a pinhole view, which is a sheet like that of a photograph.
//!
//! The view is that of the capture camera. It covers the window of [`super::window`] and at least one more pixel on
//! every side, so that no path ends beyond a border. Within [`MAX_VIEW_SIDE`], it has at least about as many pixels per
//! radian as the panorama and its map. Colour is interpolated in linear light, depth as inverse distance along the ray.

use super::equirect::{Taps, rotation};
use super::photograph::{Sheet, invert};
use super::window::{Sight, Window};
use super::{center, color, depth, fill, relative};
use crate::formats::error::SceneError;
use crate::formats::files::{FileFormat, NamedBytes, PanoramaFiles};
use crate::trace::{Grid, Texture};
use glam::{DMat3, DVec3};
use glasshouse_line::{
    DepthMap, Fill, Intrinsics, Orientation, PanoramaDepth, PanoramaFile, Transfer,
};
use std::f64::consts::TAU;

/// Largest side of the view, px.
const MAX_VIEW_SIDE: usize = 2048;

/// Least number of pixels per radian. With this number, the flat triangles that approximate a sphere deviate from it by
/// up to 2e-4 of its radius.
const MIN_PX_PER_RAD: f64 = 36.0;

/// Largest side of the view that is searched for the nearest surface, px.
const MAX_SEARCH_SIDE: usize = 512;

/// Distances along the rays of a panorama.
enum Distances {
    Sphere {
        inverse_per_m: f64,
    },
    Map {
        width: usize,
        height: usize,
        /// Inverse distances, row by row; 0 is a hole.
        inverse_per_m: Vec<f32>,
    },
}

/// The pixel grid of a view.
struct Raster {
    width: usize,
    height: usize,
    intrinsics: Intrinsics,
    rotation: DMat3,
}

/// Decodes a panorama's files into a sheet that covers `sight`.
pub(super) fn decode_panorama(
    line: &PanoramaFile,
    files: &PanoramaFiles,
    sight: &Sight,
) -> Result<Sheet, SceneError> {
    let file = &files.panorama;
    let is_light = matches!(file.format(color::FORMATS)?, FileFormat::Exr | FileFormat::Hdr);
    if is_light && line.transfer == Transfer::Srgb {
        return Err(
            file.wrong_layout("radiance, not sRGB".to_owned(), "\"transfer\": \"linear\" with it")
        );
    }
    let image = color::expanded(
        &file.path,
        &color::decode_samples(file, Orientation::Upright)?,
        line.transfer,
        line.highlights,
        line.illuminant.map(|c| line.exposure * c),
    )?;
    check_aspect(file, image.width, image.height)?;
    let mut px_per_rad = MIN_PX_PER_RAD.max(image.width as f64 / TAU);
    let (distances, relative) = match (line.distances(), &files.depth) {
        (PanoramaDepth::Map(map), Some(file)) => {
            let (distances, ends) = decode_map(&map, file)?;
            if let Distances::Map { width, .. } = &distances {
                px_per_rad = px_per_rad.max(*width as f64 / TAU);
            }
            (distances, ends)
        }
        (PanoramaDepth::Constant { depth_m }, _) => {
            (Distances::Sphere { inverse_per_m: 1.0 / depth_m }, None)
        }
        (PanoramaDepth::Map(_), None) => unreachable!("the files were read for this line"),
    };

    let turn = rotation(line.yaw_deg, line.pitch_deg);
    let nearest_m = match &distances {
        Distances::Sphere { inverse_per_m } => 1.0 / inverse_per_m,
        Distances::Map { .. } => {
            let search = Raster::new(sight.window(sight.pane_m), px_per_rad, MAX_SEARCH_SIDE, turn);
            let inverse = search.directions().map(|(d, _)| distances.inverse_per_m(d));
            (1.0 / inverse.fold(0.0, f64::max)).max(sight.pane_m)
        }
    };
    let view = Raster::new(sight.window(nearest_m), px_per_rad, MAX_VIEW_SIDE, turn);
    let pixels = view.width * view.height;
    let mut radiance = Vec::with_capacity(pixels);
    let mut inverse_depth_per_m = Vec::with_capacity(pixels);
    for (direction, secant) in view.directions() {
        let taps = Taps::new(direction, image.width, image.height);
        radiance.push(taps.color(&image.radiance, image.width));
        // The distance along the ray is z times the secant.
        let inverse = distances.inverse_per_m(direction) * secant;
        inverse_depth_per_m.push(inverse.min(f64::from(f32::MAX)) as f32);
    }
    let valid: Vec<bool> = inverse_depth_per_m.iter().map(|&w| w > 0.0).collect();
    let z_m: Vec<f64> = inverse_depth_per_m.iter().map(|&w| 1.0 / f64::from(w)).collect();
    let front_center_z_m = center::front_center_z_m(&z_m, &valid, view.width, view.height)
        .ok_or_else(|| SceneError::NoDepth {
            path: files.depth.as_ref().unwrap_or(file).path.clone(),
        })?;
    if let PanoramaDepth::Map(map) = line.distances() {
        match map.fill {
            Fill::Smooth => fill::smooth(&mut inverse_depth_per_m, view.width, view.height),
            Fill::Far => fill::far(&mut inverse_depth_per_m),
        }
    }
    let holes = valid.iter().filter(|valid| !**valid).count();
    Ok(Sheet {
        width: view.width,
        height: view.height,
        grid: Grid::new(view.width, view.height, inverse_depth_per_m).into(),
        valid: valid.into(),
        filled_share: holes as f64 / pixels as f64,
        relative,
        texture: Texture::from_vec(view.width, view.height, radiance).into(),
        intrinsics: view.intrinsics,
        front_center_z_m,
    })
}

/// Accepts only full panoramas: twice as wide as high, within one percent.
pub(super) fn check_aspect(
    file: &NamedBytes,
    width: usize,
    height: usize,
) -> Result<(), SceneError> {
    let aspect = width as f64 / height as f64;
    if (aspect / 2.0 - 1.0).abs() <= 0.01 {
        return Ok(());
    }
    Err(file.wrong_layout(
        format!("{width}x{height} pixels"),
        "an equirectangular image of 360 by 180 degrees, twice as wide as high",
    ))
}

fn decode_map(
    line: &DepthMap<'_>,
    file: &NamedBytes,
) -> Result<(Distances, Option<relative::RelativeEnds>), SceneError> {
    let codes = depth::DepthCodes { unit_m: line.depth_unit_m, none_code: line.depth_none_code };
    let mut map = depth::decode(file, Orientation::Upright, codes)?;
    check_aspect(file, map.width, map.height)?;
    let mut valid = vec![true; map.z_m.len()];
    let ends = line
        .depth_range
        .map(|range| relative::scale(&mut map, &mut valid, line.depth_kind, &range, &file.path));
    let ends = ends.transpose()?;
    let inverse_per_m = invert(&file.path, &map, &mut valid)?;
    let distances = Distances::Map { width: map.width, height: map.height, inverse_per_m };
    Ok((distances, ends))
}

impl Distances {
    /// Returns the inverse distance in direction `d`; 0 is a hole.
    fn inverse_per_m(&self, d: DVec3) -> f64 {
        match self {
            Self::Sphere { inverse_per_m } => *inverse_per_m,
            Self::Map { width, height, inverse_per_m } => {
                Taps::new(d, *width, *height).inverse_distance(inverse_per_m, *width)
            }
        }
    }
}

impl Raster {
    /// Makes a view of `window` and one or two more pixels on every side, with at least `px_per_rad` pixels per radian,
    /// or as many as `max_side` allows.
    fn new(window: Window, px_per_rad: f64, max_side: usize, rotation: DMat3) -> Self {
        let Window([across, down]) = window;
        let side = |[least, most]: [f64; 2]| {
            // Off the axis, a pixel covers a smaller angle: for a focal length of 1, a radian at the tangents t and s
            // has (1 + t^2 + s^2) / sqrt(1 + s^2) pixels. The minimum over s is 1 + t^2, or 2 t for t above 1.
            let t = least.max(-most).max(0.0);
            let fewest = if t <= 1.0 { 1.0 + t * t } else { 2.0 * t };
            let room = (max_side - 4) as f64;
            let focal_px = (px_per_rad / fewest).min(room / (most - least));
            let count = ((most - least) * focal_px).ceil() as usize + 3;
            // The first pixel's centre is one pixel before the window.
            (count, focal_px, 1.5 - least * focal_px)
        };
        let (width, fx, cx) = side(across);
        let (height, fy, cy) = side(down);
        Self { width, height, intrinsics: Intrinsics { fx, fy, cx, cy, size: None }, rotation }
    }

    /// Returns the direction of each pixel's centre in the panorama's coordinates, row by row, with the secant of the
    /// direction's angle to the view's axis.
    fn directions(&self) -> impl Iterator<Item = (DVec3, f64)> + '_ {
        let k = &self.intrinsics;
        (0..self.height).flat_map(move |j| {
            (0..self.width).map(move |i| {
                let ray =
                    DVec3::new((i as f64 + 0.5 - k.cx) / k.fx, (j as f64 + 0.5 - k.cy) / k.fy, 1.0);
                (self.rotation * ray, ray.length())
            })
        })
    }
}

#[cfg(test)]
mod tests;
