//! Runs `doctor` on good and bad folders, and on reachable and unreachable stores and queues.

use crate::support::nats::Nats;
use crate::support::outputs::{files, read_json};
use crate::support::program::{Ended, command, run, text};
use crate::support::s3_server::S3Server;
use crate::support::workplace::{run_in, workplace};
use serde_json::Value;
use std::path::Path;

/// Returns the finding of a check.
fn finding<'a>(doctor: &'a Value, check: &str) -> &'a Value {
    let findings = doctor["findings"].as_array().unwrap();
    let found = findings.iter().find(|f| f["check"] == check);
    found.unwrap_or_else(|| panic!("no {check} in {doctor:#}"))
}

fn level<'a>(doctor: &'a Value, check: &str) -> &'a str {
    finding(doctor, check)["level"].as_str().unwrap()
}

fn entries(folder: &Path) -> usize {
    std::fs::read_dir(folder).unwrap().count()
}

#[test]
fn a_good_folder_passes_and_no_file_remains() {
    let place = workplace();
    let smoke = place.path().join("runs/smoke");
    let before = files(&smoke);
    let doctor = run(&["doctor", text(&smoke), "-j", "1", "--json"]).expect(0).json();
    assert_eq!(doctor["schema"], "glasshouse.doctor/1");
    assert_eq!(doctor["fail"], 0);
    let machine = ["processor", "cores", "memory", "open files", "clock", "right bits", "run"];
    let disk = ["disk space", "disk speed", "durable files", "small files", "disk promises"];
    for check in machine.into_iter().chain(disk) {
        let found = finding(&doctor, check);
        assert_ne!(found["level"], "fail", "{found:#}");
        assert_eq!(found["level"] == "ok", found["to_do"].is_null(), "{found:#}");
    }
    assert!(finding(&doctor, "disk speed")["measured"]["mb_per_s"].as_f64().unwrap() > 0.0);
    assert_eq!(files(&smoke), before);
    assert_eq!(level(&doctor, "right bits"), "ok");
    // The text fits into 80 columns.
    let page = run_in(place.path(), &["doctor", "runs/smoke", "-j", "1"]).expect(0).stdout;
    assert!(page.lines().all(|line| line.chars().count() <= 80), "{page}");
    // For a run that does not exist yet, `doctor` checks the disk.
    let to_be = run_in(place.path(), &["doctor", "runs/none/yet", "--json", "-q"]).expect(0);
    assert!(to_be.stderr.is_empty(), "{to_be:?}");
    assert!(!place.path().join("runs/none").exists());
}

#[test]
fn a_dry_run_writes_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let doctor = run(&["doctor", text(folder.path()), "-n", "--store", "s3://nowhere/x", "--json"])
        .expect(0)
        .json();
    let findings = doctor["findings"].as_array().unwrap().iter();
    let checks: Vec<&str> = findings.map(|f| f["check"].as_str().unwrap()).collect();
    assert!(!checks.contains(&"disk speed") && !checks.contains(&"store put"), "{checks:?}");
    assert_eq!(entries(folder.path()), 0);
}

#[test]
fn a_read_only_folder_fails() {
    // No user can write to /proc.
    let doctor = run(&["doctor", "/proc", "--json"]).expect(1).json();
    let disk = finding(&doctor, "disk");
    assert_eq!(disk["level"], "fail");
    assert!(disk["to_do"].as_str().unwrap().contains("folder"), "{disk:#}");
    let page = run(&["doctor", "/proc"]).expect(1).stdout;
    assert!(page.starts_with("some checks failed") && page.contains("fail  disk"), "{page}");
}

#[test]
fn a_run_with_another_golden_digest_or_a_damaged_spec_fails() {
    let place = workplace();
    let spec = place.path().join("runs/smoke/spec.json");
    let mut other = read_json(&spec);
    other["golden"]["blake3"] = "another".into();
    std::fs::write(&spec, other.to_string()).unwrap();
    let doctor = run_in(place.path(), &["doctor", "runs/smoke", "--json"]).expect(1).json();
    assert_eq!(level(&doctor, "right bits"), "fail");
    std::fs::write(&spec, "{").unwrap();
    let doctor = run_in(place.path(), &["doctor", "runs/smoke", "--json"]).expect(1).json();
    assert!(finding(&doctor, "run")["to_do"].as_str().unwrap().contains("inspect"), "{doctor:#}");
}

const STORE: [&str; 5] =
    ["store put", "store read", "store list", "store put once", "store remove"];

#[test]
fn a_folder_works_as_a_store() {
    let folder = tempfile::tempdir().unwrap();
    let store = folder.path().join("store");
    let address = format!("file://{}", store.display());
    let arguments = ["doctor", text(folder.path()), "--store", &address, "--json"];
    let doctor = run(&arguments).expect(1).json();
    assert!(finding(&doctor, "store")["value"].as_str().unwrap().contains("does not exist"));
    assert!(!store.exists());
    std::fs::create_dir(&store).unwrap();
    let doctor = run(&arguments).expect(0).json();
    for check in STORE {
        assert_ne!(level(&doctor, check), "fail", "{doctor:#}");
    }
    assert_eq!(entries(&store), 0);
}

#[test]
fn a_bucket_works_as_a_store() {
    let folder = tempfile::tempdir().unwrap();
    let bucket = S3Server::start(3);
    let doctor = |address: &str, code| {
        let mut command = command(&["doctor", text(folder.path()), "--store", address, "--json"]);
        bucket.tell(&mut command);
        let ended: Ended = command.output().unwrap().into();
        assert!(!ended.stdout.contains("hush"), "{ended:?}");
        ended.expect(code).json()
    };
    let well = doctor("s3://bucket/runs/x", 0);
    for check in STORE.iter().chain(&["store clock"]) {
        assert_eq!(level(&well, check), "ok", "{well:#}");
    }
    let store = bucket.store("runs/x");
    assert_eq!(store.list("doctor-probe").unwrap(), [""; 0]);
    bucket.faults.set_away(true);
    let away = doctor("s3://bucket/runs/x", 1);
    assert_eq!(level(&away, "store put"), "fail");
    assert!(
        finding(&away, "store put")["to_do"].as_str().unwrap().contains("that the store runs"),
        "{away:#}"
    );
}

#[cfg(feature = "nats")]
#[test]
fn an_unreachable_queue_fails() {
    let folder = tempfile::tempdir().unwrap();
    let doctor =
        run(&["doctor", text(folder.path()), "--queue", "nats://me:hush@127.0.0.1:1", "--json"])
            .expect(1);
    assert!(!doctor.stdout.contains("hush"), "{doctor:?}");
    let doctor = doctor.json();
    let queue = finding(&doctor, "queue");
    assert_eq!(queue["level"], "fail");
    assert!(queue["value"].as_str().unwrap().contains("refused"), "{queue:#}");
}

#[cfg(feature = "nats")]
#[test]
fn a_nats_server_works_as_a_queue() {
    let Some(server) = Nats::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let url = server.url();
    for _ in 0..2 {
        let doctor =
            run(&["doctor", text(folder.path()), "--queue", &url, "--json"]).expect(0).json();
        assert_ne!(level(&doctor, "queue"), "fail", "{doctor:#}");
        assert_eq!(level(&doctor, "JetStream"), "ok", "{doctor:#}");
        // The first `doctor` removes its stream; old servers do not report streams.
        let streams = &finding(&doctor, "JetStream")["measured"]["streams"];
        assert!(streams.is_null() || streams == 0, "{doctor:#}");
        assert_eq!(level(&doctor, "queue clock"), "ok", "{doctor:#}");
        assert!(finding(&doctor, "queue")["measured"]["version"].is_string());
    }
}
