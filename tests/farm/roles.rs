//! With the shipped server configuration and keys from the shipped script, a farm works over TLS, and each role has
//! only the permissions that it needs.

use crate::processes::all_done;
use crate::support::nats::SecureNats;
use crate::support::outputs::{assert_same, tuples};
use crate::support::program::{Running, command, runtime, text};
use crate::support::scenes::{Place, SCENES, SHARDS, place, reference};
use async_nats::jetstream::consumer::PullConsumer;
use futures_util::StreamExt;
use glasshouse::run::Run;
use glasshouse_line::Roots;
use std::io::{BufRead, BufReader};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Starts the program with a role's key.
fn start_as(server: &SecureNats, role: &str, verb: &str, place: &Place, more: &[&str]) -> Running {
    let (key, ca) = (server.key(role, "nkey"), server.key(role, "ca.pem"));
    let url = server.url();
    let mut arguments = vec![verb, text(&place.run), "--queue", &url, "--lease-s", "2"];
    arguments.extend(["--queue-nkey", text(&key), "--queue-ca", text(&ca)]);
    arguments.extend(["--progress", "none", "--json"]);
    arguments.extend(more);
    command(&arguments).spawn().unwrap()
}

#[test]
fn a_farm_works_over_tls_with_the_shipped_configuration() {
    let Some(server) = SecureNats::start() else {
        return;
    };
    let place = place();
    place.plan();
    let coordinator = start_as(&server, "coordinator", "coordinate", &place, &[]);
    let workers = [1, 2].map(|_| start_as(&server, "worker", "work", &place, &["-j", "1"]));
    all_done(coordinator, workers);
    assert_same(&tuples(&place.run), reference());
}

/// The message names the cause (the certificate or the authorization) and never contains the seed.
#[test]
fn a_missing_key_or_certificate_authority_is_reported() {
    let Some(server) = SecureNats::start() else {
        return;
    };
    let place = place();
    place.plan();
    let url = server.url();
    let seed = std::fs::read_to_string(server.key("observer", "nkey")).unwrap();
    let says = |arguments: &[&str], words: &[&str]| {
        let mut all = vec!["work", text(&place.run), "--queue", &url, "-j", "1"];
        all.extend(["--progress", "none"]);
        all.extend(arguments);
        let mut child = command(&all).spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let line = lines.next().unwrap().unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
        for word in words {
            assert!(line.contains(word), "no {word:?} in {line}");
        }
        assert!(!line.contains(seed.trim()), "{line}");
    };
    let (ca, key) = (server.key("worker", "ca.pem"), server.key("observer", "nkey"));
    // The program does not trust the server's certificate authority.
    says(&["--queue-nkey", text(&key)], &["waiting for the queue", "certificate"]);
    // The program has no key.
    says(&["--queue-ca", text(&ca)], &["waiting for the queue", "authorization"]);
}

/// Publishes to each subject as a role; returns the subjects that the server refused.
fn refused(server: &SecureNats, role: &str, subjects: &[&str]) -> Vec<String> {
    let seen: Arc<Mutex<Vec<String>>> = Arc::default();
    let events = Arc::clone(&seen);
    let seed = std::fs::read_to_string(server.key(role, "nkey")).unwrap();
    let ca = server.key(role, "ca.pem");
    let runtime = runtime();
    let _ = rustls::crypto::ring::default_provider().install_default();
    let marker = "glasshouse.marker.not.allowed";
    runtime.block_on(async {
        let client = async_nats::ConnectOptions::new()
            .nkey(seed.trim().to_owned())
            .add_root_certificates(ca)
            .event_callback(move |event| {
                let events = Arc::clone(&events);
                async move {
                    events.lock().unwrap().push(event.to_string());
                }
            })
            .connect(server.url())
            .await
            .unwrap();
        for subject in subjects.iter().chain([&marker]) {
            client.publish((*subject).to_owned(), "".into()).await.unwrap();
        }
        client.flush().await.unwrap();
        // The server handles messages in order: after it has refused the marker, it has handled all others.
        let start = std::time::Instant::now();
        while !seen.lock().unwrap().iter().any(|e| e.contains(marker)) {
            assert!(start.elapsed() < Duration::from_secs(10), "no answer");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    });
    let seen: Vec<String> = seen.lock().unwrap().iter().map(|e| e.to_lowercase()).collect();
    let is_refused = |subject: &&&str| {
        let words = format!("publish to \"{}\"", subject.to_lowercase());
        seen.iter().any(|event| event.contains(&words))
    };
    let refused = subjects.iter().filter(is_refused);
    refused.map(|s| (*s).to_owned()).collect()
}

/// Each role may use its own subjects, and not those that only other roles need.
#[test]
fn a_role_has_only_the_permissions_that_it_needs() {
    let Some(server) = SecureNats::start() else {
        return;
    };
    let stream = "GLASSHOUSE_00112233";
    let administration = [
        "STREAM.CREATE.*",
        "STREAM.UPDATE.*",
        "STREAM.DELETE.*",
        "STREAM.PURGE.*",
        "STREAM.MSG.DELETE.*",
        "CONSUMER.DELETE.*.work",
        "CONSUMER.DURABLE.CREATE.*.work",
    ]
    .map(|call| format!("$JS.API.{}", call.replace('*', stream)));
    let work = [
        format!("$JS.API.CONSUMER.MSG.NEXT.{stream}.work"),
        format!("$JS.ACK.{stream}.work.1.1.1.1.1"),
        "glasshouse.00112233.span.0.0-4.0".to_owned(),
        "glasshouse.00112233.give".to_owned(),
    ];
    let looking =
        [format!("$JS.API.STREAM.INFO.{stream}"), format!("$JS.API.CONSUMER.INFO.{stream}.work")];
    let foreign = [
        "elsewhere.span".to_owned(),
        "$SYS.REQ.SERVER.PING".to_owned(),
        "$JS.ACK.OTHER.mine.1.1.1.1.1".to_owned(),
    ];
    let check = |role: &str, may: &[&[String]], may_not: &[&[String]]| {
        let list = |groups: &[&[String]]| -> Vec<String> {
            groups.iter().flat_map(|g| g.iter().cloned()).collect()
        };
        let (may, may_not) = (list(may), list(may_not));
        let all: Vec<&str> = may.iter().chain(&may_not).map(String::as_str).collect();
        assert_eq!(refused(&server, role, &all), may_not, "{role}");
    };
    check("worker", &[&work, &looking], &[&administration, &foreign]);
    check("observer", &[&looking], &[&work, &administration, &foreign]);
    check(
        "coordinator",
        &[&administration, &looking, &work[2..3]],
        &[&work[1..2], &work[3..], &foreign],
    );
}

/// A thief of the workers' key acknowledges every message without taking it, leaves garbage on the subjects, withholds a
/// task, and tries to change the stream. The farm makes all tuples once it stops.
#[test]
fn a_stolen_worker_key_costs_only_time() {
    let Some(server) = SecureNats::start() else {
        return;
    };
    let place = place();
    place.plan();
    let run = Run::open(&place.run, &Roots::default()).unwrap();
    let [a, b, c, d, ..] = run.id();
    let hex = format!("{a:02x}{b:02x}{c:02x}{d:02x}");
    let stream = format!("GLASSHOUSE_{hex}");
    let coordinator = start_as(&server, "coordinator", "coordinate", &place, &[]);
    let seed = std::fs::read_to_string(server.key("worker", "nkey")).unwrap();
    let ca = server.key("worker", "ca.pem");
    let _ = rustls::crypto::ring::default_provider().install_default();
    let runtime = runtime();
    runtime.block_on(async {
        let client = async_nats::ConnectOptions::new()
            .nkey(seed.trim().to_owned())
            .add_root_certificates(ca)
            .connect(server.url())
            .await
            .unwrap();
        let context = async_nats::jetstream::new(client.clone());
        let start = std::time::Instant::now();
        let messages = async || match context.get_stream(&stream).await {
            Ok(stream) => stream.cached_info().state.messages,
            Err(_) => 0,
        };
        while messages().await < SCENES as u64 {
            assert!(start.elapsed() < Duration::from_secs(30), "no messages");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        // The key may acknowledge any message by its number.
        for number in 1..=2 * SCENES {
            let subject = format!("$JS.ACK.{stream}.work.1.{number}.{number}.1.0");
            client.publish(subject, "+ACK".into()).await.unwrap();
        }
        for scene in 0..SCENES {
            let subject = format!("glasshouse.{hex}.span.{scene}.0-{SHARDS}.0");
            client.publish(subject, "garbage!".into()).await.unwrap();
        }
        client.flush().await.unwrap();
        // It takes a message and never returns it.
        let consumer: PullConsumer =
            context.get_consumer_from_stream("work", &stream).await.unwrap();
        let mut batch = consumer.fetch().max_messages(1).messages().await.unwrap();
        while batch.next().await.is_some() {}
    });
    let may_not = [
        format!("$JS.API.STREAM.PURGE.{stream}"),
        format!("$JS.API.STREAM.DELETE.{stream}"),
        format!("$JS.API.STREAM.UPDATE.{stream}"),
        format!("$JS.API.STREAM.MSG.GET.{stream}"),
        format!("$JS.API.STREAM.MSG.DELETE.{stream}"),
        format!("$JS.API.DIRECT.GET.{stream}"),
        format!("$JS.API.CONSUMER.DELETE.{stream}.work"),
        format!("$JS.API.CONSUMER.CREATE.{stream}.mine"),
    ];
    let all: Vec<&str> = may_not.iter().map(String::as_str).collect();
    assert_eq!(refused(&server, "worker", &all), may_not);
    let workers = [1, 2].map(|_| start_as(&server, "worker", "work", &place, &["-j", "1"]));
    all_done(coordinator, workers);
    assert!(!place.run.join("quarantine").exists());
    assert_same(&tuples(&place.run), reference());
}
