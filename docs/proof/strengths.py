#!/usr/bin/env python3
"""Measures the strengths of reflections, the mean luminance of R~ over that of F = I - R~, for docs/proof.md.

    docs/proof/strengths.py RUN                         # of the first 500 train tuples; writes strengths.json
    docs/proof/strengths.py RUN --name composed-seed-1  # of the first 2,000 examples of a training of the run's recipe

Prints percentiles; strengths.json is beside this script. Needs the Python package.
"""

import argparse
import json
from pathlib import Path

import glasshouse
import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32).reshape(3, 1, 1)
# The end of the default range of `strength`: stronger reflections made networks worse on real photographs.
LARGEST = 1.5
BATCH, TUPLES, EXAMPLES = 20, 500, 2000
# The largest value of I becomes 0.9, so that codes lose nothing, and there is no camera.
UNCLIPPED = {"percentile": {"percentile": [100, 100], "level": [0.9, 0.9], "front_mean": [0.001, 100]}}
OF_TUPLES = {"other_share": 0, "strength": "of_tuple", "none_share": 0, "white_balance": 0, "reflection_white_balance": 0}


def light(codes):
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def strengths(run, settings, count):
    """Returns the strengths of the first examples of a training, without the camera."""
    composition = {**settings["composition"], "exposure": UNCLIPPED, "camera": {"enabled": False}}
    source = glasshouse.Examples(run, {**settings, "batch": BATCH, "composition": composition})
    found = []
    for step in range(count // BATCH):
        made = source.step(step)
        means = {k: (light(made[k]) * LUMINANCE).sum(1).mean((1, 2)) for k in ("input", "glass_reflection")}
        found.append(means["glass_reflection"] / (means["input"] - means["glass_reflection"]))
    return np.concatenate(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a run")
    parser.add_argument("--name", help="training of the run's recipe")
    args = parser.parse_args()
    if args.name:
        settings = glasshouse.train_settings(args.run, name=args.name, of_recipe=True)
        found = strengths(args.run, settings, EXAMPLES)
    else:
        settings = {"examples": "composed", "crop_px": 256, "flip": False, "scenes": TUPLES, "composition": OF_TUPLES}
        found = strengths(args.run, settings, TUPLES)
        found = found[found <= LARGEST]
        values = [round(float(v), 4) for v in np.quantile(found, np.linspace(0, 1, 21))]
        (Path(__file__).parent / "strengths.json").write_text(json.dumps(values) + "\n")
    percentiles = " / ".join(f"{v:.3f}" for v in np.percentile(found, [10, 25, 50, 75, 90]))
    print(f"{args.name or 'tuples'}: {percentiles} (percentiles 10, 25, 50, 75, 90 of {len(found)})")


if __name__ == "__main__":
    main()
