//! Records the system calls of a command with strace.

use super::calls::parse;
use super::disk::Disk;
use super::journal::Journal;
use crate::support::program::PROGRAM;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::OnceLock;

/// Calls that change or sync files. `creat` is in the list so that the model can refuse it.
const TRACED: &str = "open,openat,creat,close,write,writev,pwrite64,ftruncate,lseek,fsync,fdatasync,sync,syncfs,mkdir,\
mkdirat,unlink,unlinkat,rmdir,rename,renameat,renameat2,link,linkat,dup,dup2,dup3,fcntl";

/// Makes a command that runs the program under strace with `options`, in `folder`, with a checkpoint per shard.
pub(crate) fn traced(options: &[&str], folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new("strace");
    command
        .args(["-f", "--seccomp-bpf", "-e", "signal=none"])
        .args(options)
        .arg(PROGRAM)
        .args(arguments)
        .env("GLASSHOUSE_CHECKPOINT_S", "0")
        .current_dir(folder)
        .stdin(Stdio::null());
    command
}

/// True if strace works here; prints a line otherwise.
pub(crate) fn can_trace() -> bool {
    static CAN: OnceLock<Option<String>> = OnceLock::new();
    let reason = CAN.get_or_init(|| {
        let mut trial = Command::new("strace");
        trial.args(["-f", "--seccomp-bpf", "-e", "trace=write", "-o", "/dev/null", "true"]);
        match trial.stdin(Stdio::null()).output() {
            Ok(output) if output.status.success() => None,
            Ok(output) => Some(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
            Err(error) => Some(error.to_string()),
        }
    });
    if let Some(reason) = reason {
        eprintln!("skipped: strace cannot trace ({reason})");
    }
    reason.is_none()
}

/// Runs a command in `folder`, which must end with 0, and returns all its changes there; `None` if the order of
/// simultaneous calls of its threads is unclear.
pub(crate) fn record(folder: &Path, arguments: &[&str]) -> Option<Journal> {
    let folder = folder.canonicalize().unwrap();
    let before = Disk::read(&folder);
    let logs = tempfile::tempdir().unwrap();
    let log = logs.path().join("log");
    let trace = format!("trace={TRACED}");
    let options = ["-xx", "-s", "1000000000", "-e", &trace, "-o", log.to_str().unwrap()];
    let output = traced(&options, &folder, arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    let journal = Journal::of(&folder, before, &parse(&std::fs::read_to_string(log).unwrap()));
    // The model has understood every call if it arrives at the content of the real disk.
    (journal.after.tree() == Disk::read(&folder).tree()).then_some(journal)
}
