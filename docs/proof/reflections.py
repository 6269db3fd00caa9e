#!/usr/bin/env python3
"""Writes a copy of an export with other reflections, to find what of them teaches a network: pip install safetensors numpy

    glasshouse export runs/mixed-light --format safetensors --out EXPORT
    docs/proof/reflections.py EXPORT runs/mixed-light/manifest.jsonl OUT KIND

KIND is one of

    photographs  the transmission of another tuple, with the light of the reflection that it replaces
    colours      the same reflection, whose channels have the mean colour of another tuple's transmission
    one-light    the same reflection, lit by the front's illuminant; exact, because light is linear
"""

import argparse
import json
import shutil
from pathlib import Path

import numpy as np
from safetensors import safe_open
from safetensors.numpy import save_file

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def means(layer):
    """Returns the means of a layer's channels."""
    return layer.astype(np.float64).mean((1, 2))


def recoloured(reflection, colour):
    """Returns the factors that give a reflection the chromaticity of a colour, and keep its luminance."""
    own = means(reflection)
    light = LUMINANCE @ own
    if light < 1e-7:
        return np.ones((3, 1, 1))
    factors = np.clip(colour / (LUMINANCE @ colour) * light / np.maximum(own, 1e-9), 0.05, 20)
    return factors[:, None, None]


def one_light(scene, reflection):
    """Returns the factors of the channels under the front's illuminant, with the luminance of before."""
    front, back = (np.array(scene[side].get("illuminant", [1, 1, 1])) for side in ("front", "back"))
    light = LUMINANCE @ means(reflection)
    factors = front / back
    if light < 1e-7:
        return np.ones((3, 1, 1))
    return (factors * light / (LUMINANCE @ (means(reflection) * factors)))[:, None, None]


def changed(kind, scene, layers, other):
    """Returns R~ and R of a scene, given its layers and another tuple's transmission."""
    reflection, clean = (layers[name].astype(np.float32) for name in ("glass_reflection", "clean_reflection"))
    if kind == "photographs":
        factor = LUMINANCE @ means(reflection) / max(LUMINANCE @ means(other), 1e-9)
        return other.astype(np.float32) * factor, other
    factors = one_light(scene, reflection) if kind == "one-light" else recoloured(reflection, means(other))
    return reflection * factors, clean * factors


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("export", type=Path)
    parser.add_argument("manifest", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("kind", choices=("photographs", "colours", "one-light"))
    args = parser.parse_args()
    scenes = {scene["id"]: scene for scene in map(json.loads, args.manifest.open())}
    files = [safe_open(path, "numpy") for path in sorted(args.export.glob("train-*.safetensors"))]
    ids = [json.loads(file.metadata()["scenes"]) for file in files]
    place = {scene: file for file, names in zip(files, ids) for scene in names}
    names = sorted(place)
    draw = np.random.default_rng(7)
    shutil.copytree(args.export, args.out, ignore=shutil.ignore_patterns("train-*", "SHA256SUMS"))
    for path, file, own in zip(sorted(args.export.glob("train-*.safetensors")), files, ids):
        tensors = {key: file.get_tensor(key) for key in file.keys()}
        for scene in own:
            other = scene
            while other == scene:
                other = names[draw.integers(len(names))]
            transmission = place[other].get_tensor(f"{other}.transmission")
            layers = {name: tensors[f"{scene}.{name}"] for name in ("input", "glass_reflection", "clean_reflection")}
            reflection, clean = changed(args.kind, scenes[scene], layers, transmission)
            front = layers["input"].astype(np.float32) - layers["glass_reflection"].astype(np.float32)
            for name, layer in (("glass_reflection", reflection), ("clean_reflection", clean), ("input", front + reflection)):
                key = f"{scene}.{name}"
                tensors[key] = np.clip(layer, -6e4, 6e4).astype(tensors[key].dtype)
        save_file(tensors, args.out / path.name, file.metadata())


if __name__ == "__main__":
    main()
