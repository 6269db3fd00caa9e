//! Disks without locks, hard links or syncs of folders: what is missing is named, or done without.

use crate::support::outputs::tuples;
use crate::support::program::{Ended, command, text};
use crate::support::scenes::{Place, place, reference};
use crate::support::tools::poor_disk;
use std::path::Path;

fn run_on(place: &Place, library: &Path, faults: &[(&str, i32)]) -> Ended {
    let out = place.folder.path().join("poor-disk");
    let _ = std::fs::remove_dir_all(&out);
    let mut call = command(&["run", text(&place.recipe), "--out", text(&out)]);
    call.env("LD_PRELOAD", library);
    for (name, error) in faults {
        call.env(name, error.to_string());
    }
    call.output().unwrap().into()
}

#[test]
fn what_a_disk_lacks_is_named() {
    let Some(library) = poor_disk() else { return };
    let place = place();
    // ENOSYS and ENOLCK: no locks. EPERM and ENOTSUP: no links.
    for (fault, errors, words) in [
        ("POOR_DISK_FLOCK", [38, 37], "locks do not work, so two programs could work on one run"),
        ("POOR_DISK_LINK", [1, 95], "hard links do not work"),
    ] {
        for error in errors {
            let ended = run_on(&place, library, &[(fault, error)]);
            ended.expect(1).says(&[words, "use another disk for runs", "--store"]);
        }
    }
    // EINVAL and ENOTSUP of a folder are tolerated, with a note and the same bits.
    for error in [22, 95] {
        let ended = run_on(&place, library, &[("POOR_DISK_SYNC", error)]).expect(0);
        ended.says(&["note: ", "poor-disk", "folders cannot be synced"]);
        assert!(tuples(&place.folder.path().join("poor-disk")) == *reference());
    }
    // EIO is no missing feature.
    let ended = run_on(&place, library, &[("POOR_DISK_SYNC", 5)]);
    ended.expect(1).says(&["Input/output error"]);
}
