//! Random interleavings of the real state machine: messages may be late, lost or duplicated and workers may die, but no
//! work is lost.
//!
//! A hash of the seed chooses each step of a small farm. Its workers drive [`Tasks`](crate::farm::worker::tasks::Tasks)
//! (`worker.rs`) against models of the queue, the store and a network that delivers packets late, twice, in any order
//! or never (`farm.rs`). The tests check five promises:
//!
//! 1. A result is put once, or again with an equal digest; a tuple is made from every shard of its scene.
//! 2. As long as the queue keeps its confirmed messages, each scene without a tuple has a message after every step, and
//!    each of its shards is in the store or in a message.
//! 3. No stored result is lost.
//! 4. After the last fault, from any state, every scene gets its tuple, the queue becomes empty, and no live worker
//!    leaves the record of an attempt.
//! 5. After every step, the receipts of each tuple name every maker of its partials.
//!
//! The tests can fail: they find each [`Mistake`] planted between the machine and its driver.

mod farm;
mod worker;

use super::seeds::run_all;
use farm::Farm;

/// A mistake in the protocol that these tests must find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mistake {
    /// A donor gives up shards before the queue has confirmed the message.
    LeavesBeforeConfirmed,
    /// A lease is finished before the actions that must precede its end.
    FinishesFirst,
    /// Requeued messages are not published.
    NeverPublishes,
    /// A lease is finished although the queue already had the messages that replace it.
    FinishesRefused,
    /// A partial counts as stored before its put has ended.
    StoredTooEarly,
    /// A partial that another worker removes before the comparison counts as a different one.
    GoneIsOther,
    /// The last worker of a scene does not complete the scene.
    NeverTheLast,
    /// The tuple is made without its last shard.
    GathersNothing,
    /// Partials are removed before the tuple is in the store.
    RemovesPartialsFirst,
    /// The record of an attempt that ended properly is not removed.
    KeepsRecords,
    /// The receipt is put after the tuple.
    ReceiptLast,
    /// The receipt names only the worker that merges.
    NamesOnlyItself,
}

const MISTAKES: [Mistake; 11] = [
    Mistake::LeavesBeforeConfirmed,
    Mistake::FinishesFirst,
    Mistake::NeverPublishes,
    Mistake::StoredTooEarly,
    Mistake::GoneIsOther,
    Mistake::NeverTheLast,
    Mistake::GathersNothing,
    Mistake::RemovesPartialsFirst,
    Mistake::KeepsRecords,
    Mistake::ReceiptLast,
    Mistake::NamesOnlyItself,
];

/// Runs the interleaving of a seed. With `log`, an error message starts with all steps.
fn run(seed: u64, mistake: Option<Mistake>, log: bool) -> Result<(), String> {
    let mut farm = Farm::new(seed, mistake, log);
    let steps = farm.draw(240);
    let ran = (0..steps).try_for_each(|_| farm.step());
    let ran = ran.and_then(|()| farm.finish_fairly());
    ran.map_err(|error| format!("{}\n{error}", farm.log()))
}

#[test]
fn no_work_is_lost_in_any_order() {
    run_all(0..20_000, |seed, log| run(seed, None, log));
}

/// `cargo test --release --lib a_million -- --ignored --nocapture`
#[test]
#[ignore = "takes minutes"]
fn no_work_is_lost_in_any_of_a_million_orders() {
    run_all(0..1_000_000, |seed, log| run(seed, None, log));
}

#[test]
fn a_seed_determines_all_steps() {
    for seed in 0..20 {
        let log = |seed| {
            let mut farm = Farm::new(seed, None, true);
            (0..100).try_for_each(|_| farm.step()).unwrap();
            farm.log()
        };
        assert_eq!(log(seed), log(seed));
        assert_ne!(log(seed), log(seed + 1));
    }
}

/// The checked actions exclude `Quarantine`, because no scene of the small farm fails.
#[test]
fn interleavings_reach_every_action() {
    let mut logs = String::new();
    for seed in 0..200 {
        let mut farm = Farm::new(seed, None, true);
        (0..160).try_for_each(|_| farm.step()).unwrap();
        farm.finish_fairly().unwrap();
        logs.push_str(&farm.log());
    }
    let actions = ["Store {", "Merge {", "CheckScene {", "Gather {", "RemovePartials {"];
    let more = ["ForgetAttempt {", "Replace {", "Finish {", "offers", "Sandbox", "gone: ["];
    for text in actions.into_iter().chain(more) {
        assert!(logs.contains(text), "{text}");
    }
}

#[test]
fn finishing_a_lease_after_refused_messages_is_found() {
    // About one interleaving in 350,000 shows the mistake. A change of the draws requires another seed.
    let seed = 362_564;
    run(seed, Some(Mistake::FinishesRefused), false).unwrap_err();
    run(seed, None, false).unwrap();
}

#[test]
fn every_planted_mistake_is_found() {
    for mistake in MISTAKES {
        let found = (0..5_000).find(|&seed| run(seed, Some(mistake), false).is_err());
        let seed = found.unwrap_or_else(|| panic!("{mistake:?} was not found"));
        // Without the mistake, the machine passes the same seed.
        run(seed, None, false).unwrap_or_else(|error| panic!("{mistake:?}, seed {seed}: {error}"));
    }
}
