//! Tells a NATS server that is away from one that can never hold the queue.

use super::nats::{ANSWER, Connection, cause, shown, within};
use async_nats::connection::State;
use async_nats::jetstream::context::{GetStreamErrorKind, RequestError, RequestErrorKind};
use async_nats::{ConnectErrorKind, ServerAddr};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

/// Least size of messages that the queue needs, bytes: descriptions of streams are its largest.
const LEAST_PAYLOAD: usize = 4096;
/// Time that a server of another protocol has to say something.
const GREETING: Duration = Duration::from_secs(1);

/// Why a call failed.
pub(super) enum Diagnosis {
    /// Nothing is wrong with server and connection: for example, the stream does not exist yet.
    Fine,
    /// The server may come back.
    Away(String),
    /// Time cannot mend it. The text has the remedy.
    Hopeless(String),
}

impl Connection {
    /// Asks the server why calls fail.
    pub(super) fn diagnose(&self) -> Diagnosis {
        if self.client.connection_state() == State::Connected {
            self.settings()
        } else {
            self.probe()
        }
    }

    /// Checks the settings of a connected server.
    fn settings(&self) -> Diagnosis {
        let server = shown(&self.options.url);
        let most = self.client.server_info().max_payload;
        if most < LEAST_PAYLOAD {
            return Diagnosis::Hopeless(format!(
                "{server} takes messages of at most {most} bytes: raise max_payload in its configuration to {LEAST_PAYLOAD} or more (the default is 1 MB)"
            ));
        }
        match within(ANSWER, self.context.get_stream(&self.stream)) {
            Some(Err(error)) => match error.kind() {
                // 404 is the answer for an absent stream.
                GetStreamErrorKind::JetStream(error) if error.code() == 404 => Diagnosis::Fine,
                GetStreamErrorKind::JetStream(error) if error.code() == 503 => {
                    without_jetstream(&server)
                }
                _ if has_no_responder(&error) => without_jetstream(&server),
                _ => Diagnosis::Fine,
            },
            Some(Ok(_)) | None => Diagnosis::Fine,
        }
    }

    /// Opens a second connection.
    fn probe(&self) -> Diagnosis {
        let (Ok(connect), Ok(servers)) = (self.options.connect(), self.options.servers()) else {
            return Diagnosis::Fine;
        };
        let server = shown(&self.options.url);
        let first = servers.first().cloned();
        let away = match within(ANSWER, connect.connect(servers)) {
            Some(Ok(_)) => return Diagnosis::Fine,
            Some(Err(error)) => match error.kind() {
                ConnectErrorKind::AuthorizationViolation | ConnectErrorKind::Authentication => {
                    return Diagnosis::Hopeless(format!(
                        "{server} refuses this user ({error}): give user and password in the address (nats://USER:PASSWORD@HOST), or a key with --queue-nkey or --queue-creds (in a farm with keys: set -a; . KEYS/queue.env)"
                    ));
                }
                _ => cause(&self.options.url, &error),
            },
            None => format!("no answer from {server}"),
        };
        match first.and_then(|first| other_protocol(&first)) {
            Some(greeting) => Diagnosis::Hopeless(format!(
                "{server} is not a NATS server: it says {greeting:?}; check host and port"
            )),
            None => Diagnosis::Away(away),
        }
    }
}

fn without_jetstream(server: &str) -> Diagnosis {
    Diagnosis::Hopeless(format!(
        "{server} runs without JetStream, which keeps the queue: start it with `nats-server -js`, or enable JetStream in its configuration (jetstream {{}})"
    ))
}

/// True if no server listens to the subjects of JetStream.
fn has_no_responder(error: &(dyn std::error::Error + 'static)) -> bool {
    let mut causes = std::iter::successors(Some(error), |cause| cause.source());
    causes.any(|cause| {
        let request = cause.downcast_ref::<RequestError>();
        request.is_some_and(|error| error.kind() == RequestErrorKind::NoResponders)
    })
}

/// Returns the first line of a server that does not greet as NATS does, even if it speaks only when it is asked.
fn other_protocol(server: &ServerAddr) -> Option<String> {
    let dialogue = async {
        let mut stream = TcpStream::connect((server.host(), server.port())).await.ok()?;
        let mut first = [0; 64];
        let mut read = tokio::time::timeout(GREETING, stream.read(&mut first)).await;
        if read.is_err() {
            stream.write_all(b"GET / HTTP/1.0\r\n\r\n").await.ok()?;
            read = tokio::time::timeout(GREETING, stream.read(&mut first)).await;
        }
        let said = String::from_utf8_lossy(&first[..read.ok()?.ok()?]).into_owned();
        let line = said.lines().next().unwrap_or_default().to_owned();
        (!line.is_empty() && !line.starts_with("INFO ")).then_some(line)
    };
    within(ANSWER, dialogue).flatten()
}
