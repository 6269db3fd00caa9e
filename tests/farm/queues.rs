//! The promises of a queue, kept by both of them.

use crate::support::nats_server::Server;
use glasshouse::farm::queue::{
    Answer, Delivery, LocalQueue, NatsCoordinator, NatsOptions, NatsWorker, Queue, QueueKeeper,
    Taken, Waiting,
};
use glasshouse::run::Span;
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

const LEASE: Duration = Duration::from_millis(700);
const SCENES: usize = 10;

fn waiting(scene: u32, start: u32, end: u32, handed_on: u32) -> Waiting {
    Waiting {
        span: Span {
            scene,
            shards: start..end,
        },
        handed_on,
    }
}

#[track_caller]
fn take(queue: &dyn Queue) -> Delivery {
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(10) {
        if let Taken::Span(delivery) = queue.take(Duration::from_millis(200)) {
            return delivery;
        }
    }
    panic!("nothing comes")
}

fn nothing(queue: &dyn Queue) -> bool {
    !matches!(queue.take(Duration::from_millis(200)), Taken::Span(_))
}

fn both(test: impl Fn(&dyn QueueKeeper, &dyn Queue, &dyn Queue)) {
    let local = LocalQueue::new(Some(LEASE));
    test(&local, &local.worker(), &local.worker());
    if let Some(server) = Server::start() {
        let options = NatsOptions {
            url: server.url(),
            name: "test".to_owned(),
            ..NatsOptions::default()
        };
        let run = *b"a-run-id";
        let keeper = NatsCoordinator::connect(&options, run, LEASE).unwrap();
        assert!(keeper.ensure().unwrap());
        assert!(!keeper.ensure().unwrap());
        let worker = || NatsWorker::connect(&options, run, SCENES, LEASE).unwrap();
        test(&keeper, &worker(), &worker());
        keeper.remove().unwrap();
    }
}

#[test]
fn a_queue_is_a_set() {
    both(|keeper, a, b| {
        let spans = [waiting(0, 0, 4, 0), waiting(1, 0, 4, 0)];
        keeper.publish(&spans).unwrap();
        keeper.publish(&spans).unwrap();
        a.publish(&spans[..1]).unwrap();
        let state = keeper.look().unwrap();
        assert_eq!((state.waiting, state.held), (2, 0));
        assert_eq!(keeper.scenes().unwrap(), BTreeSet::from([0, 1]));
        let (first, second) = (take(a), take(b));
        assert_eq!([first.waiting.clone(), second.waiting.clone()], spans);
        assert!(!first.suspect && !second.suspect);
        // Held ones are in it, too.
        keeper.publish(&spans).unwrap();
        assert!(nothing(a));
        let state = keeper.look().unwrap();
        assert_eq!((state.waiting, state.held), (0, 2));
        a.finish(first.ticket);
        b.finish(second.ticket);
        assert!(keeper.look().unwrap().is_quiet());
        // Finished ones are not.
        keeper.publish(&spans[..1]).unwrap();
        assert_eq!(take(b).waiting, spans[0]);
    });
}

#[test]
fn a_lease_ends_unless_it_is_renewed() {
    both(|keeper, a, b| {
        keeper.publish(&[waiting(3, 0, 9, 0)]).unwrap();
        let held = take(a);
        for _ in 0..8 {
            std::thread::sleep(LEASE / 4);
            a.renew(held.ticket);
            assert!(matches!(b.take(Duration::from_millis(50)), Taken::Nothing));
        }
        // Its holder is lost.
        let start = Instant::now();
        let again = take(b);
        assert!(again.suspect);
        assert_eq!(again.waiting, held.waiting);
        assert!(start.elapsed() > LEASE / 2, "{:?}", start.elapsed());
        // Both say that it is done: it is gone, once.
        b.finish(again.ticket);
        a.finish(held.ticket);
        assert!(nothing(a));
        assert!(keeper.look().unwrap().is_quiet());
    });
}

#[test]
fn handing_on_is_no_loss_of_a_holder() {
    both(|keeper, a, b| {
        keeper.publish(&[waiting(2, 0, 8, 0)]).unwrap();
        let held = take(a);
        a.publish(&[waiting(2, 4, 8, 1)]).unwrap();
        let tail = take(b);
        assert_eq!(tail.waiting, waiting(2, 4, 8, 1));
        assert!(!tail.suspect);
        // The rest, as one that stops does it.
        a.publish(&[waiting(2, 0, 4, 1)]).unwrap();
        a.finish(held.ticket);
        let rest = take(b);
        assert!(!rest.suspect);
        assert_eq!(rest.waiting, waiting(2, 0, 4, 1));
        b.finish(tail.ticket);
        b.finish(rest.ticket);
        assert!(keeper.scenes().unwrap().is_empty());
    });
}

#[test]
fn who_has_something_is_asked() {
    both(|_, idle, busy| {
        assert_eq!(idle.ask(None).spans, 0, "nobody has anything");
        busy.offer(true);
        let answer = Answer {
            spans: 3,
            load_s: Some(0.5),
        };
        let answered = std::thread::scope(|scope| {
            let answering = scope.spawn(|| {
                let start = Instant::now();
                while start.elapsed() < Duration::from_secs(10) {
                    if let Some(ask) = busy.asked(Duration::from_millis(50)) {
                        assert_eq!(ask.load_s, Some(0.25));
                        ask.answer(answer);
                        return true;
                    }
                }
                false
            });
            let start = Instant::now();
            let mut found = Answer::default();
            while found.spans == 0 && start.elapsed() < Duration::from_secs(10) {
                found = idle.ask(Some(0.25));
            }
            assert_eq!(found, answer);
            answering.join().unwrap()
        });
        assert!(answered);
        busy.offer(false);
        std::thread::sleep(Duration::from_millis(300));
        assert_eq!(idle.ask(None).spans, 0, "it is not asked any more");
    });
}

#[test]
fn what_is_purged_is_forgotten() {
    both(|keeper, a, _| {
        let spans: Vec<Waiting> = (0..SCENES as u32).map(|s| waiting(s, 0, 1, 0)).collect();
        keeper.publish(&spans).unwrap();
        assert_eq!(keeper.scenes().unwrap().len(), SCENES);
        keeper.purge().unwrap();
        assert!(keeper.scenes().unwrap().is_empty());
        assert!(nothing(a));
        keeper.publish(&spans[..1]).unwrap();
        assert_eq!(take(a).waiting, spans[0]);
    });
}
