//! Tests the shell completions, and the man page of every command.

use crate::support::program::{Ended, command, run, text};
use clap::CommandFactory;
use glasshouse::cli::Args;
use std::path::Path;
use std::process::{Command, Stdio};

/// Returns the names of all visible commands as in file names: `glasshouse`, `glasshouse-bench-error`, ...
fn names() -> Vec<String> {
    fn walk(command: &clap::Command, name: &str, names: &mut Vec<String>) {
        names.push(name.to_owned());
        for inside in command.get_subcommands().filter(|inside| !inside.is_hide_set()) {
            walk(inside, &format!("{name}-{}", inside.get_name()), names);
        }
    }
    let mut names = Vec::new();
    walk(&Args::command(), "glasshouse", &mut names);
    names
}

/// Runs a program; returns true if it succeeds, `None` if it is not installed.
fn accepts(program: &str, arguments: &[&str]) -> Option<bool> {
    let mut command = Command::new(program);
    let quiet = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let status = quiet.args(arguments).status();
    if status.is_err() {
        eprintln!("skipped: {program} is not installed");
    }
    status.ok().map(|status| status.success())
}

#[test]
fn shells_accept_their_completions() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = run(&["completions", shell]).expect(0).stdout;
        for name in ["glasshouse", "inspect"] {
            assert!(script.contains(name), "{shell}: {name}");
        }
        let json = run(&["completions", shell, "--json"]).expect(0).json();
        assert_eq!(json["schema"], "glasshouse.completions/1");
        assert_eq!(json["script"].as_str().unwrap().trim_end(), script.trim_end());
        let path = folder.path().join(shell);
        std::fs::write(&path, &script).unwrap();
        if let "bash" | "zsh" | "fish" = shell
            && let Some(accepted) = accepts(shell, &["-n", text(&path)])
        {
            assert!(accepted, "{shell} -n");
        }
    }
    run(&["completions", "tcsh"]).expect(2);
}

#[test]
fn bash_completes_commands_and_values() {
    let script = run(&["completions", "bash"]).expect(0).stdout;
    for (line, expected) in [
        ("insp", "inspect"),
        ("completions b", "bash"),
        ("bench er", "error"),
        ("work --checkpoint", "--checkpoint-s"),
    ] {
        let words: Vec<&str> = ["glasshouse"].into_iter().chain(line.split(' ')).collect();
        let ask = format!(
            "{script}\nCOMP_WORDS=({}); COMP_CWORD={}; _glasshouse glasshouse {:?} {:?}; echo \"${{COMPREPLY[*]}}\"",
            words.join(" "),
            words.len() - 1,
            words[words.len() - 1],
            words[words.len() - 2]
        );
        let output = Command::new("bash").args(["--norc", "-c", &ask]).output();
        let Ok(output) = output else {
            eprintln!("skipped: bash is not installed");
            return;
        };
        let offered = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            offered.split_whitespace().any(|word| word == expected),
            "{line}: {offered:?} {output:?}"
        );
    }
}

#[test]
fn every_command_has_a_man_page() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("man");
    let dry = run(&["man", "--out", text(&out), "-n", "--json"]).expect(0).json();
    assert!(!out.exists());
    let written = run(&["man", "--out", text(&out), "--json"]).expect(0).json();
    assert_eq!(written["schema"], "glasshouse.man/1");
    assert_eq!(written["pages"], dry["pages"]);
    let mut expected: Vec<String> = names().iter().map(|name| format!("{name}.1")).collect();
    let mut there: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    expected.sort();
    there.sort();
    assert_eq!(there, expected);
    let mut renders = true;
    for name in &there {
        let path = out.join(name);
        let page = std::fs::read_to_string(&path).unwrap();
        for part in [".TH ", ".SH NAME", ".SH SYNOPSIS", ".SH DESCRIPTION"] {
            assert!(page.contains(part), "{name}: no {part}");
        }
        assert!(page.contains("Examples:"), "{name}");
        renders = renders && render(&path);
    }
    let main = run(&["man"]).expect(0).stdout;
    assert_eq!(
        main.trim_end(),
        std::fs::read_to_string(out.join("glasshouse.1")).unwrap().trim_end()
    );
}

/// Formats a page with groff, and asserts that an example starts a line; returns false without groff.
fn render(path: &Path) -> bool {
    let output =
        Command::new("groff").args(["-man", "-Tutf8", "-ww", "-rLL=90n"]).arg(path).output();
    let Ok(output) = output else {
        eprintln!("skipped: groff is not installed");
        return false;
    };
    // Warnings are allowed: groff warns of examples that are longer than a line.
    let complaints = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && !complaints.contains("error"),
        "{}: {output:?}",
        path.display()
    );
    let text = String::from_utf8_lossy(&output.stdout);
    let example = |line: &str| line.trim_start().starts_with("glasshouse ");
    assert!(text.lines().any(example), "{}: {text}", path.display());
    true
}

#[test]
fn an_unwritable_folder_exits_with_1() {
    let ended: Ended = command(&["man", "--out", "/proc/x"]).output().unwrap().into();
    ended.expect(1).says(&["/proc/x"]);
}
