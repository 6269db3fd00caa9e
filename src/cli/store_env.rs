//! Settings of object stores and input files, from the environment and the command line.

use super::args::CacheArgs;
use crate::run::Run;
use crate::store::{Cache, Inputs, StoreOptions};
use std::time::Duration;

/// Prefixes of environment variables with settings of object stores.
const SETTINGS: [&str; 3] = ["AWS_", "GOOGLE_", "AZURE_"];
/// Unit of `--cache-gb`, bytes.
const GB: f64 = 1e9;

/// Reads credentials and endpoints from the variables that the stores' own tools use.
pub(super) fn store_options() -> StoreOptions {
    let settings = std::env::vars_os().filter_map(|(name, value)| {
        let (name, value) = (name.into_string().ok()?, value.into_string().ok()?);
        let known = SETTINGS.iter().any(|start| name.starts_with(start));
        known.then_some((name, value))
    });
    StoreOptions { settings: settings.collect(), ..StoreOptions::default() }
}

/// Returns a reader of input files without a cache, for all commands except `work`.
pub(super) fn inputs() -> Inputs {
    Inputs::new(store_options(), None)
}

/// Returns a worker's reader of input files. It retries a store for `patience`, and has a cache in the folder of `args`
/// or of the run, unless the cache's limit is 0.
pub(super) fn inputs_of(run: &Run, args: &CacheArgs, patience: Duration) -> Inputs {
    let folder = args.cache.clone();
    let folder = folder.unwrap_or_else(|| run.root().join("cache"));
    let limit_bytes = (args.cache_gb * GB) as u64;
    let cache = (limit_bytes > 0).then(|| Cache::new(folder, limit_bytes));
    Inputs::new(StoreOptions { patience, ..store_options() }, cache)
}
