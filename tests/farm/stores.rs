//! Tests the properties of a store that the farm needs, on a disk and on S3, with a reliable and a failing server.

use crate::support::moto::Moto;
use crate::support::s3_server::{BUCKET, S3Server};
use glasshouse::store::{Put, Store, StoreError, StoreOptions};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Number of objects in a large listing, more than one page of S3.
const MANY: usize = 1100;

/// Runs a test on a disk, on S3 with and without a prefix, and on S3 with faults in 15 % of the requests.
fn on_all_stores(test: impl Fn(&str, &Store)) {
    let folder = tempfile::tempdir().unwrap();
    test("disk", &Store::local(folder.path()).unwrap());
    let server = S3Server::start(1);
    test("s3", &server.store("runs/mine"));
    test("s3 without prefix", &server.store(""));
    server.faults.set(150);
    test("s3 with faults", &server.store("runs/faulty"));
}

#[test]
fn objects_are_created_once_and_differences_are_errors() {
    on_all_stores(|name, store| {
        assert_eq!(store.get("a/b.json").unwrap(), None, "{name}");
        let put = store.create("a/b.json", b"one").unwrap();
        // After a lost response, the store repeats the put and finds its own bytes.
        assert!(put == Put::New || name.contains("faults"), "{name}");
        assert_eq!(store.create("a/b.json", b"one").unwrap(), Put::Same, "{name}");
        let error = store.create("a/b.json", b"two").unwrap_err();
        let StoreError::Differs { here, there, .. } = &error else {
            panic!("{name}: {error}");
        };
        let digest = |bytes: &[u8]| blake3::hash(bytes).to_hex()[..16].to_owned();
        assert_eq!((here, there), (&digest(b"two"), &digest(b"one")), "{name}");
        assert!(error.to_string().contains(store.name()), "{error}");
        assert_eq!(store.get("a/b.json").unwrap().unwrap(), "one", "{name}");
        store.replace("a/b.json", b"two").unwrap();
        assert_eq!(store.get("a/b.json").unwrap().unwrap(), "two", "{name}");
        store.create("empty", b"").unwrap();
        assert_eq!(store.get("empty").unwrap().unwrap(), "", "{name}");
    });
}

/// A coordinator that finishes the run while a worker writes removes the unfinished file with its folder.
#[test]
fn a_put_is_repeated_if_its_file_is_removed() {
    while_files_are_removed(&|store, key, bytes| {
        assert_eq!(store.create(key, bytes).unwrap(), Put::New);
    });
    while_files_are_removed(&|store, key, bytes| store.replace(key, bytes).unwrap());
}

fn while_files_are_removed(put: &dyn Fn(&Store, &str, &[u8])) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::local(folder.path()).unwrap();
    let bytes = vec![7; 8 << 20];
    let objects = 8;
    let clear_away = |object: usize| {
        let place = folder.path().join(format!("partials/s{object}"));
        let there = |name: &str| place.join(name).exists();
        let start = Instant::now();
        while !there("x#1") && !there("x") && start.elapsed() < Duration::from_secs(10) {
            std::thread::yield_now();
        }
        let is_gone = std::fs::remove_file(place.join("x#1")).is_ok();
        // A complete object stays.
        is_gone && std::fs::remove_dir(&place).is_ok()
    };
    let mut cleared_away = 0;
    for object in 0..objects {
        std::thread::scope(|scope| {
            let other = scope.spawn(|| clear_away(object));
            put(&store, &format!("partials/s{object}/x"), &bytes);
            cleared_away += u32::from(other.join().unwrap());
        });
    }
    assert!(cleared_away > 0, "no file was removed during its put");
    assert_eq!(store.list("partials").unwrap().len(), objects);
}

#[test]
fn many_objects_can_be_listed_and_removed() {
    on_all_stores(|name, store| {
        assert_eq!(store.list("partials").unwrap(), [""; 0], "{name}");
        // S3 is slow, and slower with retries after faults, so only one of its listings has more than a page.
        let many = if ["disk", "s3"].contains(&name) { MANY } else { 100 };
        let keys: Vec<String> = (0..many).map(|k| format!("partials/s/{k:06}.exr")).collect();
        let objects = keys.iter().map(|k| (k.clone(), k.clone().into()));
        store.create_all(objects.collect()).unwrap();
        // A key that only begins with the folder's name is not in the folder.
        store.create("partials/s2/000000.exr", b"t").unwrap();
        store.create("partials/s/deep/x", b"t").unwrap();
        let mut found = store.list("partials/s").unwrap();
        found.sort();
        assert_eq!(found.len(), many + 1, "{name}");
        assert!(found[..many] == keys[..], "{name}");
        assert_eq!(store.list("partials").unwrap().len(), many + 2, "{name}");
        let bytes = store.get_all(&keys).unwrap();
        let same = |(b, k): (&Option<bytes::Bytes>, &String)| b.as_ref().unwrap() == k.as_bytes();
        assert!(bytes.iter().zip(&keys).all(same), "{name}");
        store.delete(&keys).unwrap();
        store.delete(&keys).unwrap();
        store.delete(&[]).unwrap();
        let mut left = store.list("partials").unwrap();
        left.sort();
        assert_eq!(left, ["partials/s/deep/x", "partials/s2/000000.exr"], "{name}");
    });
}

/// Returns bytes that take several packets, so that faults can also cut a response in the middle.
fn large(k: u8) -> Vec<u8> {
    (0..300_000u32).flat_map(|n| (n * 7 + u32::from(k)).to_le_bytes()).collect()
}

#[test]
fn retries_hide_every_kind_of_fault() {
    let server = S3Server::start(2);
    server.faults.set(400);
    let store = server.store("x");
    for k in 0..24 {
        let key = format!("tuples/{k}");
        store.create(&key, &large(k)).unwrap();
        assert!(store.get(&key).unwrap().unwrap() == large(k));
    }
    assert_eq!(store.list("tuples").unwrap().len(), 24);
    for kind in &server.faults.happened {
        assert!(kind.load(Ordering::SeqCst) > 0, "{:?}", server.faults.happened);
    }
}

#[test]
fn simultaneous_equal_puts_succeed() {
    on_all_stores(|name, store| {
        for round in 0..5 {
            let key = format!("tuples/{round}");
            std::thread::scope(|scope| {
                for _ in 0..8 {
                    scope.spawn(|| store.create(&key, &large(round)).unwrap());
                }
            });
            assert!(store.get(&key).unwrap().unwrap() == large(round), "{name}");
        }
    });
}

/// Asserts that one of sixteen simultaneous different puts succeeds, and that the others return an error.
fn one_wins(store: &Store) {
    for round in 0..10 {
        let key = format!("race/{round}");
        let made: Vec<_> = std::thread::scope(|scope| {
            let put = |k: u8| store.create(&key, &[k; 5000]);
            let puts: Vec<_> = (0..16).map(|k| scope.spawn(move || put(k))).collect();
            puts.into_iter().map(|p| p.join().unwrap()).collect()
        });
        let new = made.iter().position(|m| matches!(m, Ok(Put::New))).unwrap();
        let differ = made.iter().filter(|m| matches!(m, Err(StoreError::Differs { .. })));
        assert_eq!(differ.count(), 15, "{made:?}");
        assert_eq!(store.get(&key).unwrap().unwrap(), vec![new as u8; 5000]);
    }
}

#[test]
fn one_of_several_different_puts_wins_on_a_disk() {
    let folder = tempfile::tempdir().unwrap();
    one_wins(&Store::local(folder.path()).unwrap());
}

#[test]
fn one_of_several_different_puts_wins_on_s3() {
    one_wins(&S3Server::start(6).store("x"));
}

#[test]
fn a_put_waits_for_an_unreachable_store() {
    let server = S3Server::start(3);
    let store = server.store("x");
    server.faults.set_away(true);
    std::thread::scope(|scope| {
        let put = scope.spawn(|| store.create("a", b"one"));
        std::thread::sleep(Duration::from_secs(2));
        assert!(!put.is_finished());
        server.faults.set_away(false);
        put.join().unwrap().unwrap();
    });
    assert_eq!(store.get("a").unwrap().unwrap(), "one");
}

#[test]
fn errors_of_an_unreachable_store_are_passing() {
    let server = S3Server::start(4);
    let address = format!("s3://{BUCKET}/x");
    let store = Store::open(&address, &server.options(Duration::from_secs(1))).unwrap();
    server.faults.set_away(true);
    let start = Instant::now();
    for error in [
        store.create("a", b"one").unwrap_err(),
        store.get("a").unwrap_err(),
        store.list("a").unwrap_err(),
        store.delete(&["a".to_owned()]).unwrap_err(),
    ] {
        assert!(error.is_passing(), "{error}");
        assert!(error.to_string().contains("a in s3://bucket/x"), "{error}");
    }
    assert!(start.elapsed() < Duration::from_secs(40));
}

#[test]
fn permanent_errors_are_reported_at_once_and_without_secrets() {
    let server = S3Server::start(5);
    let mut options: StoreOptions = server.options(Duration::from_mins(5));
    let start = Instant::now();
    for (name, value) in &mut options.settings {
        if name == "AWS_SECRET_ACCESS_KEY" {
            "wrongwrongwrong".clone_into(value);
        }
    }
    let refused = Store::open(&format!("s3://{BUCKET}/x"), &options).unwrap();
    let error = refused.create("a", b"one").unwrap_err();
    assert!(!error.is_passing(), "{error}");
    let text = format!("{error} {error:?} {refused:?}");
    assert!(text.contains("SignatureDoesNotMatch"), "{text}");
    for secret in ["wrongwrongwrong", "hushhush", "AKIATEST"] {
        assert!(!text.contains(secret), "{text}");
    }
    assert!(start.elapsed() < Duration::from_secs(30));
}

/// s3s-fs creates absent buckets, so this test uses moto.
#[test]
fn an_absent_bucket_is_reported_at_once() {
    let Some(server) = Moto::start() else { return };
    let start = Instant::now();
    let store = server.store_at("s3://absent/x");
    for error in [store.create("a", b"one").unwrap_err(), store.list("a").unwrap_err()] {
        assert!(!error.is_passing(), "{error}");
        assert!(error.to_string().contains("NoSuchBucket"), "{error}");
        assert!(error.to_string().contains("s3://absent/x"), "{error}");
    }
    assert!(start.elapsed() < Duration::from_secs(30));
}
