//! Reads and writes manifests (one scene per line of JSON), and reads files of a single scene.

use super::error::LineError;
use super::scene_line::SceneLine;
use crate::ids::SceneId;
use std::collections::BTreeMap;

/// A manifest or scene file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// Text that is not JSON, or not a scene.
    #[error("manifest line {line}, column {column}: {reason}; correct that line")]
    Json { line: usize, column: usize, reason: String },
    #[error("manifest line {line}, scene {id}: {source}")]
    Scene { line: usize, id: SceneId, source: LineError },
    #[error(
        "manifest line {line}: scene {id} is already on line {first}; give one of them another id"
    )]
    DuplicateId {
        /// Line of the second scene, counted from 1.
        line: usize,
        first: usize,
        id: SceneId,
    },
}

/// Reads a manifest. Keeps the order, skips blank lines, rejects repeated ids and [validates](SceneLine::validate) each
/// line.
pub fn parse_jsonl(text: &str) -> Result<Vec<SceneLine>, ManifestError> {
    let mut lines = Vec::new();
    let mut line_of_id: BTreeMap<SceneId, usize> = BTreeMap::new();
    for (index, json) in without_byte_order_mark(text).lines().enumerate() {
        if json.trim().is_empty() {
            continue;
        }
        let line = index + 1;
        let scene = parse_at(json, line)?;
        if let Some(first) = line_of_id.insert(scene.id.clone(), line) {
            let id = scene.id;
            return Err(ManifestError::DuplicateId { line, first, id });
        }
        lines.push(scene);
    }
    Ok(lines)
}

/// Reads and validates a file of one scene, on any number of lines.
pub fn parse_scene(text: &str) -> Result<SceneLine, ManifestError> {
    parse_at(without_byte_order_mark(text), 1)
}

/// Writes a manifest in canonical form: one scene per line, with its keys in the order of the schema and a line break
/// at the end.
pub fn to_jsonl(lines: &[SceneLine]) -> String {
    let mut text = String::new();
    for line in lines {
        let json = serde_json::to_string(line).expect("a scene line has string keys alone");
        text.push_str(&json);
        text.push('\n');
    }
    text
}

fn without_byte_order_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// Parses and validates `json`, which starts at line `first_line` of its file.
fn parse_at(json: &str, first_line: usize) -> Result<SceneLine, ManifestError> {
    let scene: SceneLine = serde_json::from_str(json).map_err(|error| {
        let text = error.to_string();
        // serde_json appends a line and a column within `json`, not within the manifest.
        let reason = match text.rsplit_once(" at line ") {
            Some((reason, _)) => reason.to_owned(),
            None => text,
        };
        ManifestError::Json {
            line: first_line + error.line().saturating_sub(1),
            column: error.column(),
            reason,
        }
    })?;
    scene.validate().map_err(|source| ManifestError::Scene {
        line: first_line,
        id: scene.id.clone(),
        source,
    })?;
    Ok(scene)
}

#[cfg(test)]
mod tests {
    use super::super::image::{Apex, DepthKind, Fill, Transfer};
    use super::super::published::{photograph, published};
    use super::super::{Filter, Focus, FocusAt, Split};
    use super::*;
    use proptest::prelude::*;

    fn manifest(ids: &[&str]) -> String {
        let lines: Vec<_> = ids
            .iter()
            .map(|id| {
                let mut line = published();
                line.id = SceneId::new(*id).unwrap();
                line
            })
            .collect();
        to_jsonl(&lines)
    }

    #[test]
    fn order_is_kept_and_blank_lines_are_skipped() {
        let text = format!("\u{feff}\n{}\r\n  \n", manifest(&["b", "a"]).replace('\n', "\r\n"));
        let ids: Vec<_> = parse_jsonl(&text).unwrap().into_iter().map(|l| l.id).collect();
        assert_eq!(ids, [SceneId::new("b").unwrap(), SceneId::new("a").unwrap()]);
    }

    #[test]
    fn errors_name_the_line_of_the_file() {
        let bad = |text: &str| parse_jsonl(text).unwrap_err().to_string();
        let unknown = manifest(&["a", "b"]).replacen("\"ior\"", "\"iOr\"", 1);
        let error = bad(&format!("\n{unknown}"));
        assert!(error.starts_with("manifest line 2, column "), "{error}");
        assert!(error.contains("unknown field `iOr`"), "{error}");
        assert!(!error.contains("line 1"), "{error}");

        let range = manifest(&["a", "b"]).replace("\"ior\":1.6", "\"ior\":0.5");
        let error = bad(&range);
        assert!(error.starts_with("manifest line 1, scene a: glass.ior is 0.5"), "{error}");

        let error = bad(&manifest(&["a", "b", "a"]));
        assert!(error.starts_with("manifest line 3: scene a is already on line 1"), "{error}");
    }

    #[test]
    fn a_scene_file_may_span_several_lines() {
        let pretty = serde_json::to_string_pretty(&published()).unwrap();
        assert_eq!(parse_scene(&pretty).unwrap(), published());
        let error = parse_scene(
            &pretty
                .replace("\"front_center\"", "\"front\"")
                .replace("\"distance_m\": 7.05", "\"distance\": 7.05"),
        )
        .unwrap_err()
        .to_string();
        assert!(error.contains("front_center"), "{error}");
    }

    #[test]
    fn a_focus_has_one_of_its_forms_and_distances_may_be_whole() {
        let with =
            |focus: &str| parse_jsonl(&manifest(&["a"]).replace("{\"distance_m\":7.05}", focus));
        let focus = with("{\"distance_m\":7}").unwrap()[0].camera.focus;
        assert_eq!(focus, Focus::Distance { distance_m: 7.0 });
        for bad in ["7", "{}", "{\"distance_m\":7,\"at\":\"infinity\"}", "\"infinity\""] {
            let error = with(bad).unwrap_err().to_string();
            assert!(error.contains("focus must be {\"distance_m\": z}"), "{error}");
        }
    }

    #[test]
    fn unknown_keys_are_refused_at_every_depth() {
        let text = manifest(&["a"]);
        for (from, to) in [
            ("\"seed\"", "\"x\":1,\"seed\""),
            ("\"width\"", "\"x\":1,\"width\""),
            ("\"focal_length_mm\"", "\"x\":1,\"focal_length_mm\""),
            ("{\"distance_m\":7.05", "{\"x\":1,\"distance_m\":7.05"),
            ("\"thickness_m\"", "\"x\":1,\"thickness_m\""),
            ("\"color\"", "\"x\":1,\"color\""),
            ("\"fx\"", "\"x\":1,\"fx\""),
        ] {
            let spoiled = text.replacen(from, to, 1);
            assert_ne!(spoiled, text, "{from}");
            assert!(parse_jsonl(&spoiled).is_err(), "{to}");
        }
    }

    prop_compose! {
        /// Generates numbers of up to nine digits, like those of `draw`.
        fn nine_digits()(digits in 1..=999_999_999i64, exponent in -12..=4i32) -> f64 {
            format!("{digits}e{exponent}").parse::<f64>().unwrap()
        }
    }

    proptest! {
        #[test]
        fn text_and_lines_round_trip(
            ior in 1.0..10.0f64, distance in nine_digits(), exposure in nine_digits(), seed: u64,
            which in 0..64u32, mask: Option<bool>,
        ) {
            let mut line = published();
            line.seed = seed;
            line.glass.ior = Some((ior * 1e6).round() / 1e6);
            line.glass.distance_m = distance;
            photograph(&mut line.front).exposure = exposure;
            let bit = |n: u32| which >> n & 1 == 1;
            line.camera.focus = match (bit(0), bit(1)) {
                (false, _) => Focus::Distance { distance_m: 0.125 },
                (true, false) => Focus::At { at: FocusAt::FrontCenter },
                (true, true) => Focus::At { at: FocusAt::Infinity },
            };
            line.film.filter = if bit(2) { Filter::Gaussian } else { Filter::Box };
            line.split = if bit(3) { Split::Test } else { Split::Train };
            let back = photograph(&mut line.back);
            back.apex = bit(4).then_some(Apex::Camera);
            back.fill = if bit(5) { Fill::Far } else { Fill::Smooth };
            back.depth_kind = if bit(5) { DepthKind::Distance } else { DepthKind::Z };
            back.transfer = if bit(4) { Transfer::Linear } else { Transfer::Srgb };
            back.mask = mask.map(|m| format!("NAME:\"{m}\" é\n.npy"));
            let text = to_jsonl(std::slice::from_ref(&line));
            prop_assert_eq!(text.lines().count(), 1);
            let read = parse_jsonl(&text).unwrap();
            prop_assert_eq!(&read, &[line]);
            prop_assert_eq!(to_jsonl(&read), text);
        }
    }
}
