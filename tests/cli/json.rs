//! With `--json`, every command prints one JSON object to stdout, and progress and notes to stderr.

use crate::support::program::{run, run_line, text};
use crate::support::scenes::{photographs, place, scene};

#[test]
fn every_command_prints_one_object() {
    let place = place();
    let folder = place.folder.path();
    photographs(folder);
    let scene_path = folder.join("scene.json");
    std::fs::write(&scene_path, scene("one").to_string()).unwrap();
    let (out, run_folder) = (folder.join("out"), text(&place.run));
    let (scene_path, out) = (text(&scene_path), text(&out));
    let [sample, exported, bench, man] =
        ["sample", "exported", "bench", "man"].map(|name| folder.join(name).display().to_string());
    let commands = [
        ("plan", place.arguments("plan", &[]).join(" ")),
        ("work", format!("work {run_folder}")),
        ("run", place.arguments("run", &[]).join(" ")),
        ("merge", format!("merge {run_folder}")),
        ("status", format!("status {run_folder}")),
        ("pause", format!("pause {run_folder}")),
        ("cancel", format!("cancel {run_folder}")),
        ("resume", format!("resume {run_folder}")),
        ("retry", format!("retry {run_folder} --all")),
        ("explain", format!("explain {run_folder} train-sample-000000:0")),
        ("audit", format!("audit {run_folder}")),
        ("export", format!("export {run_folder} --format pairs --out {exported}")),
        ("report", format!("report {run_folder}")),
        ("inspect", format!("inspect {run_folder} {scene_path}")),
        ("doctor", format!("doctor {run_folder} -j 1")),
        ("completions", "completions bash".to_owned()),
        ("man", format!("man --out {man}")),
        ("render", format!("render {scene_path} --out {out}")),
        ("sample", format!("sample {sample} --count 2 --width 32 --height 24")),
        (
            "bench_error",
            format!("bench error --scene {scene_path} --spp 1,4 --reference-spp 16 --out {bench}"),
        ),
        ("bench_trace", format!("bench trace --no-builtin --scene {scene_path} --passes 1")),
    ];
    for (name, line) in commands {
        for more in ["--json -n", "--json", "--json -q"] {
            let ended = run_line(&format!("{line} {more}")).expect(0);
            // A dry `run` prints a plan.
            let is_plan = name == "run" && more.contains("-n");
            let schema = if is_plan { "plan" } else { name };
            assert_eq!(ended.json()["schema"], format!("glasshouse.{schema}/1"));
            if more.contains("-q") {
                assert!(ended.stderr.is_empty(), "{ended:?}");
            }
        }
    }
}

#[test]
fn errors_are_json_objects() {
    let folder = tempfile::tempdir().unwrap();
    let nowhere = folder.path().join("nowhere");
    let nowhere = text(&nowhere);
    for (arguments, code) in [
        (&["plan", nowhere, "--out", nowhere][..], 4),
        (&["run", nowhere, "--out", nowhere], 4),
        (&["work", nowhere], 4),
        (&["merge", nowhere], 4),
        (&["status", nowhere], 4),
        (&["pause", nowhere], 4),
        (&["resume", nowhere], 4),
        (&["cancel", nowhere], 4),
        (&["retry", nowhere], 2),
        (&["retry", nowhere, "--all"], 4),
        (&["explain", nowhere], 2),
        (&["explain", nowhere, "a:b"], 2),
        (&["explain", nowhere, "a"], 4),
        (&["audit", nowhere], 4),
        (&["audit", nowhere, "--share", "2"], 2),
        (&["export", nowhere], 2),
        (&["export", nowhere, "--format", "exr", "--out", nowhere], 4),
        (&["report", nowhere], 4),
        #[cfg(feature = "train")]
        (&["evaluate", nowhere], 4),
        #[cfg(feature = "train")]
        (&["evaluate", nowhere, "--split", "both"], 2),
        #[cfg(feature = "train")]
        (&["separate", "a.png", "--network", nowhere, "--out", nowhere], 4),
        #[cfg(feature = "train")]
        (&["separate", "--out", nowhere], 2),
        #[cfg(feature = "train")]
        (&["similarity", nowhere], 4),
        #[cfg(feature = "train")]
        (&["similarity", nowhere, "--draws", "0"], 2),
        (&["render", nowhere, "--out", nowhere], 4),
        (&["render", nowhere, "--out", nowhere, "--spp", "3"], 2),
        (&["sample", nowhere], 2),
        (&["bench", "error", "--scene", nowhere], 4),
        (&["bench", "error", "--reference", nowhere, "-n"], 4),
        (&["bench", "error", "--spp", "3"], 2),
        (&["bench", "trace", "--scene", nowhere], 4),
        (&["bench"], 2),
        (&["inspect"], 2),
        (&["completions", "tcsh"], 2),
        (&["man", "--out", "/proc/x"], 1),
        (&["sample", "/dev/null/x", "--count", "1"], 1),
        (&["work", nowhere, "--root", "x"], 2),
        (&["paint"], 2),
    ] {
        let ended = run(&[arguments, &["--json"]].concat()).expect(code);
        let error = ended.json();
        assert_eq!(error["schema"], "glasshouse.error/1");
        assert_eq!(error["exit"], code);
        assert!(!error["error"].as_str().unwrap().is_empty());
        assert!(ended.stderr.contains("error"), "{ended:?}");
    }
}

#[test]
fn progress_needs_no_terminal() {
    for how in ["auto", "bar", "plain", "none"] {
        let place = place();
        let ended = run(&place.arguments("run", &["--progress", how, "--color", "always"]));
        let ended = ended.expect(0);
        assert!(ended.stdout.contains("4 tuples"), "{ended:?}");
        assert!(!ended.stdout.contains('\x1b'), "results are never coloured");
    }
}
