//! The status page tells a killed worker from one whose shard takes long.

use crate::processes::start;
use crate::serve_run::{get, view_address};
use crate::support::nats::Nats;
use crate::support::program::{LONGEST, run, text};
use crate::support::scenes::place;
use serde_json::Value;
use std::time::{Duration, Instant};

const LEASE_S: f64 = 2.0;

#[test]
fn a_killed_worker_is_shown_as_lost_and_a_slow_one_is_not() {
    let Some(server) = Nats::start() else { return };
    let place = place();
    run(&["plan", text(&place.recipe), "--out", text(&place.run), "--tile", "128"]).expect(0);
    let mut coordinator =
        start("coordinate", &place, &server, &["--listen", "127.0.0.1:0", "--lease-s", "2"]);
    let (address, _stderr) = view_address(&mut coordinator);
    // The only shard of a scene takes a minute, thirty leases.
    let slow = ["-j", "1", "--lease-s", "2", "--fault", "cost:4,1,60,0,0,0,0"];
    let [mut dying, mut living] = [(); 2].map(|()| start("work", &place, &server, &slow));
    let [killed, alive] = [&dying, &living].map(|child| format!("-{}", child.id()));
    let begin = Instant::now();
    let worker = |name: &str| {
        let view: Value =
            serde_json::from_slice(&get(address, "/api/view").expect(200).body).unwrap();
        let workers = view["workers"].as_array().unwrap().clone();
        workers.into_iter().find(|worker| worker["name"].as_str().unwrap().ends_with(name))
    };
    let wait_for = |name: &str, state: &str| loop {
        if let Some(found) = worker(name).filter(|worker| worker["state"] == state) {
            return found;
        }
        assert!(begin.elapsed() < LONGEST, "{name} is never {state}: {:?}", worker(name));
        if let Some(living) = worker(&alive) {
            assert_eq!(living["state"], "working", "{living}");
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    let scene = wait_for(&killed, "working")["scene"].clone();
    let its = wait_for(&alive, "working");
    let since = Instant::now();
    dying.kill().unwrap();
    dying.wait().unwrap();
    let lost = wait_for(&killed, "lost");
    let silent_s = lost["last_progress_s"].as_f64().unwrap();
    assert!(silent_s > 2.0 * LEASE_S, "{lost}");
    assert_eq!(lost["scene"], scene, "{lost}");
    assert!(get(address, "/").expect(200).text().contains("1 lost"));
    let sign = format!("{killed}, last sign of life");
    run(&["status", text(&place.run)]).prints(&[&sign]);

    // Another worker finishes its scene, and the page still tells which one was lost.
    let mut other = start("work", &place, &server, &["-j", "1", "--lease-s", "2"]);
    let record = place.run.join("tuples").join(scene.as_str().unwrap()).join("tuple.json");
    while !record.exists() {
        assert!(begin.elapsed() < LONGEST, "no worker takes the scene");
        std::thread::sleep(Duration::from_millis(50));
    }
    std::thread::sleep(Duration::from_secs_f64(LEASE_S));
    let still = worker(&killed).unwrap();
    assert_eq!((&still["state"], &still["scene"]), (&lost["state"], &scene), "{still}");
    // The other worker gave signs of life for more than four leases.
    std::thread::sleep(Duration::from_secs_f64(5.0 * LEASE_S).saturating_sub(since.elapsed()));
    let still = worker(&alive).unwrap();
    assert_eq!((&still["state"], &still["scene"]), (&its["state"], &its["scene"]), "{still}");
    for child in [&mut living, &mut other, &mut coordinator] {
        child.kill().unwrap();
        child.wait().unwrap();
    }
}
