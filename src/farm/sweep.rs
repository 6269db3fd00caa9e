//! Removes the files that killed processes leave: half-written files under temporary names, and partials and attempts
//! of merged scenes.

use crate::run::{Run, keys};
use crate::store::Store;
use render::atomic_file::{self, is_unfinished};
use render::merge::is_written;

/// Removes the leftovers of killed processes from a run. The caller must hold the run's lock. Ignores errors.
pub(super) fn sweep(run: &Run) {
    // Depth 5 covers the input folders of DIODE: source / train / indoors / scene / scan.
    sweep_folders(run, &[("", 0), ("report", 0), ("inputs", 5)]);
    sweep_folders(run, &STORED);
    for line in &run.lines {
        if is_written(&run.path(&keys::tuple_folder(&line.id)), line) {
            let _ = std::fs::remove_dir_all(run.path(&keys::partials(&line.id)));
            let _ = std::fs::remove_dir_all(run.path(&keys::attempts(&line.id)));
        }
    }
}

/// Removes unfinished puts of killed workers from the run's folder if the store is on a local disk. Callers use it at
/// the end of a run: the removal may make a late put fail, but the store already has that object then.
pub(super) fn sweep_staged(run: &Run, store: &Store) {
    if store.is_local() {
        sweep_folders(run, &STORED);
    }
}

/// Folders of the objects that workers put into the store, with the depth of their subfolders.
const STORED: [(&str, u32); 8] = [
    (keys::TUPLES, 1),
    (keys::PARTIALS, 1),
    (keys::ATTEMPTS, 1),
    (keys::QUARANTINE, 0),
    (keys::NOISE, 0),
    (keys::LOGS, 0),
    (keys::RECEIPTS, 0),
    // A key of a scene below the name of a worker.
    (keys::CONFLICTS, 3),
];

fn sweep_folders(run: &Run, folders: &[(&str, u32)]) {
    for &(name, depth) in folders {
        let folder = run.root().join(name);
        atomic_file::sweep(&folder, depth, &is_unfinished);
    }
}
