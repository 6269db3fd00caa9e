//! Reads links, headings and command lines from the repository's documents.

use std::collections::BTreeSet;
use std::path::Path;

/// First words of command lines in code blocks, separated by spaces.
const PROGRAMS: &str = "glasshouse cargo python3 python3.11 pip sbatch scancel kubectl docker systemctl systemd-run sudo \
    nats-server nats nohup kill while rsync scp ssh git curl cp mkdir sha256sum benches/peers/run.py \
    benches/peers/export_scene.py ~/peers/bin/pip ~/peers/bin/python .ci/run benches/peers/train_step.py \
    parallel export";

/// A Markdown document of the repository.
pub(crate) struct Page {
    /// Path relative to the repository.
    pub(crate) name: String,
    pub(crate) text: String,
}

pub(crate) fn page(name: &str) -> Page {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
    Page {
        name: name.to_owned(),
        text: std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{name}: {e}")),
    }
}

/// Reads the listed documents, and all documents directly in `docs/`.
pub(crate) fn pages() -> Vec<Page> {
    let named = "README.md ARCHITECTURE.md CHANGELOG.md CONTRIBUTING.md docs/decisions/farm-scheduling.md \
                 manifests/README.md workers/README.md benches/README.md benches/peers/README.md";
    let mut names: Vec<String> = named.split(' ').map(str::to_owned).collect();
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    for entry in std::fs::read_dir(docs).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if Path::new(&name).extension().is_some_and(|e| e == "md") {
            names.push(format!("docs/{name}"));
        }
    }
    names.sort();
    names.iter().map(|name| page(name)).collect()
}

/// Returns the lines except fences, each with true if the line is in a code block.
fn lines(text: &str) -> Vec<(&str, bool)> {
    let mut fenced = false;
    let mut before_is_code = true;
    let mut found = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
            before_is_code = true;
            continue;
        }
        // Four spaces start a code block after an empty line and continue a code block.
        let indented = line.starts_with("    ") && before_is_code;
        before_is_code = line.is_empty() || indented;
        found.push((line, fenced || indented));
    }
    found
}

/// Returns the code spans of a line of prose.
fn spans(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2)
}

/// Removes the prompt and the comment from a command line.
fn bare(line: &str) -> &str {
    let line = line.trim();
    let line = line.strip_prefix("$ ").unwrap_or(line);
    let end = line.find(" #").unwrap_or(line.len());
    line[..end].trim()
}

/// Replaces each run of white space by one space.
fn one_space(line: &str) -> String {
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn is_command(line: &str) -> bool {
    let first = line.split_whitespace().next().unwrap_or_default();
    let is_program = PROGRAMS.split(' ').any(|program| program == first);
    is_program && line.contains(' ') || first == ".ci/run"
}

impl Page {
    /// Returns the command lines in code blocks, with continued lines joined, and `glasshouse` commands in prose.
    pub(crate) fn command_lines(&self) -> Vec<String> {
        let mut found = Vec::new();
        let mut open = String::new();
        for (line, is_code) in lines(&self.text) {
            if !is_code {
                let in_prose = spans(line).filter(|s| s.starts_with("glasshouse "));
                found.extend(in_prose.map(one_space));
                continue;
            }
            let part = bare(line);
            if open.is_empty() && !is_command(part) {
                continue;
            }
            open += part.trim_end_matches('\\');
            if part.ends_with('\\') {
                open.push(' ');
            } else {
                found.push(one_space(&std::mem::take(&mut open)));
            }
        }
        found
    }

    /// Returns the targets of the document's links.
    pub(crate) fn links(&self) -> Vec<String> {
        let prose = lines(&self.text).into_iter().filter(|(_, code)| !code);
        let mut found = Vec::new();
        for (line, _) in prose {
            let words: String = line.split('`').step_by(2).collect();
            for part in words.split("](").skip(1) {
                if let Some((target, _)) = part.split_once(')') {
                    found.push(target.to_owned());
                }
            }
        }
        found
    }

    /// Returns GitHub's anchors for the document's headings.
    pub(crate) fn anchors(&self) -> BTreeSet<String> {
        let prose = lines(&self.text).into_iter().filter(|(_, code)| !code);
        prose
            .filter(|(line, _)| line.starts_with('#'))
            .map(|(line, _)| {
                let title = line.trim_start_matches('#').trim().to_lowercase();
                title
                    .chars()
                    .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'))
                    .map(|c| if c == ' ' { '-' } else { c })
                    .collect()
            })
            .collect()
    }
}
