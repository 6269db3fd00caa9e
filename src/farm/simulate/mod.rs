//! A farm in virtual time: the cost of sharing work, for any number of workers.
//!
//! The worker's state machine (`worker::tasks`) is the one that ships. Modelled are the code that drives it
//! (`driver.rs`, `idle.rs`), the queue's server (`queue.rs`, as measured on a real one), the store (a bit for each shard), the
//! tracer (time passes) and the network (a constant delay). Every random number is a hash of the seed and a counter, so equal
//! cases have equal outcomes.
//!
//! ```text
//! case -> engine (events, faults) -> driver | server -> queue | coordinator -> store -> outcome
//! ```

mod bound;
mod case;
mod coordinator;
mod driver;
mod engine;
mod idle;
#[cfg(test)]
mod interleavings;
mod outcome;
mod queue;
mod server;
mod state;
mod store;
#[cfg(test)]
mod tests;

pub use bound::lower_bound_s;
pub use case::{Case, Fault, Fleet, Rules, Work, some_workers};
pub use engine::simulate;
pub use outcome::{Messages, Outcome};
