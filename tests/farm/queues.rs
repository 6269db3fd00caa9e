//! Tests the guarantees of a queue with both implementations.

use crate::support::nats::Nats;
use glasshouse::farm::queue::{
    Answer, Lease, LocalQueue, Message, NatsCoordinator, NatsWorker, Queue, QueueKeeper, Taken,
};
use glasshouse::run::Task;
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

const LEASE: Duration = Duration::from_millis(700);
const SCENES: usize = 10;

fn message(scene: u32, start: u32, end: u32, hops: u32) -> Message {
    Message { task: Task { scene, shards: start..end }, hops }
}

#[track_caller]
fn take(queue: &dyn Queue) -> Lease {
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(10) {
        if let Taken::Lease(delivery) = queue.take(Duration::from_millis(200)) {
            return delivery;
        }
    }
    panic!("the queue delivers no message")
}

fn scenes(keeper: &dyn QueueKeeper) -> BTreeSet<u32> {
    keeper.messages().unwrap().iter().map(|listed| listed.message.task.scene).collect()
}

fn nothing(queue: &dyn Queue) -> bool {
    !matches!(queue.take(Duration::from_millis(200)), Taken::Lease(_))
}

fn both(test: impl Fn(&dyn QueueKeeper, &dyn Queue, &dyn Queue)) {
    let local = LocalQueue::new(Some(LEASE));
    test(&local, &local.worker(), &local.worker());
    if let Some(server) = Nats::start() {
        let run = *b"a-run-id";
        let keeper =
            NatsCoordinator::connect(&server.options(), run, vec![16; SCENES], LEASE).unwrap();
        assert!(keeper.ensure().unwrap());
        assert!(!keeper.ensure().unwrap());
        let worker =
            || NatsWorker::connect(&server.options(), run, vec![16; SCENES], LEASE).unwrap();
        test(&keeper, &worker(), &worker());
        keeper.remove().unwrap();
    }
}

#[test]
fn a_queue_holds_each_message_once() {
    both(|keeper, a, b| {
        let spans = [message(0, 0, 4, 0), message(1, 0, 4, 0)];
        keeper.publish(&spans[..1]).unwrap();
        assert!(a.publish(&spans[1..]).unwrap());
        assert!(!a.publish(&spans[..1]).unwrap());
        keeper.publish(&spans).unwrap();
        let state = keeper.state().unwrap();
        assert_eq!((state.waiting, state.held), (2, 0));
        assert_eq!(scenes(keeper), BTreeSet::from([0, 1]));
        let (first, second) = (take(a), take(b));
        assert_eq!([first.message.clone(), second.message.clone()], spans);
        assert!(!first.redelivered && !second.redelivered);
        // The queue accepts no copies of leased messages.
        assert!(!b.publish(&spans).unwrap());
        assert!(nothing(a));
        let state = keeper.state().unwrap();
        assert_eq!((state.waiting, state.held), (0, 2));
        a.finish(first.id);
        b.finish(second.id);
        assert!(keeper.state().unwrap().is_quiet());
        // The queue accepts finished messages again.
        assert!(a.publish(&spans[..1]).unwrap());
        assert!(!a.publish(&spans).unwrap());
        assert_eq!([take(b).message, take(a).message], spans);
    });
}

#[test]
fn a_lease_expires_unless_it_is_renewed() {
    both(|keeper, a, b| {
        keeper.publish(&[message(3, 0, 9, 0)]).unwrap();
        let held = take(a);
        for _ in 0..8 {
            std::thread::sleep(LEASE / 4);
            a.renew(held.id);
            assert!(matches!(b.take(Duration::from_millis(50)), Taken::Nothing));
        }
        // The first worker no longer renews its lease.
        let start = Instant::now();
        let again = take(b);
        assert!(again.redelivered);
        assert_eq!(again.message, held.message);
        assert!(start.elapsed() > LEASE / 2, "{:?}", start.elapsed());
        // Both workers finish the message, which is removed once.
        b.finish(again.id);
        a.finish(held.id);
        assert!(nothing(a));
        assert!(keeper.state().unwrap().is_quiet());
    });
}

#[test]
fn a_donated_message_is_not_redelivered() {
    both(|keeper, a, b| {
        keeper.publish(&[message(2, 0, 8, 0)]).unwrap();
        let held = take(a);
        a.publish(&[message(2, 4, 8, 1)]).unwrap();
        let tail = take(b);
        assert_eq!(tail.message, message(2, 4, 8, 1));
        assert!(!tail.redelivered);
        // A stopping worker requeues the rest.
        a.publish(&[message(2, 0, 4, 1)]).unwrap();
        a.finish(held.id);
        let rest = take(b);
        assert!(!rest.redelivered);
        assert_eq!(rest.message, message(2, 0, 4, 1));
        b.finish(tail.id);
        b.finish(rest.id);
        assert!(scenes(keeper).is_empty());
    });
}

#[test]
fn a_busy_worker_is_requested_to_donate() {
    both(|_, idle, busy| {
        assert_eq!(idle.request(None).tasks, 0, "no worker has a task");
        busy.accept_requests(true);
        let answer = Answer { tasks: 3, load_s: Some(0.5) };
        let answered = std::thread::scope(|scope| {
            let answering = scope.spawn(|| {
                let start = Instant::now();
                while start.elapsed() < Duration::from_secs(10) {
                    if let Some(request) = busy.requested(Duration::from_millis(50)) {
                        assert_eq!(request.load_s, Some(0.25));
                        request.answer(answer);
                        return true;
                    }
                }
                false
            });
            let start = Instant::now();
            let mut found = Answer::default();
            while found.tasks == 0 && start.elapsed() < Duration::from_secs(10) {
                found = idle.request(Some(0.25));
            }
            assert_eq!(found, answer);
            answering.join().unwrap()
        });
        assert!(answered);
        busy.accept_requests(false);
        std::thread::sleep(Duration::from_millis(300));
        assert_eq!(idle.request(None).tasks, 0, "the worker accepts no requests");
    });
}

#[test]
fn purge_removes_all_messages() {
    both(|keeper, a, _| {
        let spans: Vec<Message> = (0..SCENES as u32).map(|s| message(s, 0, 1, 0)).collect();
        keeper.publish(&spans).unwrap();
        assert_eq!(scenes(keeper).len(), SCENES);
        keeper.purge().unwrap();
        assert!(scenes(keeper).is_empty());
        assert!(nothing(a));
        keeper.publish(&spans[..1]).unwrap();
        assert_eq!(take(a).message, spans[0]);
    });
}
