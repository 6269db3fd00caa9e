//! Checks the simulator against known lower bounds, and the farm's rules under faults.

use super::{Case, Fault, Fleet, Outcome, Rules, Work, lower_bound_s, simulate, some_workers};

/// Simulates a case, and checks that all of its work is done.
fn run(case: &Case) -> Outcome {
    let outcome = simulate(case).unwrap_or_else(|| panic!("not finished: {case:?}"));
    let all = u64::from(case.work.scenes) * u64::from(case.work.shards);
    assert_eq!(outcome.shards_traced - outcome.shards_traced_again, all);
    assert!(outcome.makespan_s >= outcome.bound_s, "{outcome:?}");
    assert!(outcome.known_s >= outcome.makespan_s - case.fleet.store_s);
    outcome
}

fn prototype(faults: Vec<Fault>) -> Case {
    Case {
        work: Work::default(),
        fleet: Fleet::default(),
        rules: Rules { lease_s: 2.0, ..Rules::default() },
        faults,
    }
}

fn prototype_faults() -> Vec<Fault> {
    vec![Fault::Kill { worker: 0, at_s: 3.1 }, Fault::Slow { worker: 1, times: 4.0 }]
}

/// The prototype computed bounds of 13.52 s and 16.81 s, with costs in whole milliseconds.
#[test]
fn the_bound_equals_that_of_the_prototype() {
    let bound = |faults| lower_bound_s(&prototype(faults)).unwrap();
    assert!((bound(vec![]) - 13.52).abs() < 0.08);
    assert!((bound(prototype_faults()) - 16.81).abs() < 0.08);
    let all = (0..8).map(|worker| Fault::Kill { worker, at_s: 1.0 }).collect();
    assert_eq!(lower_bound_s(&prototype(all)), None);
    let stopped = (0..8).map(|worker| Fault::Stop { worker, at_s: 1.0, for_s: 5.0 }).collect();
    assert!((bound(stopped) - bound(vec![]) - 5.0).abs() < 1e-9);
}

/// A single worker takes the bound, plus at most half a second until the coordinator has listed and published.
#[test]
fn one_worker_takes_the_sum_of_all_costs() {
    let mut case = prototype(vec![]);
    case.fleet.workers = 1;
    let outcome = run(&case);
    assert_eq!(outcome.loads, 50);
    assert_eq!((outcome.donations, outcome.shards_traced_again), (0, 0));
    assert!(outcome.makespan_s < outcome.bound_s + 0.5, "{outcome:?}");
}

#[test]
fn the_prototypes_case_stays_near_the_bound() {
    for (faults, most) in [(vec![], 1.10), (prototype_faults(), 1.12)] {
        let case = prototype(faults);
        let outcome = run(&case);
        assert!(outcome.makespan_s <= most * outcome.bound_s, "{outcome:?}");
        assert!(outcome.loads_per_scene < 1.4, "{outcome:?}");
    }
}

fn hundred_workers(seed: u64) -> Case {
    let mut case = prototype(vec![]);
    case.work.seed = seed;
    case.work.scenes = 1500;
    case.work.shards = 5;
    case.fleet.workers = 100;
    case
}

#[test]
fn everything_gets_done_under_all_faults() {
    for seed in 0..40 {
        let mut case = hundred_workers(seed);
        let some = |share, salt| some_workers(100, share, seed * 10 + salt).into_iter();
        case.faults = vec![Fault::Wipe { at_s: 3.0 }, Fault::Away { at_s: 5.0, for_s: 3.0 }];
        case.faults.extend(some(0.2, 1).map(|(worker, t)| Fault::Kill { worker, at_s: 20.0 * t }));
        case.faults.extend(some(0.1, 2).map(|(worker, _)| Fault::Slow { worker, times: 4.0 }));
        let stop = |(worker, t)| Fault::Stop { worker, at_s: 20.0 * t, for_s: 5.0 };
        case.faults.extend(some(0.1, 3).map(stop));
        let outcome = run(&case);
        assert!(outcome.leases_ended > 0, "{outcome:?}");
        assert_eq!(outcome, run(&case));
    }
}

/// A stopped worker resumes tasks that others have leased meanwhile, so some of their shards are traced twice.
#[test]
fn an_expired_lease_costs_only_time() {
    let mut case = hundred_workers(1);
    assert_eq!(run(&case).leases_ended, 0);
    case.faults = (0..30).map(|worker| Fault::Stop { worker, at_s: 2.0, for_s: 6.0 }).collect();
    let outcome = run(&case);
    assert!(outcome.leases_ended >= 20, "{outcome:?}");
    assert!(outcome.shards_traced_again > 0, "{outcome:?}");
}

/// The coordinator lists the queue before the store.
#[test]
fn scenes_finished_between_the_two_listings_are_not_published_again() {
    let mut case = hundred_workers(2);
    case.rules.reconcile_s = 2.0;
    case.fleet.page_s = 1.0;
    assert_eq!(run(&case).published_though_done, 0);
}
