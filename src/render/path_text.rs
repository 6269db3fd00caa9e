//! Paths as JSON texts: each byte sequence of a path that is not UTF-8 becomes U+FFFD, as on a terminal.
//!
//! serde's own form of such a path is an error, so a result with a path is written through these functions
//! (`#[serde(serialize_with = "...")]`). They suit output only: a program that must find the file again reads a path
//! with [`Path::to_str`] and refuses other paths.

use serde::{Serialize, Serializer};
use std::path::Path;

/// Serializes a path.
pub fn one<P: AsRef<Path>, S: Serializer>(path: &P, serializer: S) -> Result<S::Ok, S::Error> {
    path.as_ref().to_string_lossy().serialize(serializer)
}

/// Serializes an optional path.
pub fn optional<P: AsRef<Path>, S: Serializer>(
    path: &Option<P>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    path.as_ref().map(|path| path.as_ref().to_string_lossy()).serialize(serializer)
}

/// Serializes a list of paths.
pub fn each<P: AsRef<Path>, S: Serializer>(paths: &[P], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(paths.iter().map(|path| path.as_ref().to_string_lossy()))
}

#[cfg(all(test, unix))]
mod tests {
    use serde::Serialize;
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    use std::path::{Path, PathBuf};

    #[derive(Serialize)]
    struct Paths<'a> {
        #[serde(serialize_with = "super::one")]
        one: &'a Path,
        #[serde(serialize_with = "super::optional")]
        none: Option<PathBuf>,
        #[serde(serialize_with = "super::each")]
        each: Vec<PathBuf>,
    }

    #[test]
    fn bytes_that_are_not_text_become_replacement_characters() {
        let one = Path::new(OsStr::from_bytes(b"a/\xff\xfe/ \x1b"));
        let paths = Paths { one, none: None, each: vec![PathBuf::from("b"), one.to_owned()] };
        let json = serde_json::to_string(&paths).unwrap();
        let text = "\"a/\u{fffd}\u{fffd}/ \\u001b\"";
        assert_eq!(json, format!(r#"{{"one":{text},"none":null,"each":["b",{text}]}}"#));
    }
}
