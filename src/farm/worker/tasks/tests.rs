//! The machine's rules, one test each.

use super::*;

const COSTS: Costs = Costs { shard_s: 1.0, threads: 1.0, load_s: 0.1, load_is_known: true };
const CHECKPOINT: Time = Duration::from_secs(20);
const START: Time = Duration::ZERO;

fn lease(id: u64, scene: u32, shards: Range<u32>) -> Lease {
    Lease { id, message: Message { task: Task { scene, shards }, hops: 0 }, redelivered: false }
}

/// Returns a machine with one task and its loaded scene of `count` shards.
fn opened(shards: Range<u32>, count: u32, found: &[u32]) -> (Tasks<()>, TaskId, Vec<Action>) {
    let mut tasks = Tasks::new(CHECKPOINT);
    let task = tasks.lease(&lease(1, 7, shards), START).unwrap();
    assert!(tasks.attempted(task, 1));
    assert!(tasks.load(task, START));
    let actions = tasks.loaded(task, count, found, ());
    (tasks, task, actions)
}

fn trace(tasks: &mut Tasks<()>, task: TaskId, shard: u32, at_s: u64) -> Vec<Action> {
    assert!(tasks.begin(task, shard));
    tasks.traced(task, shard, Duration::from_secs(at_s))
}

fn forget(shards: Range<u32>) -> Action {
    let task = Task { scene: 7, shards };
    Action::ForgetAttempt { task, n: 1 }
}

fn message(shards: Range<u32>) -> Message {
    Message { task: Task { scene: 7, shards }, hops: 1 }
}

const FINISH: Action = Action::Finish { lease: 1 };

#[test]
fn a_whole_scene_is_merged_from_memory_before_its_lease_is_finished() {
    let (mut tasks, task, actions) = opened(0..3, 3, &[]);
    assert_eq!(actions, []);
    assert_eq!(tasks.waiting(task), [0, 1, 2]);
    assert_eq!(trace(&mut tasks, task, 2, 1), []);
    assert_eq!(trace(&mut tasks, task, 0, 2), []);
    assert_eq!(trace(&mut tasks, task, 1, 3), [Action::Merge { task }]);
    let ended = tasks.merged(task);
    assert_eq!(ended, [Action::RemovePartials { scene: 7 }, forget(0..3), FINISH]);
    assert!(tasks.is_empty());
    assert_eq!(tasks.merged(task), []);
}

#[test]
fn shards_are_written_at_the_checkpoint() {
    let (mut tasks, task, _) = opened(0..4, 4, &[]);
    assert_eq!(trace(&mut tasks, task, 0, 1), []);
    assert_eq!(trace(&mut tasks, task, 1, 20), []);
    let write = trace(&mut tasks, task, 2, 21);
    assert_eq!(write, [Action::Store { task, shards: vec![0, 1, 2] }]);
    // Shards on their way into the store are still in memory.
    assert_eq!(tasks.stored(task, 1), []);
    assert_eq!(trace(&mut tasks, task, 3, 22), [Action::Merge { task }]);
    assert_eq!(tasks.stored(task, 0), []);
}

#[test]
fn a_task_with_a_part_of_a_scene_writes_shards_at_once_and_ends_when_they_are_stored() {
    let (mut tasks, task, _) = opened(2..4, 6, &[]);
    let write = |shard| Action::Store { task, shards: vec![shard] };
    assert_eq!(trace(&mut tasks, task, 2, 1), [write(2)]);
    assert_eq!(trace(&mut tasks, task, 3, 1), [write(3)]);
    assert_eq!(tasks.stored(task, 3), []);
    assert_eq!(tasks.stored(task, 2), [Action::CheckScene { task }]);
    let mut last = tasks.clone();
    assert_eq!(tasks.scene_checked(task, false), [forget(2..4), FINISH]);
    // The last worker of the scene fetches the rest.
    assert_eq!(last.scene_checked(task, true), [Action::Gather { task }]);
    let mut damaged = last.clone();
    assert_eq!(last.gathered(task, &[]), [Action::Merge { task }]);
    let messages = vec![message(5..6)];
    let again = [forget(2..4), Action::Replace { lease: 1, messages }];
    assert_eq!(damaged.gathered(task, &[5]), again);
}

#[test]
fn stored_shards_are_not_traced_again() {
    let (tasks, task, actions) = opened(0..3, 3, &[1]);
    assert_eq!((tasks.waiting(task), actions), (vec![0, 2], vec![]));
    let (_, task, all) = opened(0..3, 3, &[0, 1, 2]);
    assert_eq!(all, [Action::Merge { task }]);
    let (_, task, own) = opened(0..3, 6, &[0, 1, 2]);
    assert_eq!(own, [Action::CheckScene { task }]);
}

#[test]
fn a_donor_finishes_begun_shards_and_writes_finished_ones() {
    let (mut tasks, task, _) = opened(0..8, 8, &[]);
    assert_eq!(trace(&mut tasks, task, 0, 1), []);
    assert!(tasks.begin(task, 1));
    let offers = tasks.offers(COSTS, None);
    assert_eq!(offers.len(), 1);
    assert_eq!((offers[0].task, &offers[0].message), (task, &message(5..8)));
    // Threads may start offered shards until the queue confirms the offer.
    assert!(tasks.begin(task, 5));
    let write = tasks.donated(task, 5..8);
    assert_eq!(write, [Action::Store { task, shards: vec![0] }]);
    assert!(!tasks.begin(task, 6) && !tasks.begin(task, 7) && tasks.begin(task, 5));
    assert_eq!(tasks.waiting(task), [2, 3, 4]);
    // A second confirmation changes nothing.
    assert_eq!(tasks.donated(task, 5..8), []);
    for shard in [2, 3, 4, 1, 5] {
        let write = trace(&mut tasks, task, shard, 1);
        assert_eq!(write, [Action::Store { task, shards: vec![shard] }]);
    }
    for shard in 0..5 {
        assert_eq!(tasks.stored(task, shard), []);
    }
    assert_eq!(tasks.stored(task, 5), [Action::CheckScene { task }]);
}

#[test]
fn a_queued_task_is_donated_whole_unless_it_is_pinned_or_being_loaded() {
    let mut tasks: Tasks<()> = Tasks::new(CHECKPOINT);
    let ids = [1, 2, 3, 4].map(|k| tasks.lease(&lease(k, k as u32, 0..2), START).unwrap());
    assert!(tasks.pin(ids[0]));
    let offers = tasks.offers(COSTS, None);
    let offered: Vec<TaskId> = offers.iter().map(|offer| offer.task).collect();
    assert_eq!(offered, ids[2..]);
    assert!(tasks.load(ids[2], START));
    assert_eq!(tasks.donated(ids[2], 0..2), []);
    assert_eq!(tasks.donated(ids[3], 0..2), [Action::Finish { lease: 4 }]);
    assert!(tasks.has(ids[2]) && !tasks.has(ids[3]));
    assert!(!tasks.load(ids[3], START) && !tasks.pin(ids[3]) && !tasks.attempted(ids[3], 1));
    // Both workers do that task, so this one is not alone.
    assert_eq!(tasks.loaded(ids[2], 2, &[], ()), []);
}

#[test]
fn the_same_message_is_not_leased_twice() {
    let mut tasks: Tasks<()> = Tasks::new(CHECKPOINT);
    let task = tasks.lease(&lease(1, 7, 0..2), START).unwrap();
    assert_eq!(tasks.lease(&lease(1, 7, 0..2), START), None);
    // A queue that was created again counts from the start, so another message may have the same number.
    let other = tasks.lease(&lease(1, 8, 0..2), START).unwrap();
    assert_ne!(task, other);
    assert_eq!(tasks.leases(), [1, 1]);
}

#[test]
fn a_stopping_worker_starts_no_shard_and_requeues_unstored_ones() {
    let (mut tasks, task, _) = opened(0..8, 8, &[0]);
    assert!(tasks.begin(task, 1) && tasks.begin(task, 2));
    assert_eq!(tasks.traced(task, 1, START), []);
    tasks.stop();
    assert!(!tasks.begin(task, 5) && tasks.begin(task, 2));
    // Shards traced from now on are written at once.
    let store = |shards: &[u32]| [Action::Store { task, shards: shards.to_vec() }];
    assert_eq!(tasks.store_all(), store(&[1]));
    assert_eq!(tasks.traced(task, 2, START), store(&[2]));
    assert_eq!(tasks.stored(task, 2), []);
    // The writer did not store shard 1.
    let messages = vec![message(1..2), message(3..8)];
    let requeued = [forget(0..8), Action::Replace { lease: 1, messages }];
    assert_eq!(tasks.requeue_all(), requeued);
    assert!(tasks.is_empty());
}

#[test]
fn a_stored_task_with_an_unchecked_scene_is_requeued_whole() {
    let (mut tasks, task, actions) = opened(0..2, 4, &[0, 1]);
    assert_eq!(actions, [Action::CheckScene { task }]);
    let messages = vec![message(0..2)];
    let requeued = [forget(0..2), Action::Replace { lease: 1, messages }];
    assert_eq!(tasks.requeue_all(), requeued);
}

#[test]
fn attempts_of_tasks_that_end_before_tracing_are_forgotten_except_after_retry_and_set_aside() {
    let queued = || {
        let mut tasks: Tasks<()> = Tasks::new(CHECKPOINT);
        let task = tasks.lease(&lease(1, 7, 0..2), START).unwrap();
        assert!(tasks.pin(task) && tasks.attempted(task, 1));
        (tasks, task)
    };
    let again = || Action::Replace { lease: 1, messages: vec![message(0..2)] };
    let aside = |reason: &str| Action::Quarantine { scene: 7, reason: reason.to_owned() };
    let (mut tasks, task) = queued();
    assert_eq!(tasks.retry(task), [again()]);
    let (mut tasks, task) = queued();
    assert_eq!(tasks.requeue(task), [forget(0..2), again()]);
    let (mut tasks, task) = queued();
    assert_eq!(tasks.set_aside(task, "lost"), [aside("lost"), FINISH]);
    let (mut tasks, task) = queued();
    assert_eq!(tasks.nothing_to_do(task), [forget(0..2), FINISH]);
    let (mut tasks, task) = queued();
    assert!(tasks.load(task, START));
    assert_eq!(tasks.fail(task, "cut"), [aside("cut"), forget(0..2), FINISH]);
    let (mut tasks, _) = queued();
    assert_eq!(tasks.cancel(), [forget(0..2)]);
}

#[test]
fn a_hanging_worker_requeues_its_unopened_tasks() {
    let (mut tasks, _, _) = opened(0..4, 4, &[]);
    let second = tasks.lease(&lease(2, 8, 0..4), START).unwrap();
    let hang = Duration::from_mins(2);
    assert_eq!(tasks.hung(hang, hang), None);
    let late = hang + Duration::from_secs(1);
    assert_eq!(tasks.hung(late, hang).map(|task| task.scene), Some(7));
    assert!(tasks.attempted(second, 3));
    let task = Task { scene: 8, shards: 0..4 };
    let again = Message { task: task.clone(), hops: 1 };
    let left =
        [Action::Replace { lease: 2, messages: vec![again] }, Action::ForgetAttempt { task, n: 3 }];
    assert_eq!(tasks.requeue_waiting(), left);
    assert_eq!(tasks.leases(), [1]);
}

#[test]
fn a_worker_leases_more_when_the_open_tasks_end_soon() {
    let (mut tasks, task, _) = opened(0..8, 8, &[]);
    assert!(tasks.has_enough(1, COSTS));
    for shard in 0..8 {
        assert!(tasks.begin(task, shard));
    }
    assert!(!tasks.has_enough(1, COSTS));
    let next = tasks.lease(&lease(2, 8, 0..4), START).unwrap();
    assert!(tasks.has_enough(1, COSTS) && !tasks.has_enough(2, COSTS));
    // The shard times of an opened task replace the mean of all scenes.
    assert!(tasks.load(next, START));
    assert!(tasks.has_enough(2, COSTS));
    tasks.loaded(next, 4, &[], ());
    tasks.spent(next, 0.001, 1.0);
    assert!(!tasks.has_enough(2, COSTS));
}
