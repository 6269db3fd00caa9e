//! Checks shell scripts and environment files.

use super::launch_files;
use crate::support::tools::{content, tool};
use std::process::Command;

#[test]
fn bash_parses_the_scripts() {
    for script in launch_files(&[".sh", ".sbatch"]) {
        let Some(output) = tool(Command::new("bash").arg("-n").arg(&script)) else {
            return;
        };
        content(&output);
    }
}

#[test]
fn shellcheck_finds_no_problem() {
    let mut command = Command::new("shellcheck");
    if let Some(output) = tool(command.args(launch_files(&[".sh", ".sbatch"]))) {
        content(&output);
    }
}

/// Scripts that are called without arguments print their usage and exit with 2.
#[test]
fn scripts_print_their_usage() {
    for script in launch_files(&[".sh"]) {
        let Some(output) = tool(&mut Command::new(&script)) else {
            return;
        };
        assert_eq!(output.status.code(), Some(2), "{}", script.display());
        let said = String::from_utf8(output.stderr).unwrap();
        let name = script.file_name().unwrap().to_str().unwrap();
        assert!(said.contains(&format!("    {name} ")), "{said}");
        assert!(!said.contains("set -"), "{said}");
    }
}

/// A profile sets two variables and nothing else, so that shells, systemd and compose can read it.
#[test]
fn profiles_set_a_lease_and_arguments() {
    for profile in launch_files(&[".env"]) {
        let text = std::fs::read_to_string(&profile).unwrap();
        let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
        assert_eq!(lines.len(), 2, "{}", profile.display());
        let lease_s: f64 = lines[0]
            .strip_prefix("LEASE_S=")
            .and_then(|seconds| seconds.parse().ok())
            .unwrap_or_else(|| panic!("{}: {}", profile.display(), lines[0]));
        assert!((5.0..=600.0).contains(&lease_s));
        let arguments = lines[1].strip_prefix("WORK_ARGS=\"").unwrap();
        assert!(arguments.ends_with('"') && !arguments.contains(['$', '\\', '\'']));
    }
}
