//! Procedural RGBD photographs: rooms and streets for smoke runs, tests and benches.
//!
//! They look like places, not like noise: lit rooms and streets with occlusion edges, depths from
//! half a metre to sixty metres, and holes where a scanner has them. Every byte follows from the
//! seed: no clock, no thread count and no system mathematics library takes part.
//!
//! ```text
//! listing -> room | street -> model -> tiles -> light -> render -> diode | places
//! (which)    (what stands where)      (visible) (lit)   (picture)  (files)
//! ```

mod bounds;
mod build;
mod camera;
mod daylight;
mod diode;
mod fittings;
mod furniture;
mod garden;
mod hole;
mod light;
mod listing;
mod material;
mod model;
mod noise;
mod outdoors;
mod pattern;
mod places;
mod random;
mod render;
mod room;
mod shape;
mod sky;
mod street;
mod style;
mod tiles;
mod tone;
mod tree;

pub use camera::{intrinsics, places_intrinsics};
pub use diode::{SampleError, SampleFiles, encode, is_written, write};
pub use listing::{Place, SamplePhotograph, listing};
pub use places::{PLACES_COLOR, PLACES_DEPTH, PlacesPhotograph, places_listing, write_places};
pub use render::{Rgbd, render, render_through};
