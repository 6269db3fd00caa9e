//! The layout `list`: photographs in any folders, listed in a file.
//!
//! Each line is a JSON object of schema `glasshouse.photograph/1`. It has the keys of a scene line's side (not `apex`),
//! with paths relative to the source's root, and the keys `place`, `scan` (optional) and `values` (optional).

use super::diode::{Index, IndexError, SourceImage};
use super::numbers::is_number;
use glasshouse_line::{Side, is_url, validate_side};
use procedural::Place;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::io;
use std::path::{Component, Path};

/// Schema name of a line of the list.
pub const PHOTOGRAPH_SCHEMA: &str = "glasshouse.photograph/1";

/// Default name of the list in the source's root.
pub(crate) const LIST_NAME: &str = "photographs.jsonl";

/// Error of a list that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ListError {
    #[error("line {line}: {reason}; correct that line")]
    Line {
        /// Line number, from 1.
        line: usize,
        reason: String,
    },
    #[error("it is empty: write one JSON object per photograph")]
    Empty,
}

/// A line of the list; `side` has the remaining keys.
#[derive(Deserialize)]
struct Listed {
    schema: String,
    place: Place,
    #[serde(default)]
    scan: Option<String>,
    #[serde(default)]
    values: BTreeMap<String, f64>,
    #[serde(flatten)]
    side: serde_json::Map<String, serde_json::Value>,
}

/// Parses a list and checks each side. Keeps the order and skips blank lines.
pub fn parse_list(text: &str) -> Result<Vec<SourceImage>, ListError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut images = Vec::new();
    for (index, json) in text.lines().enumerate() {
        if json.trim().is_empty() {
            continue;
        }
        let line = index + 1;
        images.push(parse_line(json).map_err(|reason| ListError::Line { line, reason })?);
    }
    if images.is_empty() {
        return Err(ListError::Empty);
    }
    Ok(images)
}

fn parse_line(json: &str) -> Result<SourceImage, String> {
    let listed: Listed = serde_json::from_str(json).map_err(|error| {
        let text = error.to_string();
        // serde_json parses only this line, so its line number is always 1.
        text.replace(" at line 1 column ", " at column ")
    })?;
    if listed.schema != PHOTOGRAPH_SCHEMA {
        return Err(format!(
            "its schema is {:?}, but must be {PHOTOGRAPH_SCHEMA:?}",
            listed.schema
        ));
    }
    if let Some(key) = listed.values.keys().find(|key| !is_number(key)) {
        return Err(format!(
            "unknown field `values.{key}`, expected the name of a recipe's parameter, such as `camera.focal_length_mm`"
        ));
    }
    let side = Side::deserialize(serde_json::Value::Object(listed.side))
        .map_err(|error| error.to_string())?;
    if side.apex().is_some() {
        return Err("`apex` is not allowed in a list: set back.apex in the recipe".to_owned());
    }
    for (key, path) in side.paths() {
        if is_url(path) || !stays_below(path) {
            return Err(format!(
                "{key} is {path:?}, but must be a path below the source's root, without \"..\""
            ));
        }
    }
    validate_side("photograph", &side).map_err(|error| error.to_string())?;
    let color = side.name().to_owned();
    // A scan may have the name of a photograph; the scene distinguishes named scans from single photographs.
    let (scene, scan) = match listed.scan {
        Some(scan) => ("scan".to_owned(), scan),
        None => (String::new(), color.clone()),
    };
    Ok(SourceImage {
        color,
        depth: String::new(),
        depth_root: None,
        depth_range: None,
        mask: None,
        place: listed.place,
        scene,
        scan,
        side: Some(side),
        values: listed.values,
        shared: None,
    })
}

fn stays_below(path: &str) -> bool {
    Path::new(path)
        .components()
        .all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}

/// Returns the side with its paths below the root `root`.
pub(super) fn rooted(side: &Side, root: &str) -> Side {
    let mut side = side.clone();
    for path in side.paths_mut() {
        *path = format!("{root}:{path}");
    }
    side
}

/// Lists the photographs of the source `name` from `read`, the content of the file `list`. Does not check their files.
pub(crate) fn index_list(
    name: &str,
    list: &Path,
    read: io::Result<Vec<u8>>,
) -> Result<Index, IndexError> {
    let no_text = |_| io::Error::new(io::ErrorKind::InvalidData, "it is not UTF-8 text");
    let text =
        read.and_then(|bytes| String::from_utf8(bytes).map_err(no_text)).map_err(|source| {
            IndexError::NoList { name: name.to_owned(), path: list.to_owned(), source }
        })?;
    let images = parse_list(&text).map_err(|source| IndexError::List {
        name: name.to_owned(),
        path: list.to_owned(),
        source,
    })?;
    Ok(Index { images, ..Index::default() })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: &str =
        r#""color":"a.png","depth":"a.npy","intrinsics":{"fx":1,"fy":1,"cx":0,"cy":0}"#;

    fn line(rest: &str) -> String {
        format!(r#"{{"schema":"glasshouse.photograph/1","place":"indoors",{rest}}}"#)
    }

    fn parse(text: &str) -> Result<Vec<SourceImage>, String> {
        parse_list(text).map_err(|error| error.to_string())
    }

    #[test]
    fn a_line_has_a_side_a_place_and_a_scan() {
        let text = format!(
            "\n{}\r\n{}\n",
            line(SIDE),
            line(r#""scan":"a.png","mesh":"b.ply","exposure":2,"values":{"camera.f_number":1.5}"#)
                .replace("indoors", "outdoor")
        );
        let images = parse(&text).unwrap();
        let [first, second] = images.as_slice() else { panic!("{images:?}") };
        assert_eq!((first.color.as_str(), first.place), ("a.png", Place::Indoors));
        assert_eq!((second.color.as_str(), second.place), ("b.ply", Place::Outdoor));
        // A scan with the name of a photograph is not the scan of that photograph.
        assert_eq!(first.scan, second.scan);
        assert_ne!(first.scene, second.scene);
        assert_eq!(second.values["camera.f_number"], 1.5);

        let side = rooted(second.side.as_ref().unwrap(), "mine");
        assert_eq!(side.paths(), [("mesh".into(), "mine:b.ply")]);
        assert_eq!(side.exposure(), 2.0);
    }

    #[test]
    fn errors_name_the_line() {
        for (rest, words) in [
            (format!(r#"{SIDE},"colour":"x""#), "unknown field `colour`"),
            (r#""color":"a.png""#.to_owned(), "missing field `intrinsics`"),
            (format!(r#"{SIDE},"apex":"mirror""#), "`apex` is not"),
            (format!(r#"{SIDE},"depth_unit_m":0"#), "photograph.depth_unit_m is 0, but must be"),
            (format!(r#"{SIDE},"scan":3"#), "invalid type: integer `3`"),
            (
                format!(r#"{SIDE},"values":{{"camera.gain":2}}"#),
                "unknown field `values.camera.gain`",
            ),
            (SIDE.replace("a.png", "../a.png"), "color is \"../a.png\""),
            (SIDE.replace("a.npy", "/a.npy"), "depth is \"/a.npy\""),
            (SIDE.replace("a.npy", "s3://b/a"), "depth is \"s3://b/a\""),
            (SIDE.replace("a.png", ""), "photograph.color is empty"),
        ] {
            let error = parse(&format!("{}\n{}", line(SIDE), line(&rest))).unwrap_err();
            assert!(error.starts_with("line 2: "), "{error}");
            assert!(error.contains(words), "{rest}: {error}");
        }
        let other = line(SIDE).replace("photograph/1", "photograph/2");
        let error = parse(&other).unwrap_err();
        assert!(error.contains("must be \"glasshouse.photograph/1\""), "{error}");
        assert!(parse("{").unwrap_err().contains("at column 1"));
        assert!(parse(" \n").unwrap_err().contains("it is empty"));
    }

    #[test]
    fn errors_name_an_unreadable_list() {
        let index =
            |read| index_list("mine", Path::new("l.jsonl"), read).map_err(|e| e.to_string());
        let there = index(Ok(line(SIDE).into_bytes())).unwrap();
        assert_eq!(there.images.len(), 1);
        for (read, words) in [
            (Err(io::ErrorKind::NotFound.into()), "entity not found"),
            (Ok(vec![0xff]), "it is not UTF-8 text"),
        ] {
            let error = index(read).unwrap_err();
            assert!(error.contains("source mine: cannot read its list l.jsonl"), "{error}");
            assert!(error.contains(words), "{error}");
        }
        let error = index(Ok(b"{}".to_vec())).unwrap_err();
        assert!(error.starts_with("source mine: list l.jsonl: line 1: missing"), "{error}");
    }
}
