#!/usr/bin/env python3
"""Compares the CPU seconds of a tuple with those of mixtures in image space, of the same pair and size.

    pip install numpy scipy opencv-python-headless
    cargo build --release
    benches/peers/mixtures.py [--glasshouse target/release/glasshouse] [--rounds 5] [--json]

One thread each, pictures in memory as 8-bit sRGB, 256 x 256 px, medians:

- dsit: the synthetic 70 % of the training examples of DSIT in XReflection: one Gaussian of 5 to 11 px by SciPy's convolve2d in
  each channel, then I = a T + b R - a b T R in sRGB codes
- zhang: Zhang et al., CVPR 2018, with NumPy and OpenCV's blur: light = code^2.2, sums above 1 taken from R, vignette
- opencv: OpenCV's GaussianBlur of 11 px and addWeighted, in 8 bits
- glasshouse: the four layers of the built-in pair at 1 and 16 samples, with its photographs in memory (`bench error`), and this
  program's own examples (`bench compose`): composed in linear light, and with its model of a camera
"""

import argparse
import json
import math
import pathlib
import statistics
import subprocess
import tempfile
import time

ROOT = pathlib.Path(__file__).parents[2]
SIZE_PX = 256
VIGNETTE_PX = 560


def peers(front, back):
    """Returns each method's name and a function that mixes the pair once, with random parameters."""
    import cv2
    import numpy as np
    from scipy.signal import convolve2d
    from scipy.stats import norm

    cv2.setNumThreads(1)
    random = np.random.default_rng(1)

    def dsit():
        t, r = front.astype(np.float32) / 255, back.astype(np.float32) / 255
        size = random.choice([5, 7, 9, 11], p=[0.1, 0.2, 0.3, 0.4])
        line = cv2.getGaussianKernel(int(size), random.uniform(2, 5))
        kernel = line @ line.T
        for c in range(3):
            r[..., c] = convolve2d(r[..., c], kernel, mode="same")
        t, r = random.uniform(0.8, 1.0) * t, random.uniform(0.4, 1.0) * r
        return np.clip(t + r - t * r, 0, 1)

    half_cell = 7 / VIGNETTE_PX / 2
    shares = np.diff(norm.cdf(np.linspace(-3 - half_cell, 3 + half_cell, VIGNETTE_PX + 1)))
    vignette = np.sqrt(np.outer(shares, shares))
    vignette = np.dstack([vignette / vignette.max()] * 3)

    def zhang():
        t, r = (front / 255.0) ** 2.2, (back / 255.0) ** 2.2
        sigma = random.uniform(1, 5)
        side = 2 * math.ceil(2 * sigma) + 1
        r = cv2.GaussianBlur(r, (side, side), sigma)
        attenuation, total = 1.08 + random.uniform(0, 0.1), r + t
        for c in range(3):
            over = total[..., c] > 1
            mean = max(1.0, total[..., c][over].sum() / (over.sum() + 1e-6))
            r[..., c] -= (mean - 1) * attenuation
        x, y = random.integers(0, VIGNETTE_PX - 10 - SIZE_PX, 2)
        r = np.clip(r, 0, 1) * vignette[x : x + SIZE_PX, y : y + SIZE_PX]
        return np.clip((r + t * random.uniform(0.8, 1.0)) ** (1 / 2.2), 0, 1), r ** (1 / 2.2)

    def opencv():
        return cv2.addWeighted(front, 0.9, cv2.GaussianBlur(back, (11, 11), random.uniform(2, 5)), 0.4, 0)

    return {"dsit": dsit, "zhang": zhang, "opencv": opencv}


def median_cpu_s(mix, times=40):
    seconds = []
    for _ in range(times):
        begin = time.process_time()
        mix()
        seconds.append(time.process_time() - begin)
    return statistics.median(seconds)


def pictures(glasshouse, folder):
    """Renders the pair's T and R as pictures: the front and the back photograph, as the film sees them."""
    import cv2

    recipe = (ROOT / "manifests/smoke.toml").read_text().replace("spp = 256", "spp = 16")
    (folder / "pair.toml").write_text(recipe)
    for command in (["plan", folder / "pair.toml", "--out", folder / "run"], ["work", folder / "run"]):
        subprocess.run([glasshouse, *command, "-q"], check=True, stdout=subprocess.DEVNULL)
    tuple_ = sorted((folder / "run/tuples").iterdir())[0]
    return [cv2.imread(str(tuple_ / f"{layer}.png")) for layer in ("transmission", "clean_reflection")]


def traced_cpu_s(glasshouse, folder):
    """Returns the median CPU seconds of the four layers by samples a pixel."""
    command = [glasshouse, "bench", "error", "--spp", "1,16", "--seeds", "3", "--reference-spp", "64", "-j", "1", "--json", "-q"]
    found = json.loads(subprocess.run([*command, "--out", folder / "error"], check=True, stdout=subprocess.PIPE).stdout)
    rows = [row for row in found["rows"] if row["variant"] == "sobol" and row["layer"] == "input"]
    return {row["spp"]: row["cpu_s"] for row in rows}


def own_mixtures(glasshouse):
    """Returns the CPU seconds of this program's examples, composed from tuples or mixed from photographs."""
    command = [glasshouse, "bench", "compose", "--size", str(SIZE_PX), "--examples", "40", "-j", "1", "--json", "-q"]
    found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    return {f"glasshouse, {row['up_to']}": row["cpu_seconds"] for row in found["rows"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--glasshouse", default=ROOT / "target/release/glasshouse")
    parser.add_argument("--rounds", type=int, default=5, help="rounds, in which the programs alternate")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    seconds = {}
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        methods = peers(*pictures(args.glasshouse, folder))
        for _ in range(args.rounds):
            found = {name: median_cpu_s(mix) for name, mix in methods.items()}
            for spp, cpu_s in traced_cpu_s(args.glasshouse, folder).items():
                found[f"glasshouse {spp} spp"] = cpu_s
            for name, cpu_s in found.items():
                seconds.setdefault(name, []).append(cpu_s)
    medians = {name: statistics.median(values) for name, values in seconds.items()} | own_mixtures(args.glasshouse)
    if args.json:
        print(json.dumps(medians))
        return
    tuple_s = medians["glasshouse 16 spp"]
    for name, cpu_s in medians.items():
        print(f"{name:46} {1000 * cpu_s:7.2f} ms   tuple of 16 samples / this: {tuple_s / cpu_s:6.2f}")


if __name__ == "__main__":
    main()
