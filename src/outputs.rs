//! Protects files from `--out`: a command overwrites only files that earlier calls of the same command wrote.
//!
//! Before a command writes, it appends the names of its files to [`WRITTEN_FILE`] in their folder. Calls at the same
//! time append whole lines, and a line that a killed process left unfinished is ignored.

use crate::run::keys;
use render::atomic_file::{self, WriteError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

/// Schema of each line of [`WRITTEN_FILE`].
pub(crate) const WRITTEN_SCHEMA: &str = "glasshouse.written/1";
/// List of the files that commands wrote into a folder.
pub(crate) const WRITTEN_FILE: &str = ".glasshouse-written.jsonl";

/// A call's files, one line of [`WRITTEN_FILE`].
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Written {
    schema: String,
    command: String,
    /// Paths relative to the folder.
    pub(crate) files: Vec<String>,
}

/// The files that a command is about to write.
pub(crate) struct Outputs<'a> {
    pub(crate) command: &'static str,
    pub(crate) folder: &'a Path,
    /// Paths relative to the folder.
    pub(crate) files: Vec<PathBuf>,
    /// Files that the command reads.
    pub(crate) inputs: Vec<PathBuf>,
}

#[derive(Debug, thiserror::Error)]
pub(crate) enum OutputsError {
    #[error("{} is an input of this command and would be overwritten; give another --out", path.display())]
    Input { path: PathBuf },
    #[error(
        "{} exists, and no `glasshouse {command}` wrote it{}; give another --out, or remove the file",
        path.display(),
        if *is_tuple { " (its folder is a tuple)" } else { "" }
    )]
    Foreign { path: PathBuf, command: &'static str, is_tuple: bool },
    #[error(
        "{} is in {part}/ of the run {}, where only the run's own commands write; give another --out",
        path.display(),
        run.display()
    )]
    InRun { path: PathBuf, part: String, run: PathBuf },
    #[error("{} is a file; give a folder as --out", path.display())]
    File { path: PathBuf },
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl Outputs<'_> {
    /// Refuses to overwrite an input, a file that the command did not write, or a part of a run. Writes nothing.
    pub(crate) fn check(&self) -> Result<(), OutputsError> {
        check_place(self.folder)?;
        if self.folder.exists() && !self.folder.is_dir() {
            return Err(OutputsError::File { path: self.folder.to_owned() });
        }
        let inputs: BTreeSet<PathBuf> =
            self.inputs.iter().filter_map(|path| path.canonicalize().ok()).collect();
        let own = self.own();
        for file in &self.files {
            let path = self.folder.join(file);
            if path.symlink_metadata().is_err() {
                continue;
            }
            if path.canonicalize().is_ok_and(|path| inputs.contains(&path)) {
                return Err(OutputsError::Input { path });
            }
            if !own.contains(&*file.to_string_lossy()) {
                let is_tuple = self.folder.join("tuple.json").exists();
                return Err(OutputsError::Foreign { path, command: self.command, is_tuple });
            }
        }
        Ok(())
    }

    /// Checks the files, creates the folder, and records the files as the command's own.
    pub(crate) fn claim(&self) -> Result<(), OutputsError> {
        self.check()?;
        atomic_file::create_dir(self.folder)?;
        let own = self.own();
        let names = self.files.iter().map(|file| file.to_string_lossy().into_owned());
        let files: Vec<String> = names.filter(|name| !own.contains(name)).collect();
        if files.is_empty() {
            return Ok(());
        }
        let (schema, command) = (WRITTEN_SCHEMA.to_owned(), self.command.to_owned());
        let line = serde_json::to_string(&Written { schema, command, files });
        let line = line.expect("strings are JSON");
        Ok(atomic_file::append_line(&self.folder.join(WRITTEN_FILE), &line)?)
    }

    /// Returns the files that earlier calls of the command wrote.
    fn own(&self) -> BTreeSet<String> {
        let text = render::input_file::read(&self.folder.join(WRITTEN_FILE)).unwrap_or_default();
        let lines = text.split(|&byte| byte == b'\n');
        let written = lines.filter_map(|line| serde_json::from_slice::<Written>(line).ok());
        let own = written.filter(|line| line.command == self.command);
        own.flat_map(|line| line.files).collect()
    }
}

/// True if a folder that exists has no files, apart from those that a killed process left unfinished.
pub(crate) fn is_empty(folder: &Path) -> std::io::Result<bool> {
    for entry in std::fs::read_dir(folder)? {
        if !atomic_file::is_temporary(&entry?.path()) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Refuses to overwrite a file unless `is_own` accepts its bytes, or to write into a part of a run.
pub(crate) fn check_file(
    path: &Path,
    command: &'static str,
    is_own: &dyn Fn(&[u8]) -> bool,
) -> Result<(), OutputsError> {
    check_place(path)?;
    match render::input_file::read(path) {
        Ok(bytes) if is_own(&bytes) => Ok(()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        _ => Err(OutputsError::Foreign { path: path.to_owned(), command, is_tuple: false }),
    }
}

/// Refuses a path inside the folders of a run's objects.
pub(crate) fn check_place(path: &Path) -> Result<(), OutputsError> {
    let real = real(path);
    for run in real.ancestors().skip(1).filter(|folder| folder.join(keys::SPEC).is_file()) {
        let below = real.strip_prefix(run).ok().and_then(|below| below.components().next());
        let part = below.map(|part| part.as_os_str().to_string_lossy().into_owned());
        if let Some(part) = part.filter(|part| keys::OBJECTS.contains(&part.as_str())) {
            return Err(OutputsError::InRun { path: path.to_owned(), part, run: run.to_owned() });
        }
    }
    Ok(())
}

/// Resolves links in the part of a path that exists, and `..` in all of it.
fn real(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut real = PathBuf::new();
    for component in absolute.components() {
        if component == Component::ParentDir {
            real.pop();
        } else {
            real.push(component);
            real = real.canonicalize().unwrap_or(real);
        }
    }
    real
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn write(path: impl AsRef<Path>, text: &str) {
        atomic_file::write(path.as_ref(), text.as_bytes()).unwrap();
    }

    fn outputs<'a>(folder: &'a Path, command: &'static str, inputs: &[PathBuf]) -> Outputs<'a> {
        let files = ["input.png", "input.exr"].map(PathBuf::from).into();
        Outputs { command, folder, files, inputs: inputs.to_owned() }
    }

    #[test]
    fn only_the_command_that_wrote_a_file_overwrites_it() {
        let dir = tempfile::tempdir().unwrap();
        let folder = &dir.path().join("out");
        outputs(folder, "render", &[]).check().unwrap();
        assert!(!folder.exists());
        outputs(folder, "render", &[]).claim().unwrap();
        write(folder.join("input.png"), "rendered");
        outputs(folder, "render", &[]).claim().unwrap();
        let list = fs::read_to_string(folder.join(WRITTEN_FILE)).unwrap();
        assert_eq!(list.lines().count(), 1, "{list}");
        let error = outputs(folder, "separate", &[]).claim().unwrap_err().to_string();
        assert!(
            error.contains("input.png exists, and no `glasshouse separate` wrote it"),
            "{error}"
        );
        let input = [folder.join("input.png")];
        let error = outputs(folder, "render", &input).check().unwrap_err().to_string();
        assert!(error.contains("is an input of this command"), "{error}");
    }

    #[test]
    fn an_unfinished_line_hides_no_later_line() {
        let dir = tempfile::tempdir().unwrap();
        let list = dir.path().join(WRITTEN_FILE);
        write(&list, r#"{"schema":"glasshouse.written/1","comm"#);
        outputs(dir.path(), "render", &[]).claim().unwrap();
        write(dir.path().join("input.exr"), "rendered");
        outputs(dir.path(), "render", &[]).check().unwrap();
    }

    #[test]
    fn a_file_of_another_program_and_links_to_inputs_are_not_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path().join("photo.png"), "photograph");
        let out = dir.path().join("out");
        fs::create_dir(&out).unwrap();
        std::os::unix::fs::symlink("../photo.png", out.join("input.png")).unwrap();
        let error = outputs(&out, "render", &[]).check().unwrap_err();
        assert!(matches!(error, OutputsError::Foreign { is_tuple: false, .. }), "{error}");
        let photo = [dir.path().join("photo.png")];
        let error = outputs(&out, "render", &photo).check().unwrap_err();
        assert!(matches!(error, OutputsError::Input { .. }), "{error}");
        write(out.join("tuple.json"), "{}");
        let error = outputs(&out, "render", &[]).check().unwrap_err().to_string();
        assert!(error.contains("(its folder is a tuple)"), "{error}");
        let file = &dir.path().join("photo.png");
        assert!(matches!(outputs(file, "render", &[]).check(), Err(OutputsError::File { .. })));
    }

    #[test]
    fn the_folders_of_a_runs_objects_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let run = dir.path().canonicalize().unwrap();
        write(run.join(keys::SPEC), "{}");
        fs::create_dir(run.join("tuples")).unwrap();
        std::os::unix::fs::symlink("tuples", run.join("link")).unwrap();
        for inside in ["tuples", "tuples/new", "inputs/a/b", "link/new", "x/../partials"] {
            let error = check_place(&run.join(inside)).unwrap_err().to_string();
            assert!(error.contains("of the run"), "{inside}: {error}");
        }
        for beside in ["", "export", "train/evaluation-2"] {
            check_place(&run.join(beside)).unwrap();
        }
    }
}
