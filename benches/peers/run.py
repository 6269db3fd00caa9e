#!/usr/bin/env python3
"""Renders one scene with glasshouse and its peers, side by side, one thread each, and prints how their costs compare.

Every peer runs in a process of its own and keeps what it measured in OUT/<peer>, so that an interrupted run goes on where
it stopped; --redo takes figures again. README.md beside this file says what is measured and how to install the peers.
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
    sys.exit(f"error: {missing}: pip install mitsuba==3.9.1 numpy pillow 'bpy==4.5.*' into a virtual environment, and run this with it")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = lambda text: [name for name in text.split(",") if name]
    counts = lambda text: sorted(int(n) for n in text.split(","))
    parser.add_argument("scene", type=Path, metavar="SCENE_DIR", help="folder with a scene.json")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="results, kept from run to run")
    parser.add_argument("--only", type=names, default=list(PEERS), metavar="PEER,...", help=f"of {', '.join(PEERS)}")
    parser.add_argument("--redo", type=names, default=[], metavar="PEER,...", help="forget what these measured (mitsuba_reference too)")
    parser.add_argument("--samples", type=counts, default=[16, 64, 256], metavar="N,...", help="of the peers [16,64,256]")
    parser.add_argument("--our-samples", type=counts, default=[16, 32, 64, 128, 256, 512, 1024], metavar="N,...",
                        help="of glasshouse [16 to 1024]")
    parser.add_argument("--samplers", type=names, default=["ldsampler", "multijitter"], metavar="NAME,...",
                        help="of Mitsuba [ldsampler,multijitter]; all but ldsampler are rows of their own")
    parser.add_argument("--mitsuba-reference-spp", type=int, default=4096, metavar="N", help="also serves Cycles [4096]")
    parser.add_argument("--reference-spp", type=int, default=65536, metavar="N", help="of glasshouse [65536]")
    parser.add_argument("--glasshouse", type=Path, default=REPOSITORY / "target" / "release" / "glasshouse", metavar="PROGRAM")
    args = parser.parse_args()
    for name in args.only:
        if name not in PEERS:
            parser.error(f"no peer is called {name}: choose from {', '.join(PEERS)}")
    return args


def commands(args: argparse.Namespace) -> dict[str, list[str]]:
    """What is run for each peer, in this order; the reference comes with the peers that need it."""
    text = lambda numbers: ",".join(str(n) for n in numbers)
    mitsuba = ["mitsuba_peer.py", "--samples", text(args.samples), "--set-up"]
    all_commands = {
        "cycles": ["cycles_peer.py", "--samples", text(args.samples)],
        "glasshouse": ["glasshouse_peer.py", "--samples", text(args.our_samples), "--program", str(args.glasshouse),
                       "--reference-spp", str(args.reference_spp)],
        "embree": ["embree_peer.py", "--program", str(args.glasshouse)],
        "mitsuba_reference": ["mitsuba_peer.py", "--samples", str(args.mitsuba_reference_spp), "--set-up", "reference"],
    }
    wanted = set(args.only)
    for set_up in ("stock", "split"):
        for sampler in args.samplers:
            name = f"mitsuba_{set_up}" + ("" if sampler == "ldsampler" else f"_{sampler}")
            all_commands[name] = [*mitsuba, set_up, "--sampler", sampler]
            if f"mitsuba_{set_up}" in wanted:
                wanted.add(name)
    if wanted & {"mitsuba_stock", "mitsuba_split", "cycles"}:
        wanted.add("mitsuba_reference")
    return {name: command for name, command in all_commands.items() if name in wanted}


def keep_or_forget(args: argparse.Namespace) -> None:
    """Results of another scene are refused; those of --redo are deleted."""
    args.out.mkdir(parents=True, exist_ok=True)
    stamp, digest = args.out / "scene.sha256", scenes.digest(args.scene)
    if stamp.is_file() and stamp.read_text() != digest:
        sys.exit(f"error: {args.out} holds results of another scene: choose another --out, or delete it")
    stamp.write_text(digest)
    for name in args.redo:
        shutil.rmtree(args.out / name, ignore_errors=True)


def run_peer(name: str, command: list[str], args: argparse.Namespace) -> bool:
    """Runs a peer's script to its end; its chatter goes to a log, its own lines are shown."""
    if name == "embree" and (args.out / "embree" / "result.json").is_file():
        return True
    script, *options = command
    line = [sys.executable, str(HERE / script), str(args.scene), "--out", str(args.out / name), *options]
    with open(args.out / f"{name}.log", "w") as log:
        with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as child:
            last = ""
            for text in child.stdout:
                log.write(text)
                last = text.strip() or last
                if text.startswith((f"{name}:", "error:")):
                    print(text, end="", flush=True)
    if child.returncode:
        print(f"error: {name} ended with {child.returncode}: {last} (see {args.out / name}.log)", file=sys.stderr)
    return child.returncode == 0


def machine() -> str:
    """The processor, and how busy it is."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown CPU")
    return f"{cpu}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"


def programs(out: Path) -> dict[str, str]:
    """Each peer's version."""
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
