//! Errors of a scene line.

use super::limits::Limit;

/// A scene line that cannot be rendered, whatever its files hold.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LineError {
    /// Another schema, or another version of it.
    #[error("schema is {found:?}, but must be \"glasshouse.scene/1\": write the line in that form")]
    Schema { found: String },
    #[error("{field} is {value}, but must be {allowed}")]
    OutOfRange { field: String, value: f64, allowed: &'static str },
    #[error("{field} is empty, but must be the path of a file")]
    EmptyPath { field: String },
    /// A relative depth without a range, or a metric depth with one.
    #[error(
        "{}",
        if *given {
            format!("{side}.depth_range is given, but only depth_kind \"relative\" and \"relative_inverse\" have one: remove it")
        } else {
            format!("{side}.depth_kind is relative, but {side}.depth_range is missing: give {{\"mean_m\": metres}}")
        }
    )]
    DepthRange { side: String, given: bool },
    /// Linear images have no clipped codes.
    #[error("{field} is given, but only images of transfer \"srgb\" have clipped codes: remove it")]
    HighlightsOfLight { field: String },
    /// `apex` is the position of the reflected side's camera; the front's camera is the lens.
    #[error("front.apex is given, but only the back has an apex: move it to back")]
    ApexOfFront,
    #[error(
        "{field} is no rotation: its rows must be of length 1 and at right angles (to 1e-4), its determinant +1; \
         scale with unit_m"
    )]
    NoRotation { field: String },
}

/// `Ok` if `limit` holds `value`.
pub(super) fn within(field: &str, value: f64, limit: Limit) -> Result<(), LineError> {
    if limit.contains(value) { Ok(()) } else { Err(out_of_range(field, value, limit)) }
}

pub(super) fn out_of_range(field: &str, value: f64, limit: Limit) -> LineError {
    LineError::OutOfRange { field: field.to_owned(), value, allowed: limit.allowed }
}
