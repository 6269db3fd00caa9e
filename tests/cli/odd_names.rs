//! No name of a file or in a file makes a command panic, lose its answer or send escape codes to the terminal.

use super::help::Instead::{DryRun, Parsed};
use super::help::{all_examples, instead, words};
use crate::support::outputs::copy_folder;
use crate::support::program::{Ended, command, run, text};
use crate::support::scenes::{photographs, place, scene};
use crate::support::workplace::workplace;
use clap::{Arg, CommandFactory};
use glasshouse::cli::Args;
use rayon::prelude::*;
use serde_json::json;
use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

/// A folder's name that is not UTF-8.
fn odd() -> &'static OsStr {
    OsStr::from_bytes(b"\xff\xfe")
}

fn is_path(argument: &Arg) -> bool {
    argument.get_value_parser().type_id() == clap::value_parser!(PathBuf).type_id()
}

/// Puts every argument of an example that is a path, according to clap, below `folder`.
fn below(folder: &Path, example: &[String]) -> Vec<OsString> {
    let mut command = Args::command();
    command.build();
    let mut command = &command;
    let mut words = Vec::new();
    let mut rest = example.iter();
    while let Some(inside) = rest.as_slice().first().and_then(|name| command.find_subcommand(name))
    {
        command = inside;
        words.extend(rest.next().map(OsString::from));
    }
    let positionals: Vec<&Arg> = command.get_positionals().collect();
    let (mut place, mut option) = (0, None);
    for word in rest {
        let argument: Option<&Arg> = if word.starts_with('-') {
            let is_it = |arg: &&Arg| {
                arg.get_long().is_some_and(|long| *word == format!("--{long}"))
                    || arg.get_short().is_some_and(|short| *word == format!("-{short}"))
            };
            option =
                command.get_arguments().find(is_it).filter(|arg| arg.get_action().takes_values());
            None
        } else if let Some(option) = option.take() {
            Some(option)
        } else {
            place += 1;
            positionals.get(place - 1).or(positionals.last()).copied()
        };
        match argument {
            Some(argument) if is_path(argument) => {
                // `--checkpoint NAME=FOLDER` has a name before its path.
                let (name, path) = match word.split_once('=') {
                    Some((name, path)) => (format!("{name}="), path),
                    None => (String::new(), word.as_str()),
                };
                let mut word = OsString::from(name);
                word.push(folder.join(path));
                words.push(word);
            }
            _ => words.push(word.into()),
        }
    }
    words
}

/// Asserts that a command ended by itself and answered with one JSON object.
fn assert_answered(ended: &Ended, line: &str) {
    assert!(ended.code.is_some_and(|code| code != 101), "{line}: {ended:#?}");
    assert!(!ended.stderr.contains("panicked"), "{line}: {ended:#?}");
    let answer = ended.json();
    // The answer of a command that succeeds has more than a schema.
    assert!(answer.as_object().unwrap().len() > 1, "{line}: {ended:#?}");
}

/// Returns the longest example of each command, which usually has the most paths.
fn longest_examples() -> Vec<String> {
    let mut longest: BTreeMap<Vec<String>, String> = BTreeMap::new();
    for line in all_examples().into_iter().filter(|line| !line.contains("--help")) {
        let root = Args::command();
        let (mut command, mut name) = (&root, Vec::new());
        while let Some(inside) =
            line.split(' ').nth(name.len()).and_then(|word| command.find_subcommand(word))
        {
            command = inside;
            name.push(inside.get_name().to_owned());
        }
        let known = longest.entry(name).or_default();
        if line.len() > known.len() {
            *known = line;
        }
    }
    longest.into_values().collect()
}

#[test]
fn every_command_works_in_a_folder_whose_name_is_not_text() {
    let mut tested: Vec<String> = longest_examples()
        .into_par_iter()
        .map(|line| {
            let original = workplace();
            let folder = tempfile::tempdir().unwrap();
            let place = folder.path().join(odd());
            copy_folder(original.path(), &place);
            // Tests with servers are elsewhere; here the server cannot be reached, and the run exists.
            let is_parsed = instead(&line) == Some(Parsed);
            let example = if is_parsed {
                line.replace(":4222", ":1").replace("runs/mine", "runs/smoke")
            } else {
                line.clone()
            };
            let mut words = words(&example, Path::new(""));
            for word in &mut words {
                // Arguments of --root are texts, so this folder has another name.
                if word == "diode=made" {
                    *word = format!("diode={}", original.path().join("made").display());
                }
            }
            let mut words = below(Path::new(odd()), &words);
            if instead(&line) == Some(DryRun) {
                words.push("-n".into());
            }
            words.extend((!line.contains("--json")).then(|| "--json".into()));
            let mut command = command(&words);
            command.current_dir(folder.path()).env("AWS_ENDPOINT_URL", "http://localhost:1");
            if is_parsed && line.starts_with("work") {
                // Without a server, a worker waits.
                command.args(["--time-limit", "1s"]);
            }
            let ended: Ended = command.output().unwrap().into();
            assert_answered(&ended, &line);
            let answer = ended.stdout.as_str();
            match ended.code {
                Some(0 | 3) => {}
                // The weights of this example are not shipped; tests/farm/pictures.rs has others.
                Some(4) if line.starts_with("depth ") => {
                    assert!(
                        answer.contains("model.safetensors: No such file"),
                        "{line}: {ended:#?}"
                    );
                }
                Some(4) => assert!(answer.contains("not UTF-8"), "{line}: {ended:#?}"),
                _ if line.starts_with("doctor") || is_parsed => {}
                _ => panic!("{line}: {ended:#?}"),
            }
            line.split_whitespace().next().unwrap().to_owned()
        })
        .collect();
    tested.sort();
    tested.dedup();
    // A new command is tested as soon as its help has an example, and another test requires one.
    let commands = Args::command();
    for name in commands.get_subcommands().filter(|c| !c.is_hide_set()).map(clap::Command::get_name)
    {
        assert!(tested.iter().any(|other| other == name), "{name} is not tested");
    }
}

#[test]
fn a_run_in_a_folder_whose_name_is_not_text_stays_there() {
    let place = place();
    let folder = place.folder.path().join(odd());
    std::fs::create_dir(&folder).unwrap();
    let run_of = |arguments: &[&OsStr]| -> Ended {
        command(arguments).current_dir(place.folder.path()).output().unwrap().into()
    };
    let out = Path::new(odd()).join("run");
    let work = |verb: &str| {
        run_of(&[verb.as_ref(), "small.toml".as_ref(), "--out".as_ref(), out.as_os_str()])
    };
    work("run").expect(0);
    let tuples = std::fs::read_dir(folder.join("run/tuples")).unwrap().count();
    assert_eq!(tuples, 4);
    // The store of the run is its folder, not another one with a similar name.
    let names = std::fs::read_dir(place.folder.path()).unwrap();
    let mut names: Vec<OsString> = names.map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, [OsStr::new("small.toml"), odd()]);

    // A plan would need the folder of these scenes, which JSON cannot hold.
    let photos = place.folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    photographs(&photos);
    copy_folder(&photos, &folder);
    let lines = folder.join("scenes.jsonl");
    std::fs::write(&lines, scene("one").to_string()).unwrap();
    let plan = [OsStr::new("plan"), lines.as_os_str(), "--out".as_ref(), "other".as_ref()];
    run_of(&plan).expect(4).says(&["scenes.jsonl", "not UTF-8", "--root manifest=LINK"]);
    assert!(!place.folder.path().join("other").exists());
}

/// A text that clears a terminal and changes its title and colours, and the same with one-byte escape codes.
const ESCAPES: &str = "x\u{1b}[2J\u{1b}]0;title\u{7}\u{9b}31m\u{202e}";

#[track_caller]
fn assert_clean(ended: &Ended) {
    for stream in [&ended.stdout, &ended.stderr] {
        let is_code = |c: char| c.is_control() && !"\n\t".contains(c);
        assert!(!stream.contains(is_code) && !stream.contains('\u{202e}'), "{ended:?}");
    }
}

#[test]
fn no_foreign_text_controls_the_terminal() {
    let place = place();
    let folder = place.folder.path();
    photographs(folder);
    let mut line = scene("one");
    line["front"]["color"] = json!(ESCAPES);
    let (lines, single) = (folder.join("scenes.jsonl"), folder.join("scene.json"));
    std::fs::write(&lines, line.to_string()).unwrap();
    std::fs::write(&single, line.to_string()).unwrap();
    std::fs::write(folder.join(ESCAPES), "not a picture").unwrap();
    let out = folder.join("out");
    let lines = ["plan", text(&lines), "--out", text(&out)];
    assert_clean(&run(&[&lines[..], &["--skip-invalid"]].concat()).expect(4));
    run(&lines).expect(0).says(&["x\u{fffd}[2J"]);
    for more in [&[][..], &["-n"], &["--json", "-n"]] {
        assert_clean(&run(&[&lines, more].concat()));
    }
    let out = text(&out);
    for arguments in [
        &["work", out][..],
        &["status", out],
        &["status", out, "--json"],
        &["explain", out, "one"],
        &["explain", out, "one", "--json"],
        &["merge", out],
        &["report", out],
        &["export", out, "--format", "pairs", "--out", text(&folder.join("exported"))],
        &["inspect", out],
        &["inspect", text(&folder.join(ESCAPES))],
        &["inspect", text(&folder.join(ESCAPES)), "--json"],
        &["render", text(&single), "--out", text(&folder.join("rendered"))],
        &["render", text(&single), "--out", text(&folder.join("rendered")), "--json"],
        &["status", text(&folder.join(ESCAPES))],
        &["status", out, &format!("--{ESCAPES}")],
        &["status", out, &format!("--{ESCAPES}"), "--json"],
    ] {
        assert_clean(&run(arguments));
    }

    // A run that another user prepared has any name.
    place.plan();
    let spec = place.run.join("spec.json");
    let old = std::fs::read_to_string(&spec).unwrap();
    let name = json!(format!("small{ESCAPES}")).to_string();
    std::fs::write(&spec, old.replacen("\"small\"", &name, 1)).unwrap();
    for arguments in [
        vec!["status", text(&place.run)],
        vec!["status", text(&place.run), "--json"],
        vec!["inspect", text(&place.run)],
        place.arguments("plan", &[]),
    ] {
        let ended = run(&arguments);
        assert!(format!("{}{}", ended.stdout, ended.stderr).contains("small"), "{ended:?}");
        assert_clean(&ended);
    }
}

#[test]
fn a_path_of_any_length_is_an_answer() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let mut line = scene("one");
    line["front"]["color"] = json!("x".repeat(65_534));
    let lines = folder.path().join("scenes.jsonl");
    std::fs::write(&lines, line.to_string()).unwrap();
    let out = folder.path().join("out");
    run(&["plan", text(&lines), "--out", text(&out)]).expect(0).says(&["cannot be used"]);
}
