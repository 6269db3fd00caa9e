//! Hard cases: described scenes with an answer on paper, run as any other scenes are, then compared.
//!
//! ```text
//! file.rs      glasshouse.cases/1, a .toml: pictures in words, glass, lens, film, what is expected
//! picture.rs   pictures -> the bytes of real files, which a run reads like any photograph's
//! expect.rs    what is expected of a layer, and the few formulas that a number cannot stand for
//! ```

mod expect;
mod file;
mod picture;

pub use expect::{Expect, Measured};
pub use file::{CASES_SCHEMA, Case, CaseError, CaseFile, is_case_file};
pub use picture::{FileKind, Picture, Ramp};
