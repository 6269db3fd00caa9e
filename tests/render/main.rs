//! Whole images: against an independent renderer, and against themselves in other cuts.

mod oracle;
