//! A farm in virtual time.

#[cfg(test)]
mod interleavings;
mod queue;
