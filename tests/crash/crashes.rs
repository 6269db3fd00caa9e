//! Crashes after every k-th operation of plan, work, merge, training and export.

use super::parallel::each;
use super::phase::{Phase, phases};
use super::recording::can_trace;
use super::recovery::check;
use super::states::{State, States};
use std::collections::BTreeMap;

/// Number of failures that a test shows per phase.
const SHOWN: usize = 12;

/// Tests the states of a phase; returns the descriptions of wrong or lost results, each with its first state.
fn test(phase: &Phase, states: &States) -> Vec<String> {
    let end = phase.journal.events.len();
    let failures = each(&states.different, |state| {
        check(phase, state, end).map_err(|reason| (without_random(&reason), state))
    });
    let mut kinds: BTreeMap<String, Vec<&State>> = BTreeMap::new();
    for (reason, state) in failures {
        kinds.entry(reason).or_default().push(state);
    }
    let describe = |(reason, states): (String, Vec<&State>)| {
        let first = states.iter().min_by_key(|state| (state.point, state.lost.len())).unwrap();
        let last = match first.point.checked_sub(1) {
            Some(last) => &phase.journal.events[last].text,
            None => "nothing",
        };
        let State { point, lost, .. } = first;
        let count = states.len();
        format!("{count} x {reason}\n  first: crash at {point} of {end}, after {last}: {lost:#?}")
    };
    kinds.into_iter().map(describe).collect()
}

/// Replaces the random ends of temporary names, so that equal failures have equal descriptions.
fn without_random(reason: &str) -> String {
    let mut parts = reason.split(".tmp-");
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(part.len());
        text += ".tmp-*";
        text += &part[end..];
    }
    text
}

/// Crashes the named commands (all, if there are no names) at every `every`-th operation, with at most `most` subsets of
/// lost operations. There must be at least `least_points` crash points.
fn crash(names: &[&str], every: usize, most: usize, least_points: usize) {
    if !can_trace() {
        return;
    }
    let (mut points, mut wrong) = (0, Vec::new());
    for phase in phases().iter().filter(|phase| names.is_empty() || names.contains(&phase.name)) {
        let states = States::of(&phase.journal, every, most);
        let found = test(phase, &states);
        eprintln!(
            "{}: {} operations, {} crash points, {} subsets, {} states; wrong or lost results: {}",
            phase.name,
            phase.journal.events.len(),
            states.points,
            states.subsets,
            states.different.len(),
            found.len(),
        );
        points += states.points;
        let shown = found.iter().take(SHOWN);
        wrong.extend(shown.map(|text| format!("{}: {text}", phase.name)));
    }
    assert!(points >= least_points, "only {points} crash points");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_crash_loses_nothing_and_the_same_command_ends_with_the_same_bits() {
    crash(&[], 4, 5, 200);
}

#[test]
#[ignore = "takes minutes; `just crash` runs it"]
fn any_crash_of_planning_loses_nothing() {
    crash(&["plan", "render", "sample"], 1, 64, 150);
}

#[test]
#[ignore = "takes minutes; `just crash` runs it"]
fn any_crash_of_work_loses_nothing() {
    crash(&["work"], 1, 64, 200);
}

#[test]
#[ignore = "takes minutes; `just crash` runs it"]
fn any_crash_of_merge_loses_nothing() {
    crash(&["merge"], 1, 64, 100);
}

#[test]
#[ignore = "takes minutes; `just crash` runs it"]
fn any_crash_of_training_loses_nothing() {
    crash(&["checkpoint"], 1, 64, 100);
}

#[test]
#[ignore = "takes minutes; `just crash` runs it"]
fn any_crash_of_exports_loses_nothing() {
    crash(&["export of pairs", "export of shards", "export of tensors"], 1, 64, 100);
}
