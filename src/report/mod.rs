//! Writes the report: one self-contained HTML page that opens from any disk and can be attached to an e-mail.
//!
//! `survey` reads the run's status, the records of its tuples and the workers' logs; each section but the last has a
//! file (`glance`, `sheet`, `errors`, `seconds`, `parameters`, `quarantine`, `training`, `evaluation`); `page` joins
//! them. A half-finished run has a report, too. The report names damaged tuples. The page stays within about 10 MB for
//! a run of any size.

mod errors;
mod evaluation;
mod glance;
mod histogram;
mod label_picture;
mod noise_picture;
mod page;
mod parameters;
mod picture;
mod quarantine;
mod seconds;
mod sheet;
mod stages;
mod survey;
mod text;
mod training;

pub(crate) use page::is_report;
pub use page::{Report, ReportError, write_report};
