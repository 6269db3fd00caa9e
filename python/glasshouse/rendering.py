"""One scene, rendered or read."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from ._threads import thread_count
from .planning import PathLike, Roots

Array = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Rendered:
    """The pictures of one scene: float32 (H, W, 3), linear Rec.709 light, not clipped; None for missing layers."""

    input: Array | None
    """I: the front scene through the pane, with the reflection."""
    transmission: Array | None
    """T: the front scene through the pane, refracted but not attenuated."""
    glass_reflection: Array | None
    """R~: the reflection in the glass, with its ghosts."""
    clean_reflection: Array | None
    """R: the mirrored back scene, without glass and lens."""
    labels: dict[str, Array] = field(default_factory=dict)
    """Further images by name: (H, W), or (H, W, 3) for `ghosts`."""
    metadata: dict[str, Any] = field(default_factory=dict)
    """The content of tuple.json: scene line, facts, estimated errors, digests of the input files."""

    @property
    def id(self) -> str:
        """The scene's id."""
        return str(self.metadata["scene"]["id"])


def _rendered(parts: tuple[dict[str, Array], dict[str, Array], str]) -> Rendered:
    layers, labels, record = parts
    return Rendered(
        input=layers.get("input"),
        transmission=layers.get("transmission"),
        glass_reflection=layers.get("glass_reflection"),
        clean_reflection=layers.get("clean_reflection"),
        labels=labels,
        metadata=json.loads(record),
    )


def render(
    scene: PathLike | Mapping[str, Any],
    spp: int | None = None,
    layers: Sequence[str] | None = None,
    root: Roots | None = None,
    *,
    threads: int | None = None,
) -> Rendered:
    """Renders one scene. The pictures have the bits of the command `glasshouse render`.

    Args:
        scene: Path of a scene (`glasshouse.scene/1`), or its content; relative paths start from its folder, or from the
            current one.
        spp: Samples per pixel, a power of two from 1 to 65,536; by default the scene's.
        layers: Names of layers and labels; by default the scene's.
        root: Folders of named roots.
        threads: Number of threads; by default the number of processors.

    Raises:
        SceneError: A file of the scene cannot be used; `scene` is its id.
        GlasshouseError: The scene is not valid.

    """
    if isinstance(scene, Mapping):
        text, base = json.dumps(scene), Path()
    else:
        path = Path(scene)
        text, base = _read_text(path), path.parent
    scenes = _native.Scenes(text, dict(root or {}), base, spp, None, None, layers, 0, True)
    return _rendered(scenes.render(0, thread_count(threads)))


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise _native.GlasshouseError(f"cannot read {path}: {error}; check the path") from error


class Run(Sequence[Rendered]):
    """The finished tuples of a run's folder, in the order of its manifest. Each is read when it is asked for."""

    def __init__(self, folder: PathLike) -> None:
        self.folder = Path(folder)
        jsonl, _ = _native.run_lines(self.folder, {})
        lines = [json.loads(line) for line in jsonl.splitlines()]
        self.lines: list[dict[str, Any]] = [line for line in lines if self._tuple(line).joinpath("tuple.json").exists()]
        """Lines of the scenes that have a tuple."""
        self.missing = len(lines) - len(self.lines)
        """Number of scenes without a tuple."""

    def _tuple(self, line: Mapping[str, Any]) -> Path:
        return self.folder / "tuples" / str(line["id"])

    def __len__(self) -> int:
        return len(self.lines)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        return _read(self._tuple(self.lines[index]))

    def __iter__(self) -> Iterator[Rendered]:
        return (_read(self._tuple(line)) for line in self.lines)


def read(path: PathLike) -> Rendered | Run:
    """Reads a tuple (its folder or tuple.json) as `Rendered`, or a run's folder as `Run`.

    Raises:
        GlasshouseError: A file is missing or does not have its digest.

    """
    path = Path(path)
    if path.name == "tuple.json":
        path = path.parent
    if (path / "spec.json").exists():
        return Run(path)
    return _read(path)


def _read(folder: Path) -> Rendered:
    return _rendered(_native.read_tuple(folder))
