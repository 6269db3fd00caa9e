//! The coordinator's side of the queue on NATS JetStream.

use super::super::message::{read_message, read_subject};
use super::nats::{ANSWER, CONSUMER, Connection, IN_FLIGHT, NatsOptions, within};
use super::{Listed, Message, QueueError, QueueKeeper, QueueState};
use crate::store::RUNTIME;
use async_nats::jetstream::consumer::{AckPolicy, PullConsumer, pull};
use async_nats::jetstream::stream::{
    Config, DiscardPolicy, LastRawMessageErrorKind, RetentionPolicy, StorageType, Stream,
};
use futures_util::{StreamExt, TryStreamExt};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::sync::Mutex;
use std::time::Duration;

/// Longest time of a call, which may consist of several requests.
const LONGEST_CALL: Duration = Duration::from_secs(4 * ANSWER.as_secs());

pub struct NatsCoordinator {
    connection: Connection,
    /// Number of shards of each scene.
    shards: Vec<u32>,
    lease: Duration,
    /// Number in the stream of each listed message, and true if its bytes name the task of its subject.
    read: Mutex<BTreeMap<String, (u64, bool)>>,
    /// Creation time of the last stream seen, ns since 1970.
    seen: Mutex<Option<i128>>,
}

impl NatsCoordinator {
    /// Connects at once, or as soon as the server can be reached. `run`: start of the spec's digest; `shards`: number of
    /// shards of each scene.
    pub fn connect(
        options: &NatsOptions,
        run: [u8; 8],
        shards: Vec<u32>,
        lease: Duration,
    ) -> Result<Self, QueueError> {
        let connection = Connection::open(options, run)?;
        Ok(Self { connection, shards, lease, read: Mutex::default(), seen: Mutex::new(None) })
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
        // A call of a client that has never been connected may wait for ever.
        match within(LONGEST_CALL, call) {
            Some(result) => result.map_err(|e| self.connection.lost(&e)),
            None => Err(self.connection.lost(&"no answer")),
        }
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
            return Err(QueueError::Away(format!(
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
            return Err(QueueError::Away(format!(
                "the consumer {CONSUMER} had leases of {} s; it was removed and will be created with {} s",
                got.ack_wait.as_secs_f64(),
                self.lease.as_secs_f64()
            )));
        }
        Ok(made)
    }
}

/// A subject, its message, its number in the stream, and true if its bytes name the same message.
type Read = (String, Message, (u64, bool));

impl NatsCoordinator {
    /// Reads the bytes of messages. Leaves out those that a worker removes meanwhile.
    async fn read(
        &self,
        stream: &Stream,
        subjects: Vec<(String, Message)>,
    ) -> Result<Vec<Read>, QueueError> {
        let run = self.connection.run;
        let read = futures_util::stream::iter(subjects).map(|(subject, message)| async move {
            match stream.get_last_raw_message_by_subject(&subject).await {
                Ok(raw) => {
                    let there = read_message(&raw.payload, run, &self.shards);
                    let is_good = there.is_ok_and(|there| there.as_ref() == Some(&message));
                    Ok(Some((subject, message, (raw.sequence, is_good))))
                }
                Err(error) if error.kind() == LastRawMessageErrorKind::NoMessageFound => Ok(None),
                Err(error) => Err(self.connection.lost(&error)),
            }
        });
        read.buffer_unordered(IN_FLIGHT)
            .try_filter_map(|found| async move { Ok(found) })
            .try_collect()
            .await
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

    fn messages(&self) -> Result<Vec<Listed>, QueueError> {
        let stream = self.stream()?;
        let info = self.call(stream.consumer_info(CONSUMER))?;
        let filter = format!("{}.span.>", self.connection.subjects);
        let subjects = self.call(stream.info_with_subjects(filter))?;
        let subjects: Vec<(String, usize)> = self.call(subjects.try_collect())?;
        let listed: Vec<(String, Message)> = subjects
            .into_iter()
            .filter_map(|(subject, _)| {
                let message = read_subject(self.connection.local(&subject), &self.shards)?;
                Some((subject, message))
            })
            .collect();
        let mut read = self.read.lock().expect("no holder of this lock panics");
        let mut known = std::mem::take(&mut *read);
        let delivered = info.delivered.stream_sequence;
        let (mut new, mut found) = (Vec::new(), Vec::new());
        for (subject, message) in listed {
            match known.remove(&subject) {
                // Another message may have taken the subject of a bad one.
                None | Some((_, false)) => new.push((subject, message)),
                Some(good) => found.push((subject, message, good)),
            }
        }
        found.extend(RUNTIME.block_on(self.read(&stream, new))?);
        let mut messages = Vec::new();
        for (subject, message, (number, is_good)) in found {
            messages.push(Listed { message, waits: number > delivered, is_readable: is_good });
            read.insert(subject, (number, is_good));
        }
        Ok(messages)
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
