//! From `--queue` and `--store` to a queue and a store.

use super::args::QueueArgs;
use super::exit_code::{Exit, Failure};
use crate::farm::Run;
use crate::farm::keys;
use crate::farm::queue::{NatsCoordinator, NatsOptions, NatsWorker};
use crate::store::{Store, StoreOptions};
use std::path::Path;

/// The run's store.
pub(super) fn store(run: &Path, args: &QueueArgs) -> Result<Store, Failure> {
    Ok(match &args.store {
        Some(address) => Store::open(address, &store_options(args))?,
        None => Store::local(run)?,
    })
}

fn store_options(args: &QueueArgs) -> StoreOptions {
    StoreOptions {
        patience: args.store_patience_s,
        ..super::store_env::store_options()
    }
}

/// Brings the run's rules to a machine that has only the store.
pub(super) fn fetch_run(run: &Path, args: &QueueArgs) -> Result<(), Failure> {
    match &args.store {
        None => Ok(()),
        Some(_) => fetch_run_from(run, &store(run, args)?),
    }
}

/// [`fetch_run`] from a store that is open.
pub(super) fn fetch_run_from(run: &Path, store: &Store) -> Result<(), Failure> {
    if run.join(keys::SPEC).exists() {
        return Ok(());
    }
    crate::atomic_file::create_dir(run)?;
    for key in [keys::MANIFEST, keys::SPEC] {
        let bytes = store.get(key)?.ok_or_else(|| {
            let error = anyhow::anyhow!(
                "{} holds no run yet (no {key}); start `glasshouse coordinate RUN --store …` first, then try again",
                store.name()
            );
            Failure::new(Exit::TryAgain, error)
        })?;
        crate::atomic_file::write(&run.join(key), &bytes)?;
    }
    Ok(())
}

/// Host and process.
pub(super) fn worker_name() -> String {
    format!("{}-{}", host_name(), std::process::id())
}

/// This machine.
pub(super) fn host_name() -> String {
    let host = rustix::system::uname();
    host.nodename().to_string_lossy().into_owned()
}

fn options(args: &QueueArgs, name: &str) -> Result<NatsOptions, Failure> {
    let url = args.queue.clone().ok_or_else(|| {
        let error = anyhow::anyhow!(
            "--queue URL is missing (or GLASSHOUSE_QUEUE): where is the NATS server?"
        );
        Failure::new(Exit::Usage, error)
    })?;
    Ok(NatsOptions {
        url,
        nkey: args.queue_nkey.clone(),
        creds: args.queue_creds.clone(),
        ca: args.queue_ca.clone(),
        name: name.to_owned(),
    })
}

/// A worker's end of the queue.
pub(super) fn worker(run: &Run, args: &QueueArgs, name: &str) -> Result<NatsWorker, Failure> {
    let options = options(args, name)?;
    let scenes = run.lines.len();
    Ok(NatsWorker::connect(
        &options,
        run.id(),
        scenes,
        args.lease_s,
    )?)
}

/// The coordinator's end of the queue.
pub(super) fn coordinator(run: &Run, args: &QueueArgs) -> Result<NatsCoordinator, Failure> {
    let options = options(args, "coordinator")?;
    Ok(NatsCoordinator::connect(&options, run.id(), args.lease_s)?)
}
