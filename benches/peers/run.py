#!/usr/bin/env python3
"""Renders one scene with glasshouse and its peers, each with one thread, and prints a comparison of their costs.

Every peer runs in a separate process and stores its figures in OUT/<peer>, so that an interrupted run resumes where it
stopped; --redo measures again. README.md beside this file describes the measurements and the installation of the peers.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parent.parent
PEERS = ("mitsuba_stock", "mitsuba_split", "cycles", "embree", "glasshouse")

try:
    import compare
    import scene as scenes
except ImportError as missing:
    sys.exit(f"error: {missing}: run this with the Python of the virtual environment that README.md describes")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = lambda text: [name for name in text.split(",") if name]
    counts = lambda text: sorted(int(n) for n in text.split(","))
    parser.add_argument("scene", type=Path, metavar="SCENE_DIR", help="folder with a scene.json")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="results, kept from run to run")
    parser.add_argument("--only", type=names, default=list(PEERS), metavar="PEER,...", help=f"peers to run, of {', '.join(PEERS)}")
    parser.add_argument("--redo", type=names, default=[], metavar="PEER,...",
                        help="discard results of these peers; also mitsuba_reference, glasshouse_reference")
    parser.add_argument("--samples", type=counts, default=[16, 64, 256], metavar="N,...", help="sample counts of the peers [16,64,256]")
    parser.add_argument("--our-samples", type=counts, default=[16, 32, 64, 128, 256, 512, 1024], metavar="N,...",
                        help="sample counts of glasshouse [16 to 1024]")
    parser.add_argument("--samplers", type=names, default=["ldsampler", "multijitter"], metavar="NAME,...",
                        help="samplers of Mitsuba [ldsampler,multijitter]; each but ldsampler has its own rows")
    parser.add_argument("--mitsuba-reference-spp", type=int, default=4096, metavar="N", help="reference of Mitsuba and Cycles [4096]")
    parser.add_argument("--reference-spp", type=int, default=65536, metavar="N", help="reference of glasshouse [65536]")
    parser.add_argument("--glasshouse", type=Path, default=REPOSITORY / "target" / "release" / "glasshouse", metavar="PROGRAM")
    args = parser.parse_args()
    for name in args.only:
        if name not in PEERS:
            parser.error(f"no peer is called {name}: choose from {', '.join(PEERS)}")
    return args


def commands(args: argparse.Namespace) -> dict[str, list[str]]:
    """Returns the script and its options for each peer and for each needed reference, in the order of the run."""
    text = lambda numbers: ",".join(str(n) for n in numbers)
    program = ["--program", str(args.glasshouse)]
    found: dict[str, list[str]] = {}
    for set_up in ("stock", "split"):
        for sampler in args.samplers if f"mitsuba_{set_up}" in args.only else []:
            name = f"mitsuba_{set_up}" + ("" if sampler == "ldsampler" else f"_{sampler}")
            found[name] = ["mitsuba_peer.py", "--set-up", set_up, "--sampler", sampler, "--samples", text(args.samples)]
    if "cycles" in args.only:
        found["cycles"] = ["cycles_peer.py", "--samples", text(args.samples)]
    if "glasshouse" in args.only:
        found["glasshouse"] = ["glasshouse_peer.py", "--set-up", "ladder", *program, "--samples", text(args.our_samples)]
    if "embree" in args.only:
        found["embree"] = ["embree_peer.py", *program]
    if {"mitsuba_stock", "mitsuba_split", "cycles"} & set(args.only):
        found["mitsuba_reference"] = ["mitsuba_peer.py", "--set-up", "reference", "--samples", str(args.mitsuba_reference_spp)]
    if "glasshouse" in args.only:
        found["glasshouse_reference"] = ["glasshouse_peer.py", "--set-up", "reference", *program, "--samples", str(args.reference_spp)]
    return found


def keep_or_forget(args: argparse.Namespace) -> None:
    """Refuses results of another scene, and deletes those of --redo."""
    args.out.mkdir(parents=True, exist_ok=True)
    stamp, digest = args.out / "scene.sha256", scenes.digest(args.scene)
    if stamp.is_file() and stamp.read_text() != digest:
        sys.exit(f"error: {args.out} holds results of another scene: choose another --out, or delete it")
    stamp.write_text(digest)
    for name in args.redo:
        for folder in args.out.glob(f"{name}*/" if name.startswith("mitsuba_s") else f"{name}/"):
            shutil.rmtree(folder)


def run_peer(name: str, command: list[str], args: argparse.Namespace) -> bool:
    """Runs a peer's script to its end; its output goes to a log, and lines that start with its name are shown."""
    script, *options = command
    line = [sys.executable, str(HERE / script), str(args.scene), "--out", str(args.out / name), *options]
    with open(args.out / f"{name}.log", "w") as log:
        with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as child:
            last = ""
            for text in child.stdout or ():
                log.write(text)
                last = text.strip() or last
                if text.startswith(f"{name}:"):
                    print(text, end="", flush=True)
    if child.returncode:
        print(f"{name} is left out: {last} (log: {args.out / name}.log)", file=sys.stderr)
    return child.returncode == 0


def machine() -> str:
    """Describes the processor and its load."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown CPU")
    return f"{cpu}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"


def programs(out: Path) -> dict[str, str]:
    """Returns each peer's version."""
    found = {path.parent.name: json.loads(path.read_text()) for path in sorted(out.glob("*/result.json"))}
    return {name: data["program"] for name, data in found.items()}


def main() -> None:
    args = arguments()
    try:
        line = scenes.load(args.scene).line
    except scenes.SceneError as error:
        sys.exit(f"error: {error}")
    keep_or_forget(args)
    whole = all([run_peer(name, command, args) for name, command in commands(args).items()])
    result = {"scene": line["id"], "machine": machine(), "programs": programs(args.out), **compare.compare(args.out)}
    (args.out / "peers.json").write_text(json.dumps(result, indent=1))
    (args.out / "peers.md").write_text(compare.markdown(result))
    print("\n" + compare.markdown(result))
    print(f"tables in {args.out / 'peers.md'}, all figures in {args.out / 'peers.json'}")
    sys.exit(0 if whole else 1)


if __name__ == "__main__":
    main()
