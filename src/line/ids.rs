//! Scene ids, which become file names and are therefore checked on construction.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::fmt;

/// A scene's id: 1 to 128 characters of `[A-Za-z0-9_-]`, which are safe in file names and keys.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct SceneId(String);

/// A string that is not a scene id.
#[derive(Debug, thiserror::Error)]
#[error(
    "scene id {0:?} is not 1 to 128 characters of [A-Za-z0-9_-]: it names files, so rename the scene"
)]
pub struct BadSceneId(String);

impl JsonSchema for SceneId {
    fn schema_name() -> Cow<'static, str> {
        "SceneId".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "pattern": "^[A-Za-z0-9_-]{1,128}$" })
    }
}

impl SceneId {
    /// Checks `text` and makes it an id.
    pub fn new(text: impl Into<String>) -> Result<Self, BadSceneId> {
        let text = text.into();
        let allowed = |b: u8| b.is_ascii_alphanumeric() || b == b'_' || b == b'-';
        if (1..=128).contains(&text.len()) && text.bytes().all(allowed) {
            Ok(Self(text))
        } else {
            Err(BadSceneId(text))
        }
    }

    /// Returns the id as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for SceneId {
    type Error = BadSceneId;
    fn try_from(text: String) -> Result<Self, BadSceneId> {
        Self::new(text)
    }
}

impl From<SceneId> for String {
    fn from(id: SceneId) -> Self {
        id.0
    }
}

impl fmt::Display for SceneId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_safe_file_names() {
        for bad in ["", "a/b", "..", "a b", "é", "a.b", "x\0"] {
            assert!(SceneId::new(bad).is_err(), "{bad:?}");
        }
        assert_eq!(SceneId::new("train-000412_b").unwrap().as_str(), "train-000412_b");
    }
}
