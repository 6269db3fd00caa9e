#!/usr/bin/env python3
"""Measures steps of the trainer in PyTorch beside those of `glasshouse bench train`, with the paper's networks and losses.

    pip install "./python[torch]"
    benches/peers/torch_trainer.py [--rounds 3]                                  # one thread: CPU seconds and ratios
    benches/peers/torch_trainer.py --device cuda --batch 16 --compile            # PyTorch alone: images a second

Networks, losses and sizes are those of benches/peers/train_step.py, with a random VGG-19.
The best step counts, and the programs alternate. `glasshouse bench train` has no GPU, so `--device cuda` measures PyTorch alone.
"""

import argparse
import json
import resource
import subprocess
import tempfile
import time

import glasshouse
import numpy as np
import torch
from glasshouse.learner import Learner, checked

LAYERS = ("input", "transmission", "glass_reflection", "clean_reflection")


def settings(batch):
    """Returns the default settings with random features."""
    with tempfile.TemporaryDirectory() as folder:
        chosen = {"features": "random", "batch": batch, "discriminator_every": 1}
        return checked({**glasshouse.train_settings(folder), **chosen})


def clock_s(device):
    """Returns the CPU time of this process; on a GPU, the wall time after its work."""
    if device == "cuda":
        torch.cuda.synchronize()
        return time.perf_counter()
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def in_pytorch(args, precision):
    """Returns the CPU seconds (on a GPU, the wall seconds) of the best step."""
    chosen = settings(args.batch)
    weights = glasshouse.initial_weights(chosen, "separation")
    device = torch.device(args.device)
    vgg = {name: torch.as_tensor(value) for name, value in weights.items() if name.startswith("features.")}
    learner = Learner(chosen, "separation", vgg, device, precision)
    learner.load({name: torch.as_tensor(value) for name, value in weights.items() if name not in vgg})
    if args.compile:
        learner.compile()
    random = np.random.default_rng(1)
    shape = (args.batch, 3, args.size, args.size)
    batch = {layer: torch.as_tensor(random.random(shape, np.float32)).to(device) for layer in LAYERS}
    best = float("inf")
    for step in range(1 + args.steps):
        begin = clock_s(args.device)
        learner.step(step, batch)
        end = clock_s(args.device)
        if step > 0:
            best = min(best, end - begin)
    return best


def in_rust(args):
    """Returns the CPU seconds of the best step."""
    command = [args.glasshouse, "bench", "train", "--json", "-q", "-j", "1", "--size", str(args.size)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout)["step_cpu_seconds"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--glasshouse", default="glasshouse")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    parser.add_argument("--batch", type=int, default=1, help="examples of a step in PyTorch; the program takes one")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=3, help="steps a round, after a warm-up step")
    parser.add_argument("--compile", action="store_true")
    args = parser.parse_args()
    torch.set_num_threads(1)
    best = {}
    for _ in range(args.rounds):
        found = {f"PyTorch {precision}": in_pytorch(args, precision) for precision in ("f32", "bf16")}
        found = {name: seconds / args.batch for name, seconds in found.items()}
        if args.device == "cpu":
            found["glasshouse"] = in_rust(args)
        for name, seconds in found.items():
            best[name] = min(best.get(name, float("inf")), seconds)
    unit = "s" if args.device == "cuda" else "CPU s"
    for name, seconds in best.items():
        ratio = f", {seconds / best['glasshouse']:.2f} of the program's" if "glasshouse" in best else ""
        print(f"{name:14} {seconds:8.4f} {unit} an image, {1 / seconds:7.2f} images/s{ratio}")


if __name__ == "__main__":
    main()
