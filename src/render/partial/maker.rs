//! The worker that made a partial.

use serde::{Deserialize, Serialize};
use std::fmt::Write as _;

/// Longest name of a worker or a host that is read from a file, bytes.
const LONGEST_NAME: usize = 1000;

/// The worker that traced a shard, for the receipt of the tuple. It is no part of the result.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Maker {
    /// Name of the process.
    pub worker: String,
    /// Name of its machine.
    pub host: String,
}

impl Maker {
    /// Formats the maker as JSON in ASCII, because a text attribute of OpenEXR cannot hold other characters.
    pub(super) fn to_json(&self) -> String {
        let json = serde_json::to_string(self).expect("strings are JSON");
        let mut ascii = String::with_capacity(json.len());
        for c in json.chars() {
            if c.is_ascii() {
                ascii.push(c);
                continue;
            }
            for unit in c.encode_utf16(&mut [0; 2]) {
                write!(ascii, "\\u{unit:04x}").expect("a string takes any text");
            }
        }
        ascii
    }

    /// Parses the attribute. A damaged one is an unknown maker: the digest of the partial does not cover it.
    pub(super) fn parse(json: &str) -> Option<Self> {
        let maker: Self = serde_json::from_str(json).ok()?;
        let is_name = |name: &str| !name.is_empty() && name.len() <= LONGEST_NAME;
        (is_name(&maker.worker) && is_name(&maker.host)).then_some(maker)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_any_characters_are_written_in_ascii_and_read_back() {
        for worker in ["w-1", "Jürgen's \"box\"", "工作者 🦀", "\u{1b}[31m"] {
            let maker = Maker { worker: worker.to_owned(), host: "h".to_owned() };
            let json = maker.to_json();
            assert!(json.is_ascii(), "{json}");
            assert_eq!(Maker::parse(&json), Some(maker));
        }
    }

    #[test]
    fn a_damaged_or_empty_maker_is_unknown() {
        let long = format!(r#"{{"worker":"{}","host":"h"}}"#, "w".repeat(LONGEST_NAME + 1));
        for json in ["", "{}", r#"{"worker":"w"}"#, r#"{"worker":"","host":"h"}"#, &long] {
            assert_eq!(Maker::parse(json), None, "{json}");
        }
    }
}
