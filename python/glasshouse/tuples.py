"""A data set that renders its scenes when they are asked for."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _native
from ._threads import thread_count
from .planning import PathLike, Roots, planned_lines

Array = npt.NDArray[np.float32]


class Tuples(Sequence[dict[str, Any]]):
    """Scenes of a recipe, a manifest or a run, rendered on demand.

    `tuples[i]` is a dictionary of float32 arrays (3, H, W) in linear Rec.709 light, not clipped: `input`,
    `transmission`, `glass_reflection`, `clean_reflection`, those labels that the scene asks for, and `id`. It depends
    on line i alone: shuffling samplers, ranks, workers and restarts change no bit, and without other values it has the
    bits of the command `glasshouse render`.

    An object renders on own threads, which it starts at the first call in each process, also after a fork. Python's
    lock is free meanwhile, and Ctrl-C works.

    Args:
        path: A recipe (.toml), a manifest (.jsonl) or a run's folder, whose manifest is rendered anew.
        root: Folders of named roots.
        spp: Samples per pixel in place of the lines' own, a power of two. 16 are enough to train on.
        size: Side of the film, px, or (width, height), in place of the lines' own.
        seed: Seed of the samples in place of the lines' own.
        split: Only the scenes of this split: "train", "validation" or "test".
        layers: Names of layers and labels in place of the lines' own.
        on_error: "raise" raises `SceneError` for a scene that cannot be rendered. "skip" warns, and returns the next
            scene that can be, so that batches keep their size.
        cache_mb: Memory of decoded photographs, in each process.
        threads: Number of threads; by default 1 in a worker of a DataLoader, else the number of processors.
        inputs: Folder for the procedural pictures of a recipe; by default one below the user's cache.

    Raises:
        GlasshouseError: The recipe, a line or a file cannot be used.

    """

    def __init__(
        self,
        path: PathLike,
        root: Roots | None = None,
        spp: int | None = None,
        size: int | tuple[int, int] | None = None,
        seed: int | None = None,
        *,
        split: str | None = None,
        layers: Sequence[str] | None = None,
        on_error: Literal["raise", "skip"] = "raise",
        cache_mb: int = 1024,
        threads: int | None = None,
        inputs: PathLike | None = None,
    ) -> None:
        if on_error not in ("raise", "skip"):
            raise ValueError(f'on_error is {on_error!r}, but must be "raise" or "skip"')
        sides = (size, size) if isinstance(size, int) else size
        planned = planned_lines(path, root, inputs=inputs)
        names = None if layers is None else list(layers)
        self._given = (planned.jsonl, planned.roots, planned.base, spp, sides, seed, names, cache_mb << 20, False)
        self._replace = on_error == "skip"
        self._threads = threads
        self._warned: set[str] = set()
        self._scenes = _native.Scenes(*self._given)
        self._indices = self._scenes.of_split(split) if split is not None else list(range(len(self._scenes)))
        if not self._indices:
            raise _native.GlasshouseError(f"{path} has no scene in the split {split!r}")

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_scenes"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._scenes = _native.Scenes(*self._given)

    def __len__(self) -> int:
        return len(self._indices)

    def line(self, index: int) -> dict[str, Any]:
        """Returns a scene line (`glasshouse.scene/1`), with the replaced values."""
        line: dict[str, Any] = json.loads(self._scenes.json(self._indices[index]))
        return line

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        batch = self.batch([index])
        return {name: value[0] for name, value in batch.items()}

    def __getitems__(self, indices: Sequence[int]) -> list[dict[str, Any]]:
        """Returns several scenes at once, as PyTorch's fetcher asks for them."""
        try:
            batch = self.batch(indices)
        except _native.SceneError:
            raise
        except _native.GlasshouseError:
            # Scenes of other sizes have no common array.
            return [self[index] for index in indices]
        return [{name: value[at] for name, value in batch.items()} for at in range(len(indices))]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (self[index] for index in range(len(self)))

    def batch(self, indices: Sequence[int], out: dict[str, Array] | None = None) -> dict[str, Any]:
        """Renders scenes of one size and with the same layers on all threads.

        Args:
            indices: Numbers of the scenes; negative ones count from the end.
            out: Writable float32 arrays in C order by name, (B, 3, H, W), which are filled in place of new ones, such
                as views of pinned memory.

        Returns:
            Arrays (B, 3, H, W) by name (labels of one channel (B, 1, H, W)), and the list of ids as `id`.

        Raises:
            SceneError: A scene cannot be rendered; `scene` is its id.
            GlasshouseError: The scenes have other sizes or layers, or an array of `out` does not fit.

        """
        chosen = [self._indices[index] for index in indices]
        arrays, rendered, bad = self._scenes.batch(chosen, out, self._replace, thread_count(self._threads))
        for scene, reason in bad:
            if scene not in self._warned:
                self._warned.add(scene)
                warnings.warn(f"scene {scene} is skipped: {reason}", stacklevel=2)
        return {**arrays, "id": [self._scenes.id(index) for index in rendered]}
