//! Hard cases: described scenes with an answer on paper, run as any other scenes are, then compared.
//!
//! ```text
//! file.rs      glasshouse.cases/1, a .toml: pictures in words, glass, lens, film, what is expected
//! picture.rs   pictures -> the bytes of real files, which a run reads like any photograph's
//! expect.rs    what is expected of a layer, and the few formulas that a number cannot stand for
//! check.rs     the tuples and quarantine records of a run -> a table of expected and got
//! ```

mod check;
mod expect;
mod file;
mod picture;

pub use check::{CheckError, CheckRow, check, table};
pub use expect::Expect;
pub use file::{CASES_SCHEMA, Case, CaseError, CaseFile, is_case_file};
pub use picture::{FileKind, Picture, Ramp};
