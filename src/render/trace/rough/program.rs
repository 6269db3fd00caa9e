//! The tree of a pane's paths, ready for tracing.

use super::{Joined, Rest, Step};

/// Where the light of a branch goes.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Target {
    /// To a later meeting.
    To(usize),
    /// Out of the pane, at the end of a path, along a way. If it `joins`, an earlier leaf has the way, too.
    Leaf { path: usize, way: usize, is_front: bool, joins: bool },
    /// To the last ways of the front and of the back, in these shares for each colour.
    Cut([[f32; 3]; 2]),
    /// Nowhere: no image needs the light.
    Nothing,
}

/// A meeting with a face.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Meet {
    pub(super) step: Step,
    /// Number of meetings before it.
    pub(super) depth: usize,
    /// Light that passes the face, and light that it reflects.
    pub(super) branches: [Target; 2],
}

/// Meetings of paths. Each comes before those behind it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Program {
    pub(super) meets: Vec<Meet>,
    /// The ways of the front and of the back that receive the light of cuts.
    pub(super) rests: [Option<Rest>; 2],
}

impl Program {
    /// Gives the leaves of paths their ways, which several may have in common.
    pub(super) fn number(&mut self, joined: &Joined) {
        let mut is_taken = vec![false; joined.count];
        for target in self.meets.iter_mut().flat_map(|meet| &mut meet.branches) {
            if let Target::Leaf { path, way, joins, .. } = target {
                *way = joined.ways[*path];
                *joins = std::mem::replace(&mut is_taken[*way], true);
            }
        }
        self.rests = joined.rests;
    }

    /// Gives all leaves a way.
    pub(super) fn number_all(&mut self, number: usize) {
        for target in self.meets.iter_mut().flat_map(|meet| &mut meet.branches) {
            if let Target::Leaf { way, .. } = target {
                *way = number;
            }
        }
    }

    /// Computes the number of samples that each meeting serves, from those that each way takes.
    pub(super) fn serve(&self, taken: &[usize], served: &mut Vec<usize>) {
        let rest = self.rests.iter().flatten().map(|rest| taken[rest.way]).max().unwrap_or(0);
        served.clear();
        served.resize(self.meets.len(), 0);
        for (index, meet) in self.meets.iter().enumerate().rev() {
            let of = |target: &Target| match target {
                Target::To(next) => served[*next],
                Target::Leaf { way, .. } => taken[*way],
                Target::Cut(_) => rest,
                Target::Nothing => 0,
            };
            served[index] = meet.branches.iter().map(of).max().unwrap_or(0);
        }
    }
}
