//! What a person looks at: one self-contained HTML page, to be opened from any disk and attached to a mail.
//!
//! `survey` reads what the run's store holds, once; each section is drawn by a file of its own (`glance`, `sheet`,
//! `errors`, `seconds`, `parameters`, `quarantine`, `training`, `evaluation`); `page` puts them together. A run that is half done has a
//! report, too, and what is damaged is named on it. Whatever the size of the run, the page stays within about 10 MB.

mod errors;
mod evaluation;
mod glance;
mod histogram;
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

pub use page::{Report, ReportError, write_report};
