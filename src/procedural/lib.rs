//! Procedural RGBD photographs of rooms, streets, squares and parks: inputs without downloads.
//!
//! The places have light, occlusion edges, depths from 0.5 m to 60 m, and the holes of a scanner. The seed determines
//! every byte on all machines and for any number of threads: the code uses no clock and no system mathematics library.
//!
//! ```text
//! listing -> room, furnish | outdoors, street -> model -> tiles    -> light -> render -> diode | places
//! (numbers)  (solids in a Builder)               (place)  (visibility) (soft)  (picture)  (files)
//! ```

mod bounds;
mod build;
mod camera;
mod cover;
mod daylight;
mod diode;
mod fittings;
mod furnish;
mod furniture;
mod garden;
#[cfg(test)]
mod golden;
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
mod texture;
mod tiles;
mod tone;
mod tree;

pub use camera::{intrinsics, places_intrinsics};
pub use cover::{CAMERA_ROW, CoverKind, CoverPicture, cover, cover_png};
pub use diode::{SampleError, SampleFiles, encode, write};
pub use listing::{Place, SamplePhotograph, listing};
pub use places::{PLACES_COLOR, PLACES_DEPTH, PlacesPhotograph, places_listing, write_places};
pub use render::{Rgbd, render, render_through};
