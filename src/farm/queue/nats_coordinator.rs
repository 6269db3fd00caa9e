//! The coordinator's side of the queue on NATS JetStream.

use super::nats::{CONSUMER, Connection, NatsOptions};
use super::{Message, QueueError, QueueKeeper, QueueState};
use crate::store::RUNTIME;
use async_nats::jetstream::consumer::{AckPolicy, PullConsumer, pull};
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, StorageType, Stream};
use futures_util::TryStreamExt;
use std::collections::BTreeSet;
use std::fmt::Display;
use std::sync::Mutex;
use std::time::Duration;

pub struct NatsCoordinator {
    connection: Connection,
    lease: Duration,
    /// Creation time of the last stream seen, ns since 1970.
    seen: Mutex<Option<i128>>,
}

impl NatsCoordinator {
    /// Connects at once, or as soon as the server can be reached.
    pub fn connect(
        options: &NatsOptions,
        run: [u8; 8],
        lease: Duration,
    ) -> Result<Self, QueueError> {
        Ok(Self { connection: Connection::open(options, run)?, lease, seen: Mutex::new(None) })
    }

    fn config(&self) -> Config {
        Config {
            name: self.connection.stream.clone(),
            subjects: vec![format!("{}.span.>", self.connection.subjects)],
            retention: RetentionPolicy::WorkQueue,
            storage: StorageType::File,
            discard: DiscardPolicy::New,
            max_messages_per_subject: 1,
            discard_new_per_subject: true,
            ..Config::default()
        }
    }

    fn call<T, E: Display>(
        &self,
        call: impl Future<Output = Result<T, E>>,
    ) -> Result<T, QueueError> {
        RUNTIME.block_on(call).map_err(|e| self.connection.lost(&e))
    }

    fn stream(&self) -> Result<Stream, QueueError> {
        self.call(self.connection.context.get_stream(&self.connection.stream))
    }

    /// Creates the stream and its consumer if needed. Returns the stream's creation time.
    fn make(&self) -> Result<i128, QueueError> {
        let wanted = self.config();
        let stream = self.call(self.connection.context.get_or_create_stream(wanted.clone()))?;
        let made = stream.cached_info().created.unix_timestamp_nanos();
        // Older servers drop unknown settings without an error.
        let got = &stream.cached_info().config;
        let same = got.retention == wanted.retention
            && got.storage == wanted.storage
            && got.discard == wanted.discard
            && got.max_messages_per_subject == wanted.max_messages_per_subject
            && got.discard_new_per_subject == wanted.discard_new_per_subject
            && got.subjects == wanted.subjects;
        if !same {
            let name = &self.connection.stream;
            return Err(QueueError(format!(
                "the stream {name} does not have the requested settings; use nats-server 2.9.10 or newer, and remove a \
                 stream that another program created (`nats stream rm {name}`; the run loses nothing)"
            )));
        }
        let config = pull::Config {
            durable_name: Some(CONSUMER.to_owned()),
            ack_policy: AckPolicy::Explicit,
            ack_wait: self.lease,
            max_deliver: -1,
            max_ack_pending: -1,
            max_waiting: 1 << 16,
            ..pull::Config::default()
        };
        let consumer: PullConsumer = self.call(stream.get_or_create_consumer(CONSUMER, config))?;
        let got = &consumer.cached_info().config;
        if got.ack_wait != self.lease || got.max_ack_pending != -1 {
            // A coordinator with another lease duration created the consumer. Redelivered tasks only cost time.
            self.call(stream.delete_consumer(CONSUMER))?;
            return Err(QueueError(format!(
                "the consumer {CONSUMER} had leases of {} s; it was removed and will be created with {} s",
                got.ack_wait.as_secs_f64(),
                self.lease.as_secs_f64()
            )));
        }
        Ok(made)
    }
}

impl QueueKeeper for NatsCoordinator {
    fn ensure(&self) -> Result<bool, QueueError> {
        let made = self.make();
        let made = made.map_err(|error| self.connection.explained(error))?;
        let mut seen = self.seen.lock().expect("no holder of this lock panics");
        Ok(seen.replace(made) != Some(made))
    }

    fn state(&self) -> Result<QueueState, QueueError> {
        let info = self.call(self.stream()?.consumer_info(CONSUMER))?;
        Ok(QueueState { waiting: info.num_pending, held: info.num_ack_pending as u64 })
    }

    fn scenes(&self) -> Result<BTreeSet<u32>, QueueError> {
        let filter = format!("{}.span.>", self.connection.subjects);
        let subjects = self.call(self.stream()?.info_with_subjects(filter))?;
        let subjects: Vec<(String, usize)> = self.call(subjects.try_collect())?;
        let scene = |subject: &str| subject.split('.').nth(3)?.parse().ok();
        Ok(subjects.iter().filter_map(|(subject, _)| scene(subject)).collect())
    }

    fn publish(&self, messages: &[Message]) -> Result<(), QueueError> {
        RUNTIME.block_on(self.connection.publish(messages)).map(|_| ())
    }

    fn purge(&self) -> Result<(), QueueError> {
        let stream = self.stream()?;
        self.call(async { stream.purge().await }).map(|_| ())
    }

    fn remove(&self) -> Result<(), QueueError> {
        self.call(self.connection.context.delete_stream(&self.connection.stream)).map(|_| ())
    }
}
