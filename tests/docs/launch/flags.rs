//! Checks that the program has every command and flag in launch files and their pages.

use super::yaml::documents;
use super::{launch_files, repository};
use crate::support::program::run;
use std::collections::{BTreeMap, BTreeSet};
use yaml_rust2::Yaml;

/// A command line: its place, and the words after `glasshouse`.
struct Line {
    place: String,
    words: Vec<String>,
}

fn is_command(word: &str) -> bool {
    !word.is_empty() && word.bytes().all(|b| b.is_ascii_lowercase())
}

/// Returns the command lines in a script, a unit or a page.
fn lines_of_text(place: &str, text: &str) -> Vec<Line> {
    // In pages and comments, code is between backticks.
    let text = text.replace("\\\n", " ").replace('`', "\n");
    let mut found = Vec::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let starts = words.iter().enumerate().filter(|(_, word)| {
            let word = word.trim_start_matches("ExecStart=");
            word == "glasshouse" || word == "\"$program\"" || word == "\"$(command"
        });
        for (start, _) in starts {
            let rest = &words[start + 1..];
            // Skips the rest of `"$(command -v glasshouse)"`.
            let rest = rest.strip_prefix(["-v", "glasshouse)\""].as_slice()).unwrap_or(rest);
            let is_end = |word: &&str| {
                word.starts_with(['|', '&', ';', '>', '#', ')']) || word.starts_with("2>")
            };
            let words: Vec<String> = rest
                .iter()
                .take_while(|word| !is_end(word))
                .map(|word| word.trim_end_matches([';', ',', ')', '.']).to_owned())
                .collect();
            if words.first().is_some_and(|word| is_command(word)) {
                found.push(Line { place: format!("{place}: {}", line.trim()), words });
            }
        }
    }
    found
}

/// Adds the `work` and `coordinate` lines of a document's `args` and `command` keys to `found`.
fn lines_of_yaml(place: &str, value: &Yaml, found: &mut Vec<Line>) {
    match value {
        Yaml::Hash(map) => {
            for (key, value) in map {
                let words: Option<Vec<String>> = match (key.as_str(), value) {
                    (Some("args" | "command"), Yaml::Array(list)) => {
                        list.iter().map(|word| word.as_str().map(str::to_owned)).collect()
                    }
                    (Some("command"), Yaml::String(text)) => {
                        Some(text.split_whitespace().map(str::to_owned).collect())
                    }
                    _ => None,
                };
                let is_ours = |words: &Vec<String>| words[0] == "work" || words[0] == "coordinate";
                match words.filter(is_ours) {
                    Some(words) => found.push(Line { place: place.to_owned(), words }),
                    None => lines_of_yaml(place, value, found),
                }
            }
        }
        Yaml::Array(list) => {
            for value in list {
                lines_of_yaml(place, value, found);
            }
        }
        _ => {}
    }
}

fn all_lines() -> Vec<Line> {
    let mut found = Vec::new();
    let mut texts = launch_files(&[".sh", ".sbatch", ".service", ".md", "Containerfile"]);
    texts.push(repository().join("docs/farming.md"));
    for path in texts {
        let text = std::fs::read_to_string(&path).unwrap();
        let name = path.file_name().unwrap().to_str().unwrap();
        found.extend(lines_of_text(name, &text));
    }
    for path in launch_files(&[".yaml"]) {
        let name = path.file_name().unwrap().to_str().unwrap();
        for document in documents(&path) {
            lines_of_yaml(name, &document, &mut found);
        }
    }
    for path in launch_files(&[".env"]) {
        let text = std::fs::read_to_string(&path).unwrap();
        let arguments = text.split("WORK_ARGS=\"").nth(1).unwrap();
        let arguments = arguments.split('"').next().unwrap();
        found.push(Line {
            place: path.display().to_string(),
            words: std::iter::once("work")
                .chain(arguments.split_whitespace())
                .map(str::to_owned)
                .collect(),
        });
    }
    found
}

/// Returns the flags in a command's help; `None` for an unknown command.
fn flags(command: &str) -> Option<BTreeSet<String>> {
    let help = run(&[command, "--help"]);
    let flags = help
        .stdout
        .split(|c: char| !c.is_ascii_alphanumeric() && c != '-')
        .filter(|word| word.starts_with('-') && word.len() > 1)
        .map(str::to_owned);
    (help.code == Some(0)).then(|| flags.collect())
}

/// Returns the flag of a word such as `--name=value`, `-j4` or `[--store`; `None` for other words.
fn flag(word: &str) -> Option<&str> {
    let word = word.trim_start_matches('[');
    if let Some(long) = word.strip_prefix("--") {
        let end = long.find(|c: char| !c.is_ascii_lowercase() && c != '-').unwrap_or(long.len());
        return (end > 0).then(|| &word[..end + 2]);
    }
    let is_short =
        word.len() > 1 && word.starts_with('-') && word.as_bytes()[1].is_ascii_alphabetic();
    is_short.then(|| &word[..2])
}

#[test]
fn the_program_has_every_command_and_flag() {
    let mut known: BTreeMap<String, Option<BTreeSet<String>>> = BTreeMap::new();
    let mut count = 0;
    for Line { place, words } in all_lines() {
        let command = &words[0];
        let flags = known.entry(command.clone()).or_insert_with(|| flags(command));
        let Some(flags) = flags else {
            panic!("no {command}: {place}");
        };
        for flag in words.iter().filter_map(|word| flag(word)) {
            assert!(flags.contains(flag), "{command} has no {flag}: {place}");
            count += 1;
        }
    }
    assert!(count > 20, "only {count} flags were found in launch files");
}

#[test]
fn command_lines_are_found_in_texts() {
    let text = "x=$(glasshouse work \"$run\" --queue q \\\n  -j4 | cat)\nsay `glasshouse status R --json`, or glasshouse\n";
    let found = lines_of_text("", text);
    let words: Vec<Vec<&str>> =
        found.iter().map(|l| l.words.iter().map(String::as_str).collect()).collect();
    // `x=$(glasshouse` is not the word `glasshouse`, so no command is found in the first line.
    assert_eq!(words, [["status", "R", "--json"]]);
    let found = lines_of_text("", "    exec glasshouse work r --queue q -j4 & # --no\n");
    assert_eq!(found[0].words, ["work", "r", "--queue", "q", "-j4"]);
    let of = |word| flag(word);
    assert_eq!(of("--lease-s=30"), Some("--lease-s"));
    assert_eq!((of("-j4"), of("[--store"), of("--")), (Some("-j"), Some("--store"), None));
    assert_eq!(of("-"), None);
}
