"""Renders scenes of a recipe and saves them as one picture: a row for each of I, T, R~ and R.

python python/examples/gallery.py manifests/windows.toml --count 8
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

import glasshouse

LAYERS = ("input", "transmission", "glass_reflection", "clean_reflection")


def codes(linear: np.ndarray) -> np.ndarray:
    """Returns 8-bit sRGB codes of linear light (3, H, W) as (H, W, 3)."""
    linear = np.clip(np.moveaxis(linear, 0, -1), 0, 1)
    code = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)
    return np.round(255 * code).astype(np.uint8)


def main() -> None:
    """Renders and writes the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path, help="a recipe, a manifest or a run")
    parser.add_argument("--root", action="append", default=[], metavar="NAME=DIR")
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--size", type=int, default=192, help="side of each picture, px")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--out", type=Path, default=Path("gallery.png"))
    args = parser.parse_args()
    roots = dict(root.split("=", 1) for root in args.root)
    scenes = glasshouse.Tuples(args.path, root=roots, spp=args.spp, size=args.size, layers=LAYERS, on_error="skip")
    batch = scenes.batch(range(min(args.count, len(scenes))))
    rows = [np.concatenate([codes(picture) for picture in batch[layer]], axis=1) for layer in LAYERS]
    Image.fromarray(np.concatenate(rows, axis=0)).save(args.out)
    print(f"see {args.out}: {', '.join(batch['id'])}")


if __name__ == "__main__":
    main()
