"""Recipes, manifests and runs as scene lines."""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import _native
from ._threads import thread_count

PathLike = str | os.PathLike[str]
Roots = Mapping[str, PathLike]


@dataclass(frozen=True)
class Planned:
    """Scene lines, and the folders of their files."""

    jsonl: str
    """One scene a line."""
    roots: dict[str, Path]
    """Folders of the named roots."""
    base: Path
    """Folder where relative paths start."""


def plan(
    recipe: PathLike, root: Roots | None = None, *, inputs: PathLike | None = None, skip_invalid: bool = False
) -> list[dict[str, Any]]:
    """Plans a recipe (.toml) or a manifest (.jsonl), or reads the plan of a run's folder.

    Args:
        recipe: Path of the recipe, of the manifest or of the run.
        root: Folders of the recipe's named roots, as `--root NAME=DIR` of the command.
        inputs: Folder for the procedural pictures of the recipe; by default one below the user's cache that belongs to
            this recipe.
        skip_invalid: Draw other photographs in place of those with unusable files.

    Returns:
        The scene lines (`glasshouse.scene/1`) as dictionaries.

    Raises:
        GlasshouseError: The recipe or a file cannot be used.

    """
    planned = planned_lines(recipe, root, inputs=inputs, skip_invalid=skip_invalid)
    return [json.loads(line) for line in planned.jsonl.splitlines()]


def planned_lines(
    source: PathLike, root: Roots | None = None, *, inputs: PathLike | None = None, skip_invalid: bool = False
) -> Planned:
    """Like `plan`, with the lines as text."""
    source, roots = Path(source), dict(root or {})
    if source.is_dir():
        jsonl, folders = _native.run_lines(source, roots)
        return Planned(jsonl, {name: Path(folder) for name, folder in folders.items()}, source)
    folder = Path(inputs) if inputs is not None else _own_folder(source)
    jsonl, folders, notes = _native.plan_lines(source, roots, folder, skip_invalid, thread_count(None))
    for note in notes:
        warnings.warn(f"{source}: {note}", stacklevel=3)
    return Planned(jsonl, {name: Path(folder) for name, folder in folders.items()}, folder)


def _own_folder(recipe: Path) -> Path:
    """Returns the folder of the recipe's procedural pictures, which depend on its text alone."""
    try:
        text = recipe.read_bytes()
    except OSError as error:
        raise _native.GlasshouseError(f"cannot read {recipe}: {error.strerror}; check the path") from error
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "glasshouse" / "inputs" / f"{recipe.stem}-{hashlib.sha256(text).hexdigest()[:16]}"
