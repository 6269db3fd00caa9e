//! Recipes, manifests and runs as scene lines.

use crate::errors::error;
use crate::process::interruptible;
use glasshouse_line::{Roots, SceneLine, parse_jsonl, to_jsonl};
use plan::{LocalFiles, Request, draft, invalid_text, make_inputs};
use pyo3::prelude::*;
use render::input_file;
use render::shard::{SPEC_SCHEMA, Spec, manifest_digest};
use render::trace::TRACER_VERSION;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Lines as JSON lines, folders of the named roots, and notes for the user.
type Planned = (String, BTreeMap<String, PathBuf>, Vec<String>);

/// Plans a recipe (.toml) or a manifest (.jsonl). Procedural pictures are written to the folder `inputs`, where relative
/// paths of the lines start.
#[pyfunction]
pub(crate) fn plan_lines(
    py: Python<'_>,
    source: PathBuf,
    roots: BTreeMap<String, PathBuf>,
    inputs: PathBuf,
    skip_invalid: bool,
    threads: usize,
) -> PyResult<Planned> {
    let given = roots_of(&roots)?;
    let pool = crate::engine::pool(threads).map_err(error)?;
    let work = || -> Result<Planned, String> {
        let request = Request {
            roots: &given,
            inputs: &LocalFiles,
            run: &inputs,
            begin_writing: Some(&|| Ok(())),
            left_out: BTreeSet::new(),
            planned: None,
            only: None,
            checks_files: true,
            skip_invalid,
            threads,
        };
        let drafted = draft(&source, &request, &|_, _, _| {}).map_err(|e| e.to_string())?;
        make_inputs(&inputs, &drafted.to_make, threads, &|_, _| {}).map_err(|e| e.to_string())?;
        let mut notes = drafted.notes;
        if !drafted.invalid.is_empty() {
            notes.push(invalid_text(&drafted.invalid, drafted.files));
        }
        let folders = drafted.roots.into_iter();
        let folders = folders.map(|(name, folder)| (name, inputs.join(folder))).collect();
        Ok((to_jsonl(&drafted.lines), folders, notes))
    };
    // A plan has no point at which it can stop: a signal waits for its end.
    interruptible(py, &pool, &|| {}, work)?.map_err(error)
}

/// Returns the lines of a planned run, and the folders of its roots; `roots` override them.
#[pyfunction]
pub(crate) fn run_lines(
    run: PathBuf,
    roots: BTreeMap<String, PathBuf>,
) -> PyResult<(String, BTreeMap<String, PathBuf>)> {
    let (lines, folders) = planned_run(&run, roots)?;
    Ok((to_jsonl(&lines), folders))
}

/// Reads spec and manifest of a run's folder.
pub(crate) fn planned_run(
    run: &Path,
    roots: BTreeMap<String, PathBuf>,
) -> PyResult<(Vec<SceneLine>, BTreeMap<String, PathBuf>)> {
    let read = |name: &str| {
        let path = run.join(name);
        input_file::read_to_string(&path).map_err(|e| {
            error(format!(
                "cannot read {}: {e}; give the folder of a run that `glasshouse plan` made",
                path.display()
            ))
        })
    };
    let damaged = |name: &str, reason: &dyn std::fmt::Display| {
        error(format!("{}: {reason}", run.join(name).display()))
    };
    let spec: Spec =
        serde_json::from_str(&read("spec.json")?).map_err(|e| damaged("spec.json", &e))?;
    let manifest = read("manifest.jsonl")?;
    if spec.schema != SPEC_SCHEMA || spec.tracer_version > TRACER_VERSION {
        return Err(damaged("spec.json", &"a newer version of glasshouse planned the run"));
    }
    if spec.manifest_blake3 != manifest_digest(&manifest) {
        return Err(damaged("manifest.jsonl", &"it does not have the digest in spec.json"));
    }
    let lines = parse_jsonl(&manifest).map_err(|e| damaged("manifest.jsonl", &e))?;
    let mut folders: BTreeMap<String, PathBuf> =
        spec.roots.into_iter().map(|(name, folder)| (name, run.join(folder))).collect();
    folders.extend(roots);
    Ok((lines, folders))
}

/// Makes named roots of a dictionary.
pub(crate) fn roots_of(folders: &BTreeMap<String, PathBuf>) -> PyResult<Roots> {
    let mut roots = Roots::default();
    for (name, folder) in folders {
        roots.insert(name, folder.clone()).map_err(error)?;
    }
    Ok(roots)
}
