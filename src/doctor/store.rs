//! Checks the store: puts, reads, lists, compares and removes one small object.

use super::clock::compare;
use super::finding::{Finding, Level, seconds_text};
use crate::store::{Put, Store, StoreError};
use std::time::{Instant, SystemTime};

/// Folder of the probe's object.
const FOLDER: &str = "doctor-probe";
/// Time of a put above which a store is too slow, because workers put every result there, s.
const SLOW_S: f64 = 1.0;
/// Resolution of the times that a bucket reports, s.
const EXACT_S: f64 = 1.0;

/// Creates the object `doctor-probe/NAME` and removes it. `name` must be unique.
pub fn check_store(store: &Store, name: &str) -> Vec<Finding> {
    let key = format!("{FOLDER}/{name}");
    let mut findings = Vec::new();
    let checked = probe(store, &key, &mut findings);
    if let Err((what, error)) = checked {
        findings.push(failed(what, &error));
    }
    // The removal is necessary after a failure, too.
    let start = Instant::now();
    let removed = store.delete(std::slice::from_ref(&key));
    // After a failure, the result of the removal adds nothing.
    if findings.iter().all(|f| f.level < Level::Fail) {
        findings.push(match removed {
            Ok(()) => {
                let seconds = seconds_text(start.elapsed().as_secs_f64());
                Finding::ok("store remove", format!("the probe's object, in {seconds}"))
            }
            Err(error) => Finding::fail(
                "store remove",
                error.to_string(),
                format!("allow this program to remove objects (it removes the partials of finished tuples); remove {key} by hand"),
            ),
        });
    }
    if let Some(root) = store.local_root() {
        // `remove_dir` fails unless the folder is empty; another `doctor` may use it.
        let _ = std::fs::remove_dir(root.join(FOLDER));
    }
    findings
}

type Failed = (&'static str, StoreError);

fn probe(store: &Store, key: &str, findings: &mut Vec<Finding>) -> Result<(), Failed> {
    let (start, before) = (Instant::now(), SystemTime::now());
    let put = store.create(key, b"one").map_err(|e| ("store put", e))?;
    let (seconds, after) = (start.elapsed().as_secs_f64(), SystemTime::now());
    let text = format!("{} stores an object in {}", store.name(), seconds_text(seconds));
    findings.push(
        Finding::ok("store put", text)
            .unless(seconds < SLOW_S, Level::Warn, "putting results is slow: use a nearer store")
            .unless(
                put == Put::New,
                Level::Warn,
                "an object with the probe's name existed: check whether another doctor is running",
            )
            .with("seconds", seconds),
    );
    let start = Instant::now();
    let read = store.get(key).map_err(|e| ("store read", e))?;
    let seconds = start.elapsed().as_secs_f64();
    findings.push(
        Finding::ok("store read", format!("in {}", seconds_text(seconds)))
            .unless(
                read.as_deref() == Some(b"one"),
                Level::Fail,
                "the new object has other bytes: this store cannot hold a run",
            )
            .with("seconds", seconds),
    );
    let start = Instant::now();
    let listed = store.list_times(FOLDER).map_err(|e| ("store list", e))?;
    let seconds = start.elapsed().as_secs_f64();
    let found = listed.iter().find(|(listed, _)| listed == key);
    findings.push(
        Finding::ok("store list", format!("in {}", seconds_text(seconds)))
            .unless(
                found.is_some(),
                Level::Fail,
                "the list lacks the new object: this store cannot hold a run",
            )
            .with("seconds", seconds),
    );
    findings.push(once(store, key).map_err(|e| ("store put once", e))?);
    if let (Some((_, there)), None) = (found, store.local_root()) {
        findings.push(compare("store clock", *there, [before, after], EXACT_S));
    }
    Ok(())
}

/// Checks that the store refuses a second put of other bytes; otherwise, different results could stay undetected.
fn once(store: &Store, key: &str) -> Result<Finding, StoreError> {
    let is_refused = match store.create(key, b"two") {
        Err(StoreError::Differs { .. }) => true,
        Err(error) => return Err(error),
        Ok(_) => false,
    };
    Ok(if is_refused && store.create(key, b"one")? == Put::Same {
        Finding::ok("store put once", "the store refuses an existing name and keeps its object")
    } else {
        Finding::fail(
            "store put once",
            "a second put replaced the first (no conditional put)",
            "use a store with If-None-Match: S3, or a recent MinIO, Ceph or R2",
        )
    })
}

fn failed(check: &'static str, error: &StoreError) -> Finding {
    let to_do = if error.is_passing() {
        "check the store's address, and that the store runs; a bucket outside AWS needs AWS_ENDPOINT_URL"
    } else {
        "check bucket, keys (AWS_ACCESS_KEY_ID, …), region and permissions"
    };
    Finding::fail(check, error.to_string(), to_do)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_a_good_store_and_no_object_remains() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::local(folder.path()).unwrap();
        let found = check_store(&store, "x");
        assert_eq!(found.len(), 5, "{found:?}");
        assert!(found.iter().all(|f| f.level == Level::Ok), "{found:?}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
