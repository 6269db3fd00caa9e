//! A tuple never depends on threads, tiles, instruction sets or the run's place.

use super::program::{recipe, run, tuples};

#[test]
fn tuples_do_not_depend_on_threads_tiles_instructions_or_place() {
    let folder = tempfile::tempdir().unwrap();
    let recipe = recipe(folder.path(), 2, 64);
    let recipe = recipe.to_str().unwrap();
    let make = |name: &str, extra: &[&str]| {
        let out = folder.path().join(name);
        let (code, _, error) =
            run(&[&["run", recipe, "--out", out.to_str().unwrap()], extra].concat());
        assert_eq!(code, 0, "{name}: {error}");
        tuples(&out)
    };
    let expected = make("default", &[]);
    for tile in ["16", "64", "100"] {
        assert!(
            make(&format!("tile-{tile}"), &["--tile", tile]) == expected,
            "tile {tile}"
        );
    }
    for threads in ["1", "2", "5"] {
        assert!(
            make(
                &format!("threads-{threads}"),
                &["--tile", "32", "-j", threads]
            ) == expected,
            "{threads} threads"
        );
    }
    assert!(
        make("baseline", &["--isa", "baseline"]) == expected,
        "baseline instructions"
    );
    if glasshouse::trace::Isa::detect() == glasshouse::trace::Isa::Avx2 {
        assert!(make("avx2", &["--isa", "avx2"]) == expected, "AVX2");
    } else {
        println!("skipped: no AVX2 on this machine");
    }

    // Moved between two halves of the work.
    let (here, there) = (folder.path().join("here"), folder.path().join("there"));
    assert_eq!(
        run(&[
            "plan",
            recipe,
            "--out",
            here.to_str().unwrap(),
            "--tile",
            "16"
        ])
        .0,
        0
    );
    run(&[
        "work",
        here.to_str().unwrap(),
        "--time-limit",
        "0.02s",
        "-j",
        "1",
    ]);
    std::fs::rename(&here, &there).unwrap();
    assert_eq!(run(&["work", there.to_str().unwrap()]).0, 0);
    assert!(tuples(&there) == expected, "moved run");
}
