//! Reads YAML files.

use std::path::Path;
use yaml_rust2::{Yaml, YamlLoader};

/// Reads the YAML documents of a file.
pub(crate) fn documents(path: &Path) -> Vec<Yaml> {
    let text = std::fs::read_to_string(path).unwrap();
    let found =
        YamlLoader::load_from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    assert!(!found.is_empty(), "{} is empty", path.display());
    found
}

/// Returns the value at `a.b.c`, where a number is an index of a list. Follows merge keys (`<<`), as compose does.
pub(crate) fn at<'a>(value: &'a Yaml, path: &str) -> &'a Yaml {
    path.split('.').fold(value, |value, key| {
        let found = match key.parse::<usize>() {
            Ok(index) if value.is_array() => &value[index],
            _ => &value[key],
        };
        if found.is_badvalue() { &value["<<"][key] } else { found }
    })
}

/// Returns the strings of a list.
pub(crate) fn strings(value: &Yaml) -> Vec<&str> {
    let list = value.as_vec().unwrap_or_else(|| panic!("not a list: {value:?}"));
    list.iter().map(|item| item.as_str().unwrap()).collect()
}

/// Returns the value of a flag in a command line, from `--flag=value` or `--flag value`.
pub(crate) fn argument<'a>(words: &[&'a str], flag: &str) -> Option<&'a str> {
    let joined = words.iter().find_map(|word| word.strip_prefix(flag)?.strip_prefix('='));
    joined.or_else(|| {
        let place = words.iter().position(|word| *word == flag)?;
        words.get(place + 1).copied()
    })
}
