//! What a killed process leaves behind: half-written files under their temporary names, and partials whose scene
//! is merged already.

use crate::run::{Run, keys};
use crate::store::Store;
use render::atomic_file::{self, is_temporary};
use render::merge::is_written;
use std::path::Path;

/// Removes it. For whoever holds the run's lock; what cannot be removed does no harm.
pub(super) fn sweep(run: &Run) {
    let root = run.root();
    sweep_folder(root, 0);
    sweep_folder(&root.join("quarantine"), 0);
    sweep_folder(&root.join("report"), 0);
    sweep_folder(&root.join("noise"), 0);
    sweep_folder(&root.join("logs"), 0);
    // As deep as DIODE's folders: source / train / indoors / scene / scan.
    sweep_folder(&root.join("inputs"), 5);
    sweep_folder(&root.join("tuples"), 1);
    sweep_folder(&root.join("partials"), 1);
    sweep_folder(&root.join("attempts"), 1);
    for line in &run.lines {
        if is_written(&run.path(&keys::tuple_folder(&line.id)), line) {
            let _ = std::fs::remove_dir_all(run.path(&keys::partials(&line.id)));
            let _ = std::fs::remove_dir_all(run.path(&keys::attempts(&line.id)));
        }
    }
}

/// Removes what puts of killed workers left in a store on a local disk. For when all is done: a late put of something
/// that is there already may fail by it, which nobody waits for.
pub(super) fn sweep_staged(run: &Run, store: &Store) {
    if store.is_local() {
        let root = run.root();
        sweep_folder(&root.join("tuples"), 1);
        sweep_folder(&root.join("partials"), 1);
        sweep_folder(&root.join("attempts"), 1);
        sweep_folder(&root.join("receipts"), 0);
        sweep_folder(&root.join("noise"), 0);
    }
}

fn sweep_folder(folder: &Path, depth: u32) {
    atomic_file::sweep(folder, depth, &|path| is_temporary(path) || is_staged(path));
}

/// The name of a put of the local store that was not finished: `tuple.exr#1`.
fn is_staged(path: &Path) -> bool {
    let name = path.file_name().map(|name| name.to_string_lossy());
    let number = name.as_ref().and_then(|name| name.rsplit_once('#'));
    number.is_some_and(|(_, n)| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}
