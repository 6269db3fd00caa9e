#!/usr/bin/env python3
"""Measures the training step of `glasshouse bench train` in PyTorch, and the ratio of the CPU seconds of both.

    pip install torch numpy
    cargo build --release
    benches/peers/train_step.py [--glasshouse target/release/glasshouse] [--rounds 3] [--json]

Both use one thread and the same networks, losses, optimiser and sizes. The discriminator learns on (I, T); SP-net
learns from l1 + 0.2 feature + 0.01 adversarial on T, l1 + 0.2 feature on R~, and l1 + 0.2 feature of BT-net(R~*)
against R, with the gradient through BT-net's hypercolumn; Adam on all three. 256 x 256 px, batch 1, 64 channels, a
random VGG-19. The programs alternate, and the best step of each counts, so that other load matters least.
"""

import argparse
import json
import pathlib
import resource
import subprocess
import sys
import time

WIDTHS = [64, 64, 0, 128, 128, 0, 256, 256, 256, 256, 0, 512, 512, 512, 512, 0, 512, 512]
TAPS = (1, 3, 5, 9, 13)
DIVISORS = (2.6, 4.8, 3.7, 5.6, 0.15)
DILATIONS = (0, 1, 2, 4, 8, 16, 32, 64, 1)
CHANNELS, SIZE_PX = 64, 256


def pytorch_step(steps):
    """Returns CPU seconds of the best of `steps` steps after a warm-up step, number of parameters and peak memory."""
    import torch
    import torch.nn as nn
    import torch.nn.functional as F

    torch.set_num_threads(1)
    torch.manual_seed(0)
    weights, channels = [], 3
    for width in filter(None, WIDTHS):
        weights.append((torch.randn(width, channels, 3, 3) * (2 / (9 * channels)) ** 0.5, torch.zeros(width)))
        channels = width
    mean, deviation = (torch.tensor(v).view(1, 3, 1, 1) for v in ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]))

    def vgg(x):
        x, taps, index = (x - mean) / deviation, [], 0
        for width in WIDTHS:
            if not width:
                x = F.max_pool2d(x, 2)
                continue
            x = F.relu(F.conv2d(x, *weights[index], padding=1))
            if index in TAPS:
                taps.append(x)
            index += 1
        return taps

    class Generator(nn.Module):
        def __init__(self, outputs):
            super().__init__()
            shapes = [(CHANNELS, CHANNELS, 3, 3) if rate else (CHANNELS, 1475, 1, 1) for rate in DILATIONS]
            self.kernels = nn.ParameterList([torch.randn(s) * (2 / (s[1] * s[2] * s[3])) ** 0.5 for s in shapes])
            self.offsets = nn.ParameterList([torch.zeros(CHANNELS) for _ in shapes])
            self.by_itself = nn.ParameterList([torch.ones(1) for _ in shapes])
            self.by_norm = nn.ParameterList([torch.zeros(1) for _ in shapes])
            self.last = nn.Conv2d(CHANNELS, outputs, 1)

        def forward(self, x):
            taps = [F.interpolate(f, size=x.shape[2:], mode="bilinear", align_corners=False) for f in vgg(x)]
            h = torch.cat([*taps, x], 1)
            for layer, rate in enumerate(DILATIONS):
                h = F.conv2d(h, self.kernels[layer], padding=rate, dilation=max(rate, 1))
                norm = F.batch_norm(h, None, None, None, self.offsets[layer], training=True, eps=1e-3)
                h = F.leaky_relu(self.by_itself[layer] * h + self.by_norm[layer] * norm, 0.2)
            return self.last(h)

    class Discriminator(nn.Module):
        def __init__(self):
            super().__init__()
            shapes = ((6, 64, 2), (64, 128, 2), (128, 256, 2), (256, 512, 1), (512, 1, 1))
            self.convolutions = nn.ModuleList([nn.Conv2d(a, b, 4, s, 1, bias=False) for a, b, s in shapes])
            self.norms = nn.ModuleList([nn.BatchNorm2d(n, track_running_stats=False) for n in (128, 256, 512)])

        def forward(self, x):
            for layer, convolution in enumerate(self.convolutions):
                x = convolution(x)
                if 1 <= layer <= 3:
                    x = self.norms[layer - 1](x)
                if layer < 4:
                    x = F.leaky_relu(x, 0.2)
            return x

    def l1(a, b):
        return (a - b).abs().mean()

    def feature(a, b):
        with torch.no_grad():
            truth = vgg(b)
        return sum(l1(p, q) / k for p, q, k in zip(vgg(a), truth, DIVISORS))

    sp, bt, judge = Generator(6), Generator(3), Discriminator()
    of_generators = torch.optim.Adam([*sp.parameters(), *bt.parameters()], 1e-4)
    of_judge = torch.optim.Adam(judge.parameters(), 1e-4)
    i, t, rt, r = (torch.rand(1, 3, SIZE_PX, SIZE_PX) for _ in range(4))

    def step():
        made = sp(i)
        to, ro = made[:, :3], made[:, 3:]
        of_judge.zero_grad()
        real, fake = judge(torch.cat([i, t], 1)), judge(torch.cat([i, to.detach()], 1))
        (0.5 * (F.softplus(-real).mean() + F.softplus(fake).mean())).backward()
        of_judge.step()
        of_generators.zero_grad()
        tracked = bt(ro)
        believed = F.softplus(-judge(torch.cat([i, to], 1))).mean()
        loss = l1(to, t) + 0.2 * feature(to, t) + 0.01 * believed
        loss = loss + l1(ro, rt) + 0.2 * feature(ro, rt) + l1(tracked, r) + 0.2 * feature(tracked, r)
        loss.backward()
        of_generators.step()

    step()
    best = float("inf")
    for _ in range(steps):
        begin = time.process_time()
        step()
        best = min(best, time.process_time() - begin)
    parameters = sum(p.numel() for net in (sp, bt, judge) for p in net.parameters())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {"step_cpu_seconds": best, "params": parameters, "peak_memory_bytes": peak, "version": torch.__version__}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--glasshouse", default=str(pathlib.Path(__file__).parents[2] / "target/release/glasshouse"))
    parser.add_argument("--rounds", type=int, default=3, help="rounds of each program")
    parser.add_argument("--steps", type=int, default=3, help="steps per round, after a warm-up step")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--only-pytorch", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.only_pytorch:
        print(json.dumps(pytorch_step(args.steps)))
        return
    ours, theirs = [], []
    for _ in range(args.rounds):
        command = [args.glasshouse, "bench", "train", "-j", "1", "--json", "-q", "--steps", str(args.steps)]
        ours.append(json.loads(subprocess.check_output(command)))
        twin = [sys.executable, __file__, "--only-pytorch", "--steps", str(args.steps)]
        theirs.append(json.loads(subprocess.check_output(twin, stderr=subprocess.DEVNULL)))
    best = lambda rows: min(rows, key=lambda row: row["step_cpu_seconds"])
    ours, theirs = best(ours), best(theirs)
    result = {
        "ratio": ours["step_cpu_seconds"] / theirs["step_cpu_seconds"],
        "glasshouse": {k: ours[k] for k in ("step_cpu_seconds", "params", "peak_memory_bytes")},
        "pytorch": theirs,
    }
    if args.json:
        print(json.dumps(result))
        return
    print("| | CPU s a step | parameters | peak memory, GB |\n|---|---:|---:|---:|")
    for name in ("glasshouse", "pytorch"):
        row = result[name]
        print(f"| {name} | {row['step_cpu_seconds']:.2f} | {row['params']} | {row['peak_memory_bytes'] / 1e9:.2f} |")
    print(f"\nglasshouse / PyTorch {theirs['version']}: {result['ratio']:.2f}")


if __name__ == "__main__":
    main()
