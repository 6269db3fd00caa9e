//! The states in which a crash may leave the disk.

use super::disk::{Disk, Fate, Operation, Tree};
use super::journal::Journal;
use std::collections::BTreeSet;

/// Largest number of subsets of lost operations per crash point.
const SUBSETS: usize = 64;

/// The disk after a crash.
pub(crate) struct State {
    pub(crate) tree: Tree,
    /// Number of events before the crash.
    pub(crate) point: usize,
    /// Lost and torn operations, for messages.
    pub(crate) lost: Vec<String>,
}

/// Number of crash points and the different states after them.
#[derive(Default)]
pub(crate) struct States {
    pub(crate) points: usize,
    /// Number of subsets, of which many leave the same state.
    pub(crate) subsets: usize,
    pub(crate) different: Vec<State>,
}

impl States {
    /// Enumerates the crash points `first`, `first + every`, ... and the last one, with at most `most` subsets each.
    pub(crate) fn of(journal: &Journal, every: usize, most: usize) -> Self {
        let mut states = Self::default();
        let mut seen = BTreeSet::new();
        let end = journal.events.len();
        let points = (0..end).step_by(every).chain([end]);
        for point in points {
            states.points += 1;
            for fates in subsets(journal, point, most.min(SUBSETS)) {
                states.subsets += 1;
                let tree = disk(journal, point, &fates).tree();
                if seen.insert(digest(&tree)) {
                    let lost = fates.iter().filter(|(_, fate)| *fate != Fate::Kept);
                    let lost =
                        lost.map(|&(i, fate)| format!("{fate:?}: {}", journal.events[i].text));
                    states.different.push(State { tree, point, lost: lost.collect() });
                }
            }
        }
        states
    }
}

/// Returns the disk after a crash behind the first `point` events.
fn disk(journal: &Journal, point: usize, fates: &[(usize, Fate)]) -> Disk {
    let mut disk = journal.before.clone();
    for (index, event) in journal.events[..point].iter().enumerate() {
        let Some(operation) = &event.operation else { continue };
        let fate = fates.iter().find(|(of, _)| *of == index).map_or(Fate::Kept, |(_, fate)| *fate);
        disk.apply(operation, fate);
    }
    disk
}

/// Returns the fates of the operations that are not durable at `point`: all subsets, or if there are too many, the
/// empty and the full one, each operation lost alone, each kept alone, and others drawn from a fixed sequence. Torn
/// writes are added to these.
fn subsets(journal: &Journal, point: usize, most: usize) -> Vec<Vec<(usize, Fate)>> {
    let is_pending = |&i: &usize| {
        let event = &journal.events[i];
        event.operation.is_some() && event.durable_at.is_none_or(|durable_at| durable_at > point)
    };
    let pending: Vec<usize> = (0..point).filter(is_pending).collect();
    let count = pending.len();
    let mut chosen: Vec<Vec<bool>> = Vec::new();
    if count < 63 && 1 << count <= most {
        chosen.extend(
            (0..1u64 << count).map(|mask| (0..count).map(|i| mask >> i & 1 == 1).collect()),
        );
    } else {
        chosen.extend([vec![true; count], vec![false; count]]);
        // The newest operations first, because the older ones were newest at an earlier crash point.
        for i in (0..count).rev().take((most - 2) / 3) {
            chosen.push((0..count).map(|k| k != i).collect());
            chosen.push((0..count).map(|k| k == i).collect());
        }
        let mut seed = point as u64;
        while chosen.len() < most {
            let mut draw = |_| {
                seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
                let mixed = (seed ^ seed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb) >> 63 == 1
            };
            chosen.push((0..count).map(&mut draw).collect());
        }
    }
    let fate = |kept: &bool| if *kept { Fate::Kept } else { Fate::Lost };
    let with = |kept: &Vec<bool>| pending.iter().copied().zip(kept.iter().map(fate)).collect();
    let mut subsets: Vec<Vec<(usize, Fate)>> = chosen.iter().map(with).collect();
    let is_write = |i: &&usize| matches!(&journal.events[**i].operation, Some(Operation::Write { bytes, .. }) if bytes.len() > 1);
    for &torn in pending.iter().filter(is_write).rev().take(most / 4) {
        for fate in [Fate::Torn, Fate::Zeros] {
            let fate_of = |&i: &usize| (i, if i == torn { fate } else { Fate::Kept });
            subsets.push(pending.iter().map(fate_of).collect());
        }
    }
    subsets
}

fn digest(tree: &Tree) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    for (path, content) in tree {
        hasher.update(path.as_os_str().as_encoded_bytes());
        match content {
            Some(bytes) => {
                hasher.update(b"\0").update(&(bytes.len() as u64).to_le_bytes()).update(bytes)
            }
            None => hasher.update(b"\x01"),
        };
    }
    *hasher.finalize().as_bytes()
}
