//! Opens the queue of `--queue` and the store of `--store`.

use super::args::{QueueArgs, ServerArgs};
use super::exit_code::{Exit, Failure, failure};
use crate::farm::queue::{NatsCoordinator, NatsOptions, NatsWorker};
use crate::run::Run;
use crate::store::{Store, StoreOptions};
use std::path::Path;
use std::time::Duration;

pub(super) fn store(run: &Path, args: &QueueArgs) -> Result<Store, Failure> {
    let options =
        StoreOptions { patience: args.store_patience_s, ..super::store_env::store_options() };
    Ok(match &args.store {
        Some(address) => Store::open(address, &options)?,
        None => Store::local(run)?,
    })
}

/// Copies the run's spec and manifest from the store of `--store` into the folder `run`, unless the folder has a spec.
pub(super) fn fetch_run(run: &Path, args: &QueueArgs) -> Result<(), Failure> {
    match &args.store {
        None => Ok(()),
        Some(_) => super::target::fetch(run, &store(run, args)?),
    }
}

/// Returns a worker's default name: host and process id.
pub(super) fn worker_name() -> String {
    format!("{}-{}", host_name(), std::process::id())
}

pub(super) fn host_name() -> String {
    let host = rustix::system::uname();
    host.nodename().to_string_lossy().into_owned()
}

fn options(args: &QueueArgs, name: &str) -> Result<NatsOptions, Failure> {
    let url = args.queue.clone().ok_or_else(|| {
        failure!(
            Exit::Usage,
            "the NATS server is missing: give --queue URL or set GLASSHOUSE_QUEUE"
        )
    })?;
    Ok(args.keys.options(url, name.to_owned()))
}

/// Connects a worker to the queue.
pub(super) fn worker(run: &Run, args: &QueueArgs, name: &str) -> Result<NatsWorker, Failure> {
    let options = options(args, name)?;
    Ok(NatsWorker::connect(&options, run.id(), run.shard_counts(), args.lease_s)?)
}

/// Connects the coordinator to the queue.
pub(super) fn coordinator(run: &Run, args: &QueueArgs) -> Result<NatsCoordinator, Failure> {
    let options = options(args, "coordinator")?;
    Ok(NatsCoordinator::connect(&options, run.id(), run.shard_counts(), args.lease_s)?)
}

/// Connects to the queue in order to read its state; returns `None` without `--queue`.
pub(super) fn observer(run: &Run, args: &ServerArgs) -> Result<Option<NatsCoordinator>, Failure> {
    let Some(url) = args.queue.clone() else {
        return Ok(None);
    };
    let options = NatsOptions {
        url,
        nkey: args.queue_nkey.clone(),
        creds: args.queue_creds.clone(),
        ca: args.queue_ca.clone(),
        name: "status".to_owned(),
    };
    // This connection creates neither a stream nor a consumer, so it needs no lease.
    Ok(Some(NatsCoordinator::connect(&options, run.id(), run.shard_counts(), Duration::ZERO)?))
}
