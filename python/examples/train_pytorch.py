"""Trains a small U-Net in PyTorch on examples that are composed while it trains, and saves before and after pictures.

    glasshouse run manifests/smoke.toml
    python python/examples/train_pytorch.py runs/smoke --steps 200

With a recipe in place of a run's folder, the scenes are rendered on the fly. A real training needs more scenes
(manifests/pytorch.toml) and more steps.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor, nn
from torch.nn.functional import interpolate
from torch.utils.data import DataLoader

import glasshouse
from glasshouse.torch import Stream


class Network(nn.Module):
    """A residual U-Net of two scales: the transmission is the input and a correction."""

    def __init__(self, width: int = 24) -> None:
        super().__init__()

        def block(inputs: int, outputs: int) -> nn.Sequential:
            first, second = nn.Conv2d(inputs, outputs, 3, padding=1), nn.Conv2d(outputs, outputs, 3, padding=1)
            return nn.Sequential(first, nn.GELU(), second, nn.GELU())

        self.fine, self.coarse = block(3, width), block(width, 2 * width)
        self.join, self.last = block(3 * width, width), nn.Conv2d(width, 3, 1)
        nn.init.zeros_(self.last.weight)

    def forward(self, codes: Tensor) -> Tensor:
        """Returns the transmission of pictures (B, 3, H, W) with even sides, in sRGB codes."""
        fine = self.fine(codes)
        coarse = interpolate(self.coarse(nn.functional.avg_pool2d(fine, 2)), scale_factor=2.0, mode="bilinear")
        correction: Tensor = self.last(self.join(torch.cat([fine, coarse], 1)))
        return codes + correction


def srgb(linear: Tensor) -> Tensor:
    """Returns the sRGB codes of linear light, clipped to 0 to 1."""
    linear = linear.clamp(0, 1)
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


def codes_of(batch: dict[str, Tensor], device: str) -> tuple[Tensor, Tensor]:
    """Returns input and target of mixtures (codes already) or of tuples (linear light)."""
    if "target_t" in batch:
        return batch["input"].to(device), batch["target_t"].to(device)
    return srgb(batch["input"]).to(device), srgb(batch["transmission"]).to(device)


def psnr_db(made: Tensor, truth: Tensor) -> float:
    """Returns the peak signal-to-noise ratio of codes."""
    return float(-10 * torch.log10((made.clamp(0, 1) - truth).square().mean()))


def main() -> None:
    """Trains, and writes the pictures of the last batch."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", type=Path, help="folder of a run with tuples, or a recipe")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--size", type=int, default=128, help="side of the examples, px")
    parser.add_argument("--workers", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("before_after.png"))
    args = parser.parse_args()
    device = "cuda" if torch.cuda.is_available() else "cpu"
    if args.path.is_dir():
        source: glasshouse.Mixtures | glasshouse.Tuples = glasshouse.Mixtures(args.path, seed=1, size=args.size)
    else:
        source = glasshouse.Tuples(args.path, spp=16, size=args.size, split="train")
    stream = Stream(source, batch=args.batch, seed=1, batches=args.steps)
    loader = DataLoader(stream, batch_size=None, num_workers=args.workers)
    network = Network().to(device)
    optimizer = torch.optim.AdamW(network.parameters(), lr=2e-3)
    before = after = 0.0
    for step, batch in enumerate(loader, 1):
        codes, truth = codes_of(batch, device)
        made = network(codes)
        loss = (made - truth).abs().mean()
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        optimizer.step()
        # Means of some twenty batches, which the network has not seen before this step.
        before = 0.95 * before + 0.05 * psnr_db(codes, truth)
        after = 0.95 * after + 0.05 * psnr_db(made.detach(), truth)
        if step % 20 == 0:
            share = 1 - 0.95**step
            print(f"step {step}: input {before / share:.2f} dB, network {after / share:.2f} dB", flush=True)
    rows = [torch.cat([*of[:4].detach().clamp(0, 1)], 2) for of in (codes, made, truth)]
    picture = torch.cat(rows, 1).mul(255).round().byte().permute(1, 2, 0).cpu().numpy()
    Image.fromarray(np.ascontiguousarray(picture)).save(args.out)
    print(f"see {args.out}: input, network, truth")


if __name__ == "__main__":
    main()
