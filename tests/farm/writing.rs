//! Tests the writer thread: slow disks block the compute threads, full ones stop the run, and neither changes a pixel.

use crate::support::outputs::{assert_same, assert_tidy, tuples};
use crate::support::program::{run, run_on_full_disk, text};
use crate::support::scenes::{SCENES, SHARDS, place, reference};
use glasshouse::farm::{WorkOptions, work};
use glasshouse::run::{Event, Run};
use glasshouse_line::Roots;
use render::trace::Isa;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

/// Blocks the writer after its first tuple, as a slow disk does, until no more shards finish: then the channel is full,
/// and few results are in memory.
#[test]
fn a_slow_writer_blocks_the_compute_threads() {
    let place = place();
    place.plan();
    let opened = Run::open(&place.run, &Roots::default()).unwrap();
    let never = AtomicBool::new(false);
    for threads in [1, 2] {
        let mut options = WorkOptions::new(threads, Isa::detect(), &never);
        options.checkpoint = Duration::ZERO;
        let (done, held) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let hold_up = || {
            let before = done.load(Ordering::SeqCst);
            let mut last = before;
            loop {
                std::thread::sleep(Duration::from_millis(400));
                let now = done.load(Ordering::SeqCst);
                if now == last {
                    break;
                }
                last = now;
            }
            let left = SCENES * SHARDS - before;
            assert!(last < SCENES * SHARDS, "no shard was left");
            // Each thread may have a traced shard that `before` does not count yet, a shard that waits for the channel,
            // and the last shard of a scene; the channel has one place per thread.
            assert!(last - before <= 4 * threads, "{before} {last} {left}");
            held.fetch_add(1, Ordering::SeqCst);
        };
        let on_event = |event: Event| match event {
            Event::ShardDone { .. } => {
                done.fetch_add(1, Ordering::SeqCst);
            }
            Event::SceneMerged { .. } if held.load(Ordering::SeqCst) == 0 => hold_up(),
            _ => {}
        };
        let outcome = work(&opened, &options, &on_event).unwrap();
        assert_eq!(held.load(Ordering::SeqCst), 1);
        assert_eq!(outcome.merged, SCENES as u64);
        assert_eq!(outcome.traced, (SCENES * SHARDS) as u64);
        assert_same(&tuples(&place.run), reference());
        assert_tidy(&place.run);
        std::fs::remove_dir_all(place.run.join("tuples")).unwrap();
    }
}

/// Scenes of one shard have no partials, so the limit on the size of files stops the writer at a tuple.
#[test]
fn a_disk_too_full_for_a_tuple_exits_with_1_and_the_run_can_be_resumed() {
    let place = place();
    let (recipe, folder) = (text(&place.recipe), text(&place.run));
    run(&["plan", recipe, "--out", folder, "--tile", "256"]).expect(0);
    for threads in ["1", "2"] {
        run_on_full_disk(&["work", folder, "-j", threads]).expect(1).says(&[
            "cannot write",
            folder,
            "tuples",
            "permissions",
        ]);
    }
    let outcome = run(&["work", folder, "--json"]).expect(0).json();
    assert_eq!(outcome["already_merged"], 0);
    assert_eq!(outcome["merged"], SCENES);
    assert_same(&tuples(&place.run), reference());
    assert_tidy(&place.run);
}

/// If a stop comes between the opening of a scene and its first shard, the store has no part of the scene.
#[test]
fn a_scene_that_was_only_opened_leaves_no_object() {
    let place = place();
    let (recipe, folder) = (text(&place.recipe), text(&place.run));
    run(&["plan", recipe, "--out", folder, "--tile", "32"]).expect(0);
    let opened = Run::open(&place.run, &Roots::default()).unwrap();
    let stop = AtomicBool::new(false);
    let on_event = |event: Event| {
        if matches!(event, Event::SceneOpened { .. }) {
            stop.store(true, Ordering::SeqCst);
        }
    };
    let options = WorkOptions::new(1, Isa::detect(), &stop);
    let outcome = work(&opened, &options, &on_event).unwrap();
    assert_eq!((outcome.traced, outcome.merged), (0, 0));
    assert!(!place.run.join("partials").exists());
    run(&["work", folder]).expect(0);
    assert_same(&tuples(&place.run), reference());
}

/// After a stop in the middle of a shard, the threads finish it together, so that short time slots make progress, too.
#[test]
fn a_begun_shard_is_finished_after_a_stop() {
    let place = place();
    let (recipe, folder) = (text(&place.recipe), text(&place.run));
    run(&["plan", recipe, "--out", folder, "--tile", "256"]).expect(0);
    let opened = Run::open(&place.run, &Roots::default()).unwrap();
    let mut merged = 0;
    for slot in 0.. {
        assert!(slot < 50, "no progress");
        let stop = AtomicBool::new(false);
        let options = WorkOptions::new(2, Isa::detect(), &stop);
        let outcome = std::thread::scope(|scope| {
            let (opened_one, wait) = crossbeam::channel::unbounded();
            scope.spawn(|| {
                let _ = wait.into_iter().next();
                std::thread::sleep(Duration::from_millis(10));
                stop.store(true, Ordering::SeqCst);
            });
            let on_event = move |event: Event| {
                if matches!(event, Event::SceneOpened { .. }) {
                    let _ = opened_one.send(());
                }
            };
            work(&opened, &options, &on_event).unwrap()
        });
        // Every traced shard is in a tuple, and the store has no part of a shard.
        assert_eq!(outcome.merged, outcome.traced);
        assert_eq!(outcome.already_merged, merged);
        merged += outcome.merged;
        if merged == SCENES as u64 {
            break;
        }
    }
    assert!(!place.run.join("partials").exists());
    assert_same(&tuples(&place.run), reference());
    assert_tidy(&place.run);
}
