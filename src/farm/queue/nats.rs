//! The queue on NATS JetStream: one work-queue stream per run, and one subject per task. `nats_worker` implements the
//! worker's side, `nats_coordinator` the coordinator's.
//!
//! A subject holds at most one message, so the stream is a set: the server refuses a message that it already has, and
//! the message counts as published. A worker that cannot do a task sends no NAK: it publishes the task with
//! [`Message::hops`] one higher and acknowledges the old message. So a second delivery usually means a lost worker.

use super::super::message::{write_message, write_subject};
use super::nats_diagnosis::Diagnosis;
use super::{Message, QueueError};
use crate::store::RUNTIME;
use async_nats::jetstream::{self, Context};
use async_nats::{Client, ConnectOptions, ServerAddr};
use futures_util::{StreamExt, TryStreamExt};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Name of the consumer that all workers share.
pub(super) const CONSUMER: &str = "work";
/// Longest time that the server may take to answer.
pub(super) const ANSWER: Duration = Duration::from_secs(5);
/// Time between two probes of an unreachable server.
pub(super) const PROBE_EVERY: Duration = Duration::from_secs(20);
/// Pause after a failed pull.
pub(super) const AWAY: Duration = Duration::from_millis(300);
/// Largest number of unconfirmed messages of one publication.
pub(super) const IN_FLIGHT: usize = 256;

#[derive(Clone, Debug, Default)]
pub struct NatsOptions {
    /// `nats://host:port` or `tls://…`, or several of these separated by commas. May include user and password.
    pub url: String,
    /// File with the seed of an nkey.
    pub nkey: Option<PathBuf>,
    /// File with a JWT and an nkey's seed, as `nsc` writes it.
    pub creds: Option<PathBuf>,
    /// PEM file of certificates to trust in addition to the system's.
    pub ca: Option<PathBuf>,
    /// The client's name in the server's logs.
    pub name: String,
}

fn invalid(what: &str, e: &dyn std::fmt::Display) -> QueueError {
    QueueError::Away(format!("{what}: {e}"))
}

impl NatsOptions {
    pub(super) fn servers(&self) -> Result<Vec<ServerAddr>, QueueError> {
        let servers = self.url.split(',').map(str::parse);
        let servers: Result<_, _> = servers.collect();
        servers.map_err(|e: std::io::Error| invalid(&shown(&self.url), &e))
    }

    pub(super) fn connect(&self) -> Result<ConnectOptions, QueueError> {
        let mut connect = ConnectOptions::new().name(&self.name).connection_timeout(ANSWER);
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

/// The last probe of an unreachable or unusable server.
pub(super) struct Probed {
    at: Instant,
    found: Diagnosis,
    /// True if the probe before found a hopeless cause, too.
    was_hopeless: bool,
}

/// A connection that never stops trying to reconnect.
pub(super) struct Connection {
    pub(super) client: Client,
    pub(super) context: Context,
    pub(super) run: [u8; 8],
    pub(super) stream: String,
    pub(super) subjects: String,
    /// Text of the connection's last event; `None` before the first event, and if the last event was a connection.
    pub(super) complaint: Arc<Mutex<Option<String>>>,
    pub(super) options: NatsOptions,
    pub(super) probed: Mutex<Option<Probed>>,
}

impl Connection {
    pub(super) fn open(options: &NatsOptions, run: [u8; 8]) -> Result<Self, QueueError> {
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
        // The context spawns a task, which needs a runtime.
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

    /// Replaces an error by its cause. The reconnecting client reports only "IO error" for a refused port, an unknown name and an
    /// untrusted certificate, so this function opens a second connection. A cause that two probes find, [`PROBE_EVERY`] apart, and
    /// that time cannot mend, ends the waiting: a server that starts may say such things for a moment.
    pub(super) fn explained(&self, error: QueueError) -> QueueError {
        let mut probed = self.probed.lock().expect("no holder of this lock panics");
        let is_due = probed.as_ref().is_none_or(|probed| probed.at.elapsed() >= PROBE_EVERY);
        if is_due {
            let found = self.diagnose();
            let was_hopeless = probed
                .as_ref()
                .is_some_and(|before| matches!(before.found, Diagnosis::Hopeless(_)));
            *probed = Some(Probed { at: Instant::now(), found, was_hopeless });
        }
        match probed.as_ref().map(|probed| (&probed.found, probed.was_hopeless)) {
            Some((Diagnosis::Hopeless(cause), true)) => QueueError::Hopeless(cause.clone()),
            Some((Diagnosis::Hopeless(cause) | Diagnosis::Away(cause), _)) => {
                QueueError::Away(cause.clone())
            }
            Some((Diagnosis::Fine, _)) | None => error,
        }
    }

    /// Returns an error that includes the last event of the connection, unless that event was a connection.
    pub(super) fn lost(&self, error: &dyn std::fmt::Display) -> QueueError {
        let said = self.complaint.lock().expect("no holder of this lock panics");
        QueueError::Away(match &*said {
            Some(said) => format!("{error} ({said})"),
            None => error.to_string(),
        })
    }

    pub(super) fn subject(&self, message: &Message) -> String {
        format!("{}.{}", self.subjects, write_subject(message))
    }

    /// Returns the part of a subject after the run's prefix.
    pub(super) fn local<'s>(&self, subject: &'s str) -> &'s str {
        let rest = subject.strip_prefix(self.subjects.as_str());
        rest.and_then(|rest| rest.strip_prefix('.')).unwrap_or(subject)
    }

    /// Publishes messages. Returns true if all are new.
    pub(super) async fn publish(&self, messages: &[Message]) -> Result<bool, QueueError> {
        futures_util::stream::iter(messages)
            .map(|message| async move {
                let bytes = write_message(self.run, message);
                let sent = self.context.publish(self.subject(message), bytes.into()).await;
                let acknowledged = match sent {
                    Ok(acknowledgement) => acknowledgement.await,
                    Err(error) => Err(error),
                };
                match acknowledged {
                    Ok(_) => Ok(true),
                    Err(error) if is_there_already(&error) => Ok(false),
                    Err(error) => Err(self.lost(&error)),
                }
            })
            .buffer_unordered(IN_FLIGHT)
            .try_fold(true, |all_new, is_new| async move { Ok(all_new && is_new) })
            .await
    }
}

/// Waits up to `limit` for the server; returns `None` if no answer arrives.
pub(super) fn within<T>(limit: Duration, answer: impl Future<Output = T>) -> Option<T> {
    // Tokio can create a timer only inside a runtime.
    RUNTIME.block_on(async { tokio::time::timeout(limit, answer).await.ok() })
}

/// Formats an error of a connection, with the URL and all causes.
pub(super) fn cause(url: &str, error: &dyn std::error::Error) -> String {
    use std::fmt::Write as _;
    let mut text = format!("{}: {error}", shown(url));
    let mut next = error.source();
    while let Some(cause) = next {
        if !text.contains(&cause.to_string()) {
            let _ = write!(text, ": {cause}");
        }
        next = cause.source();
    }
    text
}

/// Returns a URL without user and password.
pub(super) fn shown(url: &str) -> String {
    let servers = url.split(',').map(|server| match server.rsplit_once('@') {
        Some((before, host)) => {
            let scheme = before.split_once("://").map_or("nats", |(scheme, _)| scheme);
            format!("{scheme}://…@{host}")
        }
        None => server.to_owned(),
    });
    servers.collect::<Vec<_>>().join(",")
}

pub(super) fn is_there_already(error: &(dyn std::error::Error + 'static)) -> bool {
    let mut next = Some(error);
    while let Some(error) = next {
        if error.to_string().contains("maximum messages per subject exceeded") {
            return true;
        }
        next = error.source();
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passwords_are_not_shown() {
        assert_eq!(shown("nats://me:secret@host:4222"), "nats://…@host:4222");
        assert_eq!(shown("nats://a:4222,tls://u:p@b"), "nats://a:4222,tls://…@b");
    }
}
