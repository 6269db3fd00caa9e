//! A worker of the farm: it leases tasks (consecutive shards of a scene) from a queue until the run is over.
//!
//! ```text
//!            queue --- lease keeper (renews, donates, requests)
//!              |            |
//!   prefetch thread ---- machine (tasks/, one lock) ---- writer thread --- store
//!              |            |                                 ^
//!              +-- files -> compute threads (pool) -- orders -+
//! ```
//!
//! The state machine in [`tasks`] alone holds the states of tasks and their transitions. Threads report events to it
//! and perform its actions ([`core`]). Compute threads rarely wait: the prefetch thread leases tasks and reads files,
//! the writer stores results, and the lease keeper serves a shared queue. About one scene per compute thread is in
//! memory, the next ones are read meanwhile, and all threads share the last shards. At most 2 N + 1 encoded results of
//! N compute threads wait for the store: N in the channel, one per thread and one with the writer.

mod bell;
mod compute;
mod conflict;
mod control;
mod core;
pub(crate) mod costs;
mod jobs;
mod lease_keeper;
mod options;
mod partials;
mod poison;
mod pool;
mod prefetch;
mod sandbox;
mod stop;
mod tally;
pub(crate) mod tasks;
mod work;
mod writer;

pub use options::{Outcome, Sandbox, SandboxEnd, SharedQueue, WorkOptions};
pub(crate) use work::whole;
pub use work::{work, work_shared};
