//! The lease keeper's thread, which renews leases while the worker makes progress, donates shards to workers that
//! request them, and requests shards when the worker has none.

use super::core::Worker;
use super::options::SharedQueue;
use super::prefetch::Appetite;
use crate::farm::queue::Answer;
use crate::run::{keys, sign};
use crossbeam::channel::bounded;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The shortest and the longest pause between two requests for work, chosen by simulation.
const REQUEST: [Duration; 2] = [Duration::from_millis(20), Duration::from_secs(10)];
/// Longest wait of one poll for requests.
const WAIT: Duration = Duration::from_millis(20);

/// Longest time in which a hanging worker requeues its unopened tasks before it ends.
const LEAVES_WITHIN: Duration = Duration::from_secs(5);

pub(super) struct LeaseKeeper<'s, 'a> {
    pub(super) worker: &'s Worker<'a>,
    pub(super) shared: &'s SharedQueue<'a>,
    pub(super) appetite: &'s Appetite,
}

impl LeaseKeeper<'_, '_> {
    /// Runs until the compute threads and the writer have ended.
    pub(super) fn run(&self) {
        let (worker, queue) = (self.worker, self.shared.queue);
        let every = self.shared.lease / 3;
        let (mut renewed, mut requested) = (Instant::now(), Instant::now());
        let mut signed = Instant::now();
        let mut pause = REQUEST[0];
        while !worker.stop.over.load(Ordering::Acquire) {
            queue.accept_requests(self.may_donate());
            if let Some(request) = queue.requested(WAIT) {
                self.appetite.hear_of(request.load_s);
                let tasks = self.donate(request.load_s);
                let load_s = worker.costs().known_load_s();
                request.answer(Answer { tasks, load_s });
            }
            if !worker.tasks().is_empty() {
                pause = REQUEST[0];
            } else if self.appetite.hungry.load(Ordering::Acquire)
                && !worker.stop.control.is_paused()
                && requested.elapsed() > pause
            {
                // A donated task arrives through the queue, where the prefetch thread waits for it.
                queue.request(worker.costs().known_load_s());
                requested = Instant::now();
                pause = (pause * 2).min(REQUEST[1]);
            }
            if renewed.elapsed() >= every {
                renewed = Instant::now();
                (self.shared.on_sign)();
                self.renew();
            }
            if signed.elapsed() >= self.shared.lease && !self.shared.is_child {
                signed = Instant::now();
                self.sign();
            }
        }
        queue.accept_requests(false);
    }

    fn may_donate(&self) -> bool {
        let costs = self.worker.costs();
        !self.worker.must_stop() && !self.worker.tasks().offers(costs, None).is_empty()
    }

    /// Publishes shards for an idle worker, and gives them up afterwards. Returns the number of published tasks.
    fn donate(&self, load_s: Option<f64>) -> u32 {
        let worker = self.worker;
        if worker.must_stop() {
            return 0;
        }
        let offers = worker.tasks().offers(worker.costs(), load_s);
        let mut count = 0;
        for offer in offers {
            let (task, shards) = (offer.task, offer.shards());
            // The queue cannot be reached: this worker keeps the rest, and earlier donations remain valid.
            if self.shared.queue.publish(&[offer.message]).is_err() {
                break;
            }
            count += 1;
            let actions = worker.tasks().donated(task, shards);
            worker.break_down_if(worker.perform(actions));
        }
        worker.tally.donated.add(u64::from(count));
        count
    }

    /// Puts a sign of life for each attempt of this worker: others believe the store, not the queue.
    fn sign(&self) {
        let (worker, hang) = (self.worker, self.worker.options.hang);
        if worker.tasks().hung(worker.now(), hang).is_some() {
            return;
        }
        // A store that is away costs this thread no time, in which leases would end.
        let hurried = worker.store.with_patience(Duration::ZERO);
        let attempts = worker.tasks().attempts();
        for (id, task, n) in attempts {
            let (scene, me) = (&worker.line(task.scene).id, &worker.options.who.worker);
            sign(&hurried, scene, &task, n, me);
            if !worker.tasks().has(id) {
                // The task ended meanwhile, and its record may have been removed before the sign was put.
                let key = keys::sign(scene, [task.shards.start, task.shards.end], n);
                let _ = hurried.delete(&[key]);
            }
        }
    }

    /// Renews all leases. If this worker hangs, requeues its unopened tasks and calls `on_hung` instead.
    fn renew(&self) {
        let (worker, queue) = (self.worker, self.shared.queue);
        let hang = worker.options.hang;
        let hung = worker.tasks().hung(worker.now(), hang).cloned();
        let Some(hung) = hung else {
            let leases = worker.tasks().leases();
            for lease in leases {
                queue.renew(lease);
            }
            return;
        };
        queue.accept_requests(false);
        let hurried = worker.store.with_patience(Duration::ZERO);
        let actions = worker.tasks().requeue_waiting();
        std::thread::scope(|scope| {
            let (sender, done) = bounded(1);
            scope.spawn(move || {
                let _ = worker.perform_in(&hurried, actions);
                let _ = sender.send(());
            });
            // The store may be what hangs. The call below ends the process, and with it that thread.
            let _ = done.recv_timeout(LEAVES_WITHIN);
            (self.shared.on_hung)(&format!(
                "scene {} made no progress for {} s: this worker hangs and leaves the scene to others; see --hang-s",
                worker.line(hung.scene).id,
                hang.as_secs_f64()
            ));
        });
    }
}
