"""Makes a SCENE_DIR for run.py from a scene of a finished run: copies its photographs, fills holes, fixes the focus.

    glasshouse run manifests/smoke.toml
    benches/peers/export_scene.py runs/smoke train-sample-000000 --out SCENE_DIR

Holes get the farthest valid depth (`fill = "far"`), so that every renderer gets the same sheet.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path

import numpy as np


def located(run: Path, roots: dict[str, str], text: str) -> Path:
    """Resolves a path: `NAME:rest` is below a root of the run's spec; others are absolute or relative to the run."""
    name, _, rest = text.partition(":")
    return run / roots[name] / rest if rest and name in roots else run / text


def filled_depth_m(depth: Path, mask: Path | None, unit_m: float) -> np.ndarray:
    """Returns depth along z, m, with filled holes."""
    z = np.load(depth).astype(np.float32).squeeze() * np.float32(unit_m)
    valid = np.isfinite(z) & (z > 0)
    if mask is not None:
        valid &= np.load(mask).squeeze() > 0
    return np.where(valid, z, z[valid].max()).astype(np.float32)


def export(run: Path, scene_id: str, out: Path) -> None:
    """Writes scene.json, two colour images and two depth images."""
    lines = [json.loads(text) for text in (run / "manifest.jsonl").read_text().splitlines()]
    found = [line for line in lines if line["id"] == scene_id]
    record = run / "tuples" / scene_id / "tuple.json"
    if not found or not record.is_file():
        sys.exit(f"error: {run} has no finished scene {scene_id}; its scenes are {', '.join(line['id'] for line in lines)}")
    line = found[0]
    roots = json.loads((run / "spec.json").read_text())["roots"]
    out.mkdir(parents=True, exist_ok=True)
    line["camera"]["focus"] = {"distance_m": json.loads(record.read_text())["facts"]["focus_distance_m"]}
    for side in ("front", "back"):
        entry = line[side]
        color = located(run, roots, entry["color"])
        mask = located(run, roots, entry.pop("mask")) if "mask" in entry else None
        depth_m = filled_depth_m(located(run, roots, entry["depth"]), mask, entry.get("depth_unit_m", 1.0))
        shutil.copyfile(color, out / f"{side}{color.suffix}")
        np.save(out / f"{side}_depth.npy", depth_m)
        entry.update(color=f"{side}{color.suffix}", depth=f"{side}_depth.npy", depth_unit_m=1.0)
        entry.pop("fill", None)
    (out / "scene.json").write_text(json.dumps(line, indent=1))
    print(f"wrote {out / 'scene.json'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a finished run")
    parser.add_argument("id", help="scene with an untilted pane, e.g. train-sample-000000 of the smoke recipe")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    export(args.run, args.id, args.out)


if __name__ == "__main__":
    main()
