//! The checks of a state after a crash: nothing false is said, and the same command ends with the same bits.

use super::disk::{Disk, Tree, put_tree};
use super::phase::{Phase, run_in, scratch};
use super::states::State;
use render::atomic_file::is_temporary;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Checks a state; returns a description of the first wrong or lost result.
pub(crate) fn check(phase: &Phase, state: &State, end: usize) -> Result<(), String> {
    kept_promises(phase, state, end)?;
    let folder = scratch();
    put_tree(&state.tree, folder.path());
    nothing_false_is_said(phase, state, folder.path())?;
    let ended = run_in(folder.path(), &phase.arguments);
    if ended.code != Some(0) {
        return Err(format!(
            "the same command ends with {:?}: {}",
            ended.code,
            ended.stderr.trim()
        ));
    }
    recovered(phase, folder.path())
}

/// Compares a folder after the command with the undisturbed one.
pub(crate) fn recovered(phase: &Phase, folder: &Path) -> Result<(), String> {
    let mut found = Disk::read(folder).tree();
    if !phase.is_owner() {
        found.retain(|path, _| !path.file_name().is_some_and(|name| is_temporary(Path::new(name))));
    }
    has_events_of_all_steps(&found)?;
    same(&found, &phase.reference)
}

/// Checks that TensorBoard's files of a training have every step, possibly twice.
fn has_events_of_all_steps(tree: &Tree) -> Result<(), String> {
    let mut steps = BTreeSet::new();
    for (path, bytes) in tree {
        if let (true, Some(bytes)) = (path.to_str().unwrap().contains("tfevents"), bytes) {
            steps.extend(steps_of_events(bytes));
        }
    }
    if steps.is_empty() || steps.into_iter().eq(1..=3) {
        return Ok(());
    }
    Err("TensorBoard's events lack a step".to_owned())
}

/// Reads the steps of TFRecords (length, checksum, content, checksum) of events with a time (a double), a step and a
/// summary. A killed process may have left a part of the last record.
fn steps_of_events(mut bytes: &[u8]) -> Vec<u8> {
    let mut steps = Vec::new();
    while let Some((length, rest)) = bytes.split_at_checked(8) {
        let length = u64::from_le_bytes(length.try_into().unwrap()) as usize;
        let Some(event) = rest.get(4..4 + length) else { break };
        if let Some([0x10, step, 0x2a, ..]) = event.get(9..) {
            steps.push(*step);
        }
        bytes = rest.get(8 + length..).unwrap_or_default();
    }
    steps
}

/// Checks, without running anything, that files whose presence promises other files keep the promise, and that a
/// command that has ended loses none of its results.
fn kept_promises(phase: &Phase, state: &State, end: usize) -> Result<(), String> {
    let promises = phase.promises();
    let is_kept = |path: &Path| match &phase.reference[path] {
        Some(bytes) if is_compared(path) => {
            state.tree.get(path).and_then(Option::as_ref).map(|b| content(path, b))
                == Some(content(path, bytes))
        }
        _ => true,
    };
    for (promise, promised) in &promises {
        let is_lost = |path: &&std::path::PathBuf| path.starts_with(promised) && !is_kept(path);
        if state.tree.contains_key(promise)
            && let Some(lost) = phase.reference.keys().find(is_lost)
        {
            return Err(format!("{} exists, but {} is lost", promise.display(), lost.display()));
        }
    }
    match phase.reference.keys().find(|path| !is_kept(path)) {
        Some(lost) if state.point == end => {
            Err(format!("the command had ended, but {} is lost", lost.display()))
        }
        _ => Ok(()),
    }
}

/// Runs the commands that only read.
fn nothing_false_is_said(phase: &Phase, state: &State, folder: &Path) -> Result<(), String> {
    let is_result = |path: &&Path| phase.reference.contains_key(*path) && is_compared(path);
    let files = state.tree.iter().filter(|(_, content)| content.is_some());
    let files: Vec<&Path> = files.map(|(path, _)| path.as_path()).filter(is_result).collect();
    if files.is_empty() {
        return Ok(());
    }
    let mut inspect = vec!["inspect", "--json"];
    inspect.extend(files.iter().map(|path| path.to_str().unwrap()));
    let said = run_in(folder, &inspect);
    // The code of damaged files is 4.
    if !matches!(said.code, Some(0 | 4)) {
        return Err(format!("inspect ends with {:?}: {}", said.code, said.stderr));
    }
    for file in said.json()["files"].as_array().into_iter().flatten() {
        let path = Path::new(file["file"].as_str().unwrap_or_default());
        let (there, expected) = (&state.tree[path], &phase.reference[path]);
        if file["whole"] == true && there != expected {
            return Err(format!("inspect says that {} is whole, but it differs", path.display()));
        }
        if file["whole"] == false && there == expected {
            return Err(format!(
                "inspect says that {} is damaged, but it is whole",
                path.display()
            ));
        }
    }
    if state.tree.contains_key(Path::new("run/spec.json")) {
        let status = run_in(folder, &["status", "run", "--json"]);
        if status.code != Some(0) {
            return Err(format!("status ends with {:?}: {}", status.code, status.stderr));
        }
        let merged = phase
            .reference
            .keys()
            .filter(|path| path.ends_with("tuple.json") && state.tree.contains_key(*path));
        let merged = merged.count() as u64;
        if status.json()["merged"].as_u64().is_none_or(|said| said > merged) {
            return Err(format!("status says more than {merged} tuples: {}", status.stdout));
        }
    }
    if phase.name == "work" || phase.name == "merge" {
        return refused_or_whole(folder);
    }
    Ok(())
}

/// Exports the run: the export must refuse an unfinished run, and hold every scene of a finished one.
fn refused_or_whole(folder: &Path) -> Result<(), String> {
    let export =
        run_in(folder, &["export", "run", "--out", "probe", "--format", "pairs", "--json"]);
    let told: Value = serde_json::from_str(&export.stdout).unwrap_or_default();
    let result = match export.code {
        Some(0) if told["missing"] == 0 && told["files"] == 14 => Ok(()),
        Some(75) => Ok(()),
        code => Err(format!("export ends with {code:?}: {} {}", export.stdout, export.stderr)),
    };
    let _ = std::fs::remove_dir_all(folder.join("probe"));
    result
}

/// True for results; logs and TensorBoard's events contain times, and receipts the name of a process.
fn is_compared(path: &Path) -> bool {
    let text = path.to_str().unwrap();
    // A repeated command repeats its line, and digests are remembered with times.
    if path.ends_with(".glasshouse-written.jsonl") || path.ends_with(".glasshouse-digests.json") {
        return false;
    }
    let timed = ["run/logs", "run/receipts", "run/train/backtrack/events.out.tfevents"];
    !timed.iter().any(|start| text.starts_with(start))
}

/// Returns the bytes that depend on the scenes alone: the last column of `metrics.csv` is a time.
fn content(path: &Path, bytes: &[u8]) -> Vec<u8> {
    if !path.ends_with("metrics.csv") {
        return bytes.to_vec();
    }
    let text = String::from_utf8_lossy(bytes).into_owned();
    let lines = text.lines().map(|line| line.rsplit_once(',').map_or(line, |(rest, _)| rest));
    lines.collect::<Vec<_>>().join("\n").into_bytes()
}

/// Compares the files of two trees.
fn same(found: &Tree, expected: &Tree) -> Result<(), String> {
    let results = |tree: &Tree| -> Vec<_> {
        let files = tree.iter().filter(|(_, content)| content.is_some());
        files.map(|(path, _)| path.clone()).filter(|path| is_compared(path)).collect()
    };
    let (found_paths, expected_paths) = (results(found), results(expected));
    if let Some(path) = found_paths.iter().find(|path| !expected_paths.contains(path)) {
        return Err(format!("{} is left after the recovery", path.display()));
    }
    for path in expected_paths {
        let of =
            |tree: &Tree| tree.get(&path).cloned().flatten().map(|bytes| content(&path, &bytes));
        match of(found) {
            None => return Err(format!("{} is missing after the recovery", path.display())),
            Some(bytes) if Some(&bytes) != of(expected).as_ref() => {
                return Err(format!("{} differs after the recovery", path.display()));
            }
            Some(_) => {}
        }
    }
    Ok(())
}
