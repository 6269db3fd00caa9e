//! Command lines of the documents that no test runs, each with the reason.

/// Patterns of command lines, with reasons. A pattern that ends with ` …` matches all lines with that beginning.
#[rustfmt::skip]
pub(crate) const NOT_RUN: &[(&str, &str)] = &[
    ("cargo …", "builds the program and runs this test"),
    (".ci/run", "builds the program and runs this test"),
    ("glasshouse plan my.toml --root diode=s3://bucket/diode --out runs/mine", "needs a bucket; tests/farm/store_inputs.rs uses a local server"),
    ("glasshouse run many.toml --out runs/many", "the page describes the recipe in words"),
    ("glasshouse retry RUN SCENE", "the small run has an empty quarantine; tests/farm/retry.rs retries scenes"),
    ("glasshouse retry RUN SCENE --anew", "the small run has an empty quarantine; tests/farm/conflict.rs uses --anew"),
    ("glasshouse run manifests/wild.toml --root photos=/data/photos", "needs photographs that are not shipped; tests/render/light.rs draws from such ranges"),
    ("glasshouse plan manifests/wild.toml --root photos=/data/photos", "needs photographs that are not shipped"),
    ("glasshouse plan -n my.toml --root photos=/data/photos", "needs the page's recipe and list; tests/render/list.rs runs similar ones"),
    ("glasshouse run my.toml --root photos=/data/photos", "needs the page's recipe and list; tests/render/list.rs runs similar ones"),
    ("glasshouse depth …", "needs weights that are not shipped; tests/farm/pictures.rs uses random ones"),
    ("glasshouse run manifests/wild.toml --root photos=/data/holiday-depth", "needs depth maps of that command; tests/farm/pictures.rs renders such a folder"),
    ("glasshouse train RUN --stage backtrack --steps 20000 --features vgg19.safetensors", "VGG-19's weights are not shipped; tests/train/training.rs reads narrower weights from a file"),
    ("glasshouse train RUN --name without …", "VGG-19's weights are not shipped; tests/train/training.rs uses a preset with a narrower file"),
    ("glasshouse train runs/learn --name unet-seed-1 --steps 25000", "needs a planned run of learn.toml; tests/train/names.rs trains with names of a recipe"),
    ("glasshouse sample FOLDER/photos …", "begins an experiment of hours"),
    ("glasshouse plan FOLDER/windows.toml --out RUN", "needs a recipe of docs/proof/recipes.py"),
    ("glasshouse export RUN --format safetensors --out EXPORT", "belongs to the same experiment; tests/formats exports small runs"),
    ("glasshouse evaluate --index pairs.csv --longest 640 --factor 0.83 --veil 0.88,0.8 --out EVALUATION …", "needs its checkpoints"),
    ("glasshouse run FOLDER/test-near.toml --out TEST", "needs a recipe of docs/proof/recipes.py"),
    ("glasshouse evaluate TEST …", "needs its checkpoints"),
    ("glasshouse separate photo.jpg --network converted --features FEATURES --out separated", "the published weights are not shipped; tests/train/bundle.rs converts a narrower checkpoint"),
    ("glasshouse bench trace --no-builtin $(printf …", "needs scenes that another test makes from photographs that are not shipped"),
    ("nats-server …", "starts a server, as tests/support/nats.rs does; tests/docs/launch/nats.rs uses this configuration"),
    ("export …", "sets a variable of the shell; tests set variables for each process"),
    ("sbatch …", "needs a scheduler; tests/docs/launch/scripts.rs checks the script"),
    ("kubectl …", "needs a cluster; tests/docs/launch/kubernetes.rs and flags.rs check the files"),
    ("systemd-run …", "needs a service manager; tests/docs/launch/services.rs checks the units"),
    ("nohup …", "starts `glasshouse work`, which other lines run"),
    ("kill …", "needs a process; tests/cli/signals.rs sends signals"),
    ("while …", "repeats a command; tests/cli/signals.rs repeats it until the exit code is not 75"),
    ("ssh …", "needs a second machine"),
    ("python3 …", "installs packages and converts downloads"),
    ("python3.11 …", "installs other renderers"),
    ("~/peers/bin/pip …", "installs other renderers"),
    ("~/peers/bin/python …", "needs other renderers and minutes"),
    ("sudo …", "installs packages"),
    ("pip …", "builds and installs the Python package; .ci/run does this and tests it"),
    ("benches/peers/run.py …", "needs other renderers and minutes; the documents date its figures"),
    ("benches/peers/train_step.py …", "needs PyTorch and minutes"),
    ("benches/peers/export_scene.py …", "prepares a scene for other renderers"),
    ("sha256sum …", "needs a file that is not shipped"),
    ("mkdir …", "prepares the fuzzer, which needs a nightly compiler"),
];

/// True if a pattern matches a command line.
pub(crate) fn is_of(pattern: &str, line: &str) -> bool {
    match pattern.strip_suffix(" …") {
        Some(start) => line == start || line.starts_with(&format!("{start} ")),
        None => line == pattern,
    }
}
