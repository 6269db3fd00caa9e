//! States of a scene and of a run, and numbers of scenes and shards.

use crate::run::control::ControlState;
use serde::Serialize;

/// Progress of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneState {
    /// The scene has a tuple.
    Done,
    /// The run leaves the scene out until `retry`.
    Quarantined,
    /// The scene has all partials, but no tuple.
    Complete,
    /// The scene has some partials or a record of an attempt.
    Begun,
    /// The scene has neither partials nor attempts.
    Waiting,
}

impl SceneState {
    /// Returns the state of a scene that has `shards` shards and no tuple.
    pub(crate) fn of_unfinished(
        is_quarantined: bool,
        partials: u32,
        shards: u32,
        has_attempts: bool,
    ) -> Self {
        match partials {
            _ if is_quarantined => Self::Quarantined,
            n if n >= shards => Self::Complete,
            0 if !has_attempts => Self::Waiting,
            _ => Self::Begun,
        }
    }
}

/// Activity of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RunState {
    /// Tasks are published and leased.
    Running,
    /// Workers finish their open scenes; no other scene starts before `resume`.
    Paused,
    /// No further shard starts; finished tuples stay.
    Cancelled,
    /// Every scene has a tuple or is in quarantine.
    Finished,
}

impl RunState {
    pub const ALL: [Self; 4] = [Self::Running, Self::Paused, Self::Cancelled, Self::Finished];

    pub(crate) fn new(is_finished: bool, control: ControlState) -> Self {
        match control {
            _ if is_finished => Self::Finished,
            ControlState::Running => Self::Running,
            ControlState::Paused => Self::Paused,
            ControlState::Cancelled => Self::Cancelled,
        }
    }

    /// Returns the state's name in JSON, in metrics and on the page.
    pub fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Cancelled => "cancelled",
            Self::Finished => "finished",
        }
    }
}

/// Numbers of a run's scenes and shards, by state.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Counts {
    /// Number of scenes in the manifest.
    pub scenes: u64,
    /// Number of scenes with a tuple.
    pub merged: u64,
    /// Number of scenes that have partials but no tuple, and are not in quarantine.
    pub started: u64,
    pub waiting: u64,
    /// Number of shards in the manifest.
    pub shards: u64,
    /// Number of shards of merged scenes, plus partials of scenes that are neither merged nor in quarantine.
    pub shards_done: u64,
    /// Scenes in quarantine, in the manifest's order.
    pub quarantined: Vec<Quarantined>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Quarantined {
    pub scene: String,
    /// Message of the error that put the scene into quarantine; it may contain a remedy.
    pub reason: String,
}

impl Counts {
    /// True if every scene has a tuple or is in quarantine.
    pub fn is_finished(&self) -> bool {
        self.scenes_left() == 0
    }

    /// Returns the number of scenes that are neither done nor in quarantine.
    pub fn scenes_left(&self) -> u64 {
        self.started + self.waiting
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_equal_the_json_values() {
        for state in RunState::ALL {
            assert_eq!(serde_json::to_value(state).unwrap(), state.name());
        }
    }

    #[test]
    fn quarantine_wins_over_partials_and_partials_over_attempts() {
        let of = SceneState::of_unfinished;
        assert_eq!(of(true, 4, 4, true), SceneState::Quarantined);
        assert_eq!(of(false, 4, 4, true), SceneState::Complete);
        assert_eq!(of(false, 3, 4, false), SceneState::Begun);
        assert_eq!(of(false, 0, 4, true), SceneState::Begun);
        assert_eq!(of(false, 0, 4, false), SceneState::Waiting);
    }
}
