//! Input of a file's reader: name, bytes, and access to the files beside it.

use super::facts::{Inspection, Problem};

/// Remedy for a file that can be copied or made again.
pub(super) const AGAIN: &str = "copy it from its origin again, or make it again";

/// A file's bytes, its name, and the files beside it.
pub struct Input<'a> {
    pub name: &'a str,
    pub bytes: &'a [u8],
    /// Function that reads a file in the same folder, if possible.
    pub beside: &'a dyn Fn(&str) -> Option<Vec<u8>>,
}

impl Input<'_> {
    /// Returns the file as text. Bytes that are not UTF-8 become a problem of `found`.
    pub(super) fn text(&self, found: &mut Inspection) -> Option<&str> {
        let text = std::str::from_utf8(self.bytes);
        if let Err(error) = text {
            let place = format!("byte {}", error.valid_up_to());
            found.wrong(Problem::new("it is not UTF-8 text", AGAIN).at(place));
        }
        text.ok()
    }
}
