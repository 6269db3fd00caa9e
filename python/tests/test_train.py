"""Tests of the PyTorch trainer, beside the Rust program that GLASSHOUSE_PROGRAM or PATH names: `pytest python/tests`.

Tests print why they are skipped.
"""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the PyTorch trainer needs torch")
safetensors_torch = pytest.importorskip("safetensors.torch", reason="the PyTorch trainer needs safetensors")
load_file, save_file = safetensors_torch.load_file, safetensors_torch.save_file

import glasshouse  # noqa: E402
from glasshouse import train as trainer  # noqa: E402
from glasshouse.checkpoints import COLUMNS, Checkpoint, locked, read_checkpoint, write_checkpoint  # noqa: E402
from glasshouse.learner import Learner, TrainError, checked, rate  # noqa: E402

torch.set_num_threads(1)

REFERENCES = Path(__file__).parents[2] / "tests" / "train"
CPU = torch.device("cpu")
LAYERS = ("input", "transmission", "glass_reflection", "clean_reflection")
RECIPE = """
schema = "glasshouse.recipe/1"
name = "lesson"
seed = 11
[film]
width = 48
height = 48
spp = 4
[sources.sample]
layout = "sample"
count = 12
width = 128
height = 96
[[split]]
name = "train"
pairs = { sample = 4 }
[[split]]
name = "test"
pairs = { sample = 2 }
"""
# Settings with which every example is a whole tuple, as in its PNGs.
SMALL = "--width 4 --discriminator-width 2 --crop 48 --no-flip --pixels png --batch 2 --learning-rate 1e-3".split()
SMALL += "-q -j 1".split()
# Examples of linear light behind the camera, of crops.
COMPOSED = "--examples composed --pixels exr --crop 32 --width 4 --batch 2 -q -j 1".split()
UNET = "--network unet --no-a-priori --start residual --bound 1.2 --adversarial-weight 0 --gradient-weight 1".split()
UNET += "--optimizer adamw --weight-decay 0.01 --clip-norm 0.05 --ema 0.9 --warmup-steps 2 --schedule cosine".split()
UNET += "--schedule-steps 20".split()
# Settings of the trainings of the references.
BASE: dict[str, Any] = {
    **{"seed": 1, "features": "file", "feature_style": "torch", "network": "generator", "vgg_divisor": 32, "width": 6},
    **{"discriminator_width": 4, "start": "identity", "bound": 0.0, "batch": 1, "crop_px": 48, "flip": False},
    **{"learning_rate": 1e-4, "discriminator_learning_rate": 0.0, "optimizer": "adam", "betas": [0.9, 0.999]},
    **{"weight_decay": 0.0, "schedule": "constant", "warmup_steps": 0, "schedule_steps": 0, "decay_steps": []},
    **{"decay_factor": 0.5, "clip_norm": 0.0, "ema": 0.0, "pixel_weight": 1.0, "gradient_weight": 0.0},
    **{"feature_weight": 0.2, "adversarial_weight": 0.01, "discriminator_every": 2, "a_priori": True, "scenes": 0},
    **{"examples": "rendered", "composition": {}, "pixels": "png", "real_share": 0.0, "follow": False},
}
OF_UNET = {
    **{"features": "none", "network": "unet", "start": "residual", "a_priori": False, "width": 3, "bound": 1.2},
    **{"adversarial_weight": 0.0, "gradient_weight": 1.0, "learning_rate": 2e-3, "betas": [0.9, 0.99], "ema": 0.9},
    **{"optimizer": "adamw", "weight_decay": 1e-2, "warmup_steps": 2, "schedule": "cosine", "schedule_steps": 20},
    **{"clip_norm": 0.05},
}


def program() -> str:
    """Returns the Rust program, or skips the test."""
    found = os.environ.get("GLASSHOUSE_PROGRAM") or shutil.which("glasshouse")
    if not found:
        pytest.skip("no Rust program: set GLASSHOUSE_PROGRAM, or put glasshouse on PATH")
    return found


def rust(*arguments: object) -> str:
    """Runs the Rust program and returns its output."""
    done = subprocess.run([program(), *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def png(path: Path) -> np.ndarray:
    """Reads an RGB picture as float32 (3, rows, columns) from 0 to 1."""
    image = pytest.importorskip("PIL.Image", reason="pillow is not installed").open(path)
    return np.moveaxis(np.asarray(image), 2, 0).astype(np.float32) / np.float32(255)


def train(run: Path, stage: str, steps: int, **more: Any) -> int:
    """Trains with the PyTorch trainer."""
    return trainer.train(run, stage, steps, **more)


def newest(run: Path, stage: str) -> Checkpoint:
    """Reads the newest checkpoint of a stage."""
    return read_checkpoint(max((run / "train" / stage).glob("step-*")))


def differences(one: Checkpoint, other: Checkpoint) -> dict[str, float]:
    """Returns the relative differences of two checkpoints' tensors, together for a network and a kind of parameter.

    Together, because sums that cancel in one layer have few digits in both programs. Mean squares count by their roots,
    in the unit of gradients.
    """
    assert one.model.keys() == other.model.keys() and one.moments.keys() == other.moments.keys()
    a, b = ({**of.model, **of.moments} for of in (one, other))
    squares: dict[str, list[float]] = {}
    for name in b:
        x, y = (of[name].double().sqrt() if name.startswith("square.") else of[name].double() for of in (a, b))
        kind = squares.setdefault(name.rstrip(".0123456789"), [0.0, 0.0])
        kind[0] += float((x - y).square().sum())
        kind[1] += float(y.square().sum())
    return {kind: (off / max(size, 1e-30)) ** 0.5 for kind, (off, size) in squares.items()}


def check_that_steps_agree(what: str, folder: Path, compare: Callable[[Path, int], dict[str, float]]) -> Path:
    """Calls `compare(folder, seed)` for several seeds until the differences are those of rounding; returns its folder.

    Rounding moves a unit of a network across a kink of ReLU, max or |x| in one of six seeds; which ones depends on the
    pictures' last bits. That changes gradients by up to 1e-3. A wrong equation differs with every seed.
    """
    for seed in range(3, 8):
        found = compare(folder / str(seed), seed)
        worst = max(found, key=lambda name: found[name])
        print(f"{what}, seed {seed}: the largest of {len(found)} relative differences is {found[worst]:.1e} ({worst})")
        assert found[worst] < 1e-3
        if found[worst] < 1e-5:
            return folder / str(seed)
    pytest.fail("rounding does not explain differences with every seed")


@pytest.fixture(scope="session")
def lesson(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns a folder with a rendered run, tiny weights of VGG-19, and trainings of the Rust program up to step 2."""
    folder = tmp_path_factory.mktemp("lesson")
    (folder / "lesson.toml").write_text(RECIPE)
    rust("run", folder / "lesson.toml", "--out", folder / "run", "-q")
    reference = load_file(REFERENCES / "step.safetensors")
    save_file({k: v for k, v in reference.items() if k.startswith("features.")}, folder / "vgg.safetensors")
    return folder


def begun(lesson: Path, folder: Path, kind: str, steps: int, seed: int = 3) -> tuple[Path, str, dict[str, Any]]:
    """Copies the run and trains with the Rust program; returns the run, the stage and options of PyTorch."""
    run = folder / "run"
    shutil.copytree(lesson / "run", run)
    if kind in ("unet", "composed"):
        examples = [*(SMALL if kind == "unet" else COMPOSED), "--seed", seed]
        rust("train", run, "--stage", "separation", "--steps", steps, *examples, *UNET)
        return run, "separation", {}
    vgg = lesson / "vgg.safetensors"
    source = {"features": vgg, "random": "random"}.get(kind)
    features = ["--seed", seed, *(["--features", source, "--vgg-divisor", 32] if source else [])]
    rust("train", run, "--stage", "backtrack", "--steps", steps, *SMALL, *features, "--start", "random")
    options = {"features": vgg} if kind == "features" else {}
    if kind == "backtrack":
        return run, "backtrack", options
    clipped = "--optimizer adamw --weight-decay 0.1 --clip-norm 0.05".split() if kind == "plain" else []
    rust("train", run, "--stage", "separation", "--steps", steps, *SMALL, *features, *clipped, "--start", "random")
    return run, "separation", options


def resumed(lesson: Path, folder: Path, kind: str, steps: int, seed: int) -> tuple[Path, Path, str, dict[str, Any]]:
    """Trains with the Rust program up to step 2, and a copy of the run up to `steps`; returns the run and the copy."""
    run, stage, options = begun(lesson, folder, kind, 2, seed)
    copy = folder / "copy"
    shutil.copytree(run, copy)
    more = ["--features", options["features"]] if options else []
    rust("train", copy, "--stage", stage, "--steps", steps, "-q", "-j", 1, *more)
    return run, copy, stage, options


def learner_of(settings: dict[str, Any], weights: dict[str, Any], precision: str = "f32") -> Learner:
    """Returns a learner of the separation stage with weights."""
    made = Learner(checked(settings), "separation", weights if settings["features"] == "file" else None, CPU, precision)
    made.load(weights)
    return made


def close(found: Any, expected: Any, relative: float = 1e-5) -> bool:
    """Returns whether two tensors differ little, relative to the norm of the second."""
    return bool((found.detach() - expected).norm() <= relative * expected.norm())


MODULE = ["-m", "glasshouse.train"]


# Both programs and the references: forward passes and steps.


def test_a_missing_gpu_is_an_error(tmp_path: Path) -> None:
    if torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    with pytest.raises(TrainError, match="--device cuda: this PyTorch .*; train with --device cpu") as caught:
        trainer.train(tmp_path, "separation", 1, device="cuda")
    assert caught.value.exit_code == 4


def test_a_name_that_the_recipe_lacks_is_noted(
    lesson: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    net = '"name": "net", "seeds": [3], "separation_steps": 1, "settings": {"batch": 2}'
    (tmp_path / "train.json").write_text(f'{{"trainings": [{{{net}}}]}}')
    settings = trainer.new_settings(tmp_path, "separation", "net-seed-3")
    assert settings["seed"] == 3 and settings["batch"] == 2 and not capsys.readouterr().err
    assert trainer.new_settings(tmp_path, "separation", "net") == glasshouse.train_settings(lesson / "run")
    assert 'no training "net"; it has: net-seed-3' in capsys.readouterr().err


def test_the_step_of_the_reference() -> None:
    """Five steps with VGG-19, discriminator and a priori loss have the losses that tests/train/step.py computed."""
    weights = load_file(REFERENCES / "step.safetensors")
    made = learner_of(BASE, weights)
    batch = {layer: weights[f"image.{layer}"] for layer in LAYERS}
    losses = [made.step(step, batch) for step in range(5)]
    assert close(torch.tensor([one.total for one in losses]), weights["losses"])
    told = [one.discriminator for one in losses if one.discriminator is not None]
    assert close(torch.tensor(told), weights["discriminator_losses"])


def test_the_features_and_the_generator_of_the_reference_with_caffes_style() -> None:
    """Features and outputs are those of tests/train/caffe.py."""
    weights, expected = (load_file(REFERENCES / f"{name}.safetensors") for name in ("step", "caffe"))
    made = learner_of(BASE | {"feature_style": "caffe"}, weights)
    image, terms = weights["image.input"], dict[str, torch.Tensor]()
    made._compare(terms, "transmission", image, weights["image.transmission"])
    assert close(terms["transmission_feature"], 0.2 * expected["loss"])
    assert close(made.features(image)[-1], expected["conv5_2"])
    assert close(torch.cat([t for t in made.separate(image) if t is not None], 1), expected["made"])


def test_the_unet_of_the_reference() -> None:
    """Outputs, losses of five steps and running means are those of tests/train/unet.py."""
    expected = load_file(REFERENCES / "unet.safetensors")
    made = learner_of(BASE | OF_UNET, expected)
    batch = {layer: expected[layer] for layer in ("input", "transmission")}
    assert close(made.separate(batch["input"])[0], expected["made"])
    losses = [made.step(step, batch).total for step in range(5)]
    assert close(torch.tensor(losses), expected["losses"])
    assert all(close(mean, expected[f"mean.{name}"]) for name, mean in made.means.items())


@pytest.mark.parametrize("kind", ["backtrack", "plain", "features", "random", "unet", "composed"])
def test_one_step_equals_that_of_the_rust_program(lesson: Path, tmp_path: Path, kind: str) -> None:
    """A step from the same checkpoint with the same examples gives the same losses, weights and moments."""
    stage = "backtrack" if kind == "backtrack" else "separation"

    def compare(folder: Path, seed: int) -> dict[str, float]:
        run, copy, _, options = resumed(lesson, folder, kind, 3, seed)
        assert train(run, stage, 3, **options) == 3
        return differences(newest(run, stage), newest(copy, stage))

    folder = check_that_steps_agree(kind, tmp_path, compare)
    run, copy = folder / "run", folder / "copy"
    rows = [list(csv.DictReader((r / "train" / stage / "metrics.csv").open())) for r in (run, copy)]
    assert [row["step"] for row in rows[0]] == ["1", "2", "3"]
    for column in COLUMNS[:-1]:
        ours, theirs = (of[-1][column] for of in rows)
        assert ours == theirs or abs(float(ours) / float(theirs) - 1) < 1e-5, column
    ours, theirs = (newest(r, stage).state for r in (run, copy))
    assert ours["code_path"].startswith("pytorch-")
    kept = set(theirs) - {"code_path", "files"}
    assert {key: ours[key] for key in kept} == {key: theirs[key] for key in kept}


@pytest.mark.parametrize("kind", ["plain", "features", "unet"])
def test_the_rust_program_reads_checkpoints(lesson: Path, tmp_path: Path, kind: str) -> None:
    """`separate` makes the pictures of PyTorch's networks; `evaluate` and `train` accept the checkpoint."""
    run, stage, options = begun(lesson, tmp_path, kind, 2)
    train(run, stage, 4, **options)
    own = newest(run, stage)
    image = next((run / "tuples").glob("test-*")) / "input.png"
    vgg = ["--features", options["features"]] if options else []
    rust("separate", image, "--network", own.path, "--out", tmp_path / "out", *vgg, "-q")
    made = Learner(own.state["settings"], stage, load_file(options["features"]) if options else None, CPU)
    made.load(own.model)
    with torch.no_grad():
        t, r = made.separate(torch.from_numpy(png(image))[None])
    for name, picture in (("transmission", t), ("glass_reflection", r)):
        if picture is not None:
            codes = (picture[0].clamp(0, 1) * 255).round().numpy()
            written = png(tmp_path / "out" / f"input.{name}.png") * 255
            print(f"{kind}: {name} differs by {np.abs(codes - written).max():.0f} codes at most")
            assert np.abs(codes - written).max() <= 1
    rust("evaluate", run, "-q", *vgg)
    rust("report", run, "-q")
    assert "at step 4" in (run / "report" / "index.html").read_text()
    rust("train", run, "--stage", stage, "--steps", 5, "-q", *vgg)
    assert newest(run, stage).state["code_path"] != own.state["code_path"]


def test_a_new_training_begins_like_that_of_the_rust_program(
    lesson: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """First weights and digests come from the package; the first step equals the Rust program's."""
    if not hasattr(glasshouse._native, "initial_weights"):
        pytest.skip("the package was built with --no-default-features")

    def compare(folder: Path, seed: int) -> dict[str, float]:
        run, _, _ = begun(lesson, folder, "plain", 1, seed)
        found: dict[str, float] = {}
        for stage in ("backtrack", "separation"):
            theirs = read_checkpoint(run / "train" / stage / "step-0000001")
            start = read_checkpoint(run / "train" / stage / "step-0000000")
            # The settings are those of a command line, not of the recipe.
            settings = start.state["settings"]
            monkeypatch.setattr(glasshouse, "train_settings", lambda *_, s=settings, **__: s)
            first = glasshouse.initial_weights(settings, stage)
            own = {name for name in start.model if stage == "backtrack" or "backtrack." not in name}
            assert all(np.array_equal(first[name], start.model[name].numpy()) for name in own)
            train(run, stage, 1, name="other")
            other = run / "train" / "other" / stage
            for name, value in differences(read_checkpoint(other / "step-0000001"), theirs).items():
                found[name] = max(value, found.get(name, 0.0))
            assert (other / "step-0000000" / "state.json").exists()
        return found

    run = check_that_steps_agree("first step", tmp_path, compare) / "run"
    ours = read_checkpoint(run / "train" / "other" / "separation" / "step-0000001")
    assert ours.state["origin"]["backtrack"][0] == 1
    rust("train", run, "--name", "other", "--stage", "separation", "--steps", 2, "-q")


# Interruptions.


@pytest.mark.parametrize("kind", ["plain", "unet"])
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_interrupted_trainings_have_the_same_bits(lesson: Path, tmp_path: Path, kind: str, how: signal.Signals) -> None:
    """A training that was stopped or killed resumes to the weights and moments of one that was not."""
    run, stage, _ = begun(lesson, tmp_path, kind, 2)
    path = run / "train" / stage / "step-0000002" / "state.json"
    path.write_text(path.read_text().replace('"schedule_steps": 20', '"schedule_steps": 200000'))
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    more = ["--stage", stage, "--steps", "100000"] + (["--checkpoint-every", "1"] if how == signal.SIGKILL else [])
    # The bits of PyTorch depend on the number of threads.
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    process = subprocess.Popen([sys.executable, *MODULE, str(run), *more], stderr=subprocess.DEVNULL, env=environment)
    metrics = run / "train" / stage / "metrics.csv"
    while metrics.read_text().count("\n") < 8 and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(how)
    assert process.wait(60) == (130 if how == signal.SIGINT else -signal.SIGKILL)
    if how == signal.SIGINT:
        lines = metrics.read_text().splitlines()
        assert newest(run, stage).state["step"] == int(lines[-1].split(",")[0])
    steps = newest(run, stage).state["step"] + 3
    for folder in (run, copy):
        assert train(folder, stage, steps) == steps
    assert newest(run, stage).state["files"] == newest(copy, stage).state["files"]
    assert not list((run / "train" / stage).glob(".tmp-*"))
    assert len(list((run / "train" / stage).glob("step-*"))) <= 3
    assert [line.split(",")[0] for line in metrics.read_text().splitlines()[1:]] == [str(k + 1) for k in range(steps)]


def test_a_training_from_an_export_has_the_same_bits(lesson: Path, tmp_path: Path) -> None:
    """A training may read the run's tuples or those of its export, also in turns."""
    run, stage, _ = begun(lesson, tmp_path, "composed", 1)
    rust("export", run, "--format", "safetensors", "--out", tmp_path / "export", "-q")
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    for folder, source in ((run, []), (copy, ["--export", str(tmp_path / "export")])):
        more = ["--stage", stage, "--steps", "3", "--memory-gb", "0.5", *source]
        subprocess.run([sys.executable, *MODULE, str(folder), *more], check=True, env=environment)
    assert newest(run, stage).state == newest(copy, stage).state
    assert train(run, stage, 4) == 4
    # An export of other scenes, and one that is missing.
    (tmp_path / "other.toml").write_text(RECIPE.replace("seed = 11", "seed = 12"))
    rust("run", tmp_path / "other.toml", "--out", tmp_path / "other", "-q")
    rust("export", tmp_path / "other", "--format", "safetensors", "--out", tmp_path / "foreign", "-q")
    for source, code, text in (("foreign", 5, "train scenes of"), ("missing", 4, "cannot read")):
        more = ["--stage", stage, "--steps", "5", "--export", str(tmp_path / source)]
        done = subprocess.run([sys.executable, *MODULE, str(run), *more], capture_output=True, text=True)
        assert done.returncode == code and text in done.stderr and "Traceback" not in done.stderr, done.stderr


def test_a_stop_flag_and_a_busy_folder(lesson: Path, tmp_path: Path) -> None:
    """A set flag ends training at once; a second trainer of the folder is refused."""
    run, stage, _ = begun(lesson, tmp_path, "unet", 2)
    stop = threading.Event()
    stop.set()
    assert train(run, stage, 9, stop=stop) == 2
    with locked(run / "train" / stage), pytest.raises(TrainError, match="another process") as busy:
        train(run, stage, 3)
    assert busy.value.exit_code == 75


def test_damaged_checkpoints_are_skipped(lesson: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Training resumes from the checkpoint before a damaged one."""
    run, stage, _ = begun(lesson, tmp_path, "unet", 1)
    model = run / "train" / stage / "step-0000001" / "model.safetensors"
    model.write_bytes(model.read_bytes()[:-1] + b"?")
    assert train(run, stage, 1) == 1
    assert "step-0000001 cannot be used" in capsys.readouterr().err
    assert newest(run, stage).state["step"] == 1


@pytest.mark.parametrize("what", ["example", "rate"])
def test_losses_that_are_not_finite_end_training(lesson: Path, tmp_path: Path, what: str) -> None:
    """No checkpoint follows, and a message names the step."""
    run, stage, _ = begun(lesson, tmp_path, "plain", 2)
    path = run / "train" / stage / "step-0000002" / "state.json"
    state = json.loads(path.read_text())
    state["settings"]["learning_rate"] = 1e30 if what == "rate" else 1e-3
    path.write_text(json.dumps(state))

    class Wrong(glasshouse.Examples):  # type: ignore[misc]
        def step(self, step: int) -> dict[str, np.ndarray]:
            arrays: dict[str, np.ndarray] = super().step(step)
            arrays["transmission"][0, 0, 0, 0] = np.nan if what == "example" else 0.5
            return arrays

    with pytest.raises(TrainError, match="loss of step [34] is (nan|inf)") as raised:
        train(run, stage, 5, examples=Wrong)
    print(f"{what}: {raised.value}")
    assert newest(run, stage).path == path.parent


def test_weights_that_are_not_finite_are_not_written(tmp_path: Path) -> None:
    """A message names the tensor."""
    made = learner_of(BASE | OF_UNET, load_file(REFERENCES / "unet.safetensors"))
    made.moments()["square.separation.last"][0, 0, 0, 0] = np.inf
    with pytest.raises(TrainError, match="square.separation.last is not finite"):
        write_checkpoint(tmp_path, made, {})
    assert not list(tmp_path.iterdir())


# Settings.


def test_settings_that_are_not_supported_are_named() -> None:
    """Each error names the setting."""
    wrong: list[dict[str, Any]] = [{"real_share": 0.5}, {"features": "dino"}, {"network": "unet"}, {"optimizer": "sgd"}]
    for more in wrong:
        with pytest.raises(TrainError, match=next(iter(more))):
            checked(BASE | more)
    with pytest.raises(TrainError, match="width is missing"):
        checked({name: value for name, value in BASE.items() if name != "width"})
    with pytest.raises(TrainError, match="depth is unknown"):
        checked(BASE | {"depth": 3})


def test_rates_follow_the_schedule() -> None:
    """The rates are those of the tests of src/plan/training.rs."""

    def of(*steps: int, **more: Any) -> Any:
        return pytest.approx([rate(BASE | {"learning_rate": 2.0} | more, step) for step in steps], abs=1e-12)

    assert of(1, 2, 4, 5, 900, warmup_steps=4) == [0.5, 1, 2, 2, 2]
    assert of(5, 10, schedule="cosine", schedule_steps=10) == [1, 0]
    assert of(1, 3, 4, 5, 6, schedule="step", decay_steps=[3, 5], decay_factor=0.1) == [2, 2, 0.2, 0.2, 0.02]
    other = BASE | {"discriminator_learning_rate": 3.0}
    assert [rate(one, 1, "discriminator_learning_rate") for one in (other, BASE)] == [3.0, 1e-4]


# Half precision and several processes.


def test_a_step_in_bf16_is_close_to_one_in_f32() -> None:
    """Losses differ by a percent; weights and moments stay float32."""
    weights = load_file(REFERENCES / "step.safetensors")
    batch = {layer: weights[f"image.{layer}"] for layer in LAYERS}
    # The features of this VGG-19, with one channel for 32 of the published ones, vary too little for half precision.
    settings = BASE | {"feature_weight": 0.0}
    one, other = (learner_of(settings, weights, precision) for precision in ("f32", "bf16"))
    losses = [made.step(0, batch) for made in (one, other)]
    assert abs(losses[1].total / losses[0].total - 1) < 0.01
    assert all(tensor.dtype == torch.float32 for tensor in other.moments().values())
    for name in ("separation", "backtrack", "discriminator"):
        gradients = [
            torch.cat([t.flatten() for key, t in made.moments().items() if key.startswith(f"mean.{name}")])
            for made in (one, other)
        ]
        cosine = float(torch.nn.functional.cosine_similarity(*gradients, 0))
        print(f"bf16: loss {losses[1].total / losses[0].total - 1:+.1e}, cosine of {name}'s gradients {cosine:.4f}")
        assert cosine > 0.98


TRAIN_THEN_LIST_THREADS = """
import sys
from pathlib import Path
from glasshouse.train import main

code = main()
print("threads:", sorted(path.read_text().strip() for path in Path("/proc/self/task").glob("*/comm")))
sys.exit(code)
"""


@pytest.mark.parametrize("kind", ["plain", "unet"])
def test_two_processes_equal_one(lesson: Path, tmp_path: Path, kind: str) -> None:
    """Two processes with one example each train like one process with both, also through the norms' statistics."""
    program = tmp_path / "train_then_list_threads.py"
    program.write_text(TRAIN_THEN_LIST_THREADS)
    together = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", str(program)]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}

    def compare(folder: Path, seed: int) -> dict[str, float]:
        run, stage, _ = begun(lesson, folder, kind, 2, seed)
        copy = folder / "copy"
        shutil.copytree(run, copy)
        train(copy, stage, 4)
        arguments = [sys.executable, *together, str(run), "--stage", stage, "--steps", "4"]
        done = subprocess.run(arguments, capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        if sys.platform == "linux":
            # Threads of a process group that is not destroyed abort some processes at their exit.
            assert "threads: " in done.stdout
            assert "gloo" not in done.stdout, done.stdout
        return differences(newest(run, stage), newest(copy, stage))

    check_that_steps_agree(f"two processes, {kind}", tmp_path, compare)


def test_jumps_of_the_loss_are_reported() -> None:
    losses = [2000.0] + [0.1] * 48 + [0.9]
    assert trainer.warning_of_jumps([]) is None
    assert trainer.warning_of_jumps(losses) is None
    losses[3], losses[49] = 1.5, 600.0
    assert "median, 0.100, in 2 of 50 steps, and reaches 600.000;" in (trainer.warning_of_jumps(losses) or "")
