"""The release program, as anybody runs it: `glasshouse render SCENE --spp N -j 1 --json`, for a ladder of N.

`process_cpu_s` is everything: start, decoding two photographs, building, tracing, writing four EXRs and four PNGs.
`cpu_s` is the trace stage, as the peers' figures are rendering alone. The program states its wall seconds, which on a busy
machine are more than its CPU seconds; so the smaller of two upper bounds is taken: these wall seconds, and the process's
CPU seconds less those of the other stages, which runs with one sample show.
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


def render(program: Path, scene: Path, spp: int, out: Path) -> tuple[dict, float]:
    """One run: its JSON, and the user and system seconds of the process."""
    command = [str(program), "render", str(scene), "--out", str(out), "--spp", str(spp), "-j", "1", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        text = child.stdout.read()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        sys.exit(f"error: {' '.join(command)} ended with {child.returncode}")
    return json.loads(text), usage.ru_utime + usage.ru_stime


def images(out: Path) -> dict[str, np.ndarray]:
    """The four layers of a run."""
    return {layer: exr.rgb(exr.read(out / f"{layer}.exr")) for layer in scenes.LAYERS}


def other_stages_cpu_s(program: Path, scene: Path) -> float:
    """CPU seconds of all but tracing. Each run gives a lower bound (wall seconds of tracing are taken off): the largest."""
    bounds = [0.0]
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(RUNS):
            result, process_s = render(program, scene, 1, Path(folder))
            bounds.append(process_s - result["seconds"]["trace"])
    return max(bounds)


def measure(program: Path, scene: Path, spp: int, others_s: float) -> tuple[dict[str, np.ndarray], dict]:
    """Up to five runs or 10 s; the pixels of all are the same."""
    stages, processes = [], []
    with tempfile.TemporaryDirectory() as folder:
        while not processes or (len(processes) < RUNS and sum(processes) < ENOUGH_S):
            result, process_s = render(program, scene, spp, Path(folder))
            processes.append(process_s)
            stages.append(min(result["seconds"]["trace"], process_s - others_s))
        layers = images(Path(folder))
    figures = {"cpu_s": statistics.median(stages), "runs_cpu_s": stages,
               "process_cpu_s": statistics.median(processes), "orders": result["facts"]["orders"]}
    return layers, figures


def with_other_seed(folder: Path, out: Path) -> Path:
    """The same scene file with the next seed and absolute paths, for the reference."""
    line = json.loads((folder / "scene.json").read_text())
    line["seed"] += 1
    for side in ("front", "back"):
        for key in ("color", "depth"):
            line[side][key] = str((folder / line[side][key]).resolve())
    path = out / "reference_scene.json"
    path.write_text(json.dumps(line, indent=1))
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder with a scene.json")
    parser.add_argument("--out", type=Path, required=True, help="folder for result.json and the layers")
    parser.add_argument("--samples", type=lambda t: [int(n) for n in t.split(",")], required=True)
    parser.add_argument("--program", type=Path, required=True, help="the glasshouse binary, built with --release")
    parser.add_argument("--reference-spp", type=int, default=65536, help="samples of our own reference, another seed")
    args = parser.parse_args()
    if not args.program.is_file():
        sys.exit(f"error: {args.program} is not here: cargo build --release, or pass --glasshouse PROGRAM")
    program_sha256 = hashlib.sha256(args.program.read_bytes()).hexdigest()
    forget_other_program(args.out, program_sha256)
    version = subprocess.run([args.program, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    record = Record(args.out, program=version, program_sha256=program_sha256)
    jobs = [("render", spp, args.scene / "scene.json") for spp in args.samples]
    jobs.append(("reference", args.reference_spp, with_other_seed(args.scene, args.out)))
    jobs = [job for job in jobs if not record.has(*job[:2])]
    others_s = other_stages_cpu_s(args.program, args.scene / "scene.json") if jobs else 0.0
    for name, spp, path in jobs:
        layers, figures = measure(args.program, path, spp, others_s)
        record.add(name, spp, layers, other_stages_cpu_s=others_s, **figures)


def forget_other_program(out: Path, program_sha256: str) -> None:
    """Figures of another build are not ours: they are measured again."""
    path = out / "result.json"
    if path.is_file() and json.loads(path.read_text()).get("program_sha256") != program_sha256:
        print("glasshouse: the program has changed, all its figures are taken again", flush=True)
        shutil.rmtree(out)


if __name__ == "__main__":
    main()
