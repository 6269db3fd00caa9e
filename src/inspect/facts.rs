//! Findings of a reader: rows for people, values for programs, and problems.

use super::kind::Kind;
use crate::text::{cut, many};
use serde::Serialize;
use serde_json::{Map, Value};
use std::fmt::Write;

// Maximum length of a text, in characters, and maximum number of entries of a list.
const TEXT_SHOWN: usize = 1000;
const LIST_SHOWN: usize = 8;

/// Damage to a file or folder, or an error that prevents its inspection.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    pub what: String,
    /// Location, such as a line, a byte or a sample, if known.
    #[serde(rename = "where")]
    pub place: Option<String>,
    pub to_do: String,
}

impl Problem {
    /// Creates a problem of the file as a whole.
    pub fn new(what: impl Into<String>, to_do: impl Into<String>) -> Self {
        Self { what: what.into(), place: None, to_do: to_do.into() }
    }

    #[must_use]
    pub fn at(mut self, place: impl Into<String>) -> Self {
        self.place = Some(place.into());
        self
    }
}

/// Result of checking whether a file is intact.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Whole {
    /// The file is intact; the text is the evidence.
    Yes(String),
    /// The reader found no damage; the text is the reason why it cannot prove that the file is intact.
    Unknown(String),
    /// The file has problems.
    No,
}

/// Facts in the order in which they were added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    /// Labels and texts, for people.
    pub rows: Vec<(String, String)>,
    pub values: Map<String, Value>,
}

impl Facts {
    /// Adds a row.
    pub(super) fn say(&mut self, label: impl Into<String>, text: impl Into<String>) {
        self.rows.push((label.into(), text.into()));
    }

    pub(super) fn put(&mut self, key: &str, value: impl Into<Value>) {
        self.values.insert(key.to_owned(), value.into());
    }

    /// Adds a row and a value.
    pub(super) fn fact(&mut self, key: &str, text: impl Into<String>, value: impl Into<Value>) {
        self.say(key.replace('_', " "), text);
        self.put(key, value);
    }

    /// Adds a value and a row with its text.
    pub(super) fn value(&mut self, key: &str, value: impl Into<Value>) {
        let value = value.into();
        self.fact(key, text_of(&value), value);
    }
}

/// Findings about a file or folder.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspection {
    pub kind: Kind,
    /// Length of a file, bytes; `None` for folders and unreadable files.
    pub bytes: Option<u64>,
    pub facts: Facts,
    pub whole: Whole,
    pub problems: Vec<Problem>,
    /// Next steps for the user.
    pub next: Vec<String>,
}

impl Inspection {
    pub(super) fn new(kind: Kind) -> Self {
        Self {
            kind,
            bytes: None,
            facts: Facts::default(),
            whole: Whole::Unknown("it has no digest".to_owned()),
            problems: Vec::new(),
            next: Vec::new(),
        }
    }

    /// Adds a problem and marks the file as damaged.
    pub(super) fn wrong(&mut self, problem: Problem) {
        self.whole = Whole::No;
        self.problems.push(problem);
    }

    /// Marks the file as intact, unless it has problems.
    pub(super) fn is_whole(&mut self, how: impl Into<String>) {
        if self.is_sound() {
            self.whole = Whole::Yes(how.into());
        }
    }

    /// Marks the file's intactness as unknown, unless the file has problems.
    pub(super) fn may_be_whole(&mut self, why: impl Into<String>) {
        if self.is_sound() {
            self.whole = Whole::Unknown(why.into());
        }
    }

    /// True if the reader found no problem.
    pub fn is_sound(&self) -> bool {
        self.problems.is_empty()
    }
}

/// Lists the first `shown` names and the number of the others.
pub(super) fn first_of<T: AsRef<str>>(names: &[T], shown: usize) -> String {
    let mut text = names.iter().take(shown).map(AsRef::as_ref).collect::<Vec<_>>().join(", ");
    if names.len() > shown {
        let _ = write!(text, " and {} more", names.len() - shown);
    }
    text
}

/// Formats a value as text. The text of a list that contains an object is its length. The text of an object is its
/// keys, and also its values if none of them is a list or an object.
pub(super) fn text_of(value: &Value) -> String {
    match value {
        Value::Null => "none".to_owned(),
        Value::String(text) => cut(text.trim_end(), TEXT_SHOWN),
        Value::Number(_) | Value::Bool(_) => value.to_string(),
        Value::Array(all) if all.is_empty() => "none".to_owned(),
        Value::Object(object) if object.is_empty() => "none".to_owned(),
        Value::Array(all) if all.iter().any(Value::is_object) => many(all.len() as u64, "object"),
        Value::Array(all) => first_of(&all.iter().map(text_of).collect::<Vec<_>>(), LIST_SHOWN),
        Value::Object(object) if object.values().any(|v| v.is_object() || v.is_array()) => {
            first_of(&object.keys().collect::<Vec<_>>(), LIST_SHOWN)
        }
        Value::Object(object) => {
            let pair = |(key, value): (&String, &Value)| format!("{key} {}", text_of(value));
            first_of(&object.iter().map(pair).collect::<Vec<_>>(), LIST_SHOWN)
        }
    }
}
