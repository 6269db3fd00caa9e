//! Checks the systemd units.

use super::launch_files;
use crate::support::program::PROGRAM;
use crate::support::tools::tool;
use std::process::Command;

#[test]
fn systemd_accepts_the_units() {
    // `systemd-analyze` requires existing programs, so copies of the units name the tested program.
    let folder = tempfile::tempdir().unwrap();
    let mut copies = Vec::new();
    for unit in launch_files(&[".service"]) {
        let text = std::fs::read_to_string(&unit).unwrap();
        let text = text
            .replace("ExecStart=glasshouse ", &format!("ExecStart={PROGRAM} "))
            .replace("ExecStart=nats-server ", &format!("ExecStart={PROGRAM} "));
        assert!(text.contains(PROGRAM), "{}", unit.display());
        let copy = folder.path().join(unit.file_name().unwrap());
        std::fs::write(&copy, text).unwrap();
        copies.push(copy);
    }
    let mut command = Command::new("systemd-analyze");
    command.args(["verify", "--man=no"]).args(&copies);
    let Some(output) = tool(&mut command) else {
        return;
    };
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    if said.contains("Failed to") && !said.contains("glasshouse-") {
        eprintln!("skipped: systemd-analyze does not work here: {said}");
        return;
    }
    // `systemd-analyze` reports an unknown key only as a warning.
    assert!(output.status.success(), "{said}");
    assert!(!said.contains("glasshouse-"), "{said}");
}
