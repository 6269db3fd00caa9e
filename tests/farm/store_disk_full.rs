//! Fills a disk: a small tmpfs in a separate mount namespace.

use crate::support::nats::Nats;
use crate::support::outputs::{assert_same, assert_tidy, files, tuples};
use crate::support::program::{Ended, PROGRAM, text};
use crate::support::scenes::{place, reference};
use std::process::Command;

/// Script with five arguments: an empty folder, a recipe, a folder for copies, the program, and a queue or "".
///
/// The tmpfs has room for the plan and 0.6 MB more, but the tuples and partials of four scenes need about 2 MB.
const SCRIPT: &str = r#"
set -eu
disk=$1 recipe=$2 out=$3 glasshouse=$4 queue=$5
mount -t tmpfs -o size=64m tmpfs "$disk"
"$glasshouse" plan "$recipe" --out "$disk/run" --tile 16 -q
used=$(df -k --output=used "$disk" | tail -1)
mount -o "remount,size=$((used + 600))k" "$disk"
work() {
    if [ -n "$queue" ]; then
        "$glasshouse" work "$disk/run" -q -j 2 --queue "$queue" --lease-s 2
    else
        "$glasshouse" work "$disk/run" -q -j 2
    fi
}
if [ -n "$queue" ]; then
    "$glasshouse" coordinate "$disk/run" -q --queue "$queue" --lease-s 2 &
    coordinator=$!
fi
for try in 1 2; do
    code=0
    work || code=$?
    echo "full: $code"
done
[ ! -e "$disk/run/quarantine" ] || { echo "quarantine"; exit 1; }
mkdir "$out"
cp -r "$disk/run" "$out/full"
mount -o remount,size=64m "$disk"
work
[ -z "$queue" ] || wait "$coordinator"
cp -r "$disk/run" "$out/run"
"#;

/// Runs the script; returns `None`, with a note, if the system allows no mount namespace.
fn fill_and_make_room(queue: &str) -> Option<(tempfile::TempDir, Ended)> {
    let may =
        Command::new("unshare").args(["-Urm", "sh", "-c", "mount -t tmpfs tmpfs /mnt"]).output();
    if !may.is_ok_and(|ended| ended.status.success()) {
        eprintln!("skipped: cannot create a mount namespace (unshare -Urm)");
        return None;
    }
    let place = place();
    let disk = place.folder.path().join("disk");
    std::fs::create_dir(&disk).unwrap();
    let out = place.folder.path().join("out");
    let ended: Ended = Command::new("unshare")
        .args(["-Urm", "sh", "-c", SCRIPT, "sh"])
        .args([text(&disk), text(&place.recipe), text(&out)])
        .args([PROGRAM, queue])
        .output()
        .unwrap()
        .into();
    Some((place.folder, ended))
}

fn check(folder: &std::path::Path, ended: Ended) {
    let disk = folder.join("disk/run");
    let ended = ended.expect(0).says(&[
        "cannot write",
        text(&disk),
        "No space left on device",
        "check its space",
    ]);
    assert_eq!(ended.stdout.matches("full: 1\n").count(), 2, "{ended:#?}");
    // On the full disk, the files in `tuples/` were complete, but some were missing.
    let full = tuples(&folder.join("out/full"));
    for (path, content) in &full {
        assert!(reference()[path] == *content, "{}", path.display());
    }
    assert!(full.len() < reference().len());
    assert_same(&tuples(&folder.join("out/run")), reference());
    let run = folder.join("out/run");
    assert_eq!(files(&run.join("partials")).len(), 0);
    assert_tidy(&run);
}

#[test]
fn a_run_resumes_after_a_full_disk() {
    if let Some((folder, ended)) = fill_and_make_room("") {
        check(folder.path(), ended);
    }
}

#[test]
fn a_farm_resumes_after_a_full_disk() {
    let Some(server) = Nats::start() else { return };
    if let Some((folder, ended)) = fill_and_make_room(&server.url()) {
        check(folder.path(), ended);
    }
}
