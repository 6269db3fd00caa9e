//! A farm in virtual time: what the rules of sharing work cost, for any number of workers.
//!
//! Real are [`Span`](super::Span), [`what_to_give`](super::what_to_give) and [`uncovered`](super::uncovered); modelled are
//! the worker (`holding.rs`, `worker.rs`), the queue's server (`queue.rs`, as its behaviour was measured), the store (a bit
//! for each shard), the tracer (time passes) and the network (a constant delay). Every number is drawn by a hash of the
//! seed and a counter: equal cases have equal outcomes.
//!
//! ```text
//! case -> engine (events, faults) -> worker | server -> queue | coordinator -> store -> outcome
//! ```

mod bound;
mod case;
mod coordinator;
mod engine;
mod holding;
#[cfg(test)]
mod interleavings;
mod outcome;
mod queue;
mod server;
mod store;
mod tally;
#[cfg(test)]
mod tests;
mod worker;

pub use bound::lower_bound_s;
pub use case::{Case, Fault, Fleet, Rules, Work, some_workers};
pub use engine::simulate;
pub use outcome::{Messages, Outcome};
pub use tally::{KINDS, Kind};
