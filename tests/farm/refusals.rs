//! What the command line refuses, and how it says so.

use super::program::{files, program, recipe, run, run_json, write};

#[test]
fn a_changed_recipe_is_refused_with_a_diff() {
    let folder = tempfile::tempdir().unwrap();
    let path = recipe(folder.path(), 2, 16);
    let out = folder.path().join("run");
    let (recipe, out) = (path.to_str().unwrap(), out.to_str().unwrap());
    let (code, object) = run_json(&["plan", recipe, "--out", out, "-n"]);
    assert_eq!((code, object["scenes"].as_u64()), (0, Some(2)), "{object}");
    assert!(!std::path::Path::new(out).exists(), "-n must write nothing");
    assert_eq!(run(&["plan", recipe, "--out", out]).0, 0);
    assert_eq!(run_json(&["plan", recipe, "--out", out]).1["existed"], true);

    let text = std::fs::read_to_string(&path).unwrap();
    write(
        &path,
        text.replace("thickness_m = 0.010", "thickness_m = 0.012")
            .as_bytes(),
    );
    for command in ["plan", "run"] {
        let (code, _, error) = run(&[command, recipe, "--out", out]);
        assert_eq!(code, 5, "{error}");
        assert!(
            error.contains("glass.thickness_m: 0.01 in the run, 0.012 by the recipe"),
            "{error}"
        );
        assert!(error.contains("2 scenes"), "{error}");
    }
    write(
        &path,
        text.replace("seed = 7", "seed = 7\nsede = 8").as_bytes(),
    );
    let (code, _, error) = run(&["plan", recipe, "--out", out]);
    assert_eq!(code, 4);
    assert!(error.contains("sede"), "{error}");

    let manifest = std::path::Path::new(out).join("manifest.jsonl");
    let lines = std::fs::read_to_string(&manifest).unwrap();
    write(
        &manifest,
        lines.replace("1.4", "1.5").replace("0.3", "0.4").as_bytes(),
    );
    let (code, _, error) = run(&["work", out]);
    assert_eq!(code, 5, "{error}");
    assert!(error.contains("manifest.jsonl"), "{error}");
}

#[test]
fn another_machine_s_bits_and_another_version_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = recipe(folder.path(), 2, 16);
    let out = folder.path().join("run");
    let out_text = out.to_str().unwrap();
    assert_eq!(
        run(&["plan", path.to_str().unwrap(), "--out", out_text]).0,
        0
    );
    let spec = std::fs::read_to_string(out.join("spec.json")).unwrap();
    let object: serde_json::Value = serde_json::from_str(&spec).unwrap();
    let golden = object["golden"]["blake3"].as_str().unwrap();
    write(
        &out.join("spec.json"),
        spec.replace(golden, &"0".repeat(64)).as_bytes(),
    );
    let (code, _, error) = run(&["work", out_text]);
    assert_eq!(code, 5, "{error}");
    assert!(error.contains("golden shard"), "{error}");
    let version = format!("\"tracer_version\": {}", glasshouse::trace::TRACER_VERSION);
    assert!(spec.contains(&version));
    write(
        &out.join("spec.json"),
        spec.replace(&version, "\"tracer_version\": 999").as_bytes(),
    );
    let (code, _, error) = run(&["work", out_text]);
    assert_eq!(code, 5, "{error}");
    assert!(error.contains("tracer_version is 999"), "{error}");
}

#[test]
fn usage_and_missing_files_have_their_exit_codes() {
    let folder = tempfile::tempdir().unwrap();
    let nowhere = folder.path().join("nowhere");
    let nowhere = nowhere.to_str().unwrap();
    let out = folder.path().join("out");
    let out = out.to_str().unwrap();
    for spp in ["3", "0", "131072", "x"] {
        assert_eq!(
            run(&["render", nowhere, "--out", out, "--spp", spp]).0,
            2,
            "{spp}"
        );
    }
    assert_eq!(run(&["render"]).0, 2);
    assert_eq!(run(&["work", nowhere, "--time-limit", "5 parsecs"]).0, 2);
    assert_eq!(
        run(&["plan", nowhere, "--out", out, "--root", "nonsense"]).0,
        2
    );
    for arguments in [
        vec!["render", nowhere, "--out", out],
        vec!["plan", nowhere, "--out", out],
        vec!["work", nowhere],
        vec!["merge", nowhere],
        vec!["status", nowhere],
        vec!["report", nowhere],
    ] {
        let (code, object) = run_json(&arguments);
        assert_eq!(code, 4, "{arguments:?} {object}");
        assert_eq!(object["schema"], "glasshouse.error/1");
        assert!(
            object["error"].as_str().unwrap().contains("nowhere"),
            "{object}"
        );
    }
    assert!(
        files(folder.path()).is_empty(),
        "nothing is written on errors"
    );
}

#[test]
fn every_help_has_examples_that_parse() {
    let folder = tempfile::tempdir().unwrap();
    for command in [
        "run", "sample", "plan", "render", "work", "merge", "status", "report",
    ] {
        let (code, help, _) = run(&[command, "--help"]);
        assert_eq!(code, 0);
        let (_, examples) = help
            .split_once("Examples:")
            .unwrap_or_else(|| panic!("{command} has no examples"));
        let mut count = 0;
        for line in examples
            .lines()
            .filter_map(|l| l.trim().strip_prefix("glasshouse "))
        {
            let line = line.split('#').next().unwrap();
            let dry: &[&str] = if line.contains(" -n") { &[] } else { &["-n"] };
            let output = program()
                .args(line.split_whitespace())
                .args(dry)
                .current_dir(folder.path())
                .output()
                .unwrap();
            let text = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_ne!(output.status.code(), Some(2), "{line}: {text}");
            count += 1;
        }
        assert_eq!(count, 2, "{command}");
    }
    assert!(files(folder.path()).is_empty(), "-n writes nothing");
}
