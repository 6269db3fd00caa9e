//! Reads a side from JSON: the key `mesh`, `panorama` or `color` determines the other allowed keys.

use super::panorama::PanoramaFile;
use super::side::Side;
use serde::Deserialize;
use serde::de::{DeserializeOwned, Deserializer, Error, MapAccess, Visitor};
use serde_json::{Map, Value, from_value};
use std::fmt;

impl<'de> Deserialize<'de> for Side {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let keys = deserializer.deserialize_map(KeysVisitor)?;
        let side = if keys.contains_key("mesh") {
            read("mesh", keys).map(Self::Mesh)
        } else if keys.contains_key("panorama") {
            read::<PanoramaFile>("panorama", keys)
                .and_then(PanoramaFile::resolved)
                .map(Self::Panorama)
        } else if keys.contains_key("color") {
            read("color", keys).map(Self::Photograph)
        } else {
            Err(
                "a side is missing its image: give `color`, `depth` and `intrinsics` of a photograph, or `panorama`, \
                 or `mesh`"
                    .to_owned(),
            )
        };
        side.map_err(D::Error::custom)
    }
}

/// Reads one kind of side. Errors name a wrong key and all allowed keys; those of an untagged enum would not.
fn read<T: DeserializeOwned>(kind: &str, keys: Map<String, Value>) -> Result<T, String> {
    from_value(Value::Object(keys)).map_err(|error| format!("a side with `{kind}`: {error}"))
}

/// A visitor that accepts any key once. Deserializing a `Map` directly would silently keep the last of two values.
struct KeysVisitor;

impl<'de> Visitor<'de> for KeysVisitor {
    type Value = Map<String, Value>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a photograph, a panorama or a mesh")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Self::Value, A::Error> {
        let mut keys = Map::new();
        while let Some((key, value)) = access.next_entry::<String, Value>()? {
            if keys.contains_key(&key) {
                return Err(A::Error::custom(format!("duplicate field `{key}`")));
            }
            keys.insert(key, value);
        }
        Ok(keys)
    }
}

#[cfg(test)]
mod tests {
    use super::super::image::Apex;
    use super::super::panorama::PanoramaDepth;
    use super::*;

    fn read(json: &str) -> Result<Side, String> {
        serde_json::from_str(json).map_err(|error| error.to_string())
    }

    #[test]
    fn a_mesh_has_its_own_keys_and_defaults() {
        let side = read(r#"{"mesh":"room.ply"}"#).unwrap();
        let Side::Mesh(mesh) = &side else { panic!("{side:?}") };
        assert_eq!((mesh.unit_m, mesh.exposure, mesh.pose), (1.0, 1.0, None));
        let text = serde_json::to_string(&side).unwrap();
        assert_eq!(text, r#"{"mesh":"room.ply","transfer":"srgb","unit_m":1.0,"exposure":1.0}"#);
        assert_eq!(read(&text).unwrap(), side);

        let posed = r#"{"mesh":"a:b.ply","transfer":"linear","unit_m":0.01,"exposure":2.0,"pose":{"rotation":
            [[1,0,0],[0,0,-1],[0,1,0]],"translation_m":[0,0.5,2]},"apex":"camera"}"#;
        let side = read(posed).unwrap();
        assert_eq!(side.apex(), Some(Apex::Camera));
        assert_eq!(side.paths(), [("mesh".into(), "a:b.ply")]);
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
            [("panorama".into(), "a:hall.jpg"), ("depth".into(), "a:hall.npy")]
        );
        let text = serde_json::to_string(&side).unwrap();
        assert_eq!(read(&text).unwrap(), side);
        *side.light_mut().0 = 3.0;
        side.paths_mut()[1].push('x');
        let Side::Panorama(panorama) = &side else { panic!("{side:?}") };
        let PanoramaDepth::Map(map) = panorama.distances() else { panic!("{side:?}") };
        assert_eq!((panorama.exposure, map.depth), (3.0, "a:hall.npyx"));
        assert_eq!(map.depth_unit_m, 1.0);
    }

    #[test]
    fn errors_name_the_wrong_key_and_the_allowed_ones() {
        let photograph = r#"{"color":"c","depth":"d","intrinsics":{"fx":1,"fy":1,"cx":0,"cy":0}"#;
        assert!(read(&format!("{photograph}}}")).is_ok());
        let with = |key: &str| format!(r"{photograph},{key}}}");
        for (json, words) in [
            (
                with(r#""mesh":"m""#).as_str(),
                "a side with `mesh`: unknown field `color`, expected one of `mesh`, `transfer`",
            ),
            (
                &with(r#""unit_m":1"#),
                "a side with `color`: unknown field `unit_m`, expected one of `color`, `depth`",
            ),
            (&with(r#""pose":{}"#), "unknown field `pose`"),
            (&with(r#""depth_m":1"#), "unknown field `depth_m`"),
            (&with(r#""highlights":{"above":0.5}"#), "missing field `to`"),
            (&with(r#""fill":"far","fill":"far""#), "duplicate field `fill`"),
            (
                r#"{"mesh":"m","depth_unit_m":1}"#,
                "unknown field `depth_unit_m`, expected one of `mesh`",
            ),
            (r#"{"mesh":"m","yaw_deg":3}"#, "unknown field `yaw_deg`"),
            (r#"{"mesh":"m","highlights":{"above":0.5,"to":2}}"#, "unknown field `highlights`"),
            (r#"{"mesh":"m","pose":{"scale":2}}"#, "unknown field `scale`"),
            (r#"{"mesh":null}"#, "a side with `mesh`: invalid type: null"),
            (r#"{"panorama":"p","mesh":"m"}"#, "unknown field `panorama`, expected one of `mesh`"),
            (
                r#"{"panorama":"p","color":"c"}"#,
                "a side with `panorama`: unknown field `color`, expected one of `panorama`, `transfer`",
            ),
            (r#"{"panorama":"p","pose":{}}"#, "unknown field `pose`"),
            (
                r#"{"panorama":"p","depth":"d","depth_m":3}"#,
                "`depth_m` and `depth` exclude each other",
            ),
            (r#"{"panorama":"p","fill":"far"}"#, "`fill` needs `depth`, which is missing"),
            (
                r#"{"panorama":"p","depth":"d","depth_kind":"z"}"#,
                "`depth_kind` of a panorama must be \"distance\"",
            ),
            (r#"{"color":"c"}"#, "a side with `color`: missing field `intrinsics`"),
            (r#"{"depth":"d"}"#, "give `color`, `depth` and `intrinsics` of a photograph"),
            ("[]", "expected a photograph, a panorama or a mesh"),
        ] {
            let error = read(json).unwrap_err();
            assert!(error.contains(words), "{json}: {error}");
        }
    }
}
