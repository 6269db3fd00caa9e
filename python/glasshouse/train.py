"""Trains the networks of a run in PyTorch: `python -m glasshouse.train RUN --stage separation --steps 100000`.

Settings, examples, losses, optimisers and checkpoint folders are those of `glasshouse train`, so that both programs
resume each other's trainings, and `glasshouse separate` and `evaluate` read the checkpoints. `torchrun` starts several
processes, which share the examples of each step. docs/training.md lists the differences.
"""

import argparse
import math
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import dropwhile
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
import torch.distributed as dist
from safetensors.torch import load
from torch import Tensor

import glasshouse
from glasshouse.checkpoints import (
    MODEL,
    Metrics,
    code_path,
    locked,
    newest,
    write_checkpoint,
)
from glasshouse.learner import Learner, Settings, Tensors, TrainError, checked
from glasshouse.networks import mean_of_processes, process_count

# Number of steps whose examples are read ahead, and of threads that read them.
AHEAD, READERS = 8, 4
# Loss of a step over the median of all steps from which a step counts as a jump.
JUMP = 10
# Settings of the architecture, which the separation stage inherits from the backtrack stage.
OF_NETWORKS = ("features", "feature_style", "network", "vgg_divisor", "width", "start")


class ExampleSource(Protocol):
    """The examples of a training."""

    @property
    def scenes_blake3(self) -> str:
        """The digest of the scenes' lines."""
        ...

    def step(self, step: int, /) -> Mapping[str, Any]:
        """Returns the float32 arrays (batch, 3, rows, columns) of a step, counted from 0: sRGB codes from 0 to 1.

        The keys are `input`, `transmission` and, if all examples have them, `glass_reflection` and `clean_reflection`.
        """
        ...


@dataclass
class Begun:
    """What a training begins with."""

    settings: Settings
    # Fields of `state.json` that training does not change.
    state: dict[str, Any]
    vgg: Tensors | None
    model: Mapping[str, Any]
    # None for a new training.
    moments: Tensors | None
    # Numbers of steps of the generators' and of the discriminator's optimiser.
    steps: tuple[int, int]


def new_settings(run: Path, stage: str, name: str | None) -> dict[str, Any]:
    """Returns the recipe's settings, or the defaults with a note if the recipe has no training of this name."""
    settings = glasshouse.train_settings(run, stage=stage, name=name)
    if name is not None:
        try:
            return glasshouse.train_settings(run, stage=stage, name=name, of_recipe=True)
        except glasshouse.GlasshouseError as error:
            print(f"note: {error}: this one begins with the default settings", file=sys.stderr)
    return settings


def begin(run: Path, training: Path, stage: str, steps: int, name: str | None, features: Path | None) -> Begun:
    """Reads the newest checkpoint of the stage, or begins a training with the recipe's settings.

    Raises TrainError if a setting is not supported, or if weights of VGG-19 or of BT-net are missing or others.
    """
    own = newest(training / stage, 0)
    settings = checked(own.state["settings"] if own else new_settings(run, stage, name))
    if settings["schedule"] == "cosine":
        settings["schedule_steps"] = end = settings["schedule_steps"] or steps
        if steps > end:
            raise TrainError(f"the cosine of the learning rate ends at step {end}, before step {steps}", 5)
    vgg, vgg_blake3 = None, None
    if settings["features"] == "file":
        if features is None:
            raise TrainError("these networks use features of a VGG-19 from a file: name it with --features FILE", 4)
        data = features.read_bytes()
        vgg, vgg_blake3 = load(data), glasshouse.blake3(data)
    is_random = settings["features"] == "random"
    initial: Mapping[str, Any] = glasshouse.initial_weights(settings, stage) if own is None or is_random else {}
    if is_random:
        vgg = {key: torch.as_tensor(value) for key, value in initial.items() if key.startswith("features.")}
    has_before = own is None and stage == "separation" and settings["network"] == "generator"
    before = newest(training / "backtrack", 1) if has_before else None
    for other in filter(None, (own, before)):
        if other.state["origin"]["vgg_blake3"] != vgg_blake3:
            raise TrainError(f"VGG-19's weights are not those that {other.path} was trained with", 5)
    if own:
        names = ("history", "origin", "baselines", "code_path")
        kept: dict[str, Any] = {key: own.state[key] for key in names if key in own.state}
        counts = own.state["generator_steps"], own.state["discriminator_steps"]
        return Begun(settings, kept, vgg, own.model, own.moments, counts)
    if before:
        others = [key for key in OF_NETWORKS if before.state["settings"][key] != settings[key]]
        if others:
            raise TrainError(f"the settings {', '.join(others)} differ from those of {before.path}", 5)
        initial = {**initial, **{key: t for key, t in before.model.items() if key.startswith("backtrack.")}}
    elif stage == "separation" and settings["a_priori"]:
        raise TrainError(f"the separation stage begins with a BT-net, and {training} has none: train it first", 4)
    origin = {
        "vgg_blake3": vgg_blake3,
        "scenes_blake3": None,
        "real_files_blake3": None,
        "backtrack": [before.state["step"], before.state["files"][MODEL]] if before else None,
    }
    return Begun(settings, {"origin": origin}, vgg, initial, None, (0, 0))


def prefetched(source: ExampleSource, steps: range) -> Generator[Mapping[str, Any]]:
    """Yields the examples of steps, in order, which threads read ahead."""
    reader, ahead, unread = ThreadPoolExecutor(READERS, "examples"), deque[Any](), iter(steps)
    try:
        for _ in steps:
            while len(ahead) < AHEAD and (step := next(unread, None)) is not None:
                ahead.append(reader.submit(source.step, step))
            yield ahead.popleft().result()
    finally:
        reader.shutdown(wait=False, cancel_futures=True)


def is_first() -> bool:
    """Returns whether this process writes: the only one, or the first of several."""
    return process_count() == 1 or dist.get_rank() == 0


def from_first(make: Callable[[], Begun]) -> Begun:
    """Calls `make` in the first process and returns its result in all."""
    if process_count() == 1:
        return make()
    shared = [make() if is_first() else None]
    dist.broadcast_object_list(shared, 0)
    assert shared[0] is not None
    return shared[0]


def train(
    run: Path,
    stage: str,
    steps: int,
    *,
    name: str | None = None,
    device: str = "cpu",
    precision: str = "f32",
    compiled: bool = False,
    features: Path | None = None,
    checkpoint_every: int | None = None,
    stop: threading.Event | None = None,
    examples: Callable[[Path, Settings], ExampleSource] | None = None,
) -> int:
    """Trains a stage until step `steps` in all, or until `stop` is set; returns the last step, which has a checkpoint.

    `checkpoint_every` is a number of steps, by default a twentieth of `steps`, from 10 to 1,000. `examples` makes the
    source of examples; by default, it is the package's `Examples`. `glasshouse.learner.checked` lists the settings.

    Raises TrainError, and writes no checkpoint, if a setting, a weight, the loss or an example is unusable.
    """
    check_device(device)
    training = run / "train" / name if name else run / "train"
    with locked(training / stage) if is_first() else unlocked():
        begun = from_first(lambda: begin(run, training, stage, steps, name, features))
        source = (examples or glasshouse.Examples)(run, begun.settings)
        origin = begun.state["origin"]
        if origin["scenes_blake3"] not in (None, source.scenes_blake3):
            raise TrainError("the run's train scenes are not those of the checkpoint", 5)
        origin["scenes_blake3"] = source.scenes_blake3
        place = torch.device(f"cuda:{os.environ.get('LOCAL_RANK', '0')}" if device == "cuda" else device)
        learner = Learner(begun.settings, stage, begun.vgg, place, precision)
        learner.load(begun.model, begun.moments)
        learner.steps, learner.judge_steps = begun.steps
        if compiled:
            learner.compile()
        session = Session(learner, training / stage, begun)
        batches = prefetched(source, range(learner.steps, steps))
        try:
            return session.run(batches, steps, checkpoint_every, stop or threading.Event())
        finally:
            batches.close()


def check_device(device: str) -> None:
    """Raises TrainError if PyTorch cannot compute on the device."""
    if device.startswith("cuda") and not torch.cuda.is_available():
        built = "was built without CUDA" if torch.version.cuda is None else "finds no GPU or no driver (nvidia-smi)"
        raise TrainError(f"--device {device}: this PyTorch {built}; train with --device cpu", 4)


@contextmanager
def unlocked() -> Iterator[None]:
    """Does nothing: the first process holds the lock."""
    yield


def warning_of_jumps(losses: list[float]) -> str | None:
    """Returns a warning if the losses of steps, all finite, jump, the sign of an unstable training."""
    median = sorted(losses)[len(losses) // 2] if losses else 0.0
    # A long training begins with losses far above its median.
    after_start = dropwhile(lambda loss: loss > median, losses)
    jumps = [loss for loss in after_start if loss > JUMP * median]
    if not jumps:
        return None
    found = f"exceeds {JUMP} times its median, {median:.3f}, in {len(jumps)} of {len(losses)} steps"
    return f"the loss {found}, and reaches {max(jumps):.3f}; a smaller learning rate may help"


class Session:
    """The steps of one call, with its logs and checkpoints."""

    def __init__(self, learner: Learner, folder: Path, begun: Begun) -> None:
        """Begins at the learner's step; raises TrainError if processes cannot share the batch."""
        self.learner, self.folder, self.state = learner, folder, begun.state
        self.written = None if begun.moments is None else learner.steps
        self.metrics = Metrics(folder / "metrics.csv", learner.steps) if is_first() else None
        share, rest = divmod(learner.settings["batch"], process_count())
        if rest:
            raise TrainError(f"the setting batch is not a multiple of the number of processes, {process_count()}", 2)
        rank = dist.get_rank() if process_count() > 1 else 0
        self.part = slice(rank * share, (rank + 1) * share)
        before = begun.state.get("code_path", code_path(learner))
        if is_first() and before != code_path(learner):
            print(f"note: the checkpoint was computed by {before}: the last bits will differ", file=sys.stderr)

    def run(self, batches: Iterator[Mapping[str, Any]], steps: int, every: int | None, stop: threading.Event) -> int:
        """Trains until step `steps` or until a process's `stop` is set; returns the last step."""
        learner, told, totals = self.learner, time.monotonic(), list[float]()
        every = every or min(1000, max(10, steps // 20))
        while learner.steps < steps and not self._is_stopped(stop):
            begin = time.monotonic()
            try:
                batch = {layer: self._tensor(array) for layer, array in next(batches).items() if array is not None}
            except Exception:
                self.write()
                raise
            if self.written is None:
                # A training killed before its first due checkpoint resumes with its own settings.
                self.write()
            losses = learner.step(learner.steps, batch)
            if not math.isfinite(losses.total):
                text = f"the loss of step {learner.steps} is {losses.total}; earlier checkpoints stay."
                raise TrainError(f"{text} A smaller learning rate may help")
            totals.append(losses.total)
            now = time.monotonic()
            if self.metrics:
                self.metrics.add(learner.steps, losses, now - begin)
                if now - told > 10:
                    print(f"step {learner.steps} of {steps}, loss {losses.total:.4f}", file=sys.stderr)
                    told = now
            if learner.steps % every == 0:
                self.write()
        if learner.steps > 0:
            self.write()
        if is_first() and (warning := warning_of_jumps(totals)):
            print(f"warning: {warning}", file=sys.stderr)
        return learner.steps

    def _is_stopped(self, stop: threading.Event) -> bool:
        flag = torch.tensor(float(stop.is_set()), device=self.learner.device)
        return bool(mean_of_processes(flag) > 0) if process_count() > 1 else stop.is_set()

    def _tensor(self, array: Any) -> Tensor:
        part = torch.from_numpy(np.ascontiguousarray(array[self.part], np.float32))
        return part.to(self.learner.device, memory_format=torch.channels_last)

    def write(self) -> None:
        """Writes the checkpoint of the last step, unless it is written."""
        if self.metrics and self.written != self.learner.steps:
            self.metrics.sync()
            write_checkpoint(self.folder, self.learner, self.state)
        self.written = self.learner.steps


def main() -> int:
    """Runs the command line; returns the exit code: 0, 130 or 143 after a signal, and those of `glasshouse train`."""
    parser = argparse.ArgumentParser("python -m glasshouse.train", description="Train the networks of a run in PyTorch")
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument("--stage", choices=("backtrack", "separation"), required=True)
    parser.add_argument("--steps", type=int, required=True, help="total number of steps; an earlier training resumes")
    parser.add_argument("--name", help="name of the training, if the run has several")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    parser.add_argument("--precision", choices=("f32", "bf16"), default="f32", help="type of the convolutions")
    parser.add_argument("--compile", action="store_true", help="compile the networks with torch.compile")
    parser.add_argument("--features", type=Path, help="file of VGG-19's weights (.safetensors), if settings need it")
    parser.add_argument("--checkpoint-every", type=int, help="steps between checkpoints [a twentieth, 10 to 1000]")
    parser.add_argument("--memory-gb", type=float, default=2.0, help="memory for the run's tuples, in each process [2]")
    parser.add_argument(
        "--export",
        type=Path,
        help="the run's export in the format of safetensors, for composed examples: it is mapped"
        " into memory, which all processes share, in place of the run's tuples",
    )
    options = parser.parse_args()
    stop, caught = threading.Event(), list[int]()

    def examples(run: Path, settings: Settings) -> ExampleSource:
        memory_mb = int(options.memory_gb * 1000)
        of_run = glasshouse.Examples(run, settings, memory_mb=memory_mb)
        if options.export is None:
            return of_run
        exported = glasshouse.Examples(options.export, settings, memory_mb=memory_mb)
        if exported.scenes_blake3 != of_run.scenes_blake3:
            found = f"the {exported.scenes} train scenes of {options.export} are not the {of_run.scenes} of {run}"
            raise TrainError(f"{found}: export the run again, or train without --export if scenes are in quarantine", 5)
        return exported

    def catch(number: int, _frame: object) -> None:
        caught.append(number)
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, catch)
    if int(os.environ.get("WORLD_SIZE", "1")) > 1:
        if options.device == "cuda" and torch.cuda.is_available():
            torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
        # The default arguments of this module hold the process group if the first step imports it: then gloo's threads
        # outlive the group, and may abort the process at its exit.
        from torch.distributed.nn import functional as _functional  # noqa: F401

        dist.init_process_group("nccl" if options.device == "cuda" else "gloo")
    try:
        step = train(
            options.run,
            options.stage,
            options.steps,
            name=options.name,
            device=options.device,
            precision=options.precision,
            compiled=options.compile,
            features=options.features,
            checkpoint_every=options.checkpoint_every,
            stop=stop,
            examples=examples,
        )
    except (TrainError, glasshouse.GlasshouseError) as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code if isinstance(error, TrainError) else 4
    finally:
        if process_count() > 1:
            dist.destroy_process_group()
    print(f"reached step {step}")
    return 128 + caught[0] if caught and step < options.steps else 0


if __name__ == "__main__":
    sys.exit(main())
