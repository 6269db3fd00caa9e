//! One client of the queue forges, replaces and removes messages: no healthy scene goes into quarantine, every scene is
//! published again, and all processes end.

use crate::processes::{all_done, alone, assert_whole, coordinator, end, slow_place, worker};
use crate::support::nats::Nats;
use crate::support::program::{command, run, runtime, text};
use crate::support::scenes::{Place, SCENES, photographs, place, reference, scene, write_lines};
use crate::support::tools::{stuck_reads, wait_for};
use async_nats::jetstream::{self, consumer::PullConsumer};
use futures_util::StreamExt;
use glasshouse::farm::queue::{Message, write_message};
use glasshouse::run::{Run, Task};
use glasshouse_line::Roots;
use std::time::{Duration, Instant};

/// A client that may do to the run's stream what a worker may, and removes messages.
struct Client {
    runtime: tokio::runtime::Runtime,
    connection: async_nats::Client,
    context: jetstream::Context,
    hex: String,
    run: [u8; 8],
}

impl Client {
    fn new(place: &Place, server: &Nats) -> Self {
        let run = Run::open(&place.run, &Roots::default()).unwrap().id();
        let [a, b, c, d, ..] = run;
        let runtime = runtime();
        let connection = runtime.block_on(async_nats::connect(server.url())).unwrap();
        let context = {
            let _runtime = runtime.enter();
            jetstream::new(connection.clone())
        };
        Self { runtime, connection, context, hex: format!("{a:02x}{b:02x}{c:02x}{d:02x}"), run }
    }

    fn stream(&self) -> String {
        format!("GLASSHOUSE_{}", self.hex)
    }

    fn publish(&self, subject: &str, bytes: Vec<u8>) {
        let subject = format!("glasshouse.{}.{subject}", self.hex);
        self.runtime.block_on(async {
            self.connection.publish(subject, bytes.into()).await.unwrap();
            self.connection.flush().await.unwrap();
        });
    }

    /// Publishes shards 5 to 8 of every scene, which has fewer, as another worker of the run would publish a task.
    fn publish_beyond_the_end(&self) {
        for scene in 0..SCENES as u32 {
            let message = Message { task: Task { scene, shards: 5..9 }, hops: 0 };
            self.publish(&format!("span.{scene}.5-9.0"), write_message(self.run, &message));
        }
    }

    fn messages(&self) -> u64 {
        self.runtime.block_on(async {
            let stream = self.context.get_stream(self.stream()).await;
            stream.map_or(0, |stream| stream.cached_info().state.messages)
        })
    }

    /// Takes up to `count` messages and returns them: their leases run.
    fn take(&self, count: usize) -> Vec<jetstream::Message> {
        self.runtime.block_on(async {
            let consumer: PullConsumer =
                self.context.get_consumer_from_stream("work", self.stream()).await.unwrap();
            let batch = consumer.fetch().max_messages(count).messages().await.unwrap();
            batch.map(|message| message.unwrap()).collect().await
        })
    }

    fn acknowledge(&self, messages: &[jetstream::Message]) {
        self.runtime.block_on(async {
            for message in messages {
                message.double_ack().await.unwrap();
            }
        });
    }
}

/// Plans scenes of one shard.
fn one_shard_each() -> Place {
    let place = place();
    let (recipe, out) = (text(&place.recipe), text(&place.run));
    run(&["plan", recipe, "--out", out, "--tile", "128"]).expect(0);
    place
}

#[test]
fn forged_messages_in_place_of_the_real_ones_put_no_scene_into_quarantine() {
    let Some(server) = Nats::start() else { return };
    let place = one_shard_each();
    let run = Run::open(&place.run, &Roots::default()).unwrap();
    assert!(run.shard_counts().iter().all(|count| *count < 6), "{:?}", run.shard_counts());
    let coordinator = coordinator(&place, &server);
    let client = Client::new(&place, &server);
    wait_for("the messages", || client.messages() == SCENES as u64);
    client.acknowledge(&client.take(SCENES));
    client.publish_beyond_the_end();
    let workers = [worker(&place, &server), worker(&place, &server)];
    all_done(coordinator, workers);
    // Tuples do not depend on the size of tiles.
    assert_whole(&place.run, reference());
}

#[test]
fn forged_messages_beside_the_real_ones_hold_no_worker() {
    let Some(server) = Nats::start() else { return };
    let place = one_shard_each();
    let coordinator = coordinator(&place, &server);
    let client = Client::new(&place, &server);
    wait_for("the messages", || client.messages() == SCENES as u64);
    client.publish_beyond_the_end();
    let workers = [worker(&place, &server), worker(&place, &server)];
    all_done(coordinator, workers);
    // Tuples do not depend on the size of tiles.
    assert_whole(&place.run, reference());
}

/// The message on a scene's subject has eight bytes that no worker can read.
#[test]
fn garbage_in_place_of_messages_is_removed_and_its_scenes_are_published_again() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let client = Client::new(&place, &server);
    wait_for("the messages", || client.messages() == SCENES as u64);
    let taken = client.take(2);
    client.acknowledge(&taken);
    for message in &taken {
        let subject = message.subject.split_once(".span.").unwrap().1;
        client.publish(&format!("span.{subject}"), b"garbage!".to_vec());
    }
    let said = worker(&place, &server);
    end(coordinator).expect(0);
    end(said).expect(0).says(&["removed from the queue"]);
    assert_whole(&place.run, alone(&place));
}

/// A client takes every message and renews the leases for ever.
#[test]
fn withheld_messages_are_published_again() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let client = Client::new(&place, &server);
    wait_for("the messages", || client.messages() == SCENES as u64);
    let held = client.take(SCENES);
    assert_eq!(held.len(), SCENES);
    let mut working = worker(&place, &server);
    let start = Instant::now();
    while !place.run.join("finished.json").exists() {
        assert!(start.elapsed() < Duration::from_mins(3), "the run does not end");
        client.runtime.block_on(async {
            for message in &held {
                // The stream is gone when the run is finished.
                let _ = message.ack_with(jetstream::AckKind::Progress).await;
            }
        });
        std::thread::sleep(Duration::from_millis(300));
    }
    end(coordinator).expect(0).says(&["made no progress", "published again"]);
    assert!(working.try_wait().unwrap().is_none_or(|status| status.success()));
    end(working).expect(0);
    assert_whole(&place.run, alone(&place));
}

/// A client gives back every lease of live workers, so that the server delivers each task many times.
#[test]
fn leases_that_a_client_gives_back_blame_no_scene() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let coordinator = coordinator(&place, &server);
    let client = Client::new(&place, &server);
    wait_for("the messages", || client.messages() == SCENES as u64);
    let workers: Vec<_> = (0..3).map(|_| worker(&place, &server)).collect();
    let start = Instant::now();
    let mut given_back = 0u32;
    while !place.run.join("finished.json").exists() && start.elapsed() < Duration::from_secs(8) {
        for number in 1..40 {
            // The reply subject of a delivery; the server reads only the number in the stream.
            let subject = format!("$JS.ACK.{}.work.1.{number}.{number}.1.0", client.stream());
            client.runtime.block_on(client.connection.publish(subject, "-NAK".into())).unwrap();
            given_back += 1;
        }
        client.runtime.block_on(client.connection.flush()).unwrap();
        std::thread::sleep(Duration::from_millis(100));
    }
    assert!(given_back > 0);
    all_done(coordinator, workers);
    nothing_is_in_quarantine(&place);
    assert_whole(&place.run, alone(&place));
}

/// Prints the records in quarantine, if there are any.
fn nothing_is_in_quarantine(place: &Place) {
    let records = std::fs::read_dir(place.run.join("quarantine")).into_iter().flatten();
    let records: Vec<String> =
        records.map(|entry| std::fs::read_to_string(entry.unwrap().path()).unwrap()).collect();
    assert!(records.is_empty(), "{}", records.concat());
}

/// A read of a photograph does not return, as on a mount that hangs: the worker leaves, though it traces nothing.
#[test]
fn a_worker_that_cannot_finish_reading_ends() {
    let (Some(server), Some(library)) = (Nats::start(), stuck_reads()) else { return };
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    std::fs::rename(folder.path().join("a.png"), folder.path().join("stuck.png")).unwrap();
    let mut place = place();
    place.recipe = folder.path().join("scenes.jsonl");
    let mut one = scene("one");
    one["front"]["color"] = "stuck.png".into();
    write_lines(&place.recipe, &[one]);
    place.plan();
    let coordinator = coordinator(&place, &server);
    let url = server.url();
    let mut hung = command(&["work", text(&place.run), "--queue", &url, "--lease-s", "2"]);
    hung.args(["-j", "1", "--hang-s", "1"]).env("LD_PRELOAD", library);
    // Either the read or the task's lack of progress is noticed first.
    end(hung.spawn().unwrap()).expect(1).says(&["for 1 s", "--hang-s"]);
    all_done(coordinator, [worker(&place, &server)]);
    nothing_is_in_quarantine(&place);
}
