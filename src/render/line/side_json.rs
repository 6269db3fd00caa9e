//! A side as it stands in JSON: which keys go together, and errors that say so.

use super::depth_range::DepthRange;
use super::highlights::Highlights;
use super::image::{Apex, DepthKind, Fill, Intrinsics, Transfer, one, white};
use super::panorama::{DepthMap, PanoramaDepth, PanoramaFile};
use super::photograph::Photograph;
use super::side::{MeshFile, MeshPose, Side};
use serde::{Deserialize, Deserializer};

/// Every key that any kind may have. Deserialised as one struct, so that an error can say which keys go together
/// (serde's untagged enums only say that nothing matched).
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AnySide {
    #[serde(default, deserialize_with = "given")]
    mesh: Option<String>,
    #[serde(default, deserialize_with = "given")]
    panorama: Option<String>,
    #[serde(default, deserialize_with = "given")]
    color: Option<String>,
    #[serde(default, deserialize_with = "given")]
    depth: Option<String>,
    #[serde(default)]
    mask: Option<String>,
    #[serde(default, deserialize_with = "given")]
    transfer: Option<Transfer>,
    #[serde(default, deserialize_with = "given")]
    highlights: Option<Highlights>,
    #[serde(default, deserialize_with = "given")]
    depth_m: Option<f64>,
    #[serde(default, deserialize_with = "given")]
    depth_unit_m: Option<f64>,
    #[serde(default, deserialize_with = "given")]
    depth_kind: Option<DepthKind>,
    #[serde(default, deserialize_with = "given")]
    depth_range: Option<DepthRange>,
    #[serde(default, deserialize_with = "given")]
    intrinsics: Option<Intrinsics>,
    #[serde(default, deserialize_with = "given")]
    unit_m: Option<f64>,
    #[serde(default, deserialize_with = "given")]
    exposure: Option<f64>,
    #[serde(default, deserialize_with = "given")]
    illuminant: Option<[f64; 3]>,
    #[serde(default, deserialize_with = "given")]
    fill: Option<Fill>,
    #[serde(default)]
    pose: Option<MeshPose>,
    #[serde(default, deserialize_with = "given")]
    yaw_deg: Option<f64>,
    #[serde(default, deserialize_with = "given")]
    pitch_deg: Option<f64>,
    #[serde(default)]
    apex: Option<Apex>,
}

/// A key that may be missing, but not `null`.
fn given<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Option<T>, D::Error> {
    T::deserialize(from).map(Some)
}

impl<'de> Deserialize<'de> for Side {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let any = AnySide::deserialize(deserializer)?;
        any.side().map_err(serde::de::Error::custom)
    }
}

const PHOTOGRAPH_KEYS: &str = "color, depth, mask, transfer, highlights, depth_unit_m, depth_kind, depth_range, \
                               intrinsics, exposure, illuminant, fill and apex";
const PANORAMA_KEYS: &str = "transfer, highlights, exposure, illuminant, depth_m or depth (with depth_unit_m, depth_kind, \
                             depth_range and fill), yaw_deg, pitch_deg and apex";
const MESH_KEYS: &str = "transfer, unit_m, exposure, illuminant, pose and apex";

impl AnySide {
    fn side(self) -> Result<Side, String> {
        match (&self.mesh, &self.panorama) {
            (None, None) => self.into_photograph().map(Side::Photograph),
            (Some(_), None) => self.into_mesh().map(Side::Mesh),
            (None, Some(_)) => self.into_panorama().map(Side::Panorama),
            (Some(_), Some(_)) => {
                Err("`mesh` and `panorama` are two sides: give one of them".to_owned())
            }
        }
    }

    /// The first key that is given and belongs to photographs alone.
    fn of_photographs(&self) -> Option<&'static str> {
        [
            ("color", self.color.is_some()),
            ("mask", self.mask.is_some()),
            ("intrinsics", self.intrinsics.is_some()),
        ]
        .into_iter()
        .find_map(|(key, is_given)| is_given.then_some(key))
    }

    /// The same of the keys that describe a depth image.
    fn of_depth(&self) -> Option<&'static str> {
        [
            ("depth", self.depth.is_some()),
            ("depth_unit_m", self.depth_unit_m.is_some()),
            ("depth_kind", self.depth_kind.is_some()),
            ("depth_range", self.depth_range.is_some()),
            ("fill", self.fill.is_some()),
        ]
        .into_iter()
        .find_map(|(key, is_given)| is_given.then_some(key))
    }

    fn of_meshes(&self) -> Option<&'static str> {
        [
            ("unit_m", self.unit_m.is_some()),
            ("pose", self.pose.is_some()),
        ]
        .into_iter()
        .find_map(|(key, is_given)| is_given.then_some(key))
    }

    fn of_panoramas(&self) -> Option<&'static str> {
        [
            ("depth_m", self.depth_m.is_some()),
            ("yaw_deg", self.yaw_deg.is_some()),
            ("pitch_deg", self.pitch_deg.is_some()),
        ]
        .into_iter()
        .find_map(|(key, is_given)| is_given.then_some(key))
    }

    fn into_mesh(self) -> Result<MeshFile, String> {
        if let Some(key) = self.of_photographs().or(self.of_depth()) {
            return Err(format!(
                "`{key}` belongs to a photograph and cannot stand beside `mesh`, which takes {MESH_KEYS}"
            ));
        }
        if let Some(key) = self.of_panoramas() {
            return Err(format!(
                "`{key}` belongs to a panorama and cannot stand beside `mesh`, which takes {MESH_KEYS}"
            ));
        }
        if self.highlights.is_some() {
            return Err(format!(
                "`highlights` belongs to an image and cannot stand beside `mesh`, which takes {MESH_KEYS}"
            ));
        }
        Ok(MeshFile {
            mesh: self.mesh.unwrap_or_default(),
            transfer: self.transfer.unwrap_or_default(),
            unit_m: self.unit_m.unwrap_or_else(one),
            exposure: self.exposure.unwrap_or_else(one),
            illuminant: self.illuminant.unwrap_or_else(white),
            pose: self.pose,
            apex: self.apex,
        })
    }

    fn into_panorama(self) -> Result<PanoramaFile, String> {
        for (key, of) in [
            (self.of_photographs(), "photograph"),
            (self.of_meshes(), "mesh"),
        ] {
            if let Some(key) = key {
                return Err(format!(
                    "`{key}` belongs to a {of} and cannot stand beside `panorama`, which takes {PANORAMA_KEYS}"
                ));
            }
        }
        if self.depth.is_some() && self.depth_m.is_some() {
            return Err("`depth_m` is a constant and cannot stand beside `depth`".to_owned());
        }
        let depth_key = self.of_depth();
        let depth = match self.depth {
            Some(depth) => PanoramaDepth::Map(DepthMap {
                depth,
                depth_unit_m: self.depth_unit_m.unwrap_or_else(one),
                depth_kind: self.depth_kind.unwrap_or(DepthKind::Distance),
                depth_range: self.depth_range,
                fill: self.fill.unwrap_or_default(),
            }),
            None => match depth_key {
                Some(key) => {
                    return Err(format!("`{key}` describes a `depth`, which is not given"));
                }
                None => PanoramaDepth::Constant {
                    depth_m: self.depth_m.unwrap_or(PanoramaDepth::DEFAULT_M),
                },
            },
        };
        if self.depth_kind == Some(DepthKind::Z) {
            return Err(
                "`depth_kind` of a panorama is \"distance\" (along the ray), \"relative\" or \"relative_inverse\": \
                 it has no axis"
                    .to_owned(),
            );
        }
        Ok(PanoramaFile {
            panorama: self.panorama.unwrap_or_default(),
            transfer: self.transfer.unwrap_or_default(),
            exposure: self.exposure.unwrap_or_else(one),
            illuminant: self.illuminant.unwrap_or_else(white),
            highlights: self.highlights,
            depth,
            yaw_deg: self.yaw_deg.unwrap_or(0.0),
            pitch_deg: self.pitch_deg.unwrap_or(0.0),
            apex: self.apex,
        })
    }

    fn into_photograph(self) -> Result<Photograph, String> {
        for (key, of) in [
            (self.of_meshes(), "mesh"),
            (self.of_panoramas(), "panorama"),
        ] {
            if let Some(key) = key {
                return Err(format!(
                    "`{key}` belongs to a `{of}`, which is not given; a photograph takes {PHOTOGRAPH_KEYS}"
                ));
            }
        }
        let missing = |key: &str| {
            format!(
                "missing field `{key}`: give color, depth and intrinsics of a photograph, or a panorama, or the mesh of a PLY \
                 file"
            )
        };
        Ok(Photograph {
            color: self.color.ok_or_else(|| missing("color"))?,
            depth: self.depth.ok_or_else(|| missing("depth"))?,
            mask: self.mask,
            transfer: self.transfer.unwrap_or_default(),
            depth_unit_m: self.depth_unit_m.unwrap_or_else(one),
            depth_kind: self.depth_kind.unwrap_or_default(),
            depth_range: self.depth_range,
            intrinsics: self.intrinsics.ok_or_else(|| missing("intrinsics"))?,
            exposure: self.exposure.unwrap_or_else(one),
            illuminant: self.illuminant.unwrap_or_else(white),
            highlights: self.highlights,
            fill: self.fill.unwrap_or_default(),
            apex: self.apex,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str) -> Result<Side, String> {
        serde_json::from_str(json).map_err(|error| error.to_string())
    }

    #[test]
    fn a_mesh_has_its_own_keys_and_defaults() {
        let side = read(r#"{"mesh":"room.ply"}"#).unwrap();
        let Side::Mesh(mesh) = &side else {
            panic!("{side:?}")
        };
        assert_eq!((mesh.unit_m, mesh.exposure, mesh.pose), (1.0, 1.0, None));
        let text = serde_json::to_string(&side).unwrap();
        assert_eq!(
            text,
            r#"{"mesh":"room.ply","transfer":"srgb","unit_m":1.0,"exposure":1.0}"#
        );
        assert_eq!(read(&text).unwrap(), side);

        let posed = r#"{"mesh":"a:b.ply","transfer":"linear","unit_m":0.01,"exposure":2.0,"pose":{"rotation":
            [[1,0,0],[0,0,-1],[0,1,0]],"translation_m":[0,0.5,2]},"apex":"camera"}"#;
        let side = read(posed).unwrap();
        assert_eq!(side.apex(), Some(Apex::Camera));
        assert_eq!(side.paths(), [("mesh", "a:b.ply")]);
        let text = serde_json::to_string(&side).unwrap();
        assert_eq!(read(&text).unwrap(), side);
        let moved = read(r#"{"mesh":"b","pose":{"translation_m":[0,0,1]}}"#).unwrap();
        let Side::Mesh(mesh) = moved else { panic!() };
        assert_eq!(mesh.pose.unwrap().distortion(), 0.0);
    }

    #[test]
    fn a_panorama_has_its_own_keys_and_defaults() {
        let side = read(r#"{"panorama":"hall.exr"}"#).unwrap();
        let text = serde_json::to_string(&side).unwrap();
        assert_eq!(
            text,
            r#"{"panorama":"hall.exr","transfer":"srgb","exposure":1.0,"depth_m":10.0,"yaw_deg":0.0,"pitch_deg":0.0}"#
        );
        assert_eq!(read(&text).unwrap(), side);
        let mut side = read(
            r#"{"panorama":"a:hall.jpg","highlights":{"above":0.9,"to":8},"depth":"a:hall.npy","depth_kind":
            "relative_inverse","depth_range":{"mean_m":3},"fill":"far","yaw_deg":-90,"pitch_deg":5,"apex":"camera"}"#,
        )
        .unwrap();
        assert_eq!(
            side.paths(),
            [("panorama", "a:hall.jpg"), ("depth", "a:hall.npy")]
        );
        let text = serde_json::to_string(&side).unwrap();
        assert_eq!(read(&text).unwrap(), side);
        *side.light_mut().0 = 3.0;
        side.paths_mut()[1].push('x');
        let Side::Panorama(panorama) = &side else {
            panic!("{side:?}")
        };
        let PanoramaDepth::Map(map) = &panorama.depth else {
            panic!("{side:?}")
        };
        assert_eq!(
            (panorama.exposure, map.depth.as_str()),
            (3.0, "a:hall.npyx")
        );
        assert_eq!(map.depth_unit_m, 1.0);
        for (json, words) in [
            (r#"{"panorama":"p","mesh":"m"}"#, "give one of them"),
            (
                r#"{"panorama":"p","color":"c"}"#,
                "`color` belongs to a photograph and cannot stand beside `panorama`",
            ),
            (
                r#"{"panorama":"p","pose":{}}"#,
                "`pose` belongs to a mesh and cannot stand beside `panorama`",
            ),
            (
                r#"{"panorama":"p","depth":"d","depth_m":3}"#,
                "`depth_m` is a constant and cannot stand beside `depth`",
            ),
            (
                r#"{"panorama":"p","fill":"far"}"#,
                "`fill` describes a `depth`, which is not given",
            ),
            (
                r#"{"panorama":"p","depth":"d","depth_kind":"z"}"#,
                "`depth_kind` of a panorama is \"distance\"",
            ),
            (
                r#"{"mesh":"m","yaw_deg":3}"#,
                "`yaw_deg` belongs to a panorama and cannot stand beside `mesh`",
            ),
            (
                r#"{"mesh":"m","highlights":{"above":0.5,"to":2}}"#,
                "`highlights` belongs to an image",
            ),
            (
                r#"{"color":"c","depth":"d","depth_m":1}"#,
                "`depth_m` belongs to a `panorama`, which is not given",
            ),
            (
                r#"{"color":"c","depth":"d","highlights":{"above":0.5}}"#,
                "missing field `to`",
            ),
        ] {
            let error = read(json).unwrap_err();
            assert!(error.contains(words), "{json}: {error}");
        }
    }

    #[test]
    fn errors_say_which_keys_go_together() {
        let photograph = r#"{"color":"c","depth":"d","intrinsics":{"fx":1,"fy":1,"cx":0,"cy":0}"#;
        assert!(read(&format!("{photograph}}}")).is_ok());
        for (json, words) in [
            (
                format!(r#"{photograph},"mesh":"m"}}"#),
                "`color` belongs to a photograph",
            ),
            (
                r#"{"mesh":"m","depth_unit_m":1}"#.into(),
                "`depth_unit_m` belongs to a photograph and cannot stand beside `mesh`",
            ),
            (
                format!(r#"{photograph},"unit_m":1}}"#),
                "`unit_m` belongs to a `mesh`",
            ),
            (
                format!(r#"{photograph},"pose":{{}}}}"#),
                "`pose` belongs to a `mesh`",
            ),
            (
                r#"{"color":"c"}"#.into(),
                "missing field `depth`: give color, depth",
            ),
            (
                "{}".into(),
                "missing field `color`: give color, depth and intrinsics",
            ),
            (
                r#"{"mesh":"m","meshes":1}"#.into(),
                "unknown field `meshes`",
            ),
            (r#"{"mesh":null}"#.into(), "invalid type: null"),
            (
                r#"{"mesh":"m","pose":{"scale":2}}"#.into(),
                "unknown field `scale`",
            ),
        ] {
            let error = read(&json).unwrap_err();
            assert!(error.contains(words), "{json}: {error}");
        }
    }
}
