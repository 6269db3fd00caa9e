"""Measures the release program with `glasshouse render SCENE --spp N -j 1 --json`, for a ladder of N.

`process_cpu_s` covers all of `render`: start, decoding two photographs, building, tracing, writing four EXRs and PNGs.
`cpu_s` covers the tracer alone, since the peers' figures cover rendering alone. It comes from `glasshouse bench error`,
which renders the same and counts the tracer thread's CPU seconds; `render` reports only wall seconds.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import exr
import scene as scenes
from record import Record

RUNS = 5
ENOUGH_S = 10.0
TRACER_RUNS = 3


def run(program: Path, options: list[str]) -> tuple[dict, float]:
    """Runs once with one thread; returns the JSON, and the user and system seconds of the process."""
    command = [str(program), *options, "-j", "1", "--json", "--quiet"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        text = child.stdout.read() if child.stdout else b""
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        sys.exit(f"error: {' '.join(command)} ended with {child.returncode}")
    return json.loads(text), usage.ru_utime + usage.ru_stime


def render(program: Path, scene: Path, spp: int, out: Path) -> tuple[dict, float]:
    """Runs `glasshouse render`."""
    return run(program, ["render", str(scene), "--out", str(out), "--spp", str(spp)])


def tracer_cpu_s(program: Path, scene: Path, samples: list[int]) -> dict[int, list[float]]:
    """Returns the tracer's CPU seconds for the four layers by sample count, from three runs each."""
    seconds: dict[int, list[float]] = {spp: [] for spp in samples}
    with tempfile.TemporaryDirectory() as folder:
        # `bench error` needs images to compare with, although only its seconds are used.
        render(program, scene, min(samples), Path(folder))
        counts = ",".join(map(str, samples))
        options = ["bench", "error", "--scene", str(scene), "--reference", folder, "--out", folder, "--spp", counts]
        for _ in range(TRACER_RUNS):
            for row in run(program, options)[0]["rows"]:
                if row["variant"] == "sobol" and row["layer"] == "input":
                    seconds[row["spp"]].append(row["cpu_s"])
    return seconds


def images(out: Path) -> dict[str, np.ndarray]:
    """Returns the four layers of a run."""
    return {layer: exr.rgb(exr.read(out / f"{layer}.exr")) for layer in scenes.LAYERS}


def ladder(program: Path, scene: Path, samples: list[int], record: Record) -> None:
    """Measures the missing sample counts with up to five runs or 10 s each; all runs give the same pixels."""
    todo = [spp for spp in samples if not record.has("render", spp)]
    seconds = tracer_cpu_s(program, scene, todo) if todo else {}
    for spp in todo:
        processes: list[float] = []
        with tempfile.TemporaryDirectory() as folder:
            while not processes or (len(processes) < RUNS and sum(processes) < ENOUGH_S):
                result, process_s = render(program, scene, spp, Path(folder))
                processes.append(process_s)
            record.add("render", spp, images(Path(folder)), cpu_s=statistics.median(seconds[spp]), runs_cpu_s=seconds[spp],
                       process_cpu_s=statistics.median(processes), orders=result["facts"]["orders"])


def reference(program: Path, scene: Path, spp: int, record: Record) -> None:
    """Renders many samples with another seed."""
    if record.has("reference", spp):
        return
    path = with_other_seed(scene, record.folder)
    with tempfile.TemporaryDirectory() as folder:
        _, process_s = render(program, path, spp, Path(folder))
        record.add("reference", spp, images(Path(folder)), cpu_s=process_s)


def with_other_seed(scene: Path, out: Path) -> Path:
    """Writes the scene file with the next seed and absolute paths."""
    line = json.loads(scene.read_text())
    line["seed"] += 1
    for side in ("front", "back"):
        for key in ("color", "depth"):
            line[side][key] = str((scene.parent / line[side][key]).resolve())
    path = out / "reference_scene.json"
    path.write_text(json.dumps(line, indent=1))
    return path


def forget_other_program(out: Path, program_sha256: str) -> None:
    """Deletes figures of another build, so that they are measured again."""
    path = out / "result.json"
    if path.is_file() and json.loads(path.read_text()).get("program_sha256") != program_sha256:
        print("glasshouse: the program has changed and is measured again", flush=True)
        shutil.rmtree(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder with a scene.json")
    parser.add_argument("--set-up", choices=("ladder", "reference"), required=True)
    parser.add_argument("--out", type=Path, required=True, help="folder for result.json and the layers")
    parser.add_argument("--samples", type=lambda t: [int(n) for n in t.split(",")], required=True)
    parser.add_argument("--program", type=Path, required=True, help="the glasshouse binary, built with --release")
    args = parser.parse_args()
    if not args.program.is_file():
        sys.exit(f"error: {args.program} does not exist: cargo build --release, or pass --glasshouse PROGRAM")
    program_sha256 = hashlib.sha256(args.program.read_bytes()).hexdigest()
    if args.set_up == "ladder":
        forget_other_program(args.out, program_sha256)
    version = subprocess.run([args.program, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    record = Record(args.out, program=version, program_sha256=program_sha256)
    if args.set_up == "ladder":
        ladder(args.program, args.scene / "scene.json", args.samples, record)
    else:
        reference(args.program, args.scene / "scene.json", args.samples[-1], record)


if __name__ == "__main__":
    main()
