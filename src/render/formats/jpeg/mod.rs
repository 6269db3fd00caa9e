//! Checks that a JPEG file holds a whole picture.
//!
//! Decoders fill missing or damaged parts with grey. This check reads the markers and decodes all entropy-coded data
//! without computing pixels, and refuses what libjpeg-turbo's strict decoder calls an error or a warning of corrupt
//! data. It also refuses pictures with coefficients that no scan holds, or whose data end a scan within a run. References
//! are to ITU-T T.81.

mod bits;
mod frame;
mod head;
mod huffman;
mod markers;
mod progressive;
mod rare;
mod scan;
mod sequential;

pub(crate) use head::{Head, Kind};
pub(crate) use rare::RareDecoder;

/// Damage of a JPEG file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum JpegDamage {
    #[error("the file ends within the picture")]
    Cut,
    #[error("marker FF{marker:02X} at byte {at} is none that a picture has here")]
    Marker { marker: u8, at: usize },
    #[error("{count} extraneous bytes before marker FF{marker:02X} at byte {at}")]
    Extraneous { count: usize, marker: u8, at: usize },
    #[error("the segment of marker FF{marker:02X} at byte {at} is damaged: {what}")]
    Segment { marker: u8, at: usize, what: &'static str },
    #[error("the data of scan {scan} are damaged before byte {at}: {what}")]
    Data { scan: usize, at: usize, what: &'static str },
    #[error("scan {scan} does not continue the scans before it: {what}")]
    Progression { scan: usize, what: &'static str },
    #[error("{what} of component {component} is in no scan: the picture is incomplete")]
    Incomplete { component: u8, what: &'static str },
}

/// Checks a whole file. Bytes after the end marker do not matter. Kinds of JPEG other than Huffman-coded baseline,
/// extended and progressive pictures of 8 bits pass; the decoder refuses them.
pub(crate) fn check(bytes: &[u8]) -> Result<(), JpegDamage> {
    markers::check(bytes)
}

#[cfg(test)]
mod matrix_tests;
#[cfg(test)]
mod tests;
