//! Tests that commands fail if their run's folder is deleted, moved, replaced or changed while they work.

use crate::support::outputs::files;
use crate::support::program::{Ended, command, run, text, wait_until};
use crate::support::scenes::{Place, place};
use std::fs;
use std::path::Path;

/// Plans a run that takes seconds.
fn planned() -> Place {
    let place = place();
    let recipe = fs::read_to_string(&place.recipe).unwrap();
    let long = recipe.replace("sample = 3", "sample = 8");
    assert_ne!(long, recipe);
    fs::write(&place.recipe, long).unwrap();
    place.plan();
    place
}

/// Changes the run's files after the first tuple of `work`, and returns its end.
fn disturbed(place: &Place, change: impl Fn(&Path)) -> Ended {
    let mut child = command(&["work", text(&place.run), "-j", "1"]).spawn().unwrap();
    let tuples = place.run.join("tuples");
    let has_begun = || fs::read_dir(&tuples).is_ok_and(|entries| entries.count() > 1);
    assert!(wait_until(&mut child, has_begun), "the command ended too early");
    change(&place.run);
    child.wait_with_output().unwrap().into()
}

/// Asserts that a folder holds at most files that were being written when it was removed.
#[track_caller]
fn assert_no_tuple(run: &Path) {
    let made = files(run);
    assert!(!made.iter().any(|path| path.ends_with("tuple.json")), "{made:?}");
}

#[test]
fn a_folder_that_is_deleted_or_moved_is_not_made_again() {
    let deleted = planned();
    let remove = |run: &Path| {
        // The command may add a file meanwhile.
        while run.exists() {
            let _ = fs::remove_dir_all(run);
        }
    };
    let ended = disturbed(&deleted, remove);
    if ended.code == Some(4) {
        // A deletion removes one file after another: the inputs of the next scenes may vanish before the folder does.
        ended.says(&["the files of no scene can be opened", text(&deleted.run)]);
    } else {
        ended.expect(1).says(&["was deleted, moved or replaced", text(&deleted.run)]);
    }
    assert_no_tuple(&deleted.run);

    let moved = planned();
    let elsewhere = moved.folder.path().join("elsewhere");
    disturbed(&moved, |run| fs::rename(run, &elsewhere).unwrap())
        .expect(1)
        .says(&["was deleted, moved or replaced", text(&moved.run)]);
    assert_no_tuple(&moved.run);
    run(&["work", text(&elsewhere)]).expect(0);
}

#[test]
fn another_run_in_its_place_is_not_touched() {
    let place = planned();
    let elsewhere = place.folder.path().join("elsewhere");
    let ended = disturbed(&place, |run| {
        fs::rename(run, &elsewhere).unwrap();
        place.plan();
    });
    ended.expect(1).says(&["was deleted, moved or replaced"]);
    // At most the file that was being written during the change is in the other run.
    let made = fs::read_dir(place.run.join("tuples")).map_or(0, Iterator::count);
    assert!(made <= 1, "{made} tuples");
    run(&["work", text(&place.run)]).expect(0);
}

#[test]
fn files_that_vanish_are_noticed() {
    let spec = planned();
    disturbed(&spec, |run| fs::write(run.join("spec.json"), "").unwrap())
        .expect(1)
        .says(&["spec.json was changed, moved or removed"]);
    let manifest = planned();
    disturbed(&manifest, |run| fs::remove_file(run.join("manifest.jsonl")).unwrap())
        .expect(1)
        .says(&["manifest.jsonl was changed, moved or removed"]);
    let lock = planned();
    disturbed(&lock, |run| fs::remove_file(run.join("work.lock")).unwrap())
        .expect(1)
        .says(&["work.lock was changed, moved or removed"]);
    let tuple = planned();
    let gone = disturbed(&tuple, |run| {
        let first = fs::read_dir(run.join("tuples")).unwrap().map(|entry| entry.unwrap().path());
        let done = first.into_iter().find(|tuple| tuple.join("tuple.json").exists()).unwrap();
        fs::remove_dir_all(done).unwrap();
    });
    gone.expect(1).says(&["tuples/", "was changed, moved or removed"]);
    run(&["work", text(&tuple.run)]).expect(0);
}
