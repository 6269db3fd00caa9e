#!/usr/bin/env python3
"""Writes the recipes of docs/proof.md: manifests/windows.toml and variants of it, with the trainings of each.

    glasshouse sample FOLDER/photos --count 2223 --seed 2026 --width 480 --height 360
    docs/proof/recipes.py FOLDER [--natural DIR]

All recipes read the same photographs, and have the exposures and limits of windows.toml; only the tables named below
differ. `--natural DIR` adds the research recipe, whose photographs are those of a folder. Python 3.11 or newer.
"""

import argparse
import json
import tomllib
from pathlib import Path

MANIFESTS = Path(__file__).resolve().parents[2] / "manifests"

# Nine tenths of the photographs are the train split's.
TUPLES = 2000

# 1.35 times the means of R~ over means of F = I - R~ of train tuples of windows.toml (strengths.py), at the probabilities
# 0, 0.05, ..., 1. At most 1.5, the end of the default range.
FACTOR, LARGEST = 1.35, 1.5
MEASURED = json.loads((Path(__file__).parent / "strengths.json").read_text())
STRENGTHS = [round(min(FACTOR * strength, LARGEST), 4) for strength in MEASURED]

COMPOSITION = {"strength": {"quantiles": STRENGTHS}, "target_light": "through_pane", "textured": 1}

# Blurs all rendered reflections, as mixtures blur theirs.
BLURRED = {**COMPOSITION, "rough": 1, "rough_px": [1.5, 5]}

# Casts as wide as those of photographs, and fronts nearer to their sharpness (photographs.py).
OF_PHOTOGRAPHS = {"white_balance": 0.25, "front_scale": [1, 2]}

# The focus of wild.toml before these trainings.
EVERYWHERE = {"choice": ["front_center", "back_center", "glass"]}

# At a rate of 2e-3, the losses of single steps of a training of this length jump by many powers of ten.
SETTINGS = {
    "network": "unet",
    "start": "residual",
    "bound": 1.0,
    "a_priori": False,
    "width": 16,
    "examples": "composed",
    "batch": 8,
    "crop_px": 128,
    "gradient_weight": 1.0,
    "adversarial_weight": 0,
    "optimizer": "adamw",
    "learning_rate": 5e-4,
    "betas": [0.9, 0.99],
    "weight_decay": 1e-4,
    "warmup_steps": 50,
    "clip_norm": 1.0,
    "ema": 0.9995,
    "composition": BLURRED,
}


def training(name, seeds, count, **settings):
    """Returns a training with a number of examples."""
    chosen = {**SETTINGS, **settings}
    steps = count // chosen["batch"]
    return {"name": name, "seeds": seeds, "separation_steps": steps, "checkpoint_every": steps, "settings": chosen}


def deciding():
    """Returns the two rows that decide: 200,000 examples, three seeds."""
    seeds, count = [1, 2, 3], 200_000
    linear = training("linear", seeds, count, examples="linear_mixtures", composition=COMPOSITION)
    return [training("composed", seeds, count), linear]


def ablated(name, **settings):
    """Returns an ablation: 40,000 examples, two seeds."""
    return training(name, [1, 2], 40_000, **settings)


def without_pane():
    """Returns the ablations that need no other tuples than those of windows.toml."""
    off = {**BLURRED, "camera": {"enabled": False}}
    undimmed = {**COMPOSITION, "mixture": {"transmitted": [1, 1]}}
    return [
        ablated("no-camera", composition=off),
        ablated("no-blur", composition=COMPOSITION),
        ablated("no-textures", composition={**BLURRED, "textured": 0}),
        ablated("own-light", composition={**BLURRED, "target_light": "without_pane"}),
        ablated("zhang", examples="zhang_mixtures", composition=undimmed),
    ]


def explored():
    """Returns rows added after a look at the deciding ones: sharp mixtures, and the casts of photographs."""
    sharp = {**COMPOSITION, "mixture": {"blur_px": [0, 0.01]}}
    casts = {**COMPOSITION, **OF_PHOTOGRAPHS}
    return [
        ablated("linear-sharp", examples="linear_mixtures", composition=sharp),
        ablated("composed-casts", composition=casts),
        ablated("linear-casts", examples="linear_mixtures", composition=casts),
    ]


def a_priori(is_on):
    """Returns the paper's networks with or without the gradients of the a priori loss."""
    settings = {"network": "generator", "bound": 0.0, "a_priori": is_on, "crop_px": 64, "learning_rate": 1e-3}
    made = ablated("prior" if is_on else "no-prior", **settings)
    return {**made, "backtrack_steps": 2500}


def sets(windows, paper, wild):
    """Yields the name of each set of tuples and its recipe."""
    yield "windows", windows | {"train": [*deciding(), *without_pane(), a_priori(True), a_priori(False), *explored()]}
    wide = {**windows, **{key: wild[key] for key in ("camera", "glass", "front", "back")}, "cover": None}
    wide_light = {**wide, "back": less(wild["back"], "front_illuminant_share")}
    others = {
        "paper": {**windows, "camera": paper["camera"], "glass": paper["glass"], "cover": None},
        "wild": {**wide_light, "camera": wild["camera"] | {"focus": EVERYWHERE}},
        "wild-in-focus": wide_light,
        "wild-one-light": wide,
        "mixed-light": {**windows, "back": less(windows["back"], "front_illuminant_share")},
        "no-cover": {**windows, "cover": None},
        "no-roughness": {**windows, "glass": less(windows["glass"], "roughness", "smudges")},
        "no-glazing": {**windows, "glass": windows["glass"] | {"glazing": {"choice": ["single-4", "single-6"]}}},
        "no-bends": {**windows, "glass": less(windows["glass"], "wave", "wedge_deg")},
    }
    for name, recipe in others.items():
        yield name, {key: value for key, value in recipe.items() if value is not None} | {"train": [ablated(name)]}


def tests(windows):
    """Yields rendered test sets: other photographs, 256 samples per pixel, and kinds in which rendering may help."""
    film = windows["film"] | {"spp": 256}
    # The train scenes fit the factor and the veil rule.
    splits = [{"name": name, "pairs": {"photos": 60}} for name in ("train", "test")]
    base = {**windows, "film": film, "split": splits}
    tilted = {"tilt_deg": [0, {"choice": [-30, -20, 20, 30]}], "distance_m": {"log_uniform": [0.1, 0.6]}}
    sharp = {**windows["camera"], "f_number": {"log_uniform": [8, 16]}}
    wide = {**windows["camera"], "f_number": {"log_uniform": [1.8, 2.8]}, "focus": "front_center"}
    plain = less(base, "cover")
    single = less(windows["glass"], "glazing", "roughness", "smudges", "wave", "wedge_deg")
    yield "test-windows", base
    ghosts = {**single, **tilted, "thickness_m": {"uniform": [0.012, 0.03]}, "ior": 1.52}
    yield "test-ghosts", plain | {"camera": sharp, "glass": ghosts}
    doubles = {**single, **tilted, "glazing": {"choice": ["double-4-16-4", "double-4-12-4"]}}
    yield "test-double", plain | {"camera": sharp, "glass": doubles}
    yield "test-near", base | {"camera": wide, "cover": {"pictures": 24, "photographer": 1}}
    yield "test-edges", base | {"cover": {"pictures": 24, "frame": 1}}


def less(table, *keys):
    """Returns a table without some keys."""
    return {key: value for key, value in table.items() if key not in keys}


def toml(value):
    """Returns a value in TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(key)} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return json.dumps(value)


def write(folder, name, recipe):
    lists = {key: recipe[key] for key in ("split", "train") if key in recipe}
    lines = [f"{key} = {toml(value)}" for key, value in less(recipe, "name", *lists).items()]
    lines.insert(1, f"name = {toml(name)}")
    for key, tables in lists.items():
        for table in tables:
            lines += [f"[[{key}]]", *(f"{inner} = {toml(value)}" for inner, value in table.items())]
    (folder / f"{name}.toml").write_text("\n".join(lines) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--natural", type=Path, metavar="DIR", help="folder of photographs for the research recipe")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    windows, paper, wild = (tomllib.loads((MANIFESTS / f"{n}.toml").read_text()) for n in ("windows", "paper", "wild"))
    windows["film"]["spp"] = 16
    windows["sources"] = {"photos": {"layout": "diode", "root": "photos", "fill": "far"}}
    windows["split"] = [{"name": "train", "pairs": {"photos": TUPLES}}, {"name": "test", "pairs": {"photos": 2}}]
    for name, recipe in [*sets(windows, paper, wild), *tests(windows)]:
        write(args.folder, name, recipe)
    if args.natural:
        folder = {"layout": "folder", "root": str(args.natural.resolve())}
        natural = {**windows, "sources": {"photos": folder}, "train": deciding()}
        write(args.folder, "natural", natural)


if __name__ == "__main__":
    main()
