//! `merge` takes only complete scenes, and makes the same tuples as `work`.

use crate::support::outputs::{assert_same, assert_tidy, files, tuples};
use crate::support::program::{run, text};
use crate::support::scenes::{SCENES, SHARDS, partials, place, put_partials, reference};
use render::partial::Maker;

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

/// A receipt names the makers that the partials name, and counts those without a maker; `work` leaves the same names.
#[test]
fn receipts_name_the_makers_of_the_partials() {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    let by = |worker: &str| Some(Maker { worker: worker.to_owned(), host: "h".to_owned() });
    let ids: Vec<String> = (0..2)
        .map(|scene| {
            let (id, mut all) = partials(&place.run, scene);
            for (shard, partial) in all.iter_mut().enumerate() {
                partial.maker = by(["w-1", "w-2", "Zoë 3"][shard % 3]);
            }
            all[5].maker = None;
            // The second scene has only some partials, so `work` traces the others.
            let there = if scene == 0 { all.len() } else { 7 };
            put_partials(&place.run, &id, &all[..there]);
            id
        })
        .collect();
    let receipt = |id: &String| -> serde_json::Value {
        let path = place.run.join(format!("receipts/{id}.json"));
        serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
    };
    let merged = run(&["merge", folder, "--json"]).expect(3).json();
    assert_eq!(merged["merged"], serde_json::json!([ids[0]]));
    run(&["work", folder, "--name", "w-9"]).expect(0);
    for id in &ids {
        let found = receipt(id);
        assert_eq!(found["with"], serde_json::json!(["Zoë 3", "w-1", "w-2"]), "{found}");
        assert_eq!(found["unknown"], 1, "{found}");
    }
    assert_eq!(receipt(&ids[1])["worker"], "w-9");
    // The other scenes are the work of one process, which leaves no receipts.
    assert_eq!(files(&place.run.join("receipts")).len(), 2);
    assert_same(&tuples(&place.run), reference());
}
