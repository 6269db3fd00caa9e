"""Times Embree on the rays of `glasshouse bench trace --dump`, in world space; compiles embree/trace.cpp first.

Both sides count the CPU seconds of intersection alone, with one thread: span and walk of glasshouse, calls of Embree.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def compiled(out: Path) -> Path:
    """Returns the program; builds it if its source is newer."""
    source, program = HERE / "embree" / "trace.cpp", out / "trace"
    if program.is_file() and program.stat().st_mtime > source.stat().st_mtime:
        return program
    if shutil.which("g++") is None:
        sys.exit("error: no C++ compiler: apt install g++")
    if not Path("/usr/include/embree3/rtcore.h").is_file() and not os.environ.get("CPATH"):
        sys.exit("error: Embree 3 is not installed: apt install libembree-dev (Debian 12), or set CPATH and LIBRARY_PATH")
    subprocess.run(["g++", "-O2", "-std=c++17", str(source), "-lembree3", "-o", str(program)], check=True)
    return program


def dump(glasshouse: Path, scene: Path, folder: Path) -> None:
    """Makes glasshouse time its kernel on the scene and write the rays."""
    command = [str(glasshouse), "bench", "trace", "--scene", str(scene), "--no-builtin", "--dump", str(folder), "--quiet"]
    if subprocess.run(command, stdout=subprocess.DEVNULL).returncode:
        sys.exit(f"error: {' '.join(command)} failed: this needs a program with `bench trace` (cargo build --release)")


def wanted(name: str, apex: str) -> bool:
    """True for the classes of the scene's apex (SCENE.t0, SCENE.r0.APEX); a dump holds both apexes."""
    return not name.endswith((".mirror", ".camera")) or name.endswith("." + apex)


def measure(program: Path, rays: Path, entry: dict, most: int) -> dict:
    """Returns Embree's figures for one class of rays."""
    files = [str(rays / entry["rays"]), str(rays / entry["vertices"]), str(entry["nx"]), str(entry["ny"])]
    if entry.get("hits"):
        files.append(str(rays / entry["hits"]))
    done = subprocess.run([str(program), *files, "--max-rays", str(most)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr.strip() or "error: the Embree program failed")
    return {"name": entry["name"], "kernel_mrays_per_s": entry.get("kernel_mrays_per_s"), **json.loads(done.stdout)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder with a scene.json")
    parser.add_argument("--out", type=Path, required=True, help="folder for result.json")
    parser.add_argument("--program", type=Path, required=True, help="the glasshouse binary, built with --release")
    parser.add_argument("--rays", type=Path, help="folder with a rays.json instead of a fresh dump")
    parser.add_argument("--max-rays", type=int, default=524288, help="rays of a class that Embree gets")
    args = parser.parse_args()
    if not args.program.is_file():
        sys.exit(f"error: {args.program} does not exist: cargo build --release, or pass --glasshouse PROGRAM")
    args.out.mkdir(parents=True, exist_ok=True)
    program_sha256 = hashlib.sha256(args.program.read_bytes()).hexdigest()
    path = args.out / "result.json"
    if path.is_file() and json.loads(path.read_text())["program_sha256"] == program_sha256:
        return
    program = compiled(args.out)
    rays = args.rays or args.out / "rays"
    if not args.rays:
        dump(args.program, args.scene / "scene.json", rays)
    line = json.loads((args.scene / "scene.json").read_text())
    apex = line["back"].get("apex", "mirror")
    entries = json.loads((rays / "rays.json").read_text())["classes"]
    classes = []
    for entry in entries:
        if wanted(entry["name"], apex):
            classes.append(measure(program, rays, entry, args.max_rays))
            print(f"embree: {entry['name']}: best {classes[-1]['best_mrays_per_s']:.1f} Mrays/s", flush=True)
    result = {"program": classes[0]["program"], "program_sha256": program_sha256, "classes": classes}
    path.write_text(json.dumps(result, indent=1))
    if not args.rays:
        shutil.rmtree(rays)


if __name__ == "__main__":
    main()
