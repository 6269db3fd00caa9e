//! The tree of a pane's paths, ready for tracing.

use super::Step;

/// Where the light of a branch goes.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Target {
    /// To a later meeting.
    To(usize),
    /// Out of the pane, along a way.
    /// If it `joins`, an earlier leaf has the way, too.
    Leaf { way: usize, is_front: bool, joins: bool },
    /// To the last paths of the front and of the back, in these shares for each colour.
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
    pub(super) last: [Option<usize>; 2],
}

impl Program {
    /// Gives each way a new number, which several may have in common; the last one of each side receives the light of cuts.
    pub(super) fn renumber(&mut self, ways: &[usize], last: [Option<usize>; 2]) {
        let mut is_taken = vec![false; ways.len()];
        for target in self.meets.iter_mut().flat_map(|meet| &mut meet.branches) {
            if let Target::Leaf { way, joins, .. } = target {
                *way = ways[*way];
                *joins = std::mem::replace(&mut is_taken[*way], true);
            }
        }
        self.last = last;
    }

    /// Computes the number of samples that each meeting serves, from those that each way takes.
    pub(super) fn serve(&self, taken: &[usize], served: &mut Vec<usize>) {
        let of_way = |way: &Option<usize>| way.map_or(0, |way| taken[way]);
        let rest = self.last.iter().map(of_way).max().unwrap_or(0);
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
