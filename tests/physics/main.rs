//! Compares the physics of the four layers with independent f64 code: vectors, explicit planes, brute force.
//!
//! No test checks the closed forms of `src/render/trace` against themselves: expected values come from a ray followed
//! face by face ([`optics`]), from a renderer that tries every triangle ([`reference`]), or from a separate formula.

#![allow(clippy::print_stdout, reason = "measured deviations, shown by --nocapture")]
#![allow(clippy::items_after_statements, reason = "constants of a test are next to their use")]

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
