//! Workers and coordinators end soon where no waiting can help, and wait where it can.

use crate::support::nats::spawn_configured;
use crate::support::program::{Ended, command, run, text};
use crate::support::scenes::place;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::time::{Duration, Instant};

/// Longest time until a command ends whose queue can never be used.
const SOON: Duration = Duration::from_mins(1);

#[test]
fn queues_that_can_never_be_used_end_workers_and_coordinators() {
    let place = place();
    run(&place.arguments("plan", &["-q"])).expect(0);
    let folder = tempfile::tempdir().unwrap();
    let jetstream = |name: &str| {
        format!("jetstream {{ store_dir: \"{}\" }}", folder.path().join(name).display())
    };
    let servers = [
        (
            format!("authorization {{ user: a, password: b }}\n{}", jetstream("a")),
            "refuses this user",
        ),
        (String::new(), "nats-server -js"),
        (format!("max_payload: 64\n{}", jetstream("p")), "raise max_payload"),
    ];
    let mut calls = Vec::new();
    let mut running = Vec::new();
    for (index, (configuration, remedy)) in servers.iter().enumerate() {
        let file = folder.path().join(format!("{index}.conf"));
        std::fs::write(&file, configuration).unwrap();
        let Some((server, url)) = spawn_configured(&file) else { return };
        running.push(server);
        calls.push((url, *remedy));
    }
    // A web server, which says nothing before it is asked.
    let web = TcpListener::bind("127.0.0.1:0").unwrap();
    calls.push((format!("nats://{}", web.local_addr().unwrap()), "is not a NATS server"));
    std::thread::spawn(move || {
        for stream in web.incoming() {
            let mut stream = stream.unwrap();
            std::thread::spawn(move || {
                let mut request = [0; 64];
                if stream.read(&mut request).is_ok_and(|count| count > 0) {
                    let _ = stream.write_all(b"HTTP/1.0 400 Bad Request\r\n\r\n");
                }
            });
        }
    });
    let start = Instant::now();
    std::thread::scope(|scope| {
        for (url, remedy) in &calls {
            for name in ["work", "coordinate"] {
                let place = &place;
                scope.spawn(move || {
                    let call = [name, text(&place.run), "--queue", url];
                    let ended: Ended = command(&call).output().unwrap().into();
                    ended.expect(1).says(&["error: the queue cannot be used", remedy]);
                });
            }
        }
    });
    assert!(start.elapsed() < SOON, "{:?}", start.elapsed());
}

/// A server that is not there, and one that starts late, are waited for.
#[test]
fn absent_servers_are_waited_for() {
    let place = place();
    run(&place.arguments("plan", &["-q"])).expect(0);
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let url = format!("nats://{free}");
    let call = ["work", text(&place.run), "--queue", &url, "--time-limit", "45s"];
    let ended: Ended = command(&call).output().unwrap().into();
    ended.expect(75).says(&["waiting for the queue"]);
}
