//! Checks the documents: links work, every command and schema is described, the README's scene renders, the README's
//! figures name their commands, and every command line runs or is an exception with a reason.

use crate::document_pages::{page, pages};
use crate::not_run::{NOT_RUN, is_of};
use crate::support::outputs::copy_folder;
use crate::support::program::run;
use crate::support::workplace::{run_in, workplace};
use std::collections::BTreeSet;
use std::path::Path;

/// Returns the command names in the program's help.
fn commands() -> Vec<String> {
    let help = run(&["--help"]).expect(0).stdout;
    let (_, list) = help.split_once("Commands:\n").unwrap();
    let lines = list.lines().take_while(|line| !line.is_empty());
    lines
        // Continued lines are indented more.
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .map(|line| line.split_whitespace().next().unwrap().to_owned())
        .filter(|name| name != "help")
        .collect()
}

#[test]
fn every_command_is_described() {
    let page = page("docs/commands.md");
    let names = commands();
    assert!(names.len() > 15, "{names:?}");
    for name in names {
        let known = [format!("`glasshouse {name}`"), format!("`glasshouse {name} ")];
        assert!(
            known.iter().any(|text| page.text.contains(text)),
            "docs/commands.md does not describe {name}"
        );
    }
}

#[test]
fn links_have_targets() {
    let mut count = 0;
    for page in pages() {
        let folder = Path::new(&page.name).parent().unwrap().to_owned();
        for link in page.links() {
            if link.starts_with("https://") {
                continue;
            }
            count += 1;
            let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target =
                if file.is_empty() { Path::new(&page.name).to_owned() } else { folder.join(file) };
            let full = Path::new(env!("CARGO_MANIFEST_DIR")).join(&target);
            assert!(full.exists(), "{}: {link} has no target", page.name);
            if !anchor.is_empty() {
                let anchors = self::page(target.to_str().unwrap()).anchors();
                assert!(
                    anchors.contains(anchor),
                    "{}: {link}: the headings of that page are {anchors:?}",
                    page.name
                );
            }
        }
    }
    assert!(count > 60, "{count}");
}

#[test]
fn every_figure_of_the_readme_names_its_command() {
    let readme = page("README.md");
    let (_, numbers) = readme.text.split_once("\n## Numbers\n").unwrap();
    let (numbers, _) = numbers.split_once("\n## ").unwrap();
    let rows: Vec<&str> = numbers.lines().filter(|l| l.starts_with("| ")).collect();
    assert_eq!(rows.len(), 9, "a header and eight figures: {rows:?}");
    for row in &rows[1..] {
        let last = row.trim_end_matches(" |").rsplit(" | ").next().unwrap();
        assert!(last.contains('`'), "{row}");
    }
}

#[test]
fn the_scene_of_the_readme_renders() {
    let folder = tempfile::tempdir().unwrap();
    let readme = page("README.md");
    let (_, scene) = readme.text.split_once("```json\n").unwrap();
    let (scene, _) = scene.split_once("```").unwrap();
    std::fs::write(folder.path().join("scene.json"), scene).unwrap();
    for line in ["sample photos --count 2", "render scene.json --out window --json"] {
        assert!(readme.text.contains(line.trim_end_matches(" --json")));
        let words: Vec<&str> = line.split(' ').collect();
        run_in(folder.path(), &words).expect(0);
    }
    let tuple = folder.path().join("window/input.png");
    assert!(image_size(&tuple) == (256, 256));
}

fn image_size(path: &Path) -> (u32, u32) {
    image::image_dimensions(path).unwrap()
}

/// Commands that leave no files. The test runs them as they are, and adds `-n` to other commands.
const READ_ONLY: &[&str] = &["status", "explain", "doctor", "completions", "inspect"];

/// Adds to the workplace the files and folders that the documents' command lines name.
fn furnish(folder: &Path) {
    let run = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        run_in(folder, &words).expect(0);
    };
    run("sample data/diode --count 72 --width 32 --height 24");
    run("sample made-places --layout places --count 68 --width 32 --height 24");
    // This run has not started, so that it can be paused and resumed.
    run("plan my.toml --root diode=data/diode --out runs/mine");
    let link = |from: &str, to: &str| {
        let to = folder.join(to);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::os::unix::fs::symlink(folder.join(from), to).unwrap();
    };
    link("runs/smoke", "RUN");
    link("runs/smoke", "runs/many");
    link("runs/mine", "shared/runs/mine");
    link("runs/mine", "anywhere/mine");
    for to in ["shared/diode", "trial/diode"] {
        link("data/diode", to);
    }
    for (part, to) in
        [("data_256", "data/places"), ("depth", "data/places-depth"), ("depth", "data/depth")]
    {
        link(&format!("made-places/{part}"), to);
    }
    link("made-places", "trial/places");
    for to in ["SCENE.json", "FILE", "scenes.jsonl"] {
        link("scene.json", to);
    }
    std::fs::create_dir(folder.join("DIR")).unwrap();
    for to in ["PHOTOS", "data/holiday"] {
        link("holiday", to);
    }
    std::fs::create_dir(folder.join("theirs")).unwrap();
    let row = "1,own,real,pairs/blended/1.png,pairs/transmission_layer/1.png,yes";
    let index = format!("id,group,kind,blended,transmission,aligned\n{row}\n");
    std::fs::write(folder.join("pairs.csv"), index).unwrap();
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in [
        "paper.toml",
        "learn.toml",
        "learn-table.toml",
        "ablation.toml",
        "folder.toml",
        "pytorch.toml",
        "depth-ranges.toml",
    ] {
        let recipe = Path::new("manifests").join(name);
        std::fs::copy(repository.join(&recipe), folder.join(&recipe)).unwrap();
    }
    let weights = Path::new("docs/proof/weights");
    copy_folder(&repository.join(weights), &folder.join(weights));
    // These runs have tuples, but no networks.
    for to in ["RUN2", "RUN3"] {
        run(&format!("plan manifests/smoke.toml --out {to}"));
        run(&format!("work {to}"));
    }
}

/// Replaces placeholders and absolute paths of a command line, drops `--watch`, and adds `-n` or `--help` if necessary.
fn as_run(line: &str) -> Vec<String> {
    let line = line
        .replace("\"$GLASSHOUSE_QUEUE\"", "nats://one:4222")
        .replace("train-000412:3", "train-diode-000000:0")
        .replace("zhang=RUN3", "zhang=RUN")
        .replace("audit /shared/runs/mine", "audit RUN")
        .replace("train-sample-000002/", "train-sample-000000/")
        .replace("RUN SCENE", "RUN train-sample-000000")
        .replace("--scene SCENE", "--scene train-sample-000000")
        .replace("COMMAND --help", "status --help")
        .replace("-j N", "-j 2")
        .replace("--spp N", "--spp 16");
    let below = |word: &str| {
        let word = word.replace("=/data/", "=data/").replace("=/shared/", "=shared/");
        let is_absolute = ["/data/", "/shared/", "/tmp/"].iter().any(|p| word.starts_with(p));
        word[usize::from(is_absolute)..].to_owned()
    };
    let mut words: Vec<String> = line.split_whitespace().skip(1).map(below).collect();
    // A document that names a command without arguments refers to the command's help.
    if words.len() == 1 || words[0] == "bench" && words.len() == 2 {
        words.push("--help".to_owned());
    }
    let is_dry = words.iter().any(|w| ["-n", "--dry-run", "--help"].contains(&w.as_str()));
    if !READ_ONLY.contains(&words[0].as_str()) && !is_dry {
        words.push("-n".to_owned());
    }
    words.retain(|word| word != "--watch");
    words
}

#[test]
fn every_command_line_runs_or_is_listed() {
    let folder = workplace();
    furnish(folder.path());
    let mut needed = BTreeSet::new();
    let mut done = BTreeSet::new();
    let mut wrong = Vec::new();
    for page in pages() {
        for line in page.command_lines() {
            if let Some((pattern, _)) = NOT_RUN.iter().find(|(pattern, _)| is_of(pattern, &line)) {
                needed.insert(*pattern);
                continue;
            }
            if !done.insert(line.clone()) {
                continue;
            }
            if !line.starts_with("glasshouse ") {
                wrong.push(format!("{}: neither run nor listed: {line}", page.name));
                continue;
            }
            let words = as_run(&line);
            let words: Vec<&str> = words.iter().map(String::as_str).collect();
            let ended = run_in(folder.path(), &words);
            if ended.code != Some(0) {
                let said = ended.stderr.lines().next().unwrap_or_default().to_owned();
                wrong.push(format!("{}: {line}: {:?} {said}", page.name, ended.code));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(done.len() > 40, "{done:?}");
    for (pattern, _) in NOT_RUN {
        assert!(
            needed.contains(pattern),
            "`{pattern}` is listed as not run, but no document has it"
        );
    }
}

/// Adds the text of every Rust file below a folder to `found`.
fn sources(folder: &Path, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(std::fs::read_to_string(path).unwrap());
        }
    }
}

#[test]
fn every_schema_is_documented() {
    let documents = ["docs/formats.md", "docs/commands.md", "manifests/README.md", "docs/data.md"]
        .map(|name| page(name).text)
        .concat();
    let mut files = Vec::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    sources(&root.join("src"), &mut files);
    let mut names = BTreeSet::new();
    for text in &files {
        for part in text.split("\"glasshouse.").skip(1) {
            let name = part.split('"').next().unwrap();
            let (word, version) = name.rsplit_once('/').unwrap_or_default();
            let is_word = |c: char| c.is_ascii_lowercase() || "_.-".contains(c);
            if !word.is_empty() && word.chars().all(is_word) && version.parse::<u32>().is_ok() {
                names.insert(format!("glasshouse.{name}"));
            }
        }
    }
    assert!(names.len() > 20, "{names:?}");
    // Keys of random numbers, and versions that only tests use.
    for name in ["draw/1", "train.random/1", "scene/2", "control/2", "spec/9"] {
        assert!(names.remove(&format!("glasshouse.{name}")), "{name}");
    }
    let missing: Vec<_> = names.iter().filter(|n| !documents.contains(*n)).collect();
    assert!(missing.is_empty(), "not documented: {missing:?}");
}
