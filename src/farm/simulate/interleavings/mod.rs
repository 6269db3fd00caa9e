//! Random interleavings of the state machine that ships: messages may be late, lost or doubled and workers may die, but no
//! work is lost.
//!
//! In a small farm a hash of the seed chooses each step. Workers drive
//! [`Tasks`](crate::farm::worker::tasks::Tasks) (`worker.rs`) against a model of the queue, a store and a network that
//! delivers packets late, twice, in any order or never (`farm.rs`). Four promises are checked:
//!
//! 1. A result is put once, or again with an equal digest; a tuple is made from every shard of its scene.
//! 2. While the queue keeps its confirmed messages, after every step each scene without a tuple has a message, and each of
//!    its shards is in the store or in a message.
//! 3. No stored result is lost.
//! 4. From any state, when faults end, every scene gets its tuple, the queue runs empty, and no live worker leaves the
//!    record of an attempt.
//!
//! The tests can fail: each [`Mistake`], planted between the machine and its driver, is found.

mod farm;
mod worker;

use farm::Farm;

/// A mistake in the protocol that these tests must find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mistake {
    /// A donor gives up shards before the queue has confirmed the message.
    LeavesBeforeConfirmed,
    /// A lease is finished before the actions that precede it.
    FinishesFirst,
    /// Requeued messages are not published.
    NeverPublishes,
    /// A lease is finished though the queue had the messages that replace it before.
    FinishesRefused,
    /// A partial counts as stored when it is on its way.
    StoredTooEarly,
    /// The last worker of a scene does not notice that it is the last one.
    NeverTheLast,
    /// The tuple is made without the partials of other workers.
    GathersNothing,
    /// Partials are removed before the tuple is in the store.
    RemovesPartialsFirst,
    /// The record of an attempt that ended in order stays.
    KeepsRecords,
}

const MISTAKES: [Mistake; 8] = [
    Mistake::LeavesBeforeConfirmed,
    Mistake::FinishesFirst,
    Mistake::NeverPublishes,
    Mistake::StoredTooEarly,
    Mistake::NeverTheLast,
    Mistake::GathersNothing,
    Mistake::RemovesPartialsFirst,
    Mistake::KeepsRecords,
];

/// Runs one interleaving, a function of its seed. With `log`, an error begins with all of its steps.
fn run(seed: u64, mistake: Option<Mistake>, log: bool) -> Result<(), String> {
    let mut farm = Farm::new(seed, mistake, log);
    let steps = farm.draw(240);
    let ran = (0..steps).try_for_each(|_| farm.step());
    let ran = ran.and_then(|()| farm.finish_fairly());
    ran.map_err(|error| format!("{}\n{error}", farm.log()))
}

/// Runs all seeds on two threads; the first failure is replayed with all of its steps.
fn run_all(seeds: std::ops::Range<u64>) {
    let middle = u64::midpoint(seeds.start, seeds.end);
    std::thread::scope(|scope| {
        for mut part in [seeds.start..middle, middle..seeds.end] {
            scope.spawn(move || {
                if let Some(seed) = part.find(|&seed| run(seed, None, false).is_err()) {
                    let error = run(seed, None, true).expect_err("the same seed, the same run");
                    panic!("seed {seed}; `run({seed}, None, true)` replays it: {error}");
                }
            });
        }
    });
}

#[test]
fn no_work_is_lost_in_any_order() {
    run_all(0..20_000);
}

/// `cargo test --release --lib a_million -- --ignored --nocapture`
#[test]
#[ignore = "minutes"]
fn no_work_is_lost_in_any_of_a_million_orders() {
    run_all(0..1_000_000);
}

#[test]
fn a_seed_replays() {
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

/// Except `Quarantine`, for the small farm has no scene that fails.
#[test]
fn interleavings_reach_every_action() {
    let mut logs = String::new();
    for seed in 0..200 {
        let mut farm = Farm::new(seed, None, true);
        (0..160).try_for_each(|_| farm.step()).unwrap();
        farm.finish_fairly().unwrap();
        logs.push_str(&farm.log());
    }
    let actions =
        ["Store {", "Merge {", "CheckScene {", "Gather {", "LeaveNote {", "RemovePartials {"];
    let more = ["ForgetAttempt {", "Replace {", "Finish {", "offers", "Sandbox", "gone: ["];
    for text in actions.into_iter().chain(more) {
        assert!(logs.contains(text), "{text}");
    }
}

#[test]
fn a_finished_lease_whose_messages_were_refused_is_found() {
    // One interleaving in 350,000 shows it; a change of the draws needs the seed of another.
    let seed = 362_564;
    run(seed, Some(Mistake::FinishesRefused), false).unwrap_err();
    run(seed, None, false).unwrap();
}

#[test]
fn every_planted_mistake_is_found() {
    for mistake in MISTAKES {
        let found = (0..5_000).find(|&seed| run(seed, Some(mistake), false).is_err());
        let seed = found.unwrap_or_else(|| panic!("{mistake:?} was not found"));
        // The machine as it ships passes the same seed.
        run(seed, None, false).unwrap_or_else(|error| panic!("{mistake:?}, seed {seed}: {error}"));
    }
}
