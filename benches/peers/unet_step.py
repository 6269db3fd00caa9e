#!/usr/bin/env python3
"""Measures the U-Net step of `glasshouse bench train --network unet` in PyTorch (f32), and the ratio of the CPU seconds.

    pip install torch numpy
    cargo build --release
    benches/peers/unet_step.py [--glasshouse target/release/glasshouse] [--rounds 5] [--json]

Both use one thread, width 16, batch 8 and 128 x 128 px: the U-Net bounded by its input, L1 and L1 of neighbouring pixels'
differences, clipping, AdamW, running means of the weights. PyTorch takes the faster of its two memory layouts. The programs
alternate, and the medians of all steps are compared, so that other load matters little.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import time

WIDTH, BATCH, SIZE_PX = 16, 8, 128


def pytorch_steps(steps, is_channels_last):
    """Returns the CPU seconds of `steps` steps after two warm-up steps, and the number of parameters."""
    import torch
    import torch.nn as nn
    import torch.nn.functional as F

    torch.set_num_threads(1)
    torch.manual_seed(0)
    layout = torch.channels_last if is_channels_last else torch.contiguous_format
    widths = [WIDTH * k for k in (1, 2, 3, 4, 4)]

    class Bound(torch.autograd.Function):
        @staticmethod
        def forward(ctx, y, bound):
            ctx.save_for_backward(y > bound)
            return torch.minimum(y, bound)

        @staticmethod
        def backward(ctx, gradient):
            return torch.where(ctx.saved_tensors[0], gradient.clamp(min=0), gradient), None

    def two(i, o):
        layers = nn.Conv2d(i, o, 3, padding=1), nn.LeakyReLU(0.1, True), nn.Conv2d(o, o, 3, padding=1), nn.LeakyReLU(0.1, True)
        return nn.Sequential(*layers)

    class Unet(nn.Module):
        def __init__(self):
            super().__init__()
            pairs = list(zip(widths, widths[1:]))
            self.head = two(12, widths[0])
            self.down = nn.ModuleList(two(small, large) for small, large in pairs)
            self.up = nn.ModuleList(two(large + small, small) for small, large in reversed(pairs))
            self.last = nn.Conv2d(widths[0], 12, 3, padding=1)
            nn.init.zeros_(self.last.weight)
            nn.init.zeros_(self.last.bias)

        def forward(self, image):
            x, skips = self.head(F.pixel_unshuffle(image - 0.5, 2)), []
            for down in self.down:
                skips.append(x)
                x = down(F.avg_pool2d(x, 2))
            for up in self.up:
                x = up(torch.cat([F.interpolate(x, scale_factor=2, mode="nearest"), skips.pop()], 1))
            return Bound.apply(image + F.pixel_shuffle(self.last(x), 2), image)

    net = Unet().to(memory_format=layout)
    means = [p.detach().clone() for p in net.parameters()]
    optimizer = torch.optim.AdamW(net.parameters(), 2e-3, (0.9, 0.99), weight_decay=1e-4)
    image, target = (torch.rand(BATCH, 3, SIZE_PX, SIZE_PX).contiguous(memory_format=layout) for _ in range(2))

    def step():
        d = net(image) - target
        slopes = (d[..., 1:] - d[..., :-1]).abs().mean() + (d[..., 1:, :] - d[..., :-1, :]).abs().mean()
        optimizer.zero_grad()
        (d.abs().mean() + slopes).backward()
        nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimizer.step()
        with torch.no_grad():
            torch._foreach_lerp_(means, list(net.parameters()), 0.002)

    seconds = []
    for number in range(steps + 2):
        begin = time.process_time()
        step()
        if number >= 2:
            seconds.append(time.process_time() - begin)
    return {"seconds": seconds, "params": sum(p.numel() for p in net.parameters()), "version": torch.__version__}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--glasshouse", default=str(pathlib.Path(__file__).parents[2] / "target/release/glasshouse"))
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each program")
    parser.add_argument("--steps", type=int, default=10, help="steps per round")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--only-pytorch", choices=["planes", "channels"], help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.only_pytorch:
        print(json.dumps(pytorch_steps(args.steps, args.only_pytorch == "channels")))
        return

    def output(command):
        return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)

    ours, theirs = [], {"planes": [], "channels": []}
    options = ["--network", "unet", "--width", str(WIDTH), "--batch", str(BATCH), "--size", str(SIZE_PX)]
    for _ in range(args.rounds):
        mine = output([args.glasshouse, "bench", "train", "--json", "-j", "1", "--steps", str(args.steps), *options])
        ours.append(mine["step_cpu_seconds_median"])
        for layout, seconds in theirs.items():
            this = [sys.executable, __file__, "--only-pytorch", layout, "--steps", str(args.steps)]
            other = output(this)
            seconds += other["seconds"]
        if other["params"] != mine["params"]:
            sys.exit(f"the networks differ: {mine['params']} and {other['params']} parameters")
    medians = {layout: statistics.median(seconds) for layout, seconds in theirs.items()}
    best = min(medians, key=medians.get)
    found = {
        "glasshouse_step_cpu_seconds": statistics.median(ours),
        "pytorch_step_cpu_seconds": medians[best],
        "pytorch_layout": best,
        "pytorch_layouts_cpu_seconds": medians,
        "pytorch_version": other["version"],
        "ratio": statistics.median(ours) / medians[best],
        "params": mine["params"],
        "cpu": mine["cpu"],
    }
    if args.json:
        print(json.dumps(found))
        return
    print(f"glasshouse {found['glasshouse_step_cpu_seconds']:.3f} CPU s, PyTorch {found['pytorch_version']} {medians[best]:.3f} CPU s ({best}), ratio {found['ratio']:.2f}, {found['cpu']}")


if __name__ == "__main__":
    main()
