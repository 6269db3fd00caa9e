//! A worker of the farm.

pub(in crate::farm) mod costs;
pub(in crate::farm) mod tasks;
