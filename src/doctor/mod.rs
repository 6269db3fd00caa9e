//! Is this machine fit to work, and is the way to store and queue free? `glasshouse doctor`.
//!
//! ```text
//! machine (cores, kernels, memory, open files)    disk (space, speed, what a rename promises)    clock
//! golden (does it compute the right bits?)        store, queue (do they answer, and do as they must?)
//! ```
//!
//! Every check measures, judges, and says what to do: a [`Finding`]. Nothing that is written stays.

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
pub use machine::{check_cpu, check_open_files};
pub use memory::check_memory;
#[cfg(feature = "nats")]
pub use queue::check_queue;
pub use queue::judge_queue;
pub use store::check_store;
