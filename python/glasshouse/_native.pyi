"""The extension module. Use the functions and classes of `glasshouse`, which wrap it."""

from collections.abc import Mapping, Sequence
from os import PathLike

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]
Path = str | PathLike[str]

__version__: str
TRACER_VERSION: int

class GlasshouseError(Exception):
    """An input that cannot be used. The text names the file, the reason and the remedy."""

class SceneError(GlasshouseError):
    """A scene that cannot be rendered."""

    scene: str

def plan_lines(
    source: Path, roots: Mapping[str, Path], inputs: Path, skip_invalid: bool, threads: int
) -> tuple[str, dict[str, PathLike[str]], list[str]]: ...
def run_lines(run: Path, roots: Mapping[str, Path]) -> tuple[str, dict[str, PathLike[str]]]: ...
def read_tuple(folder: Path) -> tuple[dict[str, Array], dict[str, Array], str]: ...
def train_settings(run: Path, name: str | None, of_recipe: bool) -> str: ...
def initial_weights(settings: str, stage: str) -> dict[str, Array]: ...
def blake3(data: bytes) -> str: ...

class Scenes:
    def __init__(
        self,
        jsonl: str,
        roots: Mapping[str, Path],
        base: Path,
        spp: int | None,
        size: tuple[int, int] | None,
        seed: int | None,
        layers: Sequence[str] | None,
        cache_bytes: int,
        is_scene: bool,
    ) -> None: ...
    def __len__(self) -> int: ...
    def id(self, index: int) -> str: ...
    def json(self, index: int) -> str: ...
    def of_split(self, split: str) -> list[int]: ...
    def render(self, index: int, threads: int) -> tuple[dict[str, Array], dict[str, Array], str]: ...
    def batch(
        self, indices: Sequence[int], out: dict[str, Array] | None, replace: bool, threads: int
    ) -> tuple[dict[str, Array], list[int], list[tuple[str, str]]]: ...

class Sampler:
    scenes_blake3: str

    def __init__(self, run: Path, roots: Mapping[str, Path], settings: str, split: str, memory_bytes: int) -> None: ...
    def __len__(self) -> int: ...
    def steps(self, steps: Sequence[int], out: dict[str, Array] | None, threads: int) -> dict[str, Array]: ...
