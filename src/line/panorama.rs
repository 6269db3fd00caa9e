//! An equirectangular panorama as one side of the pane.

use super::card::Card;
use super::depth_range::DepthRange;
use super::highlights::Highlights;
use super::image::{Apex, DepthKind, Fill, Transfer};
use glasshouse_keys::keys;

/// An image of all directions around one point: columns are longitudes, rows are latitudes, and the centre is +z.
///
/// Replaces a photograph: the loader converts the visible part to a pinhole view.
#[keys]
pub struct PanoramaFile {
    /// Path of an equirectangular image of 360 by 180 degrees, twice as wide as high (within 1 %), in any format of a colour image.
    pub panorama: String,
    /// Transfer function of the image: `srgb` or `linear`, which EXR and Radiance HDR require.
    #[key(default = Transfer::Srgb, written)]
    pub transfer: Transfer,
    /// Factor on linear radiance.
    #[key("[0, inf)", default = 1.0, written)]
    pub exposure: f64,
    /// Factors on red, green and blue of linear radiance: the colour of the light on this side.
    #[key("[0, inf)", default = [1.0; 3])]
    pub illuminant: [f64; 3],
    /// Curve that raises the radiance of clipped sRGB values.
    pub highlights: Option<Highlights>,
    /// Distance of all surfaces along the rays, without `depth`; 10 if missing.
    #[key("[0.001, 1e6] m")]
    pub depth_m: Option<f64>,
    /// Path of an equirectangular map of distances, of any size.
    pub depth: Option<String>,
    /// Metres per unit of the map; 1 if missing.
    #[key("(0, inf) m")]
    pub depth_unit_m: Option<f64>,
    /// Value in the map that means "no distance".
    #[key("(-inf, inf)")]
    pub depth_none_code: Option<f64>,
    /// Kind of the map's distances: `distance` (as if missing) along the ray, `relative` or `relative_inverse`. Never z, because a
    /// panorama has no axis.
    pub depth_kind: Option<DepthKind>,
    /// Range of relative distances in metres.
    pub depth_range: Option<DepthRange>,
    /// Method that fills holes of the map: `smooth` (as if missing) or `far`.
    pub fill: Option<Fill>,
    /// Rotation of the view to the right of the panorama's centre.
    #[key("[-360, 360] degrees", default = 0.0, written)]
    pub yaw_deg: f64,
    /// Upward rotation of the view, before the rotation to the right.
    #[key("[-90, 90] degrees", default = 0.0, written)]
    pub pitch_deg: f64,
    /// Only for the back: position of the panorama's point of view, `mirror` (as if missing) or `camera`.
    pub apex: Option<Apex>,
    /// Flat pictures between the pane and the surface, at most 16.
    pub cards: Vec<Card>,
}

/// Distances along the rays of a panorama.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PanoramaDepth<'p> {
    Constant { depth_m: f64 },
    Map(DepthMap<'p>),
}

/// An equirectangular map of distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthMap<'p> {
    /// Path of the file.
    pub depth: &'p str,
    pub depth_unit_m: f64,
    pub depth_none_code: Option<f64>,
    pub depth_kind: DepthKind,
    pub depth_range: Option<DepthRange>,
    pub fill: Fill,
}

/// Distance of the surfaces of a panorama without any, m.
const DEFAULT_M: f64 = 10.0;

impl PanoramaFile {
    /// Returns the distances.
    pub fn distances(&self) -> PanoramaDepth<'_> {
        match &self.depth {
            Some(depth) => PanoramaDepth::Map(DepthMap {
                depth,
                depth_unit_m: self.depth_unit_m.unwrap_or(1.0),
                depth_none_code: self.depth_none_code,
                depth_kind: self.depth_kind.unwrap_or(DepthKind::Distance),
                depth_range: self.depth_range,
                fill: self.fill.unwrap_or_default(),
            }),
            None => PanoramaDepth::Constant { depth_m: self.depth_m.unwrap_or(DEFAULT_M) },
        }
    }

    /// Checks which keys are given together, and writes out what missing ones mean, so that a line shows it.
    pub(super) fn resolved(mut self) -> Result<Self, String> {
        if self.depth_kind == Some(DepthKind::Z) {
            return Err(
                "`depth_kind` of a panorama must be \"distance\" (along the ray), \"relative\" or \
                 \"relative_inverse\": a panorama has no axis"
                    .to_owned(),
            );
        }
        if self.depth.is_some() {
            if self.depth_m.is_some() {
                return Err("`depth_m` and `depth` exclude each other: give one of them".to_owned());
            }
            self.depth_unit_m.get_or_insert(1.0);
            self.depth_kind.get_or_insert(DepthKind::Distance);
            self.fill.get_or_insert_default();
            return Ok(self);
        }
        let of_depth = [
            ("depth_unit_m", self.depth_unit_m.is_some()),
            ("depth_none_code", self.depth_none_code.is_some()),
            ("depth_kind", self.depth_kind.is_some()),
            ("depth_range", self.depth_range.is_some()),
            ("fill", self.fill.is_some()),
        ];
        if let Some((key, _)) = of_depth.into_iter().find(|(_, is_given)| *is_given) {
            return Err(format!(
                "`{key}` needs `depth`, which is missing: add it, or remove `{key}`"
            ));
        }
        self.depth_m.get_or_insert(DEFAULT_M);
        Ok(self)
    }
}
