//! Command lines of the documents that no test runs, each with the reason.

/// A pattern that ends with ` …` matches all lines with that beginning.
#[rustfmt::skip]
pub(crate) const NOT_RUN: &[(&str, &str)] = &[
    ("cargo …", "they build the program and run this test"),
    (".ci/run", "the same"),
    ("glasshouse plan my.toml --root diode=s3://bucket/diode --out runs/mine", "no such bucket; tests/farm/store_inputs.rs does it on a local server"),
    ("glasshouse run many.toml --out runs/many", "the page describes the recipe in words"),
    ("glasshouse retry RUN SCENE", "the small run has nothing in quarantine; tests/farm/retry.rs does it"),
    ("glasshouse retry RUN SCENE --anew", "the same"),
    ("glasshouse run manifests/wild.toml --root photos=/data/photos", "it needs photographs that are not shipped; tests/render/light.rs draws from such ranges"),
    ("glasshouse plan manifests/wild.toml --root photos=/data/photos", "the same"),
    ("glasshouse plan -n my.toml --root photos=/data/photos", "the recipe and the list are that page's; tests/render/list.rs runs such ones"),
    ("glasshouse run my.toml --root photos=/data/photos", "the same"),
    ("glasshouse train RUN --stage backtrack --steps 20000 --features vgg19.safetensors", "VGG-19's weights are not shipped; unit tests of src/train/vgg.rs make files of that form"),
    ("glasshouse bench trace --no-builtin $(printf …", "its scenes are written by another test from photographs that are not shipped"),
    ("nats-server …", "tests/support/nats_server.rs starts one with other arguments, tests/docs/launch/nats.rs with this configuration"),
    ("export …", "a shell's; the tests set what they need for each process"),
    ("sbatch …", "no scheduler; tests/docs/launch/scripts.rs runs the script with a stand-in for Slurm's commands"),
    ("kubectl …", "no cluster; tests/docs/launch/kubernetes.rs reads the files and holds their command lines against the program"),
    ("systemd-run …", "no service manager; tests/docs/launch/services.rs reads the units"),
    ("nohup …", "the same as glasshouse work, which is run"),
    ("kill …", "tests/cli/signals.rs"),
    ("while …", "tests/cli/signals.rs and tests/docs/launch/scripts.rs see the exit code 75"),
    ("ssh …", "no second machine"),
    ("python3 …", "installs packages and converts downloads"),
    ("python3.11 …", "the other renderers are installed by hand"),
    ("~/peers/bin/pip …", "the same"),
    ("~/peers/bin/python …", "the other renderers; hours"),
    ("sudo …", "the same"),
    ("benches/peers/run.py …", "the other renderers; hours. Figures are kept with their date"),
    ("benches/peers/train_step.py …", "needs PyTorch; minutes"),
    ("benches/peers/export_scene.py …", "for the other renderers"),
    ("sha256sum …", "of a file that is not shipped"),
    ("mkdir …", "for the fuzzer, which needs a nightly compiler"),
];

/// Whether a pattern matches a command line.
pub(crate) fn is_of(pattern: &str, line: &str) -> bool {
    match pattern.strip_suffix(" …") {
        Some(start) => line == start || line.starts_with(&format!("{start} ")),
        None => line == pattern,
    }
}
