"""The extension module. Use the functions and classes of `glasshouse`, which wrap it."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import final

import numpy as np
import numpy.typing as npt
from typing_extensions import Self

__all__ = [
    "GlasshouseError",
    "Sampler",
    "SceneError",
    "Scenes",
    "TRACER_VERSION",
    "__version__",
    "blake3",
    "initial_weights",
    "plan_lines",
    "read_tuple",
    "run_lines",
    "train_settings",
]

_Array = npt.NDArray[np.float32]
_Path = str | PathLike[str]

__version__: str
TRACER_VERSION: int

class GlasshouseError(Exception):
    """An input that cannot be used. The text names the file, the reason and the remedy."""

class SceneError(GlasshouseError):
    """A scene that cannot be rendered."""

    scene: str

def plan_lines(
    source: _Path, roots: Mapping[str, _Path], inputs: _Path, skip_invalid: bool, threads: int
) -> tuple[str, dict[str, PathLike[str]], list[str]]: ...
def run_lines(run: _Path, roots: Mapping[str, _Path]) -> tuple[str, dict[str, PathLike[str]]]: ...
def read_tuple(folder: _Path) -> tuple[dict[str, _Array], dict[str, _Array], str]: ...
def train_settings(run: _Path, name: str | None, of_recipe: bool) -> str: ...
def initial_weights(settings: str, stage: str) -> dict[str, _Array]: ...
def blake3(data: bytes) -> str: ...

@final
class Scenes:
    def __new__(
        cls,
        jsonl: str,
        roots: Mapping[str, _Path],
        base: _Path,
        spp: int | None,
        size: tuple[int, int] | None,
        seed: int | None,
        layers: Sequence[str] | None,
        cache_bytes: int,
        is_scene: bool,
    ) -> Self: ...
    def __len__(self) -> int: ...
    def id(self, index: int) -> str: ...
    def json(self, index: int) -> str: ...
    def of_split(self, split: str) -> list[int]: ...
    def render(self, index: int, threads: int) -> tuple[dict[str, _Array], dict[str, _Array], str]: ...
    def batch(
        self, indices: Sequence[int], out: dict[str, _Array] | None, replace: bool, threads: int
    ) -> tuple[dict[str, _Array], list[int], list[tuple[str, str]]]: ...

@final
class Sampler:
    scenes_blake3: str

    def __new__(cls, run: _Path, roots: Mapping[str, _Path], settings: str, split: str, memory_bytes: int) -> Self: ...
    def __len__(self) -> int: ...
    def steps(self, steps: Sequence[int], out: dict[str, _Array] | None, threads: int) -> dict[str, _Array]: ...
