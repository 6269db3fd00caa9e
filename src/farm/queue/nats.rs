//! The queue on NATS JetStream: one work-queue stream a run, whose subjects are the spans.
//!
//! A subject holds one message at most, so the stream is a set: publishing what is in it is refused by the server, which
//! counts as done. Nothing is ever sent back (NAK): who cannot do a span publishes it anew under the next number of
//! [`Waiting::handed_on`] and acknowledges the old one. A second delivery therefore always means a lost holder.

use super::super::message::{GiveReply, GiveRequest, decode, encode, read_waiting, write_waiting};
use super::{Answer, Ask, Delivery, Queue, QueueError, QueueKeeper, QueueState, Taken, Waiting};
use crate::store::RUNTIME;
use async_nats::jetstream::consumer::{AckPolicy, PullConsumer, pull};
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, StorageType, Stream};
use async_nats::jetstream::{self, AckKind, Context, Message};
use async_nats::{Client, ConnectOptions, ServerAddr};
use crossbeam::channel::{Receiver, Sender, unbounded};
use futures_util::{StreamExt, TryStreamExt};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::task::JoinHandle;

/// The consumer that all workers share.
const CONSUMER: &str = "work";
/// The server answers within this time, or counts as gone for now.
const ANSWER: Duration = Duration::from_secs(5);
/// Between two connections tried by hand.
const PROBE_EVERY: Duration = Duration::from_secs(20);
/// Between two calls to a server that is away.
const AWAY: Duration = Duration::from_millis(300);
/// Messages on the way to the server at once.
const IN_FLIGHT: usize = 256;

/// How to reach a server.
#[derive(Clone, Debug, Default)]
pub struct NatsOptions {
    /// `nats://host:port`, `tls://…`, several with commas; user and password may stand in them.
    pub url: String,
    /// File with an nkey's seed.
    pub nkey: Option<PathBuf>,
    /// File with a JWT and an nkey's seed, as `nsc` writes it.
    pub creds: Option<PathBuf>,
    /// File with the certificates (PEM) to trust besides the system's.
    pub ca: Option<PathBuf>,
    /// Who connects, for the server's logs.
    pub name: String,
}

fn invalid(what: &str, e: &dyn std::fmt::Display) -> QueueError {
    QueueError(format!("{what}: {e}"))
}

impl NatsOptions {
    fn servers(&self) -> Result<Vec<ServerAddr>, QueueError> {
        let servers = self.url.split(',').map(str::parse);
        let servers: Result<_, _> = servers.collect();
        servers.map_err(|e: std::io::Error| invalid(&shown(&self.url), &e))
    }

    fn connect(&self) -> Result<ConnectOptions, QueueError> {
        let mut connect = ConnectOptions::new()
            .name(&self.name)
            .connection_timeout(ANSWER);
        if let Some(path) = &self.nkey {
            let seed = std::fs::read_to_string(path)
                .map_err(|e| invalid(&format!("the nkey {}", path.display()), &e))?;
            connect = connect.nkey(seed.trim().to_owned());
        }
        if let Some(path) = &self.creds {
            connect = RUNTIME
                .block_on(connect.credentials_file(path))
                .map_err(|e| invalid(&format!("the credentials {}", path.display()), &e))?;
        }
        if let Some(path) = &self.ca {
            std::fs::metadata(path)
                .map_err(|e| invalid(&format!("the certificates {}", path.display()), &e))?;
            connect = connect.add_root_certificates(path.clone());
        }
        Ok(connect)
    }
}

/// A connection that is made anew for ever.
struct Connection {
    client: Client,
    context: Context,
    run: [u8; 8],
    stream: String,
    subjects: String,
    /// What the server complained of last.
    complaint: Arc<Mutex<Option<String>>>,
    options: NatsOptions,
    /// When a connection was tried by hand, and what came of it.
    probed: Mutex<Option<(Instant, Option<String>)>>,
}

/// A worker's end.
pub struct NatsWorker {
    connection: Connection,
    scenes: usize,
    lease: Duration,
    consumer: Mutex<Option<PullConsumer>>,
    held: Mutex<BTreeMap<u64, Arc<Message>>>,
    asks: (Sender<Ask>, Receiver<Ask>),
    listener: Mutex<Option<JoinHandle<()>>>,
}

/// The coordinator's end.
pub struct NatsCoordinator {
    connection: Connection,
    lease: Duration,
    /// When the stream was made that was seen last.
    seen: Mutex<Option<i128>>,
}

impl Connection {
    fn open(options: &NatsOptions, run: [u8; 8]) -> Result<Self, QueueError> {
        let complaint: Arc<Mutex<Option<String>>> = Arc::default();
        let said = Arc::clone(&complaint);
        let connect = options
            .connect()?
            .retry_on_initial_connect()
            .max_reconnects(None)
            .request_timeout(Some(ANSWER))
            .event_callback(move |event| {
                let said = Arc::clone(&said);
                async move {
                    let text = match event {
                        async_nats::Event::Connected => None,
                        other => Some(other.to_string()),
                    };
                    *said.lock().expect("no holder of this lock panics") = text;
                }
            });
        let servers = options.servers()?;
        let client = RUNTIME
            .block_on(connect.connect(servers))
            .map_err(|e| invalid(&shown(&options.url), &e))?;
        // It starts a task of its own.
        let _runtime = RUNTIME.enter();
        let mut context = jetstream::new(client.clone());
        context.set_timeout(ANSWER);
        let [a, b, c, d, ..] = run;
        let hex = format!("{a:02x}{b:02x}{c:02x}{d:02x}");
        Ok(Self {
            client,
            context,
            run,
            stream: format!("GLASSHOUSE_{hex}"),
            subjects: format!("glasshouse.{hex}"),
            complaint,
            options: options.clone(),
            probed: Mutex::new(None),
        })
    }

    /// The same error with its cause: the client that tries for ever says only "IO error" of a refused port, a name that
    /// nobody knows and a certificate that nobody signed, so a connection is tried by hand.
    fn explained(&self, error: QueueError) -> QueueError {
        let connected = self.client.connection_state() == async_nats::connection::State::Connected;
        if connected {
            return error;
        }
        let mut probed = self.probed.lock().expect("no holder of this lock panics");
        let cause = match &*probed {
            Some((at, cause)) if at.elapsed() < PROBE_EVERY => cause.clone(),
            _ => {
                let cause = self.probe();
                *probed = Some((Instant::now(), cause.clone()));
                cause
            }
        };
        cause.map_or(error, QueueError)
    }

    fn probe(&self) -> Option<String> {
        use std::fmt::Write as _;
        let (connect, servers) = (self.options.connect().ok()?, self.options.servers().ok()?);
        let error = match within(ANSWER, connect.connect(servers)) {
            None => return Some(format!("no answer from {}", shown(&self.options.url))),
            Some(Ok(_)) => return None,
            Some(Err(error)) => error,
        };
        let mut text = format!("{}: {error}", shown(&self.options.url));
        let mut next = std::error::Error::source(&error);
        while let Some(cause) = next {
            if !text.contains(&cause.to_string()) {
                let _ = write!(text, ": {cause}");
            }
            next = cause.source();
        }
        Some(text)
    }

    /// An error with what the server said about it, if it said anything.
    fn lost(&self, error: &dyn std::fmt::Display) -> QueueError {
        let said = self
            .complaint
            .lock()
            .expect("no holder of this lock panics");
        QueueError(match &*said {
            Some(said) => format!("{error} ({said})"),
            None => error.to_string(),
        })
    }

    fn subject(&self, waiting: &Waiting) -> String {
        let Waiting { span, handed_on } = waiting;
        let (scene, shards) = (span.scene, &span.shards);
        format!(
            "{}.span.{scene}.{}-{}.{handed_on}",
            self.subjects, shards.start, shards.end
        )
    }

    async fn publish(&self, waiting: &[Waiting]) -> Result<(), QueueError> {
        futures_util::stream::iter(waiting)
            .map(|waiting| async move {
                let message = write_waiting(self.run, waiting);
                let sent = self
                    .context
                    .publish(self.subject(waiting), message.into())
                    .await;
                let acknowledged = match sent {
                    Ok(acknowledgement) => acknowledgement.await,
                    Err(error) => Err(error),
                };
                match acknowledged {
                    Ok(_) => Ok(()),
                    Err(error) if is_there_already(&error) => Ok(()),
                    Err(error) => Err(self.lost(&error)),
                }
            })
            .buffer_unordered(IN_FLIGHT)
            .try_for_each(|()| async { Ok(()) })
            .await
    }
}

/// Waits for the server, but not for ever.
fn within<T>(limit: Duration, answer: impl Future<Output = T>) -> Option<T> {
    // A timer needs the runtime around it when it is made.
    RUNTIME.block_on(async { tokio::time::timeout(limit, answer).await.ok() })
}

/// A URL without its password.
fn shown(url: &str) -> String {
    let servers = url.split(',').map(|server| match server.rsplit_once('@') {
        Some((before, host)) => {
            let scheme = before
                .split_once("://")
                .map_or("nats", |(scheme, _)| scheme);
            format!("{scheme}://…@{host}")
        }
        None => server.to_owned(),
    });
    servers.collect::<Vec<_>>().join(",")
}

/// The server refused a second message of a subject.
fn is_there_already(error: &(dyn std::error::Error + 'static)) -> bool {
    let mut next = Some(error);
    while let Some(error) = next {
        if error
            .to_string()
            .contains("maximum messages per subject exceeded")
        {
            return true;
        }
        next = error.source();
    }
    false
}

impl NatsWorker {
    /// Connects, now or later. `run`: first bytes of the spec's digest; `scenes`: of the manifest.
    pub fn connect(
        options: &NatsOptions,
        run: [u8; 8],
        scenes: usize,
        lease: Duration,
    ) -> Result<Self, QueueError> {
        Ok(Self {
            connection: Connection::open(options, run)?,
            scenes,
            lease,
            consumer: Mutex::default(),
            held: Mutex::default(),
            asks: unbounded(),
            listener: Mutex::default(),
        })
    }

    async fn consumer(&self) -> Result<PullConsumer, QueueError> {
        let known = self
            .consumer
            .lock()
            .expect("no holder of this lock panics")
            .clone();
        if let Some(consumer) = known {
            return Ok(consumer);
        }
        let connection = &self.connection;
        let stream = connection
            .context
            .get_stream_no_info(&connection.stream)
            .await
            .map_err(|e| connection.lost(&e))?;
        let found: PullConsumer = stream
            .get_consumer(CONSUMER)
            .await
            .map_err(|e| connection.lost(&format!("the run's queue is not there yet: {e}")))?;
        let lease = found.cached_info().config.ack_wait;
        if lease != self.lease {
            return Err(QueueError(format!(
                "its leases are {} s and this worker's {} s: give coordinator and workers the same --lease-s",
                lease.as_secs_f64(),
                self.lease.as_secs_f64()
            )));
        }
        *self.consumer.lock().expect("no holder of this lock panics") = Some(found.clone());
        Ok(found)
    }

    async fn pull(&self, wait: Duration) -> Result<Option<Message>, QueueError> {
        let consumer = self.consumer().await?;
        let pull = async {
            let mut batch = if wait.is_zero() {
                consumer.fetch().max_messages(1).messages().await?
            } else {
                let batch = consumer.batch().max_messages(1);
                batch.expires(wait).messages().await?
            };
            match batch.next().await {
                Some(Ok(message)) => Ok(Some(message)),
                Some(Err(error)) => Err(error),
                None => Ok(None),
            }
        };
        match tokio::time::timeout(wait + ANSWER, pull).await {
            Ok(Ok(message)) => Ok(message),
            Ok(Err(error)) => Err(self.connection.lost(&error)),
            Err(_) => Err(self.connection.lost(&"no answer")),
        }
    }

    fn held(&self, ticket: u64) -> Option<Arc<Message>> {
        let held = self.held.lock().expect("no holder of this lock panics");
        held.get(&ticket).cloned()
    }
}

impl Queue for NatsWorker {
    fn take(&self, wait: Duration) -> Taken {
        let message = match RUNTIME.block_on(self.pull(wait)) {
            Ok(Some(message)) => message,
            Ok(None) => return Taken::Nothing,
            Err(error) => {
                *self.consumer.lock().expect("no holder of this lock panics") = None;
                std::thread::sleep(AWAY);
                return Taken::Lost(self.connection.explained(error).0);
            }
        };
        let (deliveries, ticket) = match message.info() {
            Ok(info) => (info.delivered, info.stream_sequence),
            Err(error) => return Taken::Lost(error.to_string()),
        };
        match read_waiting(&message.payload, self.connection.run, self.scenes) {
            Ok(Some(waiting)) => {
                let delivery = Delivery {
                    ticket,
                    waiting,
                    suspect: deliveries > 1,
                };
                let mut held = self.held.lock().expect("no holder of this lock panics");
                held.insert(ticket, Arc::new(message));
                Taken::Span(delivery)
            }
            // Of another version, or damaged: left for who knows it, out of the way for a while.
            Ok(None) => leave(&message, "a message does not belong to this run"),
            Err(error) => leave(&message, &error.to_string()),
        }
    }

    fn publish(&self, waiting: &[Waiting]) -> Result<(), QueueError> {
        RUNTIME.block_on(self.connection.publish(waiting))
    }

    fn renew(&self, ticket: u64) {
        if let Some(message) = self.held(ticket) {
            // If it is lost the lease ends, which costs time alone.
            let _ = RUNTIME.block_on(message.ack_with(AckKind::Progress));
        }
    }

    fn finish(&self, ticket: u64) {
        if let Some(message) = self.held(ticket) {
            // Who cannot tell the server goes on: the span comes back and is found done.
            let _ = within(ANSWER, message.double_ack());
            let mut held = self.held.lock().expect("no holder of this lock panics");
            held.remove(&ticket);
        }
    }

    fn ask(&self, load_s: Option<f64>) -> Answer {
        let subject = format!("{}.give", self.connection.subjects);
        let question = encode(&GiveRequest::new(load_s));
        let request = self.connection.client.request(subject, question.into());
        // Who asks keeps leases, too.
        let answer = within(ANSWER.min(self.lease / 3), request);
        match answer {
            Some(Ok(answer)) => {
                let reply = decode::<GiveReply>(&answer.payload);
                reply.map(GiveReply::answer).unwrap_or_default()
            }
            // Nobody may be asked, or the server is away.
            Some(Err(_)) | None => Answer::default(),
        }
    }

    fn offer(&self, able: bool) {
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
        let asks = self.asks.0.clone();
        *listener = Some(RUNTIME.spawn(async move {
            let Ok(mut questions) = client.queue_subscribe(subject, "give".to_owned()).await else {
                return;
            };
            while let Some(question) = questions.next().await {
                let Some(reply) = question.reply else {
                    continue;
                };
                let client = client.clone();
                let request = decode::<GiveRequest>(&question.payload);
                let ask = Ask {
                    load_s: request.ok().and_then(GiveRequest::load_s),
                    tell: Box::new(move |answer| {
                        let answer = encode(&GiveReply::new(answer));
                        let _ = RUNTIME.block_on(client.publish(reply, answer.into()));
                    }),
                };
                if asks.send(ask).is_err() {
                    return;
                }
            }
        }));
    }

    fn asked(&self, wait: Duration) -> Option<Ask> {
        self.asks.1.recv_timeout(wait).ok()
    }
}

fn leave(message: &Message, reason: &str) -> Taken {
    let delay = AckKind::Nak(Some(Duration::from_mins(1)));
    let _ = RUNTIME.block_on(message.ack_with(delay));
    Taken::Lost(reason.to_owned())
}

impl Drop for NatsWorker {
    fn drop(&mut self) {
        self.offer(false);
        let client = self.connection.client.clone();
        let _ = within(Duration::from_secs(1), client.flush());
    }
}

impl NatsCoordinator {
    /// Connects, now or later.
    pub fn connect(
        options: &NatsOptions,
        run: [u8; 8],
        lease: Duration,
    ) -> Result<Self, QueueError> {
        Ok(Self {
            connection: Connection::open(options, run)?,
            lease,
            seen: Mutex::new(None),
        })
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
        connection
            .context
            .get_stream(&connection.stream)
            .await
            .map_err(|e| connection.lost(&e))
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
                // Made by a coordinator with another lease: made anew; held spans come back, which costs time alone.
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
            let info = stream
                .consumer_info(CONSUMER)
                .await
                .map_err(|e| connection.lost(&e))?;
            Ok(QueueState {
                waiting: info.num_pending,
                held: info.num_ack_pending as u64,
            })
        })
    }

    fn scenes(&self) -> Result<BTreeSet<u32>, QueueError> {
        let connection = &self.connection;
        RUNTIME.block_on(async {
            let stream = self.stream().await?;
            let filter = format!("{}.span.>", connection.subjects);
            let mut subjects = stream
                .info_with_subjects(filter)
                .await
                .map_err(|e| connection.lost(&e))?;
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

    fn publish(&self, waiting: &[Waiting]) -> Result<(), QueueError> {
        RUNTIME.block_on(self.connection.publish(waiting))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passwords_are_not_shown() {
        assert_eq!(shown("nats://me:secret@host:4222"), "nats://…@host:4222");
        assert_eq!(
            shown("nats://a:4222,tls://u:p@b"),
            "nats://a:4222,tls://…@b"
        );
    }
}
