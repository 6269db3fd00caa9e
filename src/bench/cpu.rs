//! The processor's name, for the results of measurements.

pub use crate::doctor::cpu_name;

/// Returns ` on NAME`, or an empty string if the name is unknown.
pub fn on_cpu() -> String {
    cpu_name().map_or_else(String::new, |name| format!(" on {name}"))
}
