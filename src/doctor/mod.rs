//! `glasshouse doctor`: checks this machine and its connections to the store and the queue.
//!
//! ```text
//! machine (cores, kernels, memory, open files)    disk (space, speed, guarantees)    clock
//! golden (bits of the golden shard)               store, queue (answers and guarantees)
//! ```
//!
//! Every check returns one or more [`Finding`]s: a result, a level and possibly advice. The checks remove their files.

mod clock;
mod disk;
mod finding;
mod golden;
mod machine;
mod memory;
mod queue;
mod store;

pub use clock::check_clock;
pub use disk::{available_bytes, check_disk};
pub(crate) use finding::bytes_text;
pub use finding::{Finding, Level};
pub use golden::check_golden;
pub use machine::{check_cpu, check_open_files, cpu_name};
pub use memory::check_memory;
#[cfg(feature = "nats")]
pub use queue::check_queue;
pub use queue::judge_queue;
pub use store::check_store;
