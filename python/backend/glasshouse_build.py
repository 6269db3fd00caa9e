"""Build backend: maturin's wheel, and the `glasshouse` command in it.

maturin packs the extension module. Before that, this backend builds the command with the same arguments and puts it
where maturin takes scripts from, so that `pip install` copies the executable itself beside `python`.
`--no-default-features` among the build arguments leaves the command out.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import maturin
from maturin import (  # noqa: F401
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "glasshouse.data"
# maturin wants the folder at every call, also for metadata.
DATA.mkdir(exist_ok=True)
WITH_VALUE = ("--profile", "--target", "--target-dir")
FLAGS = ("--offline", "--locked", "--frozen")

Settings = Mapping[str, Any] | None


def build_wheel(directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    """Builds a wheel (PEP 517)."""
    with _command(config_settings):
        return str(maturin.build_wheel(directory, config_settings, metadata_directory))


def build_editable(directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    """Builds an editable wheel (PEP 660)."""
    with _command(config_settings):
        return str(maturin.build_editable(directory, config_settings, metadata_directory))


def _arguments(config_settings: Settings) -> list[str]:
    """Returns maturin's build arguments, which come from the settings or from its variable."""
    given = (config_settings or {}).get("build-args", os.environ.get("MATURIN_PEP517_ARGS", ""))
    return shlex.split(given) if isinstance(given, str) else list(given)


def _cargo(arguments: list[str]) -> list[str]:
    """Returns the arguments that also concern the command."""
    chosen: list[str] = []
    for at, argument in enumerate(arguments):
        name = argument.split("=")[0]
        if name in FLAGS or (name in WITH_VALUE and "=" in argument):
            chosen.append(argument)
        elif name in WITH_VALUE:
            chosen.extend(arguments[at : at + 2])
    if not any(argument.startswith("--profile") for argument in chosen):
        chosen.append("--release")
    return chosen


@contextmanager
def _command(config_settings: Settings) -> Iterator[None]:
    """Puts the command into the folder of the wheel's scripts while the wheel is built."""
    arguments = _arguments(config_settings)
    scripts = DATA / "scripts"
    shutil.rmtree(scripts, ignore_errors=True)
    try:
        if "--no-default-features" not in arguments:
            scripts.mkdir(parents=True)
            shutil.copy2(_build(arguments), scripts)
        yield
    finally:
        shutil.rmtree(scripts, ignore_errors=True)


def _build(arguments: list[str]) -> Path:
    """Builds the command, and returns its path."""
    # Both packages, so that dependencies have the features of maturin's call, which then compiles none of them again.
    call = ["cargo", "build", "--package=glasshouse", "--package=glasshouse-python", "--bin=glasshouse"]
    call += ["--message-format=json-render-diagnostics", *_cargo(arguments)]
    built = subprocess.run(call, cwd=ROOT.parent, check=True, stdout=subprocess.PIPE, text=True)
    messages = (json.loads(line) for line in built.stdout.splitlines() if line.startswith("{"))
    paths = [message["executable"] for message in messages if message.get("executable")]
    if not paths:
        raise RuntimeError("cargo built no executable of the package glasshouse")
    return Path(paths[-1])
