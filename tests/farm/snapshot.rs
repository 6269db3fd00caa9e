//! Takes snapshots of a run while its store changes.

use crate::support::program::{run, text};
use crate::support::scenes::{SCENES, SHARDS, place};
use glasshouse::run::{
    QuarantineRecord, RetryScenes, Run, RunState, SceneState, Scope, Snapshot, keys, retry,
};
use glasshouse::store::Store;
use glasshouse_line::Roots;

#[test]
fn scenes_change_their_state_with_the_objects_of_the_store() {
    let place = place();
    place.plan();
    let planned = Run::open(&place.run, &Roots::default()).unwrap();
    let store = Store::local(planned.root()).unwrap();
    let id = |scene: usize| &planned.lines[scene].id;
    let mut all = Snapshot::take(&planned, &store, Scope::STATUS).unwrap();
    let mut news = Snapshot::take(&planned, &store, Scope::DONE).unwrap();
    assert!((0..SCENES).all(|scene| all.scene(scene) == SceneState::Waiting));
    assert_eq!(all.counts().waiting, SCENES as u64);

    for shard in 0..SHARDS as u32 {
        store.create(&keys::partial(id(0), shard), b"0").unwrap();
    }
    store.create(&keys::partial(id(1), 5), b"1").unwrap();
    let attempt = keys::attempt(id(2), [0, 24], 1);
    store.create(&attempt, b"{}").unwrap();
    // The record of this tuple does not belong to the run.
    store.create(&keys::tuple(id(2), "tuple.json"), b"{}").unwrap();
    QuarantineRecord::put(&store, id(3), "no depth").unwrap();
    all.refresh(&planned, &store).unwrap();
    let states = [0, 1, 2, 3].map(|scene| all.scene(scene));
    assert_eq!(
        states,
        [SceneState::Complete, SceneState::Begun, SceneState::Begun, SceneState::Quarantined]
    );
    let status = all.status();
    let counts = &status.counts;
    assert_eq!((counts.started, counts.waiting), (2, 1));
    assert_eq!(counts.shards_done, SHARDS as u64 + 1);
    assert_eq!(counts.quarantined[0].reason, "no depth");
    assert_eq!(status.attempts.len(), 1);
    assert_eq!(status.state, RunState::Running);

    store.delete(&[attempt]).unwrap();
    run(&["work", text(&place.run), "-q"]).expect(3);
    all.refresh(&planned, &store).unwrap();
    assert_eq!(all.status().state, RunState::Finished);
    assert!(all.tuples().iter().all(|tuple| tuple.seen.is_some()));
    assert!(all.status().rate_scenes_per_s.is_none());

    // New tuples are found by their receipts.
    assert!(!news.refresh_news(&planned, &store).unwrap());
    assert_eq!(news.missing().collect::<Vec<_>>(), [0, 1, 2]);
    assert_eq!(news.reason(3), Some("no depth"));
    for scene in 0..3 {
        let provenance = br#"{"worker":"w"}"#;
        store.create(&keys::receipt(id(scene)), provenance).unwrap();
    }
    assert!(!news.refresh_news(&planned, &store).unwrap());
    assert!(news.is_finished());
    all.refresh(&planned, &store).unwrap();
    assert_eq!(all.status().workers[0].tuples, 3);

    let again = [id(0).clone()];
    let ids: Vec<_> = planned.lines.iter().map(|line| line.id.clone()).collect();
    retry(&store, &ids, RetryScenes::Anew(&again), false).unwrap();
    assert!(news.refresh_news(&planned, &store).unwrap());
    news.refresh(&planned, &store).unwrap();
    assert_eq!(news.missing().collect::<Vec<_>>(), [0]);
    retry(&store, &ids, RetryScenes::All, false).unwrap();
    assert!(news.refresh_news(&planned, &store).unwrap());
    assert_eq!(news.missing().collect::<Vec<_>>(), [0, 3]);
}
