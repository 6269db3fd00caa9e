//! A file as its reader gets it.

use super::facts::{Inspection, Problem};

/// What to do about a file that is one of many.
pub(super) const AGAIN: &str = "take it from where it was made, or make it again";

/// A file's bytes, its name, and the files beside it.
pub struct Input<'a> {
    pub name: &'a str,
    pub bytes: &'a [u8],
    /// A file in the same folder, if it is there and can be read.
    pub beside: &'a dyn Fn(&str) -> Option<Vec<u8>>,
}

impl Input<'_> {
    /// The file as text; what is wrong with it is added to `found`.
    pub(super) fn text(&self, found: &mut Inspection) -> Option<&str> {
        match std::str::from_utf8(self.bytes) {
            Ok(text) => Some(text),
            Err(error) => {
                let place = format!("byte {}", error.valid_up_to());
                found.wrong(Problem::new("it is no UTF-8 text", AGAIN).at(place));
                None
            }
        }
    }
}
