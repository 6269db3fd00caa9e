//! The processor's name, which every benchmark result records.

/// Returns the model name, if known.
pub fn cpu_name() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// Returns ` on NAME`, or an empty string if the name is unknown.
pub fn on_cpu() -> String {
    cpu_name().map_or_else(String::new, |name| format!(" on {name}"))
}
