"""Stores the results of a peer: OUT/<peer>/result.json, a list of passes, and one .npy for each layer of a pass.

A pass is one rendering that gives one or more layers: {"name", "samples", "cpu_s", "runs_cpu_s", "warm_up_cpu_s",
"layers": {layer: file}}. `cpu_s` is user and system seconds of rendering alone, median of the runs.
"""

from __future__ import annotations

import json
import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

RUNS = 3
ENOUGH_S = 15.0


class Record:
    """A peer's results so far; saved after every pass, so that an interrupted run resumes where it stopped."""

    def __init__(self, folder: Path, **facts: object) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.path = folder / "result.json"
        old = json.loads(self.path.read_text()) if self.path.is_file() else {}
        self.data: dict = {"passes": old.get("passes", []), **facts}

    def has(self, name: str, samples: int) -> bool:
        """True if this pass was measured before."""
        return any(p["name"] == name and p["samples"] == samples for p in self.data["passes"])

    def add(self, name: str, samples: int, images: dict[str, np.ndarray], **figures: object) -> None:
        """Saves the layers of a pass, then its figures."""
        files = {}
        for layer, image in images.items():
            files[layer] = f"{name}_{samples}_{layer}.npy"
            np.save(self.folder / files[layer], np.asarray(image, np.float32))
        self.data["passes"].append({"name": name, "samples": samples, "layers": files, **figures})
        self.save()
        print(f"{self.folder.name}: {name}, {samples} samples: {figures['cpu_s']:.3f} CPU s", flush=True)

    def save(self) -> None:
        """Writes to another name first, so that a killed run leaves no partial file."""
        part = self.path.with_suffix(".part")
        part.write_text(json.dumps(self.data, indent=1))
        os.replace(part, self.path)


def timed(render: Callable[[int], np.ndarray | dict], warm_up: bool) -> tuple[np.ndarray | dict, dict]:
    """Renders once to warm up if `warm_up`, then up to three times or 15 s, each time with another seed."""
    first = cpu_s(lambda: render(1))[1] if warm_up else 0.0
    runs: list[float] = []
    while not runs or (len(runs) < RUNS and sum(runs) < ENOUGH_S):
        image, seconds = cpu_s(lambda: render(2 + len(runs)))
        runs.append(seconds)
    middle = statistics.median(runs)
    return image, {"cpu_s": middle, "runs_cpu_s": runs, "warm_up_cpu_s": max(first - middle, 0.0)}


def cpu_s(work: Callable[[], object]) -> tuple:
    """Runs `work`; returns its result, and the user and system seconds of this process's threads."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start
