//! A worker's side of the queue on NATS JetStream.

use super::super::message::{
    read_answer, read_delivered, read_request, write_answer, write_request,
};
use super::nats::{ANSWER, AWAY, CONSUMER, Connection, NatsOptions, within};
use super::{Answer, Lease, Message, Queue, QueueError, Request, Taken};
use crate::store::RUNTIME;
use async_nats::jetstream::consumer::PullConsumer;
use async_nats::jetstream::{self, AckKind};
use crossbeam::channel::{Receiver, Sender, unbounded};
use futures_util::StreamExt;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::task::JoinHandle;

pub struct NatsWorker {
    connection: Connection,
    /// Number of shards of each scene.
    shards: Vec<u32>,
    lease: Duration,
    consumer: Mutex<Option<PullConsumer>>,
    held: Mutex<BTreeMap<u64, Arc<jetstream::Message>>>,
    requests: (Sender<Request>, Receiver<Request>),
    listener: Mutex<Option<JoinHandle<()>>>,
}

impl NatsWorker {
    /// Connects now, or once the server can be reached. `run`: start of the spec's digest; `shards`: number of shards of each scene.
    pub fn connect(
        options: &NatsOptions,
        run: [u8; 8],
        shards: Vec<u32>,
        lease: Duration,
    ) -> Result<Self, QueueError> {
        Ok(Self {
            connection: Connection::open(options, run)?,
            shards,
            lease,
            consumer: Mutex::default(),
            held: Mutex::default(),
            requests: unbounded(),
            listener: Mutex::default(),
        })
    }

    async fn consumer(&self) -> Result<PullConsumer, QueueError> {
        let known = self.consumer.lock().expect("no holder of this lock panics").clone();
        if let Some(consumer) = known {
            return Ok(consumer);
        }
        let connection = &self.connection;
        let stream = connection.context.get_stream_no_info(&connection.stream).await;
        let stream = stream.map_err(|e| connection.lost(&e))?;
        let found = stream.get_consumer(CONSUMER).await;
        let found: PullConsumer = found
            .map_err(|e| connection.lost(&format!("the run's queue does not exist yet: {e}")))?;
        let lease = found.cached_info().config.ack_wait;
        if lease != self.lease {
            return Err(QueueError::Away(format!(
                "the queue's leases last {} s and this worker's {} s: give coordinator and workers the same --lease-s",
                lease.as_secs_f64(),
                self.lease.as_secs_f64()
            )));
        }
        *self.consumer.lock().expect("no holder of this lock panics") = Some(found.clone());
        Ok(found)
    }

    async fn pull(&self, wait: Duration) -> Result<Option<jetstream::Message>, QueueError> {
        let consumer = self.consumer().await?;
        let pull = async {
            let mut batch = if wait.is_zero() {
                consumer.fetch().max_messages(1).messages().await?
            } else {
                consumer.batch().max_messages(1).expires(wait).messages().await?
            };
            batch.next().await.transpose()
        };
        match tokio::time::timeout(wait + ANSWER, pull).await {
            Ok(Ok(message)) => Ok(message),
            Ok(Err(error)) => Err(self.connection.lost(&error)),
            Err(_) => Err(self.connection.lost(&"no answer")),
        }
    }

    fn held(&self, lease: u64) -> Option<Arc<jetstream::Message>> {
        let held = self.held.lock().expect("no holder of this lock panics");
        held.get(&lease).cloned()
    }
}

impl Queue for NatsWorker {
    fn take(&self, wait: Duration) -> Taken {
        let delivered = match RUNTIME.block_on(self.pull(wait)) {
            Ok(Some(message)) => message,
            Ok(None) => return Taken::Nothing,
            Err(error) => {
                *self.consumer.lock().expect("no holder of this lock panics") = None;
                std::thread::sleep(AWAY);
                return Taken::Lost(self.connection.explained(error));
            }
        };
        let (deliveries, id) = match delivered.info() {
            Ok(info) => (info.delivered, info.stream_sequence),
            Err(error) => return Taken::Lost(QueueError::Away(error.to_string())),
        };
        let connection = &self.connection;
        let subject = connection.local(&delivered.subject);
        match read_delivered(subject, &delivered.payload, connection.run, &self.shards) {
            Ok(message) => {
                let lease = Lease { id, message, redelivered: deliveries > 1 };
                let mut held = self.held.lock().expect("no holder of this lock panics");
                held.insert(id, Arc::new(delivered));
                Taken::Lease(lease)
            }
            Err(reason) => {
                // Left in the queue, the message would stand for its scene for ever. If the answer is lost, the server
                // delivers it again, and the next worker removes it.
                let _ = within(ANSWER, delivered.double_ack());
                Taken::Removed(reason)
            }
        }
    }

    fn publish(&self, messages: &[Message]) -> Result<bool, QueueError> {
        RUNTIME.block_on(self.connection.publish(messages))
    }

    fn renew(&self, lease: u64) {
        if let Some(message) = self.held(lease) {
            // If renewals are lost, the lease expires, which only costs time.
            let _ = RUNTIME.block_on(message.ack_with(AckKind::Progress));
        }
    }

    fn finish(&self, lease: u64) {
        if let Some(message) = self.held(lease) {
            // If the server cannot be reached, it delivers the task again later, which only costs time.
            let _ = within(ANSWER, message.double_ack());
            let mut held = self.held.lock().expect("no holder of this lock panics");
            held.remove(&lease);
        }
    }

    fn request(&self, load_s: Option<f64>) -> Answer {
        let subject = format!("{}.give", self.connection.subjects);
        let request = self.connection.client.request(subject, write_request(load_s).into());
        // This thread also renews leases, so it must not wait for long.
        match within(ANSWER.min(self.lease / 3), request) {
            Some(Ok(answer)) => read_answer(&answer.payload).unwrap_or_default(),
            // No worker listens, or the server cannot be reached.
            Some(Err(_)) | None => Answer::default(),
        }
    }

    fn accept_requests(&self, able: bool) {
        let mut listener = self.listener.lock().expect("no holder of this lock panics");
        if !able {
            if let Some(task) = listener.take() {
                task.abort();
            }
            return;
        }
        if listener.as_ref().is_some_and(|task| !task.is_finished()) {
            return;
        }
        let client = self.connection.client.clone();
        let subject = format!("{}.give", self.connection.subjects);
        let requests = self.requests.0.clone();
        *listener = Some(RUNTIME.spawn(async move {
            let Ok(mut questions) = client.queue_subscribe(subject, "give".to_owned()).await else {
                return;
            };
            while let Some(question) = questions.next().await {
                let Some(reply) = question.reply else {
                    continue;
                };
                let client = client.clone();
                let load_s = read_request(&question.payload).ok().flatten();
                let tell = Box::new(move |answer| {
                    let answer = write_answer(answer).into();
                    let _ = RUNTIME.block_on(client.publish(reply, answer));
                });
                if requests.send(Request { load_s, tell }).is_err() {
                    return;
                }
            }
        }));
    }

    fn requested(&self, wait: Duration) -> Option<Request> {
        self.requests.1.recv_timeout(wait).ok()
    }
}

impl Drop for NatsWorker {
    fn drop(&mut self) {
        self.accept_requests(false);
        let client = self.connection.client.clone();
        let _ = within(Duration::from_secs(1), client.flush());
    }
}
