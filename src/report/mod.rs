//! What a person looks at: one self-contained HTML page.

mod html;

pub use html::{ReportError, write_report};
