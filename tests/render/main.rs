//! Whole images: against an independent renderer, against photographs, and against themselves in other cuts.

mod oracle;
mod real;
mod real_sets;
