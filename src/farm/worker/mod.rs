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
//! What a task's state is, and what follows on what, is in [`tasks`] alone. Threads tell it what happened and do what it
//! asks for ([`core`]). Three of them wait so that no other has to: one leases tasks and reads their scenes' files, one
//! writes what is encoded, and beside other workers one keeps the leases. The others compute, and nothing else. At most one
//! scene a compute thread is in memory, scene N + 1 is read while N is traced, and the last shards are shared by all
//! threads. Of results there wait for the store at most one a thread in the channel, one with each thread and one with the
//! writer, each a partial or a scene's tuple, encoded.

mod active_task;
mod compute;
mod conflict;
mod control;
mod core;
pub(in crate::farm) mod costs;
mod finished;
mod lease_keeper;
mod options;
mod partials;
mod poison;
mod pool;
mod prefetch;
mod sandbox;
mod stop;
mod tally;
pub(in crate::farm) mod tasks;
mod work;
mod work_log;
mod writer;

pub use options::{Outcome, SharedQueue, WorkOptions};
pub use sandbox::{Sandbox, SandboxEnd};
pub(in crate::farm) use work::whole;
pub use work::{work, work_shared, work_span};
