//! A plan is frozen: `plan` and `run` compare it with later recipes, and refuse recipes that differ.

use crate::support::outputs::{assert_same, files, read_json, tuples};
use crate::support::program::{run, text};
use crate::support::scenes::{RECIPE, photographs, place, scene, write_lines};
use serde_json::json;

#[test]
fn a_dry_run_writes_nothing() {
    let place = place();
    let ended = run(&place.arguments("plan", &["-n", "--json"])).expect(0);
    assert_eq!(ended.json()["scenes"], json!(4));
    assert_eq!(ended.json()["shards"], json!(96));
    run(&place.arguments("run", &["-n"])).expect(0);
    assert_eq!(files(place.folder.path()).len(), 1);
}

#[test]
fn a_changed_recipe_is_refused_with_a_diff() {
    let place = place();
    place.plan();
    let spec = std::fs::read(place.run.join("spec.json")).unwrap();
    let same = run(&place.arguments("plan", &["--json"])).expect(0).json();
    assert_eq!(same["existed"], true);
    for (from, to, words) in [
        ("spp = 256", "spp = 512", ["film.spp", "256", "512"]),
        ("name = \"small\"", "name = \"other\"", ["name", "small", "other"]),
        ("seed = 7", "seed = 8\n[glass]\nior = 1.5", ["glass.ior", "1.6", "1.5"]),
        ("= 3 }", "= 2 }", ["scenes", "4 in the run", "3 from the recipe"]),
    ] {
        assert!(RECIPE.contains(from));
        std::fs::write(&place.recipe, RECIPE.replacen(from, to, 1)).unwrap();
        for command in ["plan", "run"] {
            run(&place.arguments(command, &[])).expect(5).says(&words).says(&["--out"]);
        }
    }
    std::fs::write(&place.recipe, RECIPE).unwrap();
    let mut other_tile = place.arguments("plan", &[]);
    *other_tile.last_mut().unwrap() = "32";
    run(&other_tile).expect(5).says(&["tile_px", "16", "32"]);
    assert_eq!(std::fs::read(place.run.join("spec.json")).unwrap(), spec);
    run(&place.arguments("plan", &[])).expect(0);
}

/// Previews of thousands of scenes take minutes, and the first of them tells that the recipe has changed.
#[test]
fn a_changed_recipe_is_refused_before_all_scenes_are_previewed() {
    let place = place();
    let recipe = RECIPE.replace("= 3 }", "= 40 }").replace("spp = 256", "spp = 4")
        + "[light]\nauto_exposure = { percentile = 99, level = 0.9 }\n";
    std::fs::write(&place.recipe, &recipe).unwrap();
    let arguments = place.arguments("plan", &["-j", "1"]);
    run(&arguments).expect(0);
    std::fs::write(&place.recipe, recipe.replace("width = 96", "width = 80")).unwrap();
    let words = ["film.width: 96 in the run, 80 from the recipe", "compared: 1 of 41 scenes"];
    run(&arguments).expect(5).says(&words);
    std::fs::write(&place.recipe, recipe.replace("= 40 }", "= 30 }")).unwrap();
    let words = ["scenes: 41 in the run, 31 from the recipe", "compared: 1 of 31 scenes"];
    run(&arguments).expect(5).says(&words);
    std::fs::write(&place.recipe, &recipe).unwrap();
    run(&arguments).expect(0);
}

/// A wrong `--out` is told before any photograph is read: here, none could be.
#[test]
fn a_folder_that_cannot_hold_the_run_is_refused_first() {
    let place = place();
    let recipe = "schema = \"glasshouse.recipe/1\"\nname = \"x\"\nseed = 1\n[film]\nwidth = 8\nheight = 8\nspp = 4\n\
                  [sources.a]\nlayout = \"folder\"\nroot = \"nowhere\"\ndepth_range = { mean_m = 3 }\n\
                  [[split]]\nname = \"train\"\npairs = { a = 1 }\n";
    std::fs::write(&place.recipe, recipe).unwrap();
    let file = place.folder.path().join("file");
    std::fs::write(&file, "mine").unwrap();
    for out in [file.clone(), file.join("run")] {
        let all = ["plan", text(&place.recipe), "--out", text(&out)];
        run(&all).expect(1).says(&[text(&file), "Not a directory"]);
    }
    let taken = place.folder.path().join("taken");
    std::fs::create_dir(&taken).unwrap();
    std::fs::write(taken.join("manifest.jsonl"), "mine").unwrap();
    run(&["plan", text(&place.recipe), "--out", text(&taken)]).expect(2).says(&["manifest.jsonl"]);
    assert_eq!(std::fs::read(taken.join("manifest.jsonl")).unwrap(), b"mine");
}

#[test]
fn a_damaged_run_is_refused() {
    let place = place();
    place.plan();
    let folder = text(&place.run);
    let spec_path = place.run.join("spec.json");
    let spec = std::fs::read_to_string(&spec_path).unwrap();
    let number = "\"tracer_version\": ";
    assert!(spec.contains(number) && spec.contains("\"tile_px\": 16"));
    for damage in [
        spec.as_bytes()[..spec.len() / 2].to_vec(),
        Vec::new(),
        b"\xff\xff".to_vec(),
        spec.replace("tile_px", "tile_qx").into_bytes(),
        spec.replace("\"tile_px\": 16", "\"tile_px\": 0").into_bytes(),
        spec.replace("\"tile_px\": 16", "\"tile_px\": 4294967295").into_bytes(),
        spec.replace("\"scenes\": ", "\"scenes\": 7").into_bytes(),
        spec.replace("glasshouse.spec/1", "glasshouse.spec/9").into_bytes(),
        spec.replace(number, "\"tracer_version\": 9").into_bytes(),
    ] {
        std::fs::write(&spec_path, damage).unwrap();
        for arguments in [
            vec!["work", folder],
            vec!["status", folder],
            vec!["merge", folder],
            vec!["audit", folder],
            vec!["report", folder],
            vec!["explain", folder, "train-sample-000000"],
            vec![
                "export",
                folder,
                "--format",
                "pairs",
                "--out",
                text(&place.run.with_extension("e")),
            ],
            place.arguments("plan", &[]),
        ] {
            run(&arguments).expect(5).says(&[folder, "new folder"]);
        }
        // A whole file with senseless numbers is unsound, too.
        run(&["inspect", folder]).expect(4);
    }
    std::fs::write(&spec_path, &spec).unwrap();

    let manifest_path = place.run.join("manifest.jsonl");
    let manifest = std::fs::read_to_string(&manifest_path).unwrap();
    let half = manifest.as_bytes()[..manifest.len() / 2].to_vec();
    let other = manifest.replace("1.6", "1.7").into_bytes();
    for damage in [half, other, b"\xff\xff".to_vec()] {
        std::fs::write(&manifest_path, damage).unwrap();
        run(&["work", folder]).expect(5).says(&["manifest.jsonl"]);
    }
    std::fs::remove_file(&manifest_path).unwrap();
    for arguments in [vec!["work", folder], place.arguments("plan", &[])] {
        run(&arguments).expect(5).says(&["manifest.jsonl"]);
    }
    std::fs::write(&manifest_path, manifest).unwrap();
    run(&["status", folder]).expect(0);
}

#[test]
fn a_spec_of_another_machine_is_refused() {
    let place = place();
    place.plan();
    let path = place.run.join("spec.json");
    let mut spec = read_json(&path);
    spec["golden"]["blake3"] = json!("0".repeat(64));
    std::fs::write(&path, spec.to_string()).unwrap();
    run(&["work", text(&place.run)]).expect(5).says(&["this machine is refused"]);
    run(&place.arguments("plan", &[])).expect(5).says(&["golden shard"]);
}

#[test]
fn paths_in_scene_lines_start_at_the_manifests_folder_or_a_root() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let manifest = folder.path().join("scenes.jsonl");
    write_lines(&manifest, &[scene("one")]);
    let plain = folder.path().join("plain");
    run(&["run", text(&manifest), "--out", text(&plain)]).expect(0);

    // The second manifest, in another folder, names the same photographs through a root.
    let mut rooted = scene("one");
    for side in ["front", "back"] {
        for key in ["color", "depth", "mask"] {
            let path = format!("pictures:{}", rooted[side][key].as_str().unwrap());
            rooted[side][key] = json!(path);
        }
    }
    let elsewhere = folder.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    let manifest = elsewhere.join("rooted.jsonl");
    write_lines(&manifest, &[rooted]);
    let out = folder.path().join("rooted");
    let root = format!("pictures={}", text(folder.path()));
    let arguments = ["run", text(&manifest), "--out", text(&out), "--root", &root];
    run(&arguments).expect(0);
    let (a, b) = (tuples(&plain), tuples(&out));
    for (path, content) in &a {
        if path.extension().is_some_and(|e| e != "json") {
            assert!(b[path] == *content, "{}", path.display());
        }
    }
    // The spec stores the root, and `--root` may replace it with another folder.
    run(&["work", text(&out)]).expect(0);
    let moved = folder.path().join("moved");
    std::fs::create_dir(&moved).unwrap();
    for path in files(folder.path()) {
        if path.components().count() == 1 {
            std::fs::copy(folder.path().join(&path), moved.join(&path)).unwrap();
        }
    }
    std::fs::remove_dir_all(out.join("tuples")).unwrap();
    std::fs::remove_file(folder.path().join("a.png")).unwrap();
    let root = format!("pictures={}", text(&moved));
    run(&["work", text(&out), "--root", &root]).expect(0);
    assert_same(&tuples(&out), &b);
}

#[test]
fn absolute_paths_stay_in_the_spec() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("private");
    std::fs::create_dir(&photos).unwrap();
    photographs(&photos);
    let mut line = scene("one");
    for side in ["front", "back"] {
        for key in ["color", "depth", "mask"] {
            let path = photos.join(line[side][key].as_str().unwrap());
            line[side][key] = json!(text(&path));
        }
    }
    let lines = folder.path().join("scenes.jsonl");
    write_lines(&lines, &[line.clone()]);
    let out = folder.path().join("out");
    run(&["run", text(&lines), "--out", text(&out)]).expect(0);
    let exported = folder.path().join("exported");
    let format = ["--format", "imagefolder", "--out", text(&exported)];
    run(&[&["export", text(&out)], &format[..]].concat()).expect(0);
    let record = out.join("tuples/one/tuple.json");
    let metadata = exported.join("train/metadata.jsonl");
    for path in [&out.join("manifest.jsonl"), &record, &metadata] {
        let content = std::fs::read_to_string(path).unwrap();
        assert!(content.contains("folder-1:") && !content.contains("private"), "{content}");
    }
    let spec = read_json(out.join("spec.json"));
    assert_eq!(spec["roots"]["folder-1"], text(&photos));
    // The scene can be rendered again, and planning again changes nothing.
    let planned = run(&["plan", text(&lines), "--out", text(&out)]).expect(0);
    assert!(planned.stdout.contains("is already planned"), "{planned:?}");
    let again = folder.path().join("again");
    run(&["render", text(&record), "--out", text(&again)]).expect(0);
    let of_run = std::fs::read(out.join("tuples/one/input.png")).unwrap();
    assert!(std::fs::read(again.join("input.png")).unwrap() == of_run);

    // A run of an older version has absolute paths; it is continued as it is.
    let old = folder.path().join("old");
    run(&["plan", text(&lines), "--out", text(&old)]).expect(0);
    let manifest = std::fs::read_to_string(old.join("manifest.jsonl")).unwrap();
    let manifest = manifest.replace("folder-1:", &format!("{}/", text(&photos)));
    std::fs::write(old.join("manifest.jsonl"), &manifest).unwrap();
    let mut spec = read_json(old.join("spec.json"));
    spec["manifest_blake3"] = json!(render::shard::manifest_digest(&manifest));
    spec["roots"].as_object_mut().unwrap().remove("folder-1");
    std::fs::write(old.join("spec.json"), spec.to_string()).unwrap();
    run(&["run", text(&lines), "--out", text(&old)]).expect(0);
    let exported = folder.path().join("exported-old");
    let format = ["--format", "imagefolder", "--out", text(&exported)];
    run(&[&["export", text(&old)], &format[..]].concat()).expect(0);
    let metadata = std::fs::read_to_string(exported.join("train/metadata.jsonl")).unwrap();
    assert!(!metadata.contains("private"), "{metadata}");
}

#[test]
fn too_many_shards_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let mut line = scene("one");
    line["film"] = json!({ "width": 16384, "height": 16384, "spp": 65536 });
    let lines = folder.path().join("scenes.jsonl");
    write_lines(&lines, &[line]);
    let out = folder.path().join("out");
    let planned = run(&["plan", text(&lines), "--out", text(&out), "--tile", "1"]);
    planned.expect(2).says(&["4294967296 shards", "1048576", "--tile"]);
    assert!(!out.join("spec.json").exists());
}

#[test]
fn errors_name_the_wrong_input() {
    let place = place();
    let plan = || run(&place.arguments("plan", &[]));
    std::fs::write(&place.recipe, RECIPE.replace("spp", "ssp")).unwrap();
    plan().expect(4).says(&["small.toml", "ssp"]);
    std::fs::write(&place.recipe, RECIPE.replace("spp = 256", "spp = 255")).unwrap();
    plan().expect(4).says(&["small.toml", "film.spp"]);
    std::fs::write(&place.recipe, b"\xff\xfe").unwrap();
    plan().expect(4).says(&["small.toml"]);
    std::fs::remove_file(&place.recipe).unwrap();
    plan().expect(4).says(&["small.toml"]);
    assert!(!place.run.exists());

    let manifest = place.folder.path().join("scenes.jsonl");
    let planned = |path: &std::path::Path| run(&["plan", text(path), "--out", text(&place.run)]);
    write_lines(&manifest, &[]);
    planned(&manifest).expect(4).says(&["scenes.jsonl", "no scene"]);
    let mut typo = scene("two");
    typo["film"]["sp"] = json!(3);
    write_lines(&manifest, &[scene("one"), typo]);
    planned(&manifest).expect(4).says(&["scenes.jsonl", "line 2", "sp"]);
    write_lines(&manifest, &[scene("one"), scene("one")]);
    planned(&manifest).expect(4).says(&["line 2", "one", "line 1"]);
    let neither = place.folder.path().join("scenes.txt");
    std::fs::write(&neither, b"").unwrap();
    planned(&neither).expect(4).says(&["scenes.txt", ".toml"]);
    run(&["work", text(&place.run)]).expect(4).says(&["not the folder of a run", "plan"]);
}

#[test]
fn wrong_command_lines_exit_with_2() {
    for arguments in [
        &[][..],
        &["paint"],
        &["plan"],
        &["render", "scene.json"],
        &["sample", "dir"],
        &["sample", "dir", "--count", "many"],
        &["work", "run", "-j", "0"],
        &["work", "run", "--time-limit", "5d"],
        &["plan", "r.toml", "--tile", "0"],
        &["plan", "manifests/smoke.toml", "--root", "nonsense"],
        &["status", "run", "--progress", "dots"],
    ] {
        let ended = run(arguments).expect(2);
        assert!(ended.stdout.is_empty() && !ended.stderr.is_empty(), "{ended:?}");
    }
}
