"""Checkpoints and `metrics.csv` of a training, in the formats of `glasshouse train` (docs/formats.md)."""

import csv
import fcntl
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import torch
from safetensors.torch import load, save

import glasshouse
from glasshouse.learner import Learner, Losses, Tensors, TrainError

SCHEMA, MODEL, OPTIMIZER = "glasshouse.checkpoint/1", "model.safetensors", "optimizer.safetensors"
KEPT = 3
LAYERS = ("transmission", "glass_reflection", "clean_reflection")
TERMS = [f"{layer}_{kind}" for layer in LAYERS for kind in ("l1", "feature")]
TERMS += ["adversarial", *(f"{layer}_gradient" for layer in LAYERS)]
COLUMNS = ["step", "total", *TERMS, "discriminator", "validation_psnr_db", "validation_light_ratio", "wall_s"]


@dataclass
class Checkpoint:
    """A checkpoint with verified digests: the contents of `state.json` and the tensors of the other two files."""

    path: Path
    state: dict[str, Any]
    model: Tensors
    moments: Tensors


def steps_of(folder: Path) -> list[int]:
    """Returns the steps of the checkpoints in a stage's folder, in ascending order."""
    names = [path.name.removeprefix("step-") for path in folder.glob("step-*")]
    return sorted(int(name) for name in names if name.isdecimal())


def path_of(folder: Path, step: int) -> Path:
    """Returns the folder of a step's checkpoint in a stage's folder."""
    return folder / f"step-{step:07}"


def read_checkpoint(path: Path) -> Checkpoint:
    """Reads a checkpoint; raises ValueError, KeyError or OSError if it is damaged."""
    state = json.loads((path / "state.json").read_bytes())
    if state["schema"] != SCHEMA:
        raise ValueError(f"its schema is {state['schema']!r}, but this program reads {SCHEMA!r}")
    if path.name != path_of(path.parent, state["step"]).name:
        raise ValueError(f"step is {state['step']}, but the folder is {path.name}")
    tensors = []
    for name in (MODEL, OPTIMIZER):
        data = (path / name).read_bytes()
        if state["files"].get(name) != glasshouse.blake3(data):
            raise ValueError(f"{name} does not match its digest")
        tensors.append({key: tensor.float() for key, tensor in load(data).items()})
    return Checkpoint(path, state, *tensors)


def newest(folder: Path, least: int) -> Checkpoint | None:
    """Returns the newest usable checkpoint of a stage from step `least` on; names damaged ones on stderr."""
    for step in reversed([step for step in steps_of(folder) if step >= least]):
        try:
            return read_checkpoint(path_of(folder, step))
        except (ValueError, KeyError, OSError) as error:
            print(f"warning: the checkpoint {path_of(folder, step)} cannot be used: {error}", file=sys.stderr)
    return None


def sync(path: Path) -> None:
    """Makes a file, or the names in a folder, durable."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_checkpoint(folder: Path, learner: Learner, state: dict[str, Any]) -> Path:
    """Writes the checkpoint of the learner's step atomically and durably, and removes old ones; returns its folder.

    `state` has the fields of `state.json` that training does not change. Raises TrainError, and writes nothing, if a
    value is not finite.
    """
    files = {}
    for name, tensors in ((MODEL, learner.model()), (OPTIMIZER, learner.moments())):
        for key, tensor in tensors.items():
            if not bool(tensor.isfinite().all()):
                raise TrainError(
                    f"the networks of step {learner.steps} are not written: {key} is not finite;"
                    " earlier checkpoints stay. A smaller learning rate may help"
                )
        files[name] = save({key: tensor.cpu().contiguous() for key, tensor in tensors.items()})
    state = state | {
        "schema": SCHEMA,
        "stage": learner.stage,
        "step": learner.steps,
        "generator_steps": learner.steps,
        "discriminator_steps": learner.judge_steps,
        "parameters": sum(p.numel() for p in learner.networks.parameters()),
        "settings": learner.settings,
        "code_path": code_path(learner),
        "validation_psnr_db": None,
        "files": {name: glasshouse.blake3(data) for name, data in files.items()},
    }
    files["state.json"] = (json.dumps(state, indent=2, allow_nan=False) + "\n").encode()
    path = path_of(folder, learner.steps)
    temporary = Path(tempfile.mkdtemp(prefix=".tmp-", dir=folder))
    for name, data in files.items():
        (temporary / name).write_bytes(data)
        sync(temporary / name)
    temporary.chmod(0o755)
    sync(temporary)
    shutil.rmtree(path, ignore_errors=True)
    temporary.rename(path)
    sync(folder)
    best = folder / "best.json"
    kept = json.loads(best.read_bytes()).get("step") if best.exists() else None
    for step in steps_of(folder)[:-KEPT]:
        if step != kept:
            shutil.rmtree(path_of(folder, step))
    return path


def code_path(learner: Learner) -> str:
    """Returns what determines the last bits of a training, such as `pytorch-2.9.0-cpu-f32`."""
    return f"pytorch-{torch.__version__}-{learner.device.type}-{learner.precision}"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Locks a stage's folder against other trainers, of both programs, and removes what killed ones left.

    Raises TrainError if another process holds the lock.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "train.lock").open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise TrainError(f"another process is training in {folder}; wait for it, or stop it", 75) from error
        for path in folder.glob(".tmp-*"):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
        yield


class Metrics:
    """`metrics.csv`: a line per step."""

    def __init__(self, path: Path, step: int) -> None:
        """Opens the file for training that continues at `step`; removes later and cut lines."""
        rows: list[dict[str, str]] = []
        if path.exists():
            with path.open(newline="") as old:
                rows = [row for row in csv.DictReader(old) if None not in row and None not in row.values()]
        handle, temporary = tempfile.mkstemp(prefix=".tmp-", dir=path.parent)
        with os.fdopen(handle, "w", newline="") as new:
            writer = csv.DictWriter(new, COLUMNS, "", "ignore", lineterminator="\n")
            writer.writeheader()
            writer.writerows(row for row in rows if row["step"].isdecimal() and int(row["step"]) <= step)
        Path(temporary).chmod(0o644)
        sync(Path(temporary))
        Path(temporary).rename(path)
        sync(path.parent)
        self.file: TextIO = path.open("a", newline="")

    def add(self, step: int, losses: Losses, wall_s: float) -> None:
        """Adds a line. Absent numbers become empty fields."""
        row = {"total": losses.total, **losses.terms, "discriminator": losses.discriminator}
        numbers = [row.get(column) for column in COLUMNS[1:-1]]
        cells = ["" if number is None else f"{number:.9g}" for number in numbers]
        self.file.write(",".join([str(step), *cells, f"{wall_s:.4f}"]) + "\n")
        self.file.flush()

    def sync(self) -> None:
        """Makes all lines durable."""
        os.fsync(self.file.fileno())
