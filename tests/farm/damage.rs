//! Torn, flipped and foreign partials are noticed, and traced again.

use super::program::{files, recipe, run, run_json, tuples, write};
use std::path::{Path, PathBuf};

/// A planned run, some of whose shards are on disk.
fn half_done(folder: &Path) -> (PathBuf, Vec<PathBuf>) {
    let recipe = recipe(folder, 2, 1024);
    let out = folder.join("run");
    let text = out.to_str().unwrap();
    assert_eq!(
        run(&[
            "plan",
            recipe.to_str().unwrap(),
            "--out",
            text,
            "--tile",
            "16"
        ])
        .0,
        0
    );
    // No shard is begun after the limit: as often as it takes to have some, and no tuple yet.
    for _ in 0..200 {
        run(&["work", text, "--time-limit", "0.04s", "-j", "1"]);
        let partials = files(&out.join("partials"));
        if partials.len() >= 8 {
            return (out, partials);
        }
    }
    panic!("no partials after many short spells of work");
}

#[test]
fn damaged_and_foreign_partials_are_traced_again() {
    let folder = tempfile::tempdir().unwrap();
    let (out, partials) = half_done(folder.path());
    let bytes = |path: &PathBuf| std::fs::read(path).unwrap();
    let good = bytes(&partials[0]);
    write(&partials[0], &good[..good.len() / 2]);
    write(&partials[1], b"");
    let mut flipped = bytes(&partials[2]);
    let middle = flipped.len() - 1000;
    flipped[middle] ^= 4;
    write(&partials[2], &flipped);
    // A sound partial, of another shard.
    write(&partials[3], &bytes(&partials[4]));
    write(&partials[5], &vec![0x76; 4000]);
    let (code, object) = run_json(&["work", out.to_str().unwrap()]);
    assert_eq!(code, 0, "{object}");
    assert_eq!(
        object["shards_resumed"].as_u64(),
        Some(partials.len() as u64 - 5),
        "{object}"
    );

    let whole = folder.path().join("whole");
    let recipe = folder.path().join("small.toml");
    assert_eq!(
        run(&[
            "run",
            recipe.to_str().unwrap(),
            "--out",
            whole.to_str().unwrap()
        ])
        .0,
        0
    );
    assert!(tuples(&whole) == tuples(&out));
}

#[test]
fn partials_of_other_inputs_do_not_mix() {
    let folder = tempfile::tempdir().unwrap();
    let (out, partials) = half_done(folder.path());
    // The photographs change under the run: nothing of what was traced before may be used.
    let photographs: Vec<PathBuf> = files(&out.join("inputs"))
        .into_iter()
        .filter(|p| p.extension().is_some_and(|e| e == "png"))
        .collect();
    for photograph in &photographs {
        let mut picture = image::open(photograph).unwrap().into_rgb8();
        picture
            .pixels_mut()
            .for_each(|p| p.0[0] = p.0[0].saturating_add(9));
        picture.save(photograph).unwrap();
    }
    let (code, object) = run_json(&["work", out.to_str().unwrap()]);
    assert_eq!(
        (code, object["shards_resumed"].as_u64()),
        (0, Some(0)),
        "{object}"
    );
    assert!(!partials.is_empty());
}

#[test]
fn merge_refuses_gaps_and_makes_the_same_tuple() {
    let folder = tempfile::tempdir().unwrap();
    let (out, partials) = half_done(folder.path());
    let text = out.to_str().unwrap();
    let (code, object) = run_json(&["merge", text]);
    assert_eq!(code, 3, "{object}");
    let reason = object["refused"][0]["reason"].as_str().unwrap();
    assert!(
        reason.contains("shards are missing") && reason.contains("work"),
        "{reason}"
    );
    assert!(
        partials.iter().all(|p| p.is_file()),
        "a refused merge must not delete partials"
    );

    // All of a scene's partials without its tuple: those of a twin are copied just before it would merge.
    let run_twin = folder.path().join("twin");
    let recipe = folder.path().join("small.toml");
    assert_eq!(
        run(&[
            "run",
            recipe.to_str().unwrap(),
            "--out",
            run_twin.to_str().unwrap()
        ])
        .0,
        0
    );
    let complete = complete_partials(&out);
    assert!(complete > 0);
    let (code, object) = run_json(&["merge", text]);
    assert_eq!(code, 0, "{object}");
    assert!(tuples(&run_twin) == tuples(&out), "merge and work differ");
}

/// Traces every shard of a run through the library and leaves the partials. Returns their number.
fn complete_partials(out: &Path) -> usize {
    use glasshouse::farm::{Run, SceneJob};
    use glasshouse::manifest::Roots;
    use glasshouse::scene::{load, read_files};
    let run = Run::open(out, &Roots::default()).unwrap();
    let mut count = 0;
    for line in &run.lines {
        let loaded = load(line, &read_files(line, &run.roots, out).unwrap()).unwrap();
        let job = SceneJob::new(line, run.layout(line), loaded);
        std::fs::create_dir_all(run.dir.partials(&line.id)).unwrap();
        for shard in run.layout(line).shards() {
            let partial = job.trace(&shard, glasshouse::trace::Isa::detect());
            write(
                &run.dir.partial(&line.id, shard.index),
                &glasshouse::partial::encode(&partial).unwrap(),
            );
            count += 1;
        }
    }
    count
}
