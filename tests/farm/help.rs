//! The examples in every command's help are command lines that are understood.

use crate::program::{command, run};
use crate::scenes::{photographs, scene};
use std::path::Path;

const COMMANDS: &[&str] = &[
    "run",
    "sample",
    "plan",
    "render",
    "work",
    "merge",
    "status",
    "pause",
    "resume",
    "cancel",
    "retry",
    "explain",
    "audit",
    #[cfg(feature = "train")]
    "evaluate",
    #[cfg(feature = "train")]
    "separate",
    "export",
    "report",
    "bench",
    "bench error",
    "bench farm",
    "bench trace",
    "bench train",
    "train",
];

/// The example command lines of a command's help, without comments.
fn examples(name: &str) -> Vec<String> {
    let words: Vec<&str> = name.split(' ').chain(["--help"]).collect();
    let help = run(&words).expect(0).stdout;
    let (_, examples) = help
        .split_once("Examples:\n")
        .unwrap_or_else(|| panic!("no examples in {help}"));
    let lines = examples
        .lines()
        .map(|l| l.split('#').next().unwrap().trim());
    let found: Vec<String> = lines
        .filter(|l| !l.is_empty())
        .map(|l| {
            l.strip_prefix("glasshouse ")
                .unwrap_or_else(|| panic!("{l}"))
                .to_owned()
        })
        .collect();
    assert!(!found.is_empty());
    for line in &found {
        assert!(line.starts_with(name), "{line}");
    }
    found
}

/// A folder in which the files that the examples name are there.
fn workplace(folder: &Path) {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    std::fs::create_dir(folder.join("manifests")).unwrap();
    std::fs::copy(
        repository.join("manifests/smoke.toml"),
        folder.join("manifests/smoke.toml"),
    )
    .unwrap();
    photographs(folder);
    std::fs::write(folder.join("scene.json"), scene("one").to_string()).unwrap();
    let recipe = std::fs::read_to_string(folder.join("manifests/smoke.toml")).unwrap();
    let small = recipe
        .replace("= 256", "= 64")
        .replace("count = 16", "count = 4\nwidth = 32\nheight = 24")
        .replace("sample = 6", "sample = 1")
        .replace("sample = 2 ", "sample = 1 ")
        .replace("backtrack_steps = 60", "backtrack_steps = 1")
        .replace("separation_steps = 160", "separation_steps = 1");
    assert!(small.contains("separation_steps = 1\n"), "{small}");
    std::fs::write(folder.join("smoke.toml"), small).unwrap();
    let made = command(&["run", "smoke.toml"]).current_dir(folder).output();
    assert!(made.unwrap().status.success());
    let rendered = command(&["render", "scene.json", "--out", "out"])
        .current_dir(folder)
        .output();
    assert!(rendered.unwrap().status.success());
    pairs(folder);
    let mine = "schema = \"glasshouse.recipe/1\"\nname = \"mine\"\n[sources.diode]\nlayout = \"diode\"\n\
         [[split]]\nname = \"train\"\npairs = { diode = 1 }\n";
    std::fs::write(folder.join("my.toml"), mine).unwrap();
}

/// A photograph and a pair.
fn pairs(folder: &Path) {
    std::fs::copy(folder.join("a.png"), folder.join("photo.jpg")).unwrap();
    for (layer, picture) in [("blended", "a.png"), ("transmission_layer", "b.png")] {
        let layer = folder.join("pairs").join(layer);
        std::fs::create_dir_all(&layer).unwrap();
        std::fs::copy(folder.join(picture), layer.join("1.png")).unwrap();
    }
}

#[test]
fn examples_are_understood() {
    let folder = tempfile::tempdir().unwrap();
    workplace(folder.path());
    let mut count = 0;
    for &name in COMMANDS {
        for line in examples(name) {
            let mut arguments: Vec<&str> = line.split_whitespace().collect();
            arguments.push("-n");
            let root = format!("diode={}", folder.path().join("made").display());
            for argument in &mut arguments {
                if *argument == "diode=/data/diode" {
                    *argument = &root;
                }
            }
            // An example may have -n itself.
            if arguments.iter().filter(|a| **a == "-n").count() > 1 {
                arguments.pop();
            }
            // The example's run is the small one here, which its own recipe does not fit.
            if name == "run" && !line.contains("--out") {
                arguments.extend(["--out", "runs/fresh"]);
            }
            if name == "plan" && !line.contains("--out") {
                arguments.extend(["--out", "runs/fresh"]);
            }
            let output = command(&arguments).current_dir(folder.path()).output();
            let ended: crate::program::Ended = output.unwrap().into();
            ended.expect(0);
            count += 1;
        }
    }
    assert!(count >= COMMANDS.len(), "{count}");
    assert!(!folder.path().join("runs/fresh").exists());
}

#[test]
fn help_and_version_are_no_errors() {
    let help = run(&["--help"]).expect(0);
    for name in COMMANDS.iter().filter(|name| !name.contains(' ')) {
        assert!(help.stdout.contains(name), "{name}");
    }
    assert!(help.stderr.is_empty());
    let version = run(&["--version"]).expect(0).stdout;
    assert_eq!(
        version.trim(),
        format!("glasshouse {}", env!("CARGO_PKG_VERSION"))
    );
}
