//! The writer thread: slow disks hold the tracers back, full ones stop the run, and neither changes a pixel.

use crate::support::outputs::{assert_same, assert_tidy, tuples};
use crate::support::program::{run, run_on_full_disk, text};
use crate::support::scenes::{SCENES, SHARDS, place, reference};
use glasshouse::farm::{WorkOptions, work};
use glasshouse::run::{Event, Run};
use render::line::Roots;
use render::trace::Isa;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

/// The writer is blocked after its first tuple, as by a slow disk, until no more shards are finished: then the channel
/// is full, and few results are in memory.
#[test]
fn a_slow_writer_holds_the_tracers_back() {
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
            assert!(last < SCENES * SHARDS, "nothing was left to do");
            // With each thread: a shard whose event was being sent, one that waits for room, one that is a scene's last;
            // and a place in the channel.
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

/// Scenes of one shard have no partials: a limit on the size of files meets the writer at the tuple.
#[test]
fn a_disk_that_is_full_at_the_tuple_ends_with_1_and_can_be_resumed() {
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

/// After a stop when a scene is open and none of its shards is begun, the store has no part of it.
#[test]
fn a_scene_that_was_only_opened_leaves_nothing() {
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
        // Traced shards are in the tuple, and no part of a shard is in the store.
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
