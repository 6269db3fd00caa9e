//! Tests of the records of attempts, and of the losses that they show.

use super::*;

const TASK: Task = Task { scene: 0, shards: 0..64 };

fn scene() -> SceneId {
    SceneId::new("train-00000").unwrap()
}

fn record(n: u32, found: u32, kind: Option<EndKind>) -> AttemptRecord {
    let who = WorkerName { worker: format!("w{n}"), host: "h".to_owned() };
    let mut record = AttemptRecord::new(&scene(), &TASK, &who, found);
    record.n = n;
    record.ended = kind.map(|kind| Ending {
        kind,
        reason: "signal 6".to_owned(),
        log_tail: "out of memory".to_owned(),
    });
    record
}

const CRASHED: Option<EndKind> = Some(EndKind::Crashed);

const LOST: Option<EndKind> = Some(EndKind::Lost);
const TAIL: Task = Task { scene: 0, shards: 32..64 };

#[test]
fn only_lost_attempts_count() {
    assert_eq!(poison_check(&[], &TASK, 0), PoisonCheck::Clean);
    // The attempt still runs, or its worker was lost just now: a child process traces the task. However many such
    // records there are, they are no reason for quarantine.
    let open: Vec<AttemptRecord> = (1..20).map(|n| record(n, 0, None)).collect();
    assert_eq!(poison_check(&open[..1], &TASK, 0), PoisonCheck::Suspect);
    assert_eq!(poison_check(&open, &TASK, 0), PoisonCheck::Suspect);
    assert_eq!(poison_check(&open, &TAIL, 0), PoisonCheck::Clean);
    assert_eq!(poison_check(&[record(1, 0, LOST)], &TASK, 0), PoisonCheck::Suspect);
    // A part that was donated before is not suspect, but may contain the shard that killed a child process.
    assert_eq!(poison_check(&[record(1, 0, LOST)], &TAIL, 0), PoisonCheck::Clean);
    assert_eq!(poison_check(&[record(1, 0, CRASHED)], &TAIL, 0), PoisonCheck::Suspect);
    let unreadable = [record(1, 0, Some(EndKind::Unreadable))];
    assert_eq!(poison_check(&unreadable, &TASK, 0), PoisonCheck::Clean);
}

#[test]
fn a_task_without_a_sign_of_life_was_lost() {
    let dir = tempfile::tempdir().unwrap();
    let store = Store::local(dir.path()).unwrap();
    let mut running = record(1, 0, None);
    running.begin(&store, &[]).unwrap();
    let silence = Duration::from_secs(4);
    let marked = |task, after_s| {
        let there = attempts_with_times(&store, &scene()).unwrap();
        let now = there[0].last() + Duration::from_secs(after_s);
        mark_lost(&store, there, task, now, silence).unwrap()
    };
    assert_eq!(marked(&TAIL, 9), [running.clone()]);
    assert_eq!(marked(&TASK, 3), [running.clone()]);
    // A sign of life is later than the record.
    let last = || attempts_with_times(&store, &scene()).unwrap()[0].last();
    let put = last();
    std::thread::sleep(Duration::from_millis(20));
    sign(&store, &scene(), &TASK, 1, "w1");
    assert!(last() > put);
    let lost = marked(&TASK, 4);
    assert_eq!(lost[0].ended.as_ref().unwrap().kind, EndKind::Lost);
    assert_eq!(attempts(&store, &scene()).unwrap(), lost);
    // Nothing but a new sign of life takes the mark back.
    assert_eq!(marked(&TASK, 0), lost);
    std::thread::sleep(Duration::from_millis(20));
    sign(&store, &scene(), &TASK, 1, "w1");
    assert_eq!(marked(&TASK, 3), [running.clone()]);
    assert_eq!(marked(&TASK, 4), lost);
    assert_eq!(marked(&TASK, 0), lost);
    // The worker was only slow, so it removes its record.
    running.forget(&store);
    assert!(store.list("attempts").unwrap().is_empty());
}

/// The coordinator sees a scene at work by any change of these.
#[test]
fn records_signs_and_partials_are_evidence() {
    let dir = tempfile::tempdir().unwrap();
    let store = Store::local(dir.path()).unwrap();
    let mut seen = BTreeSet::from([evidence(&store, &scene()).unwrap()]);
    let mut is_new = || seen.insert(evidence(&store, &scene()).unwrap());
    assert!(!is_new());
    record(1, 0, None).begin(&store, &[]).unwrap();
    assert!(is_new() && !is_new());
    sign(&store, &scene(), &TASK, 1, "w1");
    assert!(is_new() && !is_new());
    std::thread::sleep(Duration::from_millis(20));
    sign(&store, &scene(), &TASK, 1, "w1");
    assert!(is_new() && !is_new());
    store.create(&keys::partial(&scene(), 3), b"x").unwrap();
    assert!(is_new() && !is_new());
    store.create("attempts/another/0-64.1.json", b"x").unwrap();
    assert!(!is_new());
}

#[test]
fn four_losses_without_new_partials_are_poison() {
    let mut lost = vec![record(1, 0, LOST)];
    for n in 2..4 {
        lost.push(record(n, 0, CRASHED));
        assert_eq!(poison_check(&lost, &TASK, 0), PoisonCheck::Suspect);
    }
    lost.push(record(4, 0, CRASHED));
    let PoisonCheck::Poison(reason) = poison_check(&lost, &TASK, 0) else {
        panic!("four losses are not poison");
    };
    let words = "the last one: signal 6; its last lines: out of memory";
    assert!(reason.contains("4 processes") && reason.contains(words), "{reason}");
}

/// Processes that are killed from outside and resume each other's work do not make a scene poison.
#[test]
fn attempts_that_add_partials_count_once() {
    let steps: Vec<AttemptRecord> = (1..10).map(|n| record(n, n * 4, LOST)).collect();
    assert_eq!(poison_check(&steps, &TASK, 40), PoisonCheck::Suspect);
    // Poison behind forty good shards: each attempt that reached it counts, and so does the first.
    let mut stuck = vec![record(1, 0, LOST)];
    for n in 2..4 {
        stuck.push(record(n, 40, CRASHED));
        assert_eq!(poison_check(&stuck, &TASK, 40), PoisonCheck::Suspect);
    }
    stuck.push(record(4, 40, CRASHED));
    assert!(matches!(poison_check(&stuck, &TASK, 40), PoisonCheck::Poison(_)));
}

/// Messages may give many tasks to one slow process.
#[test]
fn a_silent_process_counts_once() {
    let mut of_one: Vec<AttemptRecord> = (1..9).map(|n| record(n, 0, LOST)).collect();
    assert!(matches!(poison_check(&of_one, &TASK, 0), PoisonCheck::Poison(_)));
    for record in &mut of_one {
        "w1".clone_into(&mut record.worker);
    }
    assert_eq!(poison_check(&of_one, &TASK, 0), PoisonCheck::Suspect);
    // Processes that a launch file starts again under the same name.
    for (k, record) in of_one.iter_mut().enumerate() {
        record.started_us += k as u64;
    }
    assert!(matches!(poison_check(&of_one, &TASK, 0), PoisonCheck::Poison(_)));
}

#[test]
fn two_machines_or_four_attempts_find_a_file_unreadable() {
    let of = |n: u32, host: &str| {
        let mut record = record(n, 0, Some(EndKind::Unreadable));
        record.host = host.to_owned();
        record
    };
    assert!(!is_unreadable(&[of(1, "a"), of(2, "a"), of(3, "a")]));
    assert!(is_unreadable(&[of(1, "a"), of(2, "b")]));
    assert!(is_unreadable(&[of(1, "a"), of(2, "a"), of(3, "a"), of(4, "a")]));
    assert!(!is_unreadable(&[of(1, "a"), record(2, 0, None)]));
}

#[test]
fn records_are_numbered_and_damaged_ones_count() {
    let dir = tempfile::tempdir().unwrap();
    let store = Store::local(dir.path()).unwrap();
    assert!(attempts(&store, &scene()).unwrap().is_empty());
    let mut first = record(9, 3, None);
    let mut second = record(9, 3, None);
    second.worker = "another".to_owned();
    first.begin(&store, &[]).unwrap();
    // The second worker listed the same empty folder.
    second.begin(&store, &[]).unwrap();
    assert_eq!(second.key(), "attempts/train-00000/0-64.2.json");
    let ending = record(1, 0, CRASHED).ended.unwrap();
    let ended = second.end(&store, ending).unwrap();
    assert_eq!(attempts(&store, &scene()).unwrap(), [first.clone(), ended]);
    store.replace(&first.key(), b"{").unwrap();
    let there = attempts(&store, &scene()).unwrap();
    assert_eq!(there.len(), 2);
    assert!(there[0].was_lost(&TASK));
    store.replace("attempts/train-00000/notes.txt", b"?").unwrap();
    assert_eq!(attempts(&store, &scene()).unwrap().len(), 2);
}
