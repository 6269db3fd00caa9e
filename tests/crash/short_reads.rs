//! Reads that return a part of the bytes, and interrupted reads: results do not change.
//!
//! strace replaces a call, but does not shorten it. A preloaded library does, because the program reads through libc.

use super::disk::put_tree;
use super::phase::{phases, scratch};
use super::recording::can_trace;
use super::recovery::recovered;
use crate::support::program::command;
use crate::support::tools::{content, tool};
use std::path::Path;
use std::process::Command;

#[test]
fn short_and_interrupted_reads_change_no_result() {
    if !can_trace() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let library = folder.path().join("short_reads.so");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/crash/short_reads.c");
    let mut compiler = Command::new("cc");
    compiler.args(["-shared", "-fPIC", "-O1", "-o"]).arg(&library).arg(source).arg("-ldl");
    let Some(compiled) = tool(&mut compiler) else { return };
    content(&compiled);
    let file = folder.path().join("file");
    std::fs::write(&file, [7; 100]).unwrap();
    let mut dd = Command::new("dd");
    dd.args(["bs=100", "count=1"]).arg(format!("if={}", file.display()));
    let read = tool(dd.env("LD_PRELOAD", &library)).unwrap();
    assert_eq!(read.stdout.len(), 34, "the library shortens reads: {read:?}");
    for phase in phases() {
        let folder = scratch();
        put_tree(&phase.journal.before.tree(), folder.path());
        let mut command = command(&phase.arguments);
        let output = command.current_dir(folder.path()).env("LD_PRELOAD", &library).output();
        content(&output.unwrap());
        recovered(phase, folder.path()).unwrap();
    }
}
