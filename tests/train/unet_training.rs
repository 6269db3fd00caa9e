//! Training of a U-Net through the program: a killed training resumes to the same bits.

use crate::support::program::{command, random, run, text, wait_until};
use crate::training::place;
use std::os::unix::process::ExitStatusExt;

/// Options of a U-Net with all that its checkpoint must restore.
const UNET: [&str; 19] = [
    "--network",
    "unet",
    "--bound",
    "1",
    "--width",
    "3",
    "--crop",
    "40",
    "--adversarial-weight",
    "0",
    "--optimizer",
    "adamw",
    "--weight-decay",
    "0.01",
    "--schedule",
    "cosine",
    "--ema",
    "0.9",
    "--gradient-weight=1",
];

#[test]
fn a_killed_unet_resumes_with_the_same_bits_and_separates() {
    let [whole, killed] = [place(), place()];
    let unet = |more: &[&'static str]| -> Vec<&str> { UNET.iter().chain(more).copied().collect() };
    let arguments = whole.arguments("separation", "30", &unet(&["-j", "1"]));
    run(&arguments).expect(0).says(&["step 30: ", "light out over light in "]);
    let csv = killed.run.join("train/separation/metrics.csv");
    let lines = || std::fs::read_to_string(&csv).unwrap_or_default().lines().count();
    // The first kill comes before the first due checkpoint; the training keeps its settings.
    let before_any = unet(&["-j", "2", "--checkpoint-every", "100"]);
    let later = vec!["-j", "2", "--checkpoint-every", "3"];
    for (more, at) in [(before_any, 1), (later, 3 + random(17))] {
        let mut child = command(&killed.arguments("separation", "30", &more)).spawn().unwrap();
        wait_until(&mut child, || lines() > at);
        child.kill().unwrap();
        assert_eq!(child.wait().unwrap().signal(), Some(9), "training ended before the kill");
        if at == 1 {
            let alone = killed.folder_of("separation", 0);
            assert!(alone.join("state.json").is_file());
            // Nothing is learnt yet, so no command takes these weights for a network.
            run(&["separate", "x.png", "--network", text(&killed.run), "--out", "y"])
                .expect(4)
                .says(&["no usable checkpoint"]);
        }
    }
    let ended = killed.train("separation", "30", &["-j", "1"]);
    assert_eq!(ended["step"].as_u64(), Some(30));
    assert!(killed.checkpoint("separation", 30) == whole.checkpoint("separation", 30));
    run(&whole.arguments("separation", "31", &[])).expect(5).says(&["--schedule-steps 31"]);
    run(&whole.arguments("backtrack", "2", &unet(&[]))).expect(2).says(&["--stage separation"]);
    run(&["evaluate", text(&whole.run)]).expect(0);
    let scene = std::fs::read_dir(whole.run.join("tuples")).unwrap().next().unwrap().unwrap();
    let photo = scene.path().join("input.png");
    let out = whole.folder.path().join("out");
    let arguments = ["separate", text(&photo), "--network", text(&whole.run), "--out", text(&out)];
    run(&arguments).expect(0);
}
