//! A model of the coordinator, which polls the queue, lists the queue and the store, and publishes missing scenes.

use super::state::{Event, Sim, us};
use crate::farm::queue::Message;
use crate::run::Task;

const PAGE_KEYS: u64 = 1000;

/// Number of subjects in a page of the stream's listing, and time for a page (a few MB of JSON), s.
const PAGE_SUBJECTS: u64 = 100_000;
const PAGE_SUBJECTS_S: f64 = 0.2;

/// Time between two polls of the queue's counts, s.
pub(super) const POLL_S: f64 = 1.0;

const BATCH_S: f64 = 0.01;

impl Sim<'_> {
    pub(super) fn poll(&mut self) {
        self.after(us(POLL_S), Event::Poll);
        if self.now_us < self.away_until_us {
            return;
        }
        let is_new = !self.stream_is_there;
        self.stream_is_there = true;
        let coordinator = &self.coordinator;
        if coordinator.is_listing {
            return;
        }
        let rests = coordinator.backlog.is_empty() && !coordinator.is_publishing;
        let is_quiet = rests && self.queue.waiting() == 0 && self.queue.held() == 0;
        let since_us = self.now_us - coordinator.reconciled_us;
        if is_new || is_quiet || since_us >= us(self.case.rules.reconcile_s) {
            self.reconcile();
        } else {
            self.begin_publishing();
        }
    }

    /// Lists the queue before the store, so that a scene finished in between counts as finished. The store's listing
    /// has one key per tuple, and starts at the first scene without a tuple in the previous listing.
    pub(super) fn reconcile(&mut self) {
        let scenes = self.case.work.scenes;
        self.outcome.reconciles += 1;
        self.coordinator.is_listing = true;
        self.coordinator.backlog.clear();
        self.coordinator.is_absent = (0..scenes).map(|s| self.queue.ranges(s).is_empty()).collect();
        let from = self.coordinator.first_missing;
        let pages = self.store.tuples_from(from) as u64 / PAGE_KEYS + 1;
        self.coordinator.first_missing = self.store.first_missing(from);
        let subject_pages = self.queue.len() as u64 / PAGE_SUBJECTS + 1;
        self.outcome.coordinator_pages += pages;
        self.outcome.subject_pages += subject_pages;
        let listing_s =
            pages as f64 * self.case.fleet.page_s + subject_pages as f64 * PAGE_SUBJECTS_S;
        self.after(us(listing_s), Event::Listed);
    }

    /// Adds the scenes that are in neither listing to the backlog, or ends the run if every scene has its tuple.
    pub(super) fn listed(&mut self) {
        self.coordinator.is_listing = false;
        self.coordinator.reconciled_us = self.now_us;
        let is_absent = std::mem::take(&mut self.coordinator.is_absent);
        let scenes = (0..).zip(is_absent).filter(|&(s, absent)| absent && !self.store.has_tuple(s));
        let whole = |(scene, _)| Task { scene, shards: 0..self.case.work.shards };
        self.coordinator.backlog.extend(scenes.map(whole));
        let is_done = self.store.first_missing(0) == self.case.work.scenes;
        if is_done && self.coordinator.backlog.is_empty() {
            self.coordinator.is_finished = true;
            self.outcome.known_s = self.now_us as f64 * 1e-6;
        }
        self.begin_publishing();
    }

    fn begin_publishing(&mut self) {
        if !self.coordinator.is_publishing && !self.coordinator.backlog.is_empty() {
            self.coordinator.is_publishing = true;
            self.after(us(BATCH_S), Event::PublishMore);
        }
    }

    pub(super) fn publish_more(&mut self) {
        if self.now_us < self.away_until_us {
            self.after(self.away_until_us - self.now_us, Event::PublishMore);
            return;
        }
        let count = (self.case.fleet.publishes_per_s * BATCH_S).ceil() as usize;
        for _ in 0..count {
            let Some(task) = self.coordinator.backlog.pop_front() else {
                break;
            };
            self.outcome.published_though_done += u64::from(self.store.has_tuple(task.scene));
            self.store_message(&Message { task, hops: 0 });
            self.serve_waiting_pulls();
        }
        if self.coordinator.backlog.is_empty() {
            self.coordinator.is_publishing = false;
        } else {
            self.after(us(BATCH_S), Event::PublishMore);
        }
    }
}
