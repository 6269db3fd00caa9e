//! Simulates a farm in virtual time, to measure the cost of sharing work among any number of workers.
//!
//! The simulator runs the worker's real state machine (`worker::tasks`). It models the code around the machine
//! (`driver.rs`, `idle.rs`), the queue's server (`queue.rs`, as measured on a real one), the store (flags of shards and
//! tuples), the tracer (a delay) and the network (a constant delay). Every random number is a hash of the seed and a
//! counter or an index, so equal cases have equal outcomes.
//!
//! ```text
//! case -> engine (events, faults) -> driver | server -> queue | coordinator -> store -> outcome
//! ```

mod bound;
#[cfg(test)]
mod byzantine;
mod case;
mod coordinator;
mod driver;
mod engine;
mod idle;
#[cfg(test)]
mod interleavings;
mod outcome;
mod queue;
#[cfg(test)]
mod seeds;
mod server;
mod state;
mod store;
#[cfg(test)]
mod tests;

pub use bound::lower_bound_s;
pub use case::{Case, Fault, Fleet, Rules, Work, some_workers};
pub use engine::simulate;
pub use outcome::{Messages, Outcome};
