//! Smudges on a pane: fingerprints, grease and dust.

use super::error::LineError;
use super::param::Param;
use glasshouse_keys::keys;

/// A smear on the front face that covers a part of it.
///
/// A pattern gives the covered share of the face around each point; the point at which a camera ray enters decides for all its
/// orders. Light that meets the smear finds face 0 with the smear's roughness in place of its own, and passes the smear once on its
/// way to the front, and twice on its way to the back.
#[keys(recipe = SmudgeRecipe)]
pub struct Smudges {
    /// Seed of the places and forms of the marks.
    #[key(line_only)]
    pub seed: Option<u64>,
    /// Share of the pane with marks, which are random; 0 is clean. The inner halves of marks are covered, and the others less and less.
    #[key("[0, 1]")]
    pub coverage: Option<f64>,
    /// Width of the largest marks.
    // Smaller marks exceed the precision of the tracer's texel coordinates.
    #[key("[0.001, 1000] m", recipe = Param::Constant(0.05))]
    pub mark_m: Option<f64>,
    /// Path of a grey picture of shares from 0 to 1, in place of marks; beyond it, the pane is clean. Relative to the manifest, or
    /// `NAME:path` under a named root.
    #[key(line_only)]
    pub map: Option<String>,
    /// Centre of the picture in the plane of the front face, in the coordinates of the outline.
    #[key("[-1e9, 1e9] m", line_only)]
    pub center_m: Option<[f64; 2]>,
    /// Width of the picture; its height follows from its proportions.
    #[key("(0, 1e9] m", line_only)]
    pub width_m: Option<f64>,
    /// Roughness of the front face under the smear, Beckmann's alpha.
    #[key("[0, 0.1]", default = 0.0, recipe = 0.05)]
    pub roughness: f64,
    /// Share of the light that meets the smear inside the marks.
    #[key("[0, 1]", default = 1.0, recipe = 0.5)]
    pub haze: f64,
    /// Share of this light that passes the smear.
    #[key("[0, 1]", default = 1.0, recipe = 0.95)]
    pub transmittance: f64,
}

/// The covered share of the front face at each of its points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SmudgePattern<'s> {
    /// Marks of random places and forms, a function of the seed.
    Marks {
        seed: u64,
        /// Share of the pane with marks.
        coverage: f64,
        /// Width of the largest marks.
        mark_m: f64,
    },
    /// A grey picture.
    Map { map: &'s str, center_m: [f64; 2], width_m: f64 },
}

impl Smudges {
    /// Returns the pattern; `None` for keys of neither or of both, which [`super::SceneLine::validate`] refuses.
    pub fn pattern(&self) -> Option<SmudgePattern<'_>> {
        let Self { seed, coverage, mark_m, map, center_m, width_m, .. } = self;
        match (*seed, *coverage, *mark_m, map, *center_m, *width_m) {
            (Some(seed), Some(coverage), Some(mark_m), None, None, None) => {
                Some(SmudgePattern::Marks { seed, coverage, mark_m })
            }
            (None, None, None, Some(map), Some(center_m), Some(width_m)) => {
                Some(SmudgePattern::Map { map, center_m, width_m })
            }
            _ => None,
        }
    }

    pub(super) fn check(&self) -> Result<(), LineError> {
        if self.map.as_ref().is_some_and(String::is_empty) {
            return Err(LineError::EmptyPath { field: "glass.smudges.map".to_owned() });
        }
        self.pattern().map_or(Err(LineError::SmudgePattern), |_| Ok(()))
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
