//! Every command's help ends with examples, and every example works.

use crate::support::program::{Ended, command, run};
use crate::support::workplace::{run_in, workplace};
use clap::{CommandFactory, Parser};
use glasshouse::cli::Args;
use rayon::prelude::*;
use std::path::Path;

/// Treatment of an example that the test does not run unchanged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Instead {
    /// The test runs the example with `-n`.
    DryRun,
    /// The test only parses the example.
    Parsed,
}

use Instead::{DryRun, Parsed};

/// Examples that the test does not run unchanged, each with its treatment and the reason.
const NOT_RUN: &[(&str, Instead, &str)] = &[
    ("sample /tmp/places --layout places --count 68", DryRun, "is slow"),
    ("sample /tmp/many --layout places --count 4160 --width 32 --height 24", DryRun, "is slow"),
    ("coordinate runs/mine --queue nats://localhost:4222", Parsed, "needs a server"),
    ("work runs/mine --queue nats://localhost:4222", Parsed, "needs a server"),
    (
        "doctor --store s3://bucket/runs/mine --queue nats://localhost:4222",
        Parsed,
        "needs a bucket and a server",
    ),
    #[cfg(feature = "train")]
    ("train runs/smoke --stage backtrack --steps 200", DryRun, "is slow"),
    #[cfg(feature = "train")]
    ("train runs/smoke --stage separation --steps 200 --json", DryRun, "is slow"),
    #[cfg(feature = "train")]
    (
        "depth holiday --weights depth_anything_v2_vits.pth --out holiday-depth",
        Parsed,
        "needs weights that are not shipped",
    ),
    #[cfg(feature = "train")]
    (
        "depth rooms --weights model.safetensors --metric 20 --out rooms-depth --json",
        Parsed,
        "needs weights that are not shipped",
    ),
    ("bench error", DryRun, "measures for minutes"),
    (
        "bench error --scene scene.json --spp 1,4,16,64 --reference-spp 4096 --out error",
        DryRun,
        "measures for minutes",
    ),
    ("bench error --scene scene.json --reference out", DryRun, "measures for minutes"),
    ("bench trace", DryRun, "measures for minutes"),
    ("bench trace --scene scene.json --dump rays", DryRun, "measures for minutes"),
    ("bench farm", DryRun, "needs a server, and measures for minutes"),
    ("bench farm --makespan", DryRun, "needs a server, and measures for minutes"),
    ("bench farm --resume", DryRun, "measures for minutes"),
    ("bench recipe manifests/windows.toml", DryRun, "measures for minutes"),
    ("bench recipe manifests/windows.toml --spp 16 --by stage", DryRun, "measures for minutes"),
    (
        "bench recipe manifests/folder.toml --root photos=/data/holiday --scenes 100 --json",
        DryRun,
        "measures for minutes",
    ),
    ("bench compose", DryRun, "measures for seconds"),
    ("bench compose --size 128 -j 1 --json", DryRun, "measures for seconds"),
    #[cfg(feature = "train")]
    ("bench train -j 1", DryRun, "measures for minutes"),
    #[cfg(feature = "train")]
    ("bench train -j 1 --json --steps 3", DryRun, "measures for minutes"),
];

/// Returns "" (the program) and the names of all visible commands, each after its subcommands (such as `bench error`).
fn commands() -> Vec<String> {
    fn walk(command: &clap::Command, before: &str, names: &mut Vec<String>) {
        for inside in command.get_subcommands().filter(|inside| !inside.is_hide_set()) {
            let name = format!("{before}{}", inside.get_name());
            walk(inside, &format!("{name} "), names);
            names.push(name);
        }
    }
    let mut names = vec![String::new()];
    walk(&Args::command(), "", &mut names);
    assert!(names.iter().any(|name| name == "bench error"), "{names:?}");
    names
}

/// Returns the examples in a command's help, without the program's name, comments and redirections.
fn examples(name: &str) -> Vec<String> {
    let words: Vec<&str> = name.split_whitespace().chain(["--help"]).collect();
    let help = run(&words).expect(0).stdout;
    let (_, examples) = help
        .split_once("Examples:\n")
        .unwrap_or_else(|| panic!("the help of {name:?} has no examples: {help}"));
    let found: Vec<String> = examples
        .lines()
        .map(|line| line.split(['#', '>']).next().unwrap().trim())
        .filter(|line| !line.is_empty())
        .map(|line| {
            line.strip_prefix("glasshouse ")
                .unwrap_or_else(|| panic!("{name:?}: {line:?} does not run `glasshouse`"))
                .to_owned()
        })
        .collect();
    assert!(found.iter().any(|line| line.starts_with(name)), "{name}: {found:?}");
    found
}

/// Returns the treatment of an example, if the test does not run it unchanged.
pub(super) fn instead(line: &str) -> Option<Instead> {
    NOT_RUN.iter().find(|(other, ..)| *other == line).map(|(_, instead, _)| *instead)
}

/// Returns all examples without duplicates.
pub(super) fn all_examples() -> Vec<String> {
    let mut all: Vec<String> = commands().iter().flat_map(|name| examples(name)).collect();
    all.sort();
    all.dedup();
    all
}

/// Splits an example into words, and replaces `/data/diode` and paths in `/tmp` with paths in `folder`.
pub(super) fn words(line: &str, folder: &Path) -> Vec<String> {
    let of = |word: &str| match word.strip_prefix("/tmp/") {
        Some(name) => folder.join(name).display().to_string(),
        None if word == "diode=/data/diode" => format!("diode={}", folder.join("made").display()),
        None => word.to_owned(),
    };
    line.split_whitespace().map(of).collect()
}

#[test]
fn every_example_is_valid_and_every_exception_exists() {
    let all = all_examples();
    assert!(all.len() > commands().len(), "{} examples", all.len());
    for line in &all {
        let arguments = ["glasshouse"].into_iter().chain(line.split_whitespace());
        let parsed = Args::try_parse_from(arguments);
        let is_help = parsed.as_ref().err().map(clap::Error::kind)
            == Some(clap::error::ErrorKind::DisplayHelp);
        assert!(parsed.is_ok() || is_help, "{line}: {}", parsed.unwrap_err());
    }
    for (line, _, why) in NOT_RUN {
        assert!(all.iter().any(|other| other == line), "no help text has {line:?} ({why})");
    }
}

#[test]
fn examples_work() {
    all_examples().into_par_iter().for_each(|line| {
        let instead = instead(&line);
        if instead == Some(Parsed) {
            return;
        }
        let folder = workplace();
        let mut arguments = words(&line, folder.path());
        if instead == Some(DryRun) {
            arguments.push("-n".to_owned());
        }
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let ended = run_in(folder.path(), &arguments);
        // `doctor` may report that a slow or busy build machine is unfit.
        if line.starts_with("doctor") && ended.code == Some(1) {
            eprintln!("`{line}` finds this machine unfit: {}", ended.stdout);
            return;
        }
        assert_eq!(ended.code, Some(0), "glasshouse {line}: {ended:#?}");
        assert!(!ended.stdout.is_empty(), "glasshouse {line} prints nothing");
        if line.contains("--json") {
            ended.json();
        }
    });
}

#[test]
fn an_answer_lost_on_a_full_disk_is_a_failure() {
    let folder = workplace();
    let mut lines: Vec<String> = commands().iter().map(|name| format!("{name} --help")).collect();
    lines.push("--version".to_owned());
    let is_run = |line: &String| !NOT_RUN.iter().any(|(o, how, _)| o == line && *how == Parsed);
    let dry = |line: &String| [format!("{line} -n"), format!("{line} -n --json")];
    lines.extend(all_examples().iter().filter(|line| is_run(line)).flat_map(dry));
    lines.into_par_iter().for_each(|line| {
        let arguments = words(&line, folder.path());
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let mut command = command(&arguments);
        let ended: Ended = command.current_dir(folder.path()).stdout(full).output().unwrap().into();
        // The second of two --json is refused before the answer.
        if ended.code != Some(2) {
            assert_eq!(ended.code, Some(1), "glasshouse {line}: {ended:#?}");
            ended.says(&["the answer is incomplete", "No space left"]);
        }
    });
}

#[test]
fn help_and_version_exit_with_0() {
    let help = run(&["--help"]).expect(0);
    for name in commands().iter().filter(|name| !name.contains(' ')) {
        assert!(help.stdout.contains(name), "{name}");
    }
    assert!(help.stderr.is_empty());
    let version = run(&["--version"]).expect(0).stdout;
    assert_eq!(version.trim(), format!("glasshouse {}", env!("CARGO_PKG_VERSION")));
}
