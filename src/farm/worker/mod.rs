//! A worker of the farm: it leases tasks, shards in a row of one scene, from a queue until nothing is left.
//!
//! ```text
//!            queue --- lease keeper (renews, donates, requests)
//!              |            |
//!   prefetch thread ---- machine (tasks/, one lock) ---- writer thread --- store
//!              |            |                                 ^
//!              +-- files -> compute threads (pool) -- orders -+
//! ```
//!
//! The state of each task, and all transitions, are in [`tasks`] alone. Threads report events to it and do its actions
//! ([`core`]). Three threads wait so that no other has to: one leases tasks and reads their scenes' files, one writes encoded
//! results, and among other workers one keeps the leases. The others only compute. At most one scene per compute thread is in
//! memory, scene N + 1 is read while N is traced, and all threads share the last shards. At most 2 N + 1 encoded results, each
//! a partial or a tuple, wait for the store: one per thread in the channel, one with each thread and one with the writer.

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
