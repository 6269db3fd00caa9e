#!/usr/bin/env python3
"""Measures the data sets of the Python package, and the synthesis of published loaders on the same core.

    pip install ./python torch scipy opencv-python-headless pillow albumentations
    pip install --no-deps xreflection
    benches/peers/loaders.py tuples RUN        # rendering on the fly: CPU seconds, threads
    benches/peers/loaders.py memory RUN        # resident memory up to the 20,000th scene, at the scenes' own size
    benches/peers/loaders.py mixtures RUN      # composed examples beside those of other loaders

RUN is a run of 256 px tuples, such as that of manifests/smoke.toml. Every figure is a median; pictures are in memory.

- tuples: CPU seconds of `Tuples(spp=16, threads=1)[i]` over the traced CPU seconds of `glasshouse render --spp 16 -j 1` for the same
  scenes, in alternation; and the rate of batches on two threads over that on one
- mixtures: examples of 256 px a second of a core, of `Mixtures` with and without JPEG, and of
    xreflection   ReflectionSynthesis of XReflection's DSIT data set, from its package
    errnet        the mixture of ERRNet (after Fan et al., ICCV 2017), written from its description: Gaussian of 11 px by SciPy, sums
                  above 1 taken from R
    albumentations    flips, blur, noise, gamma and JPEG of albumentations on one picture, and a weighted sum: no reflection model
"""

import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
import types
from importlib.metadata import distribution
from pathlib import Path

import glasshouse
import numpy as np

SIZE_PX = 256


def cpu_s(work, times):
    """Returns the CPU seconds of each call."""
    seconds = []
    for index in range(times):
        begin = time.process_time()
        work(index)
        seconds.append(time.process_time() - begin)
    return seconds


def tuples(args):
    """Compares scenes on the fly with the command."""
    scenes = glasshouse.Tuples(args.run, spp=16, threads=1)
    count = min(args.scenes, len(scenes))
    ratios, own = [], []
    with tempfile.TemporaryDirectory() as folder:
        for index in range(count):
            Path(folder, f"{index}.json").write_text(json.dumps(scenes.line(index)))
            scenes[index]
        roots = [f"--root={name}={path}" for name, path in scenes._given[1].items()]
        for _ in range(args.rounds):
            for index in range(count):
                command = ["glasshouse", "render", f"{folder}/{index}.json", "--out", f"{folder}/out", "-j1", "--json", "-q", *roots]
                found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
                (seconds,) = cpu_s(lambda _, index=index: scenes[index], 1)
                own.append(seconds)
                ratios.append(seconds / found["seconds"]["trace"])
    rates = {}
    for _ in range(args.rounds):
        for threads in (1, 2):
            batches = glasshouse.Tuples(args.run, spp=16, threads=threads)
            batches.batch(range(count))
            begin = time.perf_counter()
            batches.batch([index % count for index in range(48)])
            rates.setdefault(threads, []).append(48 / (time.perf_counter() - begin))
    one, two = (statistics.median(rates[threads]) for threads in (1, 2))
    return {
        "scenes": count,
        "cpu_s": statistics.median(own),
        "over_traced": statistics.median(ratios),
        "per_core_s": 1 / statistics.median(own),
        "one_thread_per_s": one,
        "two_threads_over_one": two / one,
    }


def memory(args):
    """Renders scenes again and again, and reads the resident memory."""
    scenes = glasshouse.Tuples(args.run, spp=1, size=args.size, threads=1)
    page = os.sysconf("SC_PAGESIZE")
    sizes = {}
    for number in range(1, args.until + 1):
        scenes[number % len(scenes)]
        if number in (1000, args.until // 2, args.until):
            sizes[number] = int(Path("/proc/self/statm").read_text().split()[1]) * page / 1e6
    return {"resident_mb": sizes, "last_over_first": sizes[args.until] / sizes[1000]}


def xreflection():
    """Returns the synthesis of XReflection's DSIT data set."""
    folder = Path(str(distribution("xreflection").locate_file("xreflection")))
    for name in ("xreflection", "xreflection.data", "xreflection.utils"):
        package = types.ModuleType(name)
        package.__path__ = [str(folder.joinpath(*name.split(".")[1:]))]
        sys.modules[name] = package
    from xreflection.data.dsit_dataset import ReflectionSynthesis

    return ReflectionSynthesis()


def mixtures(args):
    """Compares composed examples with the synthesis of other loaders, from pictures in memory."""
    import albumentations
    import cv2
    from scipy.signal import convolve2d

    cv2.setNumThreads(1)
    stored = glasshouse.read(args.run)
    codes = [np.uint8(np.clip(each.transmission, 0, 1) ** (1 / 2.2) * 255 + 0.5) for each in stored]
    synthesis = xreflection()

    def errnet(t, r):
        t, r = t / np.float32(255), r / np.float32(255)
        line = cv2.getGaussianKernel(11, random.uniform(2, 5))
        kernel = line @ line.T
        for c in range(3):
            r[..., c] = convolve2d(r[..., c], kernel, mode="same", boundary="symm")
        total = t + r
        over = total[total > 1]
        if over.size:
            total = t + np.clip(r - (over.mean() - 1) * 1.3, 0, 1)
        return np.clip(total, 0, 1)

    compose = albumentations.Compose(
        [
            albumentations.HorizontalFlip(p=0.5),
            albumentations.GaussianBlur(blur_limit=(5, 11), p=1),
            albumentations.RandomGamma(p=1),
            albumentations.GaussNoise(p=1),
            albumentations.ImageCompression(quality_range=(60, 95), p=1),
        ]
    )

    def albumented(t, r):
        return compose(image=cv2.addWeighted(t, 0.9, r, 0.4, 0))["image"]

    def pair(mix):
        return lambda index: mix(codes[index % len(codes)].copy(), codes[(index + 1) % len(codes)].copy())

    works = {"xreflection": pair(synthesis), "errnet": pair(errnet), "albumentations": pair(albumented)}
    for name, share in (("camera", 0.0), ("camera and JPEG", 1.0)):
        settings = {"composition": {"camera": {"jpeg_share": share}}}
        own = glasshouse.Mixtures(args.run, size=SIZE_PX, settings=settings, length=1 << 20, threads=1)
        for index in range(len(stored)):
            own[index]
        works[f"glasshouse, {name}"] = own.__getitem__
    seconds = {}
    for _ in range(args.rounds):
        for name, work in works.items():
            seconds.setdefault(name, []).extend(cpu_s(work, args.examples))
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    ours = medians["glasshouse, camera and JPEG"]
    return {name: {"per_core_s": 1 / value, "cpu_s_over_ours": value / ours} for name, value in medians.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("tuples", "memory", "mixtures"))
    parser.add_argument("run", type=Path, help="folder of a run with tuples of 256 px")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--scenes", type=int, default=8)
    parser.add_argument("--examples", type=int, default=40)
    parser.add_argument("--until", type=int, default=20000)
    parser.add_argument("--size", type=int, help="side of the scenes for memory, px; by default their own")
    args = parser.parse_args()
    print(json.dumps({"tuples": tuples, "memory": memory, "mixtures": mixtures}[args.what](args), indent=2))


if __name__ == "__main__":
    main()
