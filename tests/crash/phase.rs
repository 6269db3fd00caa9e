//! The commands under test, the files that they start from, and the files that they promise.

use super::disk::{Disk, Tree, put_tree};
use super::journal::Journal;
use super::recording::record;
use crate::support::program::command;
use crate::support::scenes::{partials, put_partials};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use tempfile::TempDir;

/// Three scenes of four shards.
const RECIPE: &str = r#"
schema = "glasshouse.recipe/1"
name = "tiny"
seed = 7
[film]
width = 32
height = 32
spp = 4
[sources.sample]
layout = "sample"
count = 4
width = 32
height = 24
[train]
backtrack_steps = 3
separation_steps = 3
[train.settings]
width = 4
discriminator_width = 2
crop_px = 32
[[split]]
name = "train"
pairs = { sample = 2 }
[[split]]
name = "validation"
pairs = { sample = 1 }
"#;

/// A command with its recorded run.
pub(crate) struct Phase {
    pub(crate) name: &'static str,
    pub(crate) arguments: Vec<&'static str>,
    pub(crate) journal: Journal,
    /// The files after the undisturbed command.
    pub(crate) reference: Tree,
}

impl Phase {
    fn record(name: &'static str, before: &Tree, arguments: &'static str) -> Self {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        let attempt = || {
            let folder = scratch();
            put_tree(before, folder.path());
            record(folder.path(), &arguments)
        };
        let journal = std::iter::repeat_with(attempt).take(10).flatten().next();
        let journal = journal.expect("the model understands every call of the command");
        let reference = journal.after.tree();
        Self { name, arguments, journal, reference }
    }

    /// True if the command owns its folder, and removes all leftovers there. A folder given by `--out` may hold files of
    /// other programs.
    pub(crate) fn is_owner(&self) -> bool {
        !matches!(self.name, "render" | "sample")
    }

    /// Returns pairs of a file, whose presence promises others, and the folder or file that it promises.
    pub(crate) fn promises(&self) -> Vec<(PathBuf, PathBuf)> {
        let mut promises = Vec::new();
        for path in self.reference.keys() {
            let folder = path.parent().unwrap();
            match path.file_name().and_then(|name| name.to_str()) {
                Some("spec.json") if self.name == "plan" => {}
                Some("tuple.json" | "SHA256SUMS") => {}
                Some("state.json") => {
                    let picture = format!("{}.png", folder.file_name().unwrap().to_str().unwrap());
                    let stage = folder.parent().unwrap();
                    promises.push((path.clone(), stage.join("pictures").join(picture)));
                }
                _ => continue,
            }
            promises.push((path.clone(), folder.to_owned()));
        }
        promises
    }
}

/// Returns the commands of a run from its plan to its exports, recorded once.
pub(crate) fn phases() -> &'static [Phase] {
    static PHASES: OnceLock<Vec<Phase>> = OnceLock::new();
    PHASES.get_or_init(record_phases)
}

fn record_phases() -> Vec<Phase> {
    let recipe =
        Tree::from([(PathBuf::from("tiny.toml"), Some(RECIPE.as_bytes().to_vec().into()))]);
    let plan = Phase::record("plan", &recipe, "plan tiny.toml --out run --tile 16 -j 1");
    let work = Phase::record("work", &plan.reference, "work run -j 1");
    let merge = Phase::record("merge", &with_partials(&plan.reference), "merge run -j 1");
    let train = "train run --stage backtrack --steps 3 --checkpoint-every 1 --keep 2 -j 1";
    let train = Phase::record("checkpoint", &work.reference, train);
    let export = |name, format| Phase::record(name, &work.reference, format);
    let exports = [
        export("export of pairs", "export run --out out --format pairs -j 1"),
        export("export of shards", "export run --out out --format webdataset -j 1"),
        export("export of tensors", "export run --out out --format safetensors -j 1"),
    ];
    let mut scene = plan.reference.clone();
    let lines = String::from_utf8_lossy(scene[Path::new("run/manifest.jsonl")].as_ref().unwrap());
    let line = lines.lines().next().unwrap().as_bytes().to_vec();
    scene.insert("scene.json".into(), Some(line.into()));
    let render = "render scene.json --root sample=run/inputs/sample --out pictures -j 1";
    let render = Phase::record("render", &scene, render);
    let sample = "sample made --count 2 --width 32 --height 24 -j 1";
    let sample = Phase::record("sample", &Tree::new(), sample);
    [plan, work, merge, train].into_iter().chain(exports).chain([render, sample]).collect()
}

/// Adds the partials of all scenes to a planned run.
fn with_partials(planned: &Tree) -> Tree {
    let folder = scratch();
    put_tree(planned, folder.path());
    let run = folder.path().join("run");
    for scene in 0..3 {
        let (id, all) = partials(&run, scene);
        put_partials(&run, &id, &all);
    }
    Disk::read(folder.path()).tree()
}

/// Makes a temporary folder in memory, if the system has one there: recoveries wait for no disk.
pub(crate) fn scratch() -> TempDir {
    let memory = Path::new("/dev/shm");
    tempfile::tempdir_in(memory).unwrap_or_else(|_| tempfile::tempdir().unwrap())
}

/// Runs the program in `folder`.
pub(crate) fn run_in(folder: &Path, arguments: &[&str]) -> crate::support::program::Ended {
    command(arguments).current_dir(folder).output().unwrap().into()
}
