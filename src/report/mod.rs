//! What a person looks at: one self-contained HTML page.

mod histogram;
mod html;
mod parameters;
mod training;

pub use html::{ReportError, write_report};
