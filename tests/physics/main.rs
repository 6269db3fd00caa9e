//! The physics of the four layers against independent f64 code: vectors, explicit planes, brute force.
//!
//! Nothing here uses the closed forms of `src/trace` to check themselves: expected values come from a ray followed
//! face by face ([`optics`]), from a renderer that tries every triangle ([`reference`]), or from a formula on paper.

#![allow(clippy::print_stdout, reason = "measured deviations, shown by --nocapture")]
#![allow(clippy::items_after_statements, reason = "a test's constants stand where they are used")]

mod case;
mod checkerboard;
mod constant_depth;
mod furnace;
mod golden;
mod hard_cases;
mod invariance;
mod mesh;
mod optics;
mod pixels;
mod property;
mod reference;
mod sampler;
mod slab;
mod spot;
mod table;
