//! Queries the properties of a NATS server, for `glasshouse doctor`.

use super::QueueError;
use super::nats::{ANSWER, NatsOptions, cause, shown, within};
use async_nats::jetstream::context::{AccountErrorKind, Context, GetStreamErrorKind};
use async_nats::jetstream::stream::{Config, StorageType};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

#[derive(Debug)]
pub struct NatsFacts {
    pub version: String,
    /// Time of a round trip.
    pub answer: Duration,
    /// Usage and limits of the account, or the error. The error is `None` if no answer arrives, for example if the user
    /// lacks permission.
    pub account: Result<NatsAccount, Option<String>>,
    pub has_jetstream: bool,
    /// Creation time of a trial stream by the server's clock, with the times before and after by this machine's clock,
    /// or the error. `None` if the query of the account got no answer.
    pub made: Option<Result<(SystemTime, [SystemTime; 2]), String>>,
}

#[derive(Debug)]
pub struct NatsAccount {
    pub streams: usize,
    pub max_streams: Option<i64>,
    /// Bytes of all streams on the server's disk.
    pub storage_bytes: u64,
    pub max_storage_bytes: Option<i64>,
}

/// Connects once and queries the server. If it answers the query of the account, also makes and removes a small stream.
pub fn probe_nats(options: &NatsOptions) -> Result<NatsFacts, QueueError> {
    let (connect, servers) = (options.connect()?, options.servers()?);
    let connect = connect.request_timeout(Some(ANSWER));
    let client = match within(ANSWER, connect.connect(servers)) {
        None => return Err(QueueError::Away(format!("no answer from {}", shown(&options.url)))),
        Some(Err(error)) => return Err(QueueError::Away(cause(&options.url, &error))),
        Some(Ok(client)) => client,
    };
    let start = Instant::now();
    let flushed = within(ANSWER, client.flush());
    if !matches!(flushed, Some(Ok(()))) {
        return Err(QueueError::Away(format!("no answer from {}", shown(&options.url))));
    }
    let answer = start.elapsed();
    let mut context = {
        // The context spawns a task, which needs a runtime.
        let _runtime = crate::store::RUNTIME.enter();
        async_nats::jetstream::new(client.clone())
    };
    context.set_timeout(ANSWER);
    let account = account(&context);
    let name = format!(
        "GLASSHOUSE_DOCTOR_{}",
        options.name.replace(|c: char| !c.is_ascii_alphanumeric(), "_")
    );
    Ok(NatsFacts {
        version: client.server_info().version,
        answer,
        has_jetstream: account.is_ok() || knows_streams(&context, &name),
        made: (!matches!(account, Err(None))).then(|| make(&context, &name)),
        account,
    })
}

fn account(context: &Context) -> Result<NatsAccount, Option<String>> {
    match within(ANSWER + ANSWER, context.query_account()) {
        None => Err(None),
        Some(Err(error)) if error.kind() == AccountErrorKind::TimedOut => Err(None),
        Some(Err(error)) => Err(Some(error.to_string())),
        Some(Ok(account)) => Ok(NatsAccount {
            streams: account.streams,
            max_streams: account.limits.max_streams,
            storage_bytes: account.storage,
            max_storage_bytes: account.limits.max_storage,
        }),
    }
}

/// True if JetStream answers a lookup of a stream, which workers always have permission for. The error for an absent
/// stream is an answer, too.
fn knows_streams(context: &Context, name: &str) -> bool {
    match within(ANSWER, context.get_stream(name)) {
        Some(Err(error)) => {
            matches!(error.kind(), GetStreamErrorKind::JetStream(error) if error.code() == 404)
        }
        answer => answer.is_some(),
    }
}

fn make(context: &Context, name: &str) -> Result<(SystemTime, [SystemTime; 2]), String> {
    let config = Config {
        name: name.to_owned(),
        subjects: vec![format!("glasshouse.doctor.{name}")],
        storage: StorageType::Memory,
        max_messages: 1,
        max_bytes: 1024,
        ..Config::default()
    };
    let before = SystemTime::now();
    let stream = match within(ANSWER, context.create_stream(config)) {
        None => return Err("no answer in time".to_owned()),
        Some(Err(error)) => return Err(error.to_string()),
        Some(Ok(stream)) => stream,
    };
    let after = SystemTime::now();
    let nanoseconds = stream.cached_info().created.unix_timestamp_nanos();
    let since = Duration::from_nanos(u64::try_from(nanoseconds).unwrap_or(0));
    // If the removal fails, an empty stream remains. A later `doctor` rarely uses it again, because the client name
    // contains the process ID.
    let _ = within(ANSWER, context.delete_stream(name));
    Ok((UNIX_EPOCH + since, [before, after]))
}
