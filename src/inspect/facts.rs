//! What a reader found out: lines for a person, values for a program, and what is wrong.

use super::kind::Kind;
use crate::text::{cut, grouped};
use serde::Serialize;
use serde_json::{Map, Value};
use std::fmt::Write;

/// Characters of a text, and entries of a list, that are shown.
const TEXT_SHOWN: usize = 1000;
const LIST_SHOWN: usize = 8;

/// Something that is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// A sentence about the damage.
    pub what: String,
    /// Line, byte, member or tensor, if known.
    #[serde(rename = "where")]
    pub place: Option<String>,
    /// What to do about it.
    pub to_do: String,
}

impl Problem {
    /// Something wrong with the file as a whole.
    pub fn new(what: impl Into<String>, to_do: impl Into<String>) -> Self {
        Self { what: what.into(), place: None, to_do: to_do.into() }
    }

    /// The same at a place.
    #[must_use]
    pub fn at(mut self, place: impl Into<String>) -> Self {
        self.place = Some(place.into());
        self
    }
}

/// Whether a file is as it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Whole {
    /// Yes, and how that is known.
    Yes(String),
    /// Nothing is wrong, and why more cannot be known.
    Unknown(String),
    /// No: the problems say why.
    No,
}

/// Facts in the order in which they were added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    rows: Vec<(String, String)>,
    values: Map<String, Value>,
}

impl Facts {
    /// Adds a line for a person: a label of a word or two, and a text.
    pub fn say(&mut self, label: impl Into<String>, text: impl Into<String>) {
        self.rows.push((label.into(), text.into()));
    }

    /// Adds a value for a program.
    pub fn put(&mut self, key: &str, value: impl Into<Value>) {
        self.values.insert(key.to_owned(), value.into());
    }

    /// Adds both, of one name.
    pub fn fact(&mut self, key: &str, text: impl Into<String>, value: impl Into<Value>) {
        self.say(key.replace('_', " "), text);
        self.put(key, value);
    }

    /// Adds a value, and its text for a person.
    pub fn value(&mut self, key: &str, value: impl Into<Value>) {
        let value = value.into();
        self.fact(key, text_of(&value), value);
    }

    /// Lines for a person.
    pub fn rows(&self) -> &[(String, String)] {
        &self.rows
    }

    /// Values for a program.
    pub fn values(&self) -> &Map<String, Value> {
        &self.values
    }
}

/// Everything that is known of a file or folder.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspection {
    pub kind: Kind,
    /// Its bytes; nothing of a folder.
    pub bytes: Option<u64>,
    pub facts: Facts,
    /// Whether it is whole.
    pub whole: Whole,
    /// What is wrong with it.
    pub problems: Vec<Problem>,
    /// What can be done next.
    pub next: Vec<String>,
}

impl Inspection {
    /// Of a kind, with nothing known yet.
    pub fn new(kind: Kind) -> Self {
        Self {
            kind,
            bytes: None,
            facts: Facts::default(),
            whole: Whole::Unknown("nothing in it says so".to_owned()),
            problems: Vec::new(),
            next: Vec::new(),
        }
    }

    /// Adds what is wrong: it is not whole, then.
    pub fn wrong(&mut self, problem: Problem) {
        self.whole = Whole::No;
        self.problems.push(problem);
    }

    /// It is whole, unless something is wrong.
    pub fn is_whole(&mut self, how: impl Into<String>) {
        if self.problems.is_empty() {
            self.whole = Whole::Yes(how.into());
        }
    }

    /// Whether it is whole is unknown, unless something is wrong.
    pub fn may_be_whole(&mut self, why: impl Into<String>) {
        if self.problems.is_empty() {
            self.whole = Whole::Unknown(why.into());
        }
    }

    /// It can be used: known, and nothing wrong.
    pub fn is_sound(&self) -> bool {
        self.problems.is_empty()
    }
}

/// `1 scene`, `2,000 scenes`
pub(super) fn many(count: u64, what: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{} {what}{plural}", grouped(count))
}

/// The first names of a list, and how many more there are.
pub(super) fn first_of<T: AsRef<str>>(names: &[T], shown: usize) -> String {
    let mut text = names.iter().take(shown).map(AsRef::as_ref).collect::<Vec<_>>().join(", ");
    if names.len() > shown {
        let _ = write!(text, " and {} more", names.len() - shown);
    }
    text
}

/// A value on one line; an object by its keys, a list of objects by its length.
pub(super) fn text_of(value: &Value) -> String {
    match value {
        Value::Null => "none".to_owned(),
        Value::String(text) => cut(text.trim_end(), TEXT_SHOWN),
        Value::Number(_) | Value::Bool(_) => value.to_string(),
        Value::Array(all) if all.is_empty() => "none".to_owned(),
        Value::Array(all) if all.iter().any(Value::is_object) => many(all.len() as u64, "object"),
        Value::Array(all) => first_of(&all.iter().map(text_of).collect::<Vec<_>>(), LIST_SHOWN),
        Value::Object(object) => first_of(&object.keys().collect::<Vec<_>>(), LIST_SHOWN),
    }
}
