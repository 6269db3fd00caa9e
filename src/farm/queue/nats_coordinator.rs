//! The coordinator's end of the queue on NATS JetStream.

use super::{Message, QueueError, QueueKeeper, QueueState};
use crate::store::RUNTIME;
use async_nats::jetstream::consumer::{AckPolicy, PullConsumer, pull};
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, StorageType, Stream};
use futures_util::TryStreamExt;
use std::collections::BTreeSet;
use std::sync::Mutex;
use std::time::Duration;

use super::nats::{CONSUMER, Connection, NatsOptions};

pub struct NatsCoordinator {
    connection: Connection,
    lease: Duration,
    /// When the stream was made that was seen last.
    seen: Mutex<Option<i128>>,
}

impl NatsCoordinator {
    /// Connects, now or later.
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

    async fn stream(&self) -> Result<Stream, QueueError> {
        let connection = &self.connection;
        connection.context.get_stream(&connection.stream).await.map_err(|e| connection.lost(&e))
    }

    /// When the stream was made.
    fn make(&self) -> Result<i128, QueueError> {
        let connection = &self.connection;
        RUNTIME.block_on(async {
            let wanted = self.config();
            let stream = connection
                .context
                .get_or_create_stream(wanted.clone())
                .await
                .map_err(|e| connection.lost(&e))?;
            let made = stream.cached_info().created.unix_timestamp_nanos();
            // Older servers leave out what they do not know without a word.
            let got = &stream.cached_info().config;
            let same = got.retention == wanted.retention
                && got.storage == wanted.storage
                && got.discard == wanted.discard
                && got.max_messages_per_subject == wanted.max_messages_per_subject
                && got.discard_new_per_subject == wanted.discard_new_per_subject
                && got.subjects == wanted.subjects;
            if !same {
                return Err(QueueError(format!(
                    "the server made the stream {} otherwise than it was asked to; it must be nats-server 2.9.10 or newer, and \
                     nothing else may have made that stream (`nats stream rm {}` removes it, the run loses nothing)",
                    connection.stream, connection.stream
                )));
            }
            let consumer: PullConsumer = stream
                .get_or_create_consumer(
                    CONSUMER,
                    pull::Config {
                        durable_name: Some(CONSUMER.to_owned()),
                        ack_policy: AckPolicy::Explicit,
                        ack_wait: self.lease,
                        max_deliver: -1,
                        max_ack_pending: -1,
                        max_waiting: 1 << 16,
                        ..pull::Config::default()
                    },
                )
                .await
                .map_err(|e| connection.lost(&e))?;
            let got = &consumer.cached_info().config;
            if got.ack_wait != self.lease || got.max_ack_pending != -1 {
                // Made by a coordinator with another lease: made anew; leased tasks come back, which costs time alone.
                stream.delete_consumer(CONSUMER).await.map_err(|e| connection.lost(&e))?;
                return Err(QueueError(format!(
                    "the consumer {CONSUMER} had leases of {} s; it was removed and will be made with {} s",
                    got.ack_wait.as_secs_f64(),
                    self.lease.as_secs_f64()
                )));
            }
            Ok(made)
        })
    }
}

impl QueueKeeper for NatsCoordinator {
    fn ensure(&self) -> Result<bool, QueueError> {
        let made = self.make();
        let made = made.map_err(|error| self.connection.explained(error))?;
        let mut seen = self.seen.lock().expect("no holder of this lock panics");
        Ok(seen.replace(made) != Some(made))
    }

    fn look(&self) -> Result<QueueState, QueueError> {
        let connection = &self.connection;
        RUNTIME.block_on(async {
            let stream = self.stream().await?;
            let info = stream.consumer_info(CONSUMER).await.map_err(|e| connection.lost(&e))?;
            Ok(QueueState { waiting: info.num_pending, held: info.num_ack_pending as u64 })
        })
    }

    fn scenes(&self) -> Result<BTreeSet<u32>, QueueError> {
        let connection = &self.connection;
        RUNTIME.block_on(async {
            let stream = self.stream().await?;
            let filter = format!("{}.span.>", connection.subjects);
            let mut subjects =
                stream.info_with_subjects(filter).await.map_err(|e| connection.lost(&e))?;
            let mut scenes = BTreeSet::new();
            while let Some((subject, _)) =
                subjects.try_next().await.map_err(|e| connection.lost(&e))?
            {
                let scene = subject.split('.').nth(3);
                scenes.extend(scene.and_then(|scene| scene.parse::<u32>().ok()));
            }
            Ok(scenes)
        })
    }

    fn publish(&self, messages: &[Message]) -> Result<(), QueueError> {
        RUNTIME.block_on(self.connection.publish(messages))
    }

    fn purge(&self) -> Result<(), QueueError> {
        RUNTIME.block_on(async {
            let stream = self.stream().await?;
            let purged = stream.purge().await;
            purged.map(|_| ()).map_err(|e| self.connection.lost(&e))
        })
    }

    fn remove(&self) -> Result<(), QueueError> {
        let connection = &self.connection;
        RUNTIME.block_on(async {
            let removed = connection.context.delete_stream(&connection.stream).await;
            removed.map(|_| ()).map_err(|e| connection.lost(&e))
        })
    }
}
