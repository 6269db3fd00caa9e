//! A Byzantine adversary at the queue: it publishes any bytes on any subject, replays, acknowledges, gives back and
//! withholds messages, as every client may that has a worker's key.
//!
//! A hash of the seed chooses each step of a small farm. Its workers drive the real state machine
//! ([`Tasks`](crate::farm::worker::tasks::Tasks)), the shipped readers of messages and subjects decide what is a task, the
//! shipped check of attempts decides what is poison, and its coordinator makes the shipped decisions
//! ([`decide`](crate::farm::round::decide), [`StallWatch`](crate::farm::stall::StallWatch)). Workers are also killed,
//! and slow, and so are their lease keepers. Every scene is healthy. The tests check four promises:
//!
//! 1. No scene is put into quarantine, whatever the adversary does.
//! 2. After its last act, a scene without a tuple that no worker works at and no readable message waits for is published
//!    again within three leases, also if the adversary holds messages and renews their leases for ever.
//! 3. After its last act, every unreadable message that it does not hold is removed.
//! 4. The run ends: every scene gets its tuple, and the coordinator decides to finish.
//!
//! The tests can fail: they find each [`Mistake`], the first four of which earlier versions made.

mod adversary;
mod farm;
mod queue;
mod worker;

use super::seeds::run_all;
use farm::Farm;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mistake {
    /// The coordinator believes that a scene is queued if any subject names it.
    BelievesSubjects,
    /// A range beyond the scene's end is cut to the scene: an empty task is never done.
    CutsRanges,
    /// An unreadable message is put back into the queue.
    PutsBack,
    /// A second delivery counts as the loss of the first worker.
    BlamesDeliveries,
    /// The coordinator does not look for scenes whose messages are held without any work.
    IgnoresHolders,
    /// The coordinator publishes a scene under a subject that an unreadable message has.
    IgnoresTakenSubjects,
    /// Workers give no sign of life.
    GivesNoSign,
    /// A worker condemns a scene because others are silent, and does not look again.
    JudgesAtOnce,
}

const MISTAKES: [Mistake; 8] = [
    Mistake::BelievesSubjects,
    Mistake::CutsRanges,
    Mistake::PutsBack,
    Mistake::BlamesDeliveries,
    Mistake::IgnoresHolders,
    Mistake::IgnoresTakenSubjects,
    Mistake::GivesNoSign,
    Mistake::JudgesAtOnce,
];

/// Runs the schedule of a seed. With `log`, an error message starts with all steps.
fn run(seed: u64, mistake: Option<Mistake>, log: bool) -> Result<(), String> {
    let (ran, log) = run_with_log(seed, mistake, log);
    ran.map_err(|error| format!("{log}\n{error}"))
}

fn run_with_log(seed: u64, mistake: Option<Mistake>, log: bool) -> (Result<(), String>, String) {
    let mut farm = Farm::new(seed, mistake, log);
    let steps = farm.draw(160);
    let ran = (0..steps).try_for_each(|_| farm.hostile_step());
    (ran.and_then(|()| farm.finish_fairly()), farm.log())
}

#[test]
fn no_adversary_harms_a_healthy_scene() {
    run_all(0..5_000, |seed, log| run(seed, None, log));
}

/// `cargo test --release --lib a_million_adversaries -- --ignored`
#[test]
#[ignore = "takes minutes"]
fn none_of_a_million_adversaries_harms_a_healthy_scene() {
    run_all(0..1_000_000, |seed, log| run(seed, None, log));
}

#[test]
fn the_adversary_does_everything_that_it_may() {
    let mut logs = String::new();
    for seed in 0..5_000 {
        let (ran, log) = run_with_log(seed, None, true);
        ran.unwrap();
        logs.push_str(&log);
    }
    let acts = ["publishes", "replays", "acknowledges", "gives back", "withholds", "releases"];
    let ours = [
        "removes",
        "leases",
        "child",
        "killed",
        "slow",
        "sleeps",
        "looks again",
        "stands still",
        "merged",
    ];
    for text in acts.into_iter().chain(ours) {
        assert!(logs.contains(text), "{text}");
    }
}

#[test]
fn every_planted_mistake_is_found() {
    for mistake in MISTAKES {
        let found = (0..5_000).find(|&seed| run(seed, Some(mistake), false).is_err());
        let seed = found.unwrap_or_else(|| panic!("{mistake:?} was not found"));
        run(seed, None, false).unwrap_or_else(|error| panic!("{mistake:?}, seed {seed}: {error}"));
    }
}
