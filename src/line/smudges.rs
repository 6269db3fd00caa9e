//! Smudges on a pane: fingerprints, grease and dust.

use super::error::{LineError, all_within};
use super::image::{is_default, is_one, one};
use serde::{Deserialize, Serialize};

/// A smear on the front face that covers a part of it.
///
/// A pattern gives the covered share of the face around each point; the point at which a camera ray enters decides for all its
/// orders. Light that meets the smear finds face 0 with the smear's roughness in place of its own, and passes the smear once on its
/// way to the front, and twice on its way to the back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SmudgeKeys", into = "SmudgeKeys")]
pub struct Smudges {
    pub pattern: SmudgePattern,
    /// Beckmann's alpha of face 0 under the smear, 0 to 0.1.
    pub roughness: f64,
    /// Factor on the pattern: the share of the light that meets the smear where the pattern is 1.
    pub haze: f64,
    /// Share of the light that passes the smear.
    pub transmittance: f64,
}

/// The covered share of the front face at each of its points.
#[derive(Clone, Debug, PartialEq)]
pub enum SmudgePattern {
    /// Marks of random places and forms, a function of the seed.
    Marks {
        seed: u64,
        /// Share of the pane with marks; their inner halves are 1, and the others fall to 0.
        coverage: f64,
        /// Width of the largest marks.
        mark_m: f64,
    },
    /// A grey picture with shares from 0 to 1; beyond it, the pane is clean.
    Map {
        /// Path, relative to the manifest, or `NAME:path` under a named root.
        map: String,
        /// Centre in the plane of the front face, in the coordinates of [`super::Outline`].
        center_m: [f64; 2],
        /// Width of the picture; its height follows from its proportions.
        width_m: f64,
    },
}

/// The keys of [`Smudges`].
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SmudgeKeys {
    #[serde(skip_serializing_if = "Option::is_none")]
    seed: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    coverage: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mark_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    map: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    center_m: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    width_m: Option<f64>,
    #[serde(default, skip_serializing_if = "is_default")]
    roughness: f64,
    #[serde(default = "one", skip_serializing_if = "is_one")]
    haze: f64,
    #[serde(default = "one", skip_serializing_if = "is_one")]
    transmittance: f64,
}

impl TryFrom<SmudgeKeys> for Smudges {
    type Error = &'static str;

    fn try_from(keys: SmudgeKeys) -> Result<Self, Self::Error> {
        let SmudgeKeys { seed, coverage, mark_m, map, center_m, width_m, .. } = keys;
        let pattern = match (seed, coverage, mark_m, map, center_m, width_m) {
            (Some(seed), Some(coverage), Some(mark_m), None, None, None) => {
                SmudgePattern::Marks { seed, coverage, mark_m }
            }
            (None, None, None, Some(map), Some(center_m), Some(width_m)) => {
                SmudgePattern::Map { map, center_m, width_m }
            }
            _ => {
                return Err(
                    "glass.smudges must have either `seed`, `coverage` and `mark_m`, or `map`, `center_m` and `width_m`",
                );
            }
        };
        let SmudgeKeys { roughness, haze, transmittance, .. } = keys;
        Ok(Self { pattern, roughness, haze, transmittance })
    }
}

impl From<Smudges> for SmudgeKeys {
    fn from(smudges: Smudges) -> Self {
        let Smudges { pattern, roughness, haze, transmittance } = smudges;
        let (mut marks, mut of_map) = ((None, None, None), (None, None, None));
        match pattern {
            SmudgePattern::Marks { seed, coverage, mark_m } => {
                marks = (Some(seed), Some(coverage), Some(mark_m));
            }
            SmudgePattern::Map { map, center_m, width_m } => {
                of_map = (Some(map), Some(center_m), Some(width_m));
            }
        }
        let ((seed, coverage, mark_m), (map, center_m, width_m)) = (marks, of_map);
        Self { seed, coverage, mark_m, map, center_m, width_m, roughness, haze, transmittance }
    }
}

impl Smudges {
    /// Returns the path of the map, if there is one.
    pub fn map(&self) -> Option<&String> {
        match &self.pattern {
            SmudgePattern::Map { map, .. } => Some(map),
            SmudgePattern::Marks { .. } => None,
        }
    }

    /// Returns [`Self::map`] for changes.
    pub fn map_mut(&mut self) -> Option<&mut String> {
        match &mut self.pattern {
            SmudgePattern::Map { map, .. } => Some(map),
            SmudgePattern::Marks { .. } => None,
        }
    }

    pub(super) fn check(&self) -> Result<(), LineError> {
        if self.map().is_some_and(String::is_empty) {
            return Err(LineError::EmptyPath { field: "glass.smudges.map".to_owned() });
        }
        let of_pattern: &[(&str, &[f64])] = match &self.pattern {
            SmudgePattern::Marks { coverage, mark_m, .. } => {
                &[("coverage", &[*coverage]), ("mark_m", &[*mark_m])]
            }
            SmudgePattern::Map { center_m, width_m, .. } => {
                &[("center_m", center_m), ("width_m", &[*width_m])]
            }
        };
        all_within("glass.smudges", of_pattern)?;
        all_within(
            "glass.smudges",
            &[
                ("roughness", &[self.roughness]),
                ("haze", &[self.haze]),
                ("transmittance", &[self.transmittance]),
            ],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::{SceneLine, parse_scene, published, to_jsonl};

    fn with_smudges(smudges: &str) -> Result<SceneLine, String> {
        let mut line = published();
        line.glass.smudges =
            Some(serde_json::from_str(smudges).map_err(|error| error.to_string())?);
        line.validate().map_err(|error| error.to_string())?;
        Ok(line)
    }

    const MARKS: &str = r#"{"seed":7,"coverage":0.3,"mark_m":0.05"#;
    const MAP: &str = r#"{"map":"s.png","center_m":[0.1,-0.2],"width_m":0.5"#;

    #[test]
    fn lines_keep_their_text_and_list_the_map() {
        for (smudges, paths) in [
            (format!(r#"{MARKS},"roughness":0.04}}"#), vec![]),
            (format!(r#"{MAP},"haze":0.5,"transmittance":0.9}}"#), vec!["glass.smudges.map s.png"]),
        ] {
            let mut line = with_smudges(&smudges).unwrap();
            let text = to_jsonl(std::slice::from_ref(&line));
            assert!(text.contains(&format!(r#""smudges":{smudges}"#)), "{text}");
            assert_eq!(parse_scene(&text).unwrap(), line);
            let of_glass = |(key, path): (String, &str)| {
                key.starts_with("glass").then(|| format!("{key} {path}"))
            };
            let found: Vec<String> = line.paths().into_iter().filter_map(of_glass).collect();
            assert_eq!(found, paths);
            let count = line.paths().len();
            assert_eq!(line.paths_mut().len(), count);
        }
    }

    #[test]
    fn errors_say_what_to_change() {
        let either = "glass.smudges must have either `seed`, `coverage` and `mark_m`, or `map`";
        for (smudges, message) in [
            ("{}".to_owned(), either),
            (r#"{"seed":7,"coverage":0.3}"#.to_owned(), either),
            (format!(r#"{MARKS},"map":"s.png"}}"#), either),
            (format!(r#"{MARKS},"size":1}}"#), "unknown field `size`"),
            (
                MARKS.replace("0.3", "1.5") + "}",
                "glass.smudges.coverage is 1.5, but must be 0 to 1",
            ),
            (MARKS.replace("0.05", "0") + "}", "glass.smudges.mark_m is 0, but must be 0.001 to"),
            (MAP.replace("s.png", "") + "}", "glass.smudges.map is empty"),
            (
                MAP.replace("0.5", "-1") + "}",
                "glass.smudges.width_m is -1, but must be above 0 and",
            ),
            (
                format!(r#"{MARKS},"roughness":0.2}}"#),
                "glass.smudges.roughness is 0.2, but must be",
            ),
            (format!(r#"{MARKS},"haze":2}}"#), "glass.smudges.haze is 2, but must be 0 to 1"),
            (
                format!(r#"{MARKS},"transmittance":-1}}"#),
                "glass.smudges.transmittance is -1, but must be 0 to 1",
            ),
        ] {
            let error = with_smudges(&smudges).unwrap_err();
            assert!(error.contains(message), "{error} for {smudges}");
        }
    }
}
