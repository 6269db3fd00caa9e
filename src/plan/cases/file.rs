//! `glasshouse.cases/1`: hard cases as a .toml.

use super::expect::Expect;
use super::picture::Picture;
use render::ids::SceneId;
use render::line::{
    Apex, Camera, DepthKind, ExrPrecision, Fill, Film, Glass, Intrinsics, LineError, Photograph,
    SCENE_SCHEMA, SceneLine, Split, Transfer,
};
use render::trace::FilmPlane;
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// The schema name of a file of hard cases.
pub const CASES_SCHEMA: &str = "glasshouse.cases/1";

/// Name of the root under which the cases' pictures lie.
const ROOT: &str = "cases";

/// A file of hard cases that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// No TOML, or unknown or missing keys.
    #[error("{0}")]
    Toml(#[from] Box<toml::de::Error>),
    /// A case is wrong.
    #[error("case {id}: {reason}")]
    Case {
        /// Which.
        id: String,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// A case's scene is wrong.
    #[error("case {id}: {source}")]
    Line {
        /// Which.
        id: String,
        /// What is wrong.
        source: Box<LineError>,
    },
}

/// The whole file, `[film]`, `[camera]` and `[glass]` of each case resolved.
#[derive(Debug)]
pub struct CaseFile {
    /// As a run's name.
    pub name: String,
    /// In the file's order.
    pub cases: Vec<Case>,
}

/// One hard case: a scene and what is expected of it.
#[derive(Debug)]
pub struct Case {
    /// For the run.
    pub line: SceneLine,
    /// What it is about, in a sentence.
    pub what: String,
    /// Seen through the pane.
    pub front: Picture,
    /// Seen reflected.
    pub back: Picture,
    /// Of the tuple.
    pub expect: Vec<Expect>,
    /// Words of the reason for which the scene must be set aside, instead.
    pub refused: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFile {
    #[allow(dead_code, reason = "looked at by is_case_file, before")]
    schema: String,
    name: String,
    #[serde(default)]
    seed: u64,
    film: toml::Table,
    camera: toml::Table,
    glass: toml::Table,
    #[serde(rename = "case")]
    cases: Vec<RawCase>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCase {
    id: SceneId,
    what: String,
    #[serde(default)]
    film: toml::Table,
    #[serde(default)]
    camera: toml::Table,
    #[serde(default)]
    glass: toml::Table,
    apex: Option<Apex>,
    front: Picture,
    back: Picture,
    #[serde(default)]
    expect: Vec<Expect>,
    refused: Option<String>,
}

/// The text's schema says that it holds hard cases.
pub fn is_case_file(text: &str) -> bool {
    toml::from_str::<toml::Table>(text)
        .is_ok_and(|table| table.get("schema").and_then(|s| s.as_str()) == Some(CASES_SCHEMA))
}

impl CaseFile {
    /// Reads and checks the file's text.
    pub fn parse(text: &str) -> Result<Self, CaseError> {
        let raw: RawFile = toml::from_str(text).map_err(Box::new)?;
        let mut cases: Vec<Case> = Vec::with_capacity(raw.cases.len());
        for case in &raw.cases {
            let id = case.id.to_string();
            let wrong = |reason: String| CaseError::Case {
                id: id.clone(),
                reason,
            };
            if cases.iter().any(|other| other.line.id == case.id) {
                return Err(wrong("there is another of this id".to_owned()));
            }
            if case.expect.is_empty() == case.refused.is_none() {
                return Err(wrong(
                    "give what is expected, either expect or refused".to_owned(),
                ));
            }
            for expect in &case.expect {
                expect.validate().map_err(wrong)?;
            }
            let film: Film = merged("film", &raw.film, &case.film).map_err(wrong)?;
            let camera: Camera = merged("camera", &raw.camera, &case.camera).map_err(wrong)?;
            let glass: Glass = merged("glass", &raw.glass, &case.glass).map_err(wrong)?;
            let tan = FilmPlane::tan_half_fov(film.width, film.height, camera.focal_length_mm);
            let (mut front, mut back) = (case.front.clone(), case.back.clone());
            for picture in [&mut front, &mut back] {
                picture.half_fov_tan.get_or_insert(tan);
                picture.validate().map_err(wrong)?;
            }
            let line = SceneLine {
                schema: SCENE_SCHEMA.to_owned(),
                id: case.id.clone(),
                split: Split::Test,
                // One for all: what is the same is then so to the bit.
                seed: raw.seed,
                film: Film {
                    exr: ExrPrecision::Float,
                    ..film
                },
                camera,
                glass,
                front: photograph(&case.id, "front", &front, None).into(),
                back: photograph(&case.id, "back", &back, Some(case.apex.unwrap_or_default()))
                    .into(),
            };
            line.validate().map_err(|source| CaseError::Line {
                id: id.clone(),
                source: Box::new(source),
            })?;
            cases.push(Case {
                line,
                what: case.what.clone(),
                front,
                back,
                expect: case.expect.clone(),
                refused: case.refused.clone(),
            });
        }
        Ok(Self {
            name: raw.name,
            cases,
        })
    }

    /// Name of the root of the pictures' files.
    pub fn root(&self) -> &'static str {
        ROOT
    }

    /// Names under the root, and contents, of all pictures' files.
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        let mut files = Vec::new();
        for case in &self.cases {
            for (side, picture) in [("front", &case.front), ("back", &case.back)] {
                let [color, depth] = names(&case.line.id, side, picture);
                files.push((color, picture.color_bytes()));
                files.push((depth, picture.depth_bytes()));
            }
        }
        files
    }
}

/// The file's table with the case's keys in place of its own.
fn merged<T: DeserializeOwned>(
    name: &str,
    all: &toml::Table,
    own: &toml::Table,
) -> Result<T, String> {
    let mut table = all.clone();
    table.extend(own.clone());
    table
        .try_into()
        .map_err(|error| format!("[{name}]: {error}"))
}

fn names(id: &SceneId, side: &str, picture: &Picture) -> [String; 2] {
    [
        format!("{id}-{side}.{}", picture.color_file.ending()),
        format!("{id}-{side}-depth.{}", picture.depth_file.ending()),
    ]
}

fn photograph(id: &SceneId, side: &str, picture: &Picture, apex: Option<Apex>) -> Photograph {
    let [color, depth] = names(id, side, picture).map(|name| format!("{ROOT}:{name}"));
    let [nx, ny] = picture.depth_px.map(|n| n as f64);
    let [tx, ty] = picture.half_fov_tan.unwrap_or([1.0; 2]);
    Photograph {
        color,
        depth,
        mask: None,
        transfer: Transfer::Linear,
        depth_unit_m: picture.depth_unit_m(),
        depth_kind: DepthKind::Z,
        depth_range: None,
        intrinsics: Intrinsics {
            fx: nx / 2.0 / tx,
            fy: ny / 2.0 / ty,
            cx: nx / 2.0,
            cy: ny / 2.0,
            size: None,
        },
        exposure: 1.0,
        illuminant: [1.0; 3],
        highlights: None,
        fill: Fill::Smooth,
        apex,
    }
}
