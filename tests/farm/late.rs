//! A worker drops its partials of a scene that another worker has finished.

use crate::processes::run_alone;
use crate::support::outputs::files;
use crate::support::scenes::place;
use glasshouse::farm::queue::{LocalQueue, Message, QueueKeeper};
use glasshouse::farm::{SharedQueue, WorkOptions, work_shared};
use glasshouse::run::{Event, Run, Stop, Task};
use glasshouse::store::Store;
use glasshouse_line::Roots;
use render::trace::Isa;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

const LEASE: Duration = Duration::from_mins(1);

/// The folder of partials cannot be written when the first of several queued puts starts: no put may leave a partial.
#[test]
fn queued_partials_are_dropped_when_the_scene_is_done() {
    let place = place();
    place.plan();
    let run = Run::open(&place.run, &Roots::default()).unwrap();
    let scene = run.lines[0].id.as_str();
    let made_by_others = run_alone(&place).join("tuples").join(scene);

    let store = Store::local(run.root()).unwrap();
    let queue = LocalQueue::new(Some(LEASE));
    let task = Task { scene: 0, shards: 0..run.layout(&run.lines[0]).len() };
    queue.publish(&[Message { task, hops: 0 }]).unwrap();
    let worker = queue.worker();
    let shared = SharedQueue {
        queue: &worker,
        lease: LEASE,
        on_hung: &|what| panic!("{what}"),
        on_sign: &|| {},
        is_child: false,
    };
    let (stop, traced) = (AtomicBool::new(false), AtomicUsize::new(0));
    let on_event = |event: Event| {
        if matches!(event, Event::ShardDone { .. }) && traced.fetch_add(1, Ordering::SeqCst) == 3 {
            // The stop writes four partials from memory. The put of the first one fails.
            let partials = place.run.join("partials");
            std::fs::create_dir_all(&partials).unwrap();
            std::os::unix::fs::symlink("/nonexistent/gone", partials.join(scene)).unwrap();
            std::fs::create_dir_all(place.run.join("tuples")).unwrap();
            std::fs::rename(&made_by_others, place.run.join("tuples").join(scene)).unwrap();
            stop.store(true, Ordering::SeqCst);
        }
    };
    let options = WorkOptions::new(1, Isa::detect(), &stop);
    let outcome = work_shared(&run, &store, &shared, &options, &on_event).unwrap();
    assert_eq!((outcome.stopped, outcome.merged), (Some(Stop::Asked), 0));
    assert!(outcome.traced >= 4, "{outcome:?}");
    assert_eq!(files(&place.run.join("partials")), Vec::<PathBuf>::new());
}
