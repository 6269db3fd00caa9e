//! Stage 1, *what*: a recipe (distributions) becomes a manifest (one resolved scene a line).

mod line;

pub use line::*;
