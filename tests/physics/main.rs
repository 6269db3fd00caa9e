//! Compares the physics of the four layers with independent f64 code, closed forms, published values and golden images.
//!
//! The closed forms of the glass in `src/render/trace` are compared with a ray followed face by face ([`optics`]).
//! Expected pixels come from formulas or from a brute-force renderer ([`reference`]). Other tests check invariances.

#![allow(clippy::print_stdout, reason = "measured deviations, shown by --nocapture")]
#![allow(clippy::items_after_statements, reason = "constants of a test are next to their use")]

mod bow;
mod case;
mod checkerboard;
mod constant_depth;
mod cover;
mod form;
mod furnace;
mod golden;
mod hard_cases;
mod invariance;
mod joined;
mod labels;
mod mesh;
mod optics;
mod pairs;
mod panes;
mod pixels;
mod property;
mod reference;
mod rough;
mod sampler;
mod sheet;
mod slab;
mod smudges;
mod spot;
mod stack;
mod table;
mod textured;
mod zones;
