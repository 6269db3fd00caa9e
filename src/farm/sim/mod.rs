//! A farm in virtual time.

mod queue;
