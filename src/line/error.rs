//! Errors of a scene line.

use super::keys::{At, Keys};
use super::limits::Limit;

/// A scene line that is invalid regardless of its files.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LineError {
    /// An unknown schema or version.
    #[error("schema is {found:?}, but must be \"glasshouse.scene/1\": write the line in that form")]
    Schema { found: String },
    #[error("{field} is {}, but must be {allowed}", number(*value))]
    OutOfRange { field: String, value: f64, allowed: &'static str },
    #[error("{field} is empty, but must be the path of a file")]
    EmptyPath { field: String },
    #[error(
        "{side} has neither depth nor sketch: give the path of a depth image, or assume a shape"
    )]
    NoShape { side: String },
    #[error(
        "{side}.sketch is given together with {side}.{key}, which belongs to a depth image: remove one"
    )]
    SketchAndDepth { side: String, key: &'static str },
    /// A relative depth without a range, or a metric depth with a range.
    #[error(
        "{}",
        if *given {
            format!("{side}.depth_range is given, but only depth_kind \"relative\" and \"relative_inverse\" have one: remove it")
        } else {
            format!("{side}.depth_kind is relative, but {side}.depth_range is missing: give {{\"mean_m\": metres}}")
        }
    )]
    DepthRange { side: String, given: bool },
    /// Highlights of a linear image, which has no clipped codes.
    #[error("{field} is given, but only transfer \"srgb\" has clipped codes: remove it")]
    HighlightsOfLight { field: String },
    /// An apex of the front. Only the back has one, because the front's capture camera is at the lens.
    #[error("front.apex is given, but only the back has an apex: use back.apex")]
    ApexOfFront,
    #[error(
        "{field} is not a rotation: its rows must have length 1 and be at right angles (to 1e-4), and its determinant \
         must be +1; to scale the mesh, use unit_m"
    )]
    NoRotation { field: String },
    #[error("glass.glazing is {found:?}, but must be 1 to {most} characters of [a-z0-9.-]")]
    GlazingName { found: String, most: usize },
    #[error("missing field `{key}` of glass, which has no `layers`")]
    NoMake { key: &'static str },
    #[error("glass has `layers` and `{key}`: keep only one of them")]
    TwoMakes { key: &'static str },
    #[error("glass.layers have no layer of glass")]
    NoGlass,
    /// A pane with more layers than a path can cross.
    #[error("glass.layers has {found} layers, but at most {most} are allowed")]
    Layers { found: usize, most: usize },
    /// A coating on a face that the pane lacks.
    #[error(
        "glass.coatings[{index}].face is {face}, but the pane has the faces 0 to {last}, counted from the camera"
    )]
    NoFace { index: usize, face: u32, last: usize },
    #[error(
        "glass.coatings[{index}].face is {face}, like that of an earlier coating: keep one for each face"
    )]
    FaceTwice { index: usize, face: u32 },
    #[error(
        "glass.bow_radius_m is {radius_m}, but must be finite and not 0: leave it out for a flat pane"
    )]
    BowRadius { radius_m: f64 },
    /// A bent pane of several layers.
    #[error(
        "glass.bow_radius_m bends a plain pane only: remove glass.layers and glass.coatings, or the radius"
    )]
    BowOfStack,
    /// A list of roughnesses that does not fit the pane.
    #[error(
        "glass.roughness lists {found} value{}, but the pane has {faces} faces: give one number, or one for each face",
        if *found == 1 { "" } else { "s" }
    )]
    FacesOfRoughness { found: usize, faces: usize },
    #[error(
        "glass.wave has slopes of up to {slope:.3}, but at most {most} are allowed: reduce amplitude_m, or increase length_m"
    )]
    SteepWave { slope: f64, most: f64 },
    #[error(
        "glass.smudges must have either `seed`, `coverage` and `mark_m`, or `map`, `center_m` and `width_m`"
    )]
    SmudgePattern,
    #[error("glass.wave and glass.bow_radius_m are both given: keep one")]
    WaveAndBow,
    /// An outline without glass.
    #[error("{field} is [{low}, {high}], but its first number must be smaller than its second")]
    EmptyOutline { field: &'static str, low: f64, high: f64 },
    #[error("{side}.cards has {found} cards, but at most {most} are allowed")]
    Cards { side: String, found: usize, most: usize },
    #[error(
        "{field} has {found} row{} for {angles} angles: give one row for each of angles_deg, or [red, green, blue] for all \
         angles", if *found == 1 { "" } else { "s" }
    )]
    RowsOfCoating { field: String, found: usize, angles: usize },
    #[error("{field} must ascend from 0 to 90, with at most 91 angles")]
    AnglesOfCoating { field: String },
    /// Angles between which the curve of a coating is too steep to compute.
    #[error(
        "{field} has {low} and {high}, whose cosines differ by less than {least:e}: remove one of them, because shares are curves of \
         the cosine"
    )]
    CloseAngles { field: String, low: f64, high: f64, least: f64 },
    /// A frame whose light exceeds single precision.
    #[error(
        "glass.outline.frame_radiance[{channel}] is {radiance} with the camera's exposure and white balance, but must be at most {most:e}: \
         reduce one of them"
    )]
    FrameRadiance { channel: usize, radiance: f64, most: f64 },
    #[error(
        "sensor.black_level_dn is {black_level_dn}, but must be below the largest number of {bits} bits"
    )]
    BlackLevel { black_level_dn: u32, bits: u32 },
    #[error("sensor photographs the input, but film.layers lacks it: add input, or remove sensor")]
    SensorWithoutInput,
    #[error(
        "the rows of sensor.colour_matrix must have the sum 1 (to 1e-3), so that neutral light stays neutral, and its \
         determinant must not be near 0"
    )]
    ColourMatrix,
    /// A coating that makes light.
    #[error("{field} plus the transmittance is {sum}, but must be at most 1")]
    Light { field: String, sum: f64 },
}

/// Writes huge numbers with an exponent.
fn number(value: f64) -> String {
    if value.abs() < 1.0e18 { value.to_string() } else { format!("{value:e}") }
}

/// Checks that `limit` contains `value`.
pub(super) fn within(field: &str, value: f64, limit: Limit) -> Result<(), LineError> {
    if limit.contains(value) { Ok(()) } else { Err(out_of_range(field, value, limit)) }
}

pub(super) fn out_of_range(field: &str, value: f64, limit: Limit) -> LineError {
    LineError::OutOfRange { field: field.to_owned(), value, allowed: limit.allowed }
}

/// Checks all declared numbers of a section against their limits.
pub(super) fn check_section(section: &impl Keys, path: &str) -> Result<(), LineError> {
    let mut wrong = Ok(());
    section.numbers(&At::section(path), &mut |at, value| {
        if wrong.is_ok() {
            wrong = within(&at.path, value, at.limit());
        }
    });
    wrong
}
