//! Results of checks.

use serde::Serialize;
use serde_json::{Map, Value};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    Ok,
    /// The feature works, but slowly or less safely, or its state is unknown.
    Warn,
    /// The feature does not work.
    Fail,
}

impl Level {
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warn => "warn",
            Self::Fail => "fail",
        }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Name of the check.
    pub check: &'static str,
    pub level: Level,
    /// Result in words.
    pub value: String,
    /// Advice, if the level is not `Ok`.
    pub to_do: Option<String>,
    /// Measured values; the names of quantities contain the unit.
    pub measured: Map<String, Value>,
}

impl Finding {
    pub fn ok(check: &'static str, value: impl Into<String>) -> Self {
        Self { check, level: Level::Ok, value: value.into(), to_do: None, measured: Map::new() }
    }

    pub fn warn(check: &'static str, value: impl Into<String>, to_do: impl Into<String>) -> Self {
        Self::ok(check, value).but(Level::Warn, to_do)
    }

    pub fn fail(check: &'static str, value: impl Into<String>, to_do: impl Into<String>) -> Self {
        Self::ok(check, value).but(Level::Fail, to_do)
    }

    /// Raises the level; an equal or higher level stays, with its advice.
    #[must_use]
    pub fn but(mut self, level: Level, to_do: impl Into<String>) -> Self {
        if level > self.level {
            self.level = level;
            self.to_do = Some(to_do.into());
        }
        self
    }

    /// Calls [`Self::but`] if `is_so` is false.
    #[must_use]
    pub fn unless(self, is_so: bool, level: Level, to_do: impl Into<String>) -> Self {
        if is_so { self } else { self.but(level, to_do) }
    }

    /// Adds a measured value.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.measured.insert(name.to_owned(), value.into());
        self
    }
}

/// Formats bytes in decimal units: `12 kB`, `3.4 MB`, `5.6 GB`.
pub(crate) fn bytes_text(bytes: f64) -> String {
    match bytes {
        b if b < 1e6 => format!("{:.0} kB", b / 1e3),
        b if b < 1e9 => format!("{:.1} MB", b / 1e6),
        b => format!("{:.1} GB", b / 1e9),
    }
}

/// Formats seconds: `0.3 ms`, `12 ms`, `1.4 s`.
pub(super) fn seconds_text(seconds: f64) -> String {
    match seconds * 1e3 {
        ms if ms < 0.1 => "under 0.1 ms".to_owned(),
        ms if ms < 10.0 => format!("{ms:.1} ms"),
        ms if ms < 1000.0 => format!("{ms:.0} ms"),
        _ => format!("{seconds:.1} s"),
    }
}
