"""Inputs of the tests: the scenes of a small recipe, and its run."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

RECIPE = """
schema = "glasshouse.recipe/1"
name = "small"
seed = 7
[film]
width = 48
height = 40
spp = 16
[back]
exposure_ev = { uniform = [-1, 1] }
[glass]
tilt_deg = [0, { uniform = [-20, 20] }]
[sources.sample]
layout = "sample"
count = 8
width = 96
height = 72
[[split]]
name = "train"
pairs = { sample = 6 }
[[split]]
name = "test"
pairs = { sample = 2 }
"""


@pytest.fixture(scope="session")
def recipe(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the path of a recipe of eight scenes; its pictures are made in a cache of the tests."""
    folder = tmp_path_factory.mktemp("recipe")
    os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
    path = folder / "small.toml"
    path.write_text(RECIPE)
    return path


@pytest.fixture(scope="session")
def program() -> str:
    """Returns the command, which is part of the wheel unless it was built without."""
    found = os.environ.get("GLASSHOUSE_PROGRAM") or shutil.which("glasshouse")
    if not found:
        pytest.skip("no command: install the wheel with it, or set GLASSHOUSE_PROGRAM")
    return found


@pytest.fixture(scope="session")
def run(recipe: Path, program: str) -> Path:
    """Returns the folder of the recipe's run."""
    folder = recipe.parent / "run"
    subprocess.run([program, "run", recipe, "--out", folder, "-q"], check=True)
    return folder
