#!/usr/bin/env python3
"""Compares the fronts and reflections of a training's examples with photographs, for docs/proof.md.

    docs/proof/photographs.py --photos DIR
    docs/proof/photographs.py RUN --name composed-seed-1 [--export EXPORT] [--photos DIR]

Prints of crops of 128 px: the standard deviation of log R/G and log B/G, of means in linear light (the cast of a crop),
and percentiles 10, 50 and 90 of the mean difference of neighbouring pixels over the mean, in codes (its sharpness).
Needs the Python package and Pillow.
"""

import argparse
from pathlib import Path

import glasshouse
import numpy as np
from PIL import Image

SIDE_PX, BATCH, EXAMPLES, CROPS = 128, 16, 400, 3
# Below, a crop's colour is that of noise.
DARKEST = 1e-3


def light(codes):
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def measured(codes):
    """Returns log R/G, log B/G and the sharpness of a crop (3, height, width), or None of a dark one."""
    red, green, blue = light(codes).mean((1, 2))
    if min(red, green, blue) < DARKEST:
        return None
    grey = codes.mean(0)
    slope = (np.abs(np.diff(grey, axis=0)).mean() + np.abs(np.diff(grey, axis=1)).mean()) / 2
    return np.log(red / green), np.log(blue / green), slope / grey.mean()


def photographs(folder):
    """Yields crops of all photographs below a folder, at places from a seed."""
    places = np.random.default_rng(1)
    for file in sorted(p for p in folder.rglob("*") if p.suffix.lower() in {".jpg", ".jpeg", ".png"}):
        codes = np.asarray(Image.open(file).convert("RGB"), np.float32).transpose(2, 0, 1) / 255
        for _ in range(CROPS):
            y, x = (places.integers(0, side - SIDE_PX + 1) for side in codes.shape[1:])
            yield codes[:, y : y + SIDE_PX, x : x + SIDE_PX]


def show(name, crops):
    found = np.array([m for m in map(measured, crops) if m is not None])
    red, blue = found[:, :2].std(0)
    sharpness = " / ".join(f"{v:.3f}" for v in np.percentile(found[:, 2], [10, 50, 90]))
    print(f"{name}: cast {red:.2f} (R/G), {blue:.2f} (B/G); sharpness {sharpness}; {len(found)} crops")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, nargs="?", help="folder of a run")
    parser.add_argument("--name", help="training of the run's recipe")
    parser.add_argument("--export", type=Path, help="its tuples, instead of those of the run")
    parser.add_argument("--photos", type=Path, help="folder of photographs")
    args = parser.parse_args()
    if bool(args.run) != bool(args.name):
        parser.error("a run and the --name of a training belong together")
    if args.photos:
        show("photographs", photographs(args.photos))
    if not args.run:
        return
    settings = glasshouse.train_settings(args.run, name=args.name, of_recipe=True)
    source = glasshouse.Examples(args.export or args.run, {**settings, "batch": BATCH, "crop_px": SIDE_PX})
    made = [source.step(step) for step in range(EXAMPLES // BATCH)]
    for layer in ("transmission", "glass_reflection"):
        show(layer, (np.clip(codes, 0, 1) for step in made for codes in step[layer]))


if __name__ == "__main__":
    main()
