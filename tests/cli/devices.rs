//! Tests `--device` of the commands with networks.

use crate::support::program::run_line;

/// A program without the Cargo feature refuses a GPU before it reads any file.
#[cfg(not(feature = "cuda"))]
#[test]
fn a_gpu_needs_a_program_that_was_built_for_it() {
    for line in [
        "train runs/none --stage backtrack --steps 1",
        "evaluate runs/none",
        "separate none.jpg --out none",
        "depth none --weights none.pth --out none",
        "bench train",
    ] {
        for device in ["cuda", "cuda:1"] {
            run_line(&format!("{line} --device {device}")).expect(2).says(&[
                &format!("'{device}' for '--device <cpu|cuda[:N]>'"),
                "built without the Cargo feature `cuda`",
                "docs/training.md",
                "leave out --device",
            ]);
        }
    }
}

#[test]
fn unknown_devices_are_refused() {
    for device in ["gpu", "cuda:", "cuda:x"] {
        let line = format!("separate none.jpg --out none --device {device}");
        run_line(&line).expect(2).says(&["expected cpu, cuda or cuda:N"]);
    }
}

#[test]
fn a_measured_step_names_its_device() {
    let line = "bench train --size 32 --width 4 --steps 1 -j 1 --no-features --device cpu --json";
    assert_eq!(run_line(line).expect(0).json()["device"], "cpu");
}
