//! A farm in virtual time: what sharing work costs, for any number of workers.
//!
//! Real is the worker's state machine ([`tasks`](super::worker::tasks)); modelled are what drives it (`driver.rs`,
//! `idle.rs`), the queue's server (`queue.rs`, as its behaviour was measured), the store (a bit for each shard), the tracer
//! (time passes) and the network (a constant delay). Every number is drawn by a hash of the seed and a counter: equal cases
//! have equal outcomes.
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
mod store;
mod tally;
#[cfg(test)]
mod tests;

pub use bound::lower_bound_s;
pub use case::{Case, Fault, Fleet, Rules, Work, some_workers};
pub use engine::simulate;
pub use outcome::{Messages, Outcome};
pub use tally::Kind;
