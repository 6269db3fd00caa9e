"""Training examples of a run's tuples, as `glasshouse train` draws them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _native
from ._threads import thread_count
from .planning import PathLike, Roots

Array = npt.NDArray[np.float32]

COMPOSED = ("composed", "linear_mixtures", "zhang_mixtures", "ceilnet_mixtures")
"""Kinds of examples that are made of tuples in linear light."""


def train_settings(
    run: PathLike, *, stage: str | None = None, name: str | None = None, of_recipe: bool = False
) -> dict[str, Any]:
    """Returns the settings with which `glasshouse train RUN` begins: the recipe's, or else the defaults.

    Args:
        run: Folder of a run.
        stage: Stage of the training; both stages have the same settings.
        name: Name of the training; None for the one without a name.
        of_recipe: Whether the training must be one of the recipe; then None stands for its first one.

    Raises:
        GlasshouseError: The recipe has no training of this name, with `of_recipe`, or cannot be read.

    """
    settings: dict[str, Any] = json.loads(_native.train_settings(Path(run), name, of_recipe))
    return settings


def initial_weights(settings: Mapping[str, Any], stage: str) -> dict[str, Array]:
    """Returns the weights with which a training of a stage begins: float32 arrays by their names in a checkpoint.

    With random features, the VGG-19's weights are among them as `features.N.weight` and `features.N.bias`.

    Raises:
        GlasshouseError: The settings are not valid, or the package was built without default features.

    """
    if not hasattr(_native, "initial_weights"):
        raise _native.GlasshouseError(
            "this package was built with --no-default-features: install it with its default features"
        )
    return _native.initial_weights(json.dumps(dict(settings)), stage)


class Examples:
    """The examples of every step of a training, with the bits of `glasshouse train` for the same settings.

    Args:
        run: Folder of a run, or of its export in the format of safetensors.
        settings: Settings of the training, as `[train.settings]` of a recipe; missing ones have their defaults.
        root: Folders of named roots, for mixtures of photographs.
        split: Split of the scenes.
        memory_mb: Memory of tuples that are kept for later epochs, in each process.
        threads: Number of threads; by default 1 in a worker of a DataLoader, else the number of processors.

    """

    def __init__(
        self,
        run: PathLike,
        settings: Mapping[str, Any],
        *,
        root: Roots | None = None,
        split: str = "train",
        memory_mb: int = 2048,
        threads: int | None = None,
    ) -> None:
        self._given = (Path(run), dict(root or {}), json.dumps(dict(settings)), split, memory_mb << 20)
        self._threads = threads
        self._sampler = _native.Sampler(*self._given)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_sampler"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._sampler = _native.Sampler(*self._given)

    @property
    def scenes(self) -> int:
        """The number of scenes."""
        return len(self._sampler)

    @property
    def scenes_blake3(self) -> str:
        """The digest of the scenes' lines, as checkpoints record it."""
        return self._sampler.scenes_blake3

    def step(self, step: int, out: dict[str, Array] | None = None) -> dict[str, Array]:
        """Returns the examples of a step: float32 arrays (B, 3, S, S) in sRGB codes from 0 to 1.

        The names are `input`, `transmission`, `glass_reflection` and `clean_reflection`, those that the tuples have.

        Raises:
            GlasshouseError: A tuple is damaged, or no scene has a usable one.

        """
        return self.steps([step], out)

    def steps(self, steps: Sequence[int], out: dict[str, Array] | None = None) -> dict[str, Array]:
        """Returns the examples of several steps, one after another, made on all threads. See `step`."""
        return self._sampler.steps(list(steps), out, thread_count(self._threads))


class Mixtures(Sequence[dict[str, Any]]):
    """Examples composed in linear light, behind a camera: I = a F_i + b R~_j of a run's tuples i and j.

    `mixtures[k]` is a dictionary of float32 arrays (3, S, S) in sRGB codes from 0 to 1: `input`, `target_t` (a T_i
    through the same decisions of the camera, without noise) and `target_r`. It depends on the seed and k alone, and
    equals the k-th example that `glasshouse train` draws with the same settings and seed. Epochs follow one another:
    `len(mixtures)` examples use each tuple once as the front, and the next ones are other examples.

    Args:
        path: Folder of a run with tuples (`glasshouse run RECIPE`), or of its export (`glasshouse export RUN --format
            safetensors`), whose shards are mapped into memory.
        seed: Seed of all numbers.
        size: Side of the examples, px; by default that of the settings. The tuples must be as large.
        label: "code" for target_r = the code of b R~_j after the same decisions, clipped at 0; "difference" for `input
            - target_t`, as XReflection and RDNet compute it.
        name: Training of the recipe whose settings are used; by default the first, or else the default settings.
        settings: Settings in place of the training's, as in `[train.settings]`, such as `{"composition": {...}}`.
        length: Number of examples; by default one epoch.
        split: Split of the scenes.
        memory_mb: Memory of tuples, in each process.
        threads: Number of threads; by default 1 in a worker of a DataLoader, else the number of processors.

    """

    def __init__(
        self,
        path: PathLike,
        seed: int = 0,
        *,
        size: int | None = None,
        label: Literal["code", "difference"] = "code",
        name: str | None = None,
        settings: Mapping[str, Any] | None = None,
        length: int | None = None,
        split: str = "train",
        memory_mb: int = 2048,
        threads: int | None = None,
    ) -> None:
        if label not in ("code", "difference"):
            raise ValueError(f'label is {label!r}, but must be "code" or "difference"')
        chosen: dict[str, Any] = {**train_settings(path, name=name, of_recipe=True), **(settings or {})}
        if chosen["examples"] not in COMPOSED:
            chosen["examples"] = "composed"
        chosen.update(seed=seed, batch=1, real_share=0.0)
        if size is not None:
            chosen["crop_px"] = size
        self.settings: dict[str, Any] = chosen
        """Settings of the examples."""
        self._label = label
        self._examples = Examples(path, chosen, split=split, memory_mb=memory_mb, threads=threads)
        self._length = self._examples.scenes if length is None else length

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"example {index} of {len(self)}")
        return {name: values[0] for name, values in self.batch([index % len(self)]).items()}

    def __getitems__(self, indices: Sequence[int]) -> list[dict[str, Any]]:
        """Returns several examples at once, as PyTorch's fetcher asks for them."""
        batch = self.batch(indices)
        return [{name: values[at] for name, values in batch.items()} for at in range(len(indices))]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self[index] for index in range(len(self)))

    def batch(self, indices: Sequence[int]) -> dict[str, Array]:
        """Returns examples of any numbers from 0, also beyond the length, as arrays (B, 3, S, S)."""
        made = self._examples.steps(indices)
        code = made["glass_reflection"]
        target_r = code if self._label == "code" else made["input"] - made["transmission"]
        return {"input": made["input"], "target_t": made["transmission"], "target_r": target_r}
