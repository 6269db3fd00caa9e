//! `merge` takes only complete scenes, and makes the same tuples as `work`.

use crate::support::outputs::{assert_same, assert_tidy, files, tuples};
use crate::support::program::{run, text};
use crate::support::scenes::{SCENES, SHARDS, partials, place, put_partials, reference};

#[test]
fn scenes_with_missing_shards_are_refused() {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    let (id, all) = partials(&place.run, 0);
    let paths = put_partials(&place.run, &id, &all);
    std::fs::remove_file(&paths[7]).unwrap();
    std::fs::write(&paths[9], b"torn").unwrap();
    let before = files(&place.run);
    let ended = run(&["merge", folder, "-n", "--json"]).expect(3);
    assert_eq!(files(&place.run), before, "-n writes nothing");
    assert_eq!(ended.json()["merged"], serde_json::json!([]));
    let ended = run(&["merge", folder, "--json"]).expect(3);
    let refused = ended.json()["refused"].clone();
    assert_eq!(refused.as_array().unwrap().len(), SCENES);
    let reason = refused[0]["reason"].as_str().unwrap();
    for word in [&id, "2 of 24 shards", "first: 7", "000009.exr"] {
        assert!(reason.contains(word), "{reason}");
    }
    assert!(!place.run.join("tuples").exists());
    run(&["work", folder]).expect(0);
    assert_same(&tuples(&place.run), reference());
}

#[test]
fn merge_makes_the_tuples_of_work() {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    for scene in 0..SCENES {
        let (id, mut all) = partials(&place.run, scene);
        all.reverse();
        put_partials(&place.run, &id, &all);
    }
    // Merging needs no photographs.
    std::fs::rename(place.run.join("inputs"), place.run.join("gone")).unwrap();
    let ended = run(&["merge", folder, "--json"]).expect(0).json();
    assert_eq!(ended["merged"].as_array().unwrap().len(), SCENES);
    assert_same(&tuples(&place.run), reference());
    assert_tidy(&place.run);
    let again = run(&["merge", folder, "--json"]).expect(0).json();
    assert_eq!(again["already_merged"], SCENES);
}

#[test]
fn foreign_partials_are_refused() {
    let place = place();
    place.plan();
    let (id, all) = partials(&place.run, 0);
    let (_, others) = partials(&place.run, 1);
    put_partials(&place.run, &id, &all);
    put_partials(&place.run, &id, &others[5..6]);
    let ended = run(&["merge", text(&place.run)]).expect(3);
    ended.says(&[&id, "shard 5", "another scene line"]);
    // `work` also refuses the foreign partial, and traces its shard.
    let outcome = run(&["work", text(&place.run), "--json"]).expect(0).json();
    assert_eq!(outcome["shards_resumed"], SHARDS - 1);
    assert_same(&tuples(&place.run), reference());
}
