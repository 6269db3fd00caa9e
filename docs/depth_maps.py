#!/usr/bin/env python3
"""Depth maps for photographs that have none, by a published estimator: see docs/data.md.

For each photograph below PHOTOS (.jpg, .jpeg, .png) one file of the same name, ending in .npy, in the same folders below
DEPTHS: float32, the photograph's height and width. Depth Anything and its kin write relative inverse depth (larger is
nearer), in a recipe depth_kind = "relative_inverse". What is there already is skipped, and a file appears under its name
only when it is whole: stop it and start it again as you like.

    pip install torch transformers pillow numpy
    python3 docs/depth_maps.py places places-depth --device cuda --batch 16
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image

DEFAULT_MODEL = "depth-anything/Depth-Anything-V2-Small-hf"
ENDINGS = {".jpg", ".jpeg", ".png"}


def published(name):
    """A model and its image processor, downloaded or from the cache."""
    from transformers import AutoImageProcessor, AutoModelForDepthEstimation

    return AutoImageProcessor.from_pretrained(name), AutoModelForDepthEstimation.from_pretrained(name)


def random_tiny():
    """The same architecture, tiny and with random weights: for trying the way without a download. Its depths mean nothing."""
    from transformers import (
        DepthAnythingConfig,
        DepthAnythingForDepthEstimation,
        Dinov2Config,
        DPTImageProcessor,
    )

    backbone = Dinov2Config(
        hidden_size=32,
        num_hidden_layers=4,
        num_attention_heads=2,
        image_size=70,
        patch_size=14,
        out_features=["stage1", "stage2", "stage3", "stage4"],
        reshape_hidden_states=False,
        apply_layernorm=True,
    )
    config = DepthAnythingConfig(
        backbone_config=backbone,
        patch_size=14,
        reassemble_hidden_size=32,
        neck_hidden_sizes=[8, 16, 32, 32],
        fusion_hidden_size=16,
        head_hidden_size=8,
    )
    torch.manual_seed(0)
    processor = DPTImageProcessor(
        size={"height": 70, "width": 70}, keep_aspect_ratio=True, ensure_multiple_of=14
    )
    return processor, DepthAnythingForDepthEstimation(config)


def save(path, depth):
    """Under its name only when it is whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".tmp-{os.getpid()}-{path.name}")
    try:
        with open(temporary, "wb") as file:
            np.save(file, depth)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@torch.inference_mode()
def estimate(processor, model, images, device):
    """Depth of images of one size, at that size."""
    pixels = processor(images=images, return_tensors="pt")["pixel_values"].to(device)
    depth = model(pixel_values=pixels).predicted_depth.float()
    width, height = images[0].size
    depth = torch.nn.functional.interpolate(
        depth[:, None], size=(height, width), mode="bicubic", align_corners=False
    )
    return depth[:, 0].cpu().numpy().astype(np.float32)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("photos", type=Path, help="folder of photographs")
    parser.add_argument("depths", type=Path, help="folder for the depth maps")
    parser.add_argument("--model", default=DEFAULT_MODEL, help="name or folder of a depth estimation model of transformers")
    parser.add_argument("--device", default="cpu", help="cpu, cuda, mps")
    parser.add_argument("--batch", type=int, default=1, help="photographs of one size that are estimated together")
    parser.add_argument("--random-tiny", action="store_true", help="random weights, no download: only to try the way")
    arguments = parser.parse_args()
    if arguments.batch < 1:
        parser.error("--batch must be 1 or more")

    photographs = sorted(p for p in arguments.photos.rglob("*") if p.suffix.lower() in ENDINGS and p.is_file())
    if not photographs:
        sys.exit(f"{arguments.photos} holds no .jpg, .jpeg or .png: give the folder of the photographs")
    targets = [arguments.depths / p.relative_to(arguments.photos).with_suffix(".npy") for p in photographs]
    clashes = {target for target in targets if targets.count(target) > 1} if len(set(targets)) < len(targets) else set()
    if clashes:
        sys.exit(f"two photographs would have the depth map {min(clashes)}: rename one")
    waiting = [(p, t) for p, t in zip(photographs, targets) if not t.exists()]
    print(f"{len(photographs)} photographs, {len(photographs) - len(waiting)} have their depth maps", flush=True)
    if not waiting:
        return

    processor, model = random_tiny() if arguments.random_tiny else published(arguments.model)
    model = model.to(arguments.device).eval()
    failed = []
    batch = []

    def flush():
        if batch:
            depths = estimate(processor, model, [image for image, _ in batch], arguments.device)
            for (_, target), depth in zip(batch, depths):
                save(target, depth)
            batch.clear()

    for done, (photograph, target) in enumerate(waiting, start=1):
        try:
            with Image.open(photograph) as file:
                # As stored, like glasshouse reads it: tags that turn it are ignored by both.
                image = file.convert("RGB")
        except OSError as error:
            failed.append(photograph)
            print(f"cannot read {photograph}: {error}", file=sys.stderr, flush=True)
            continue
        if batch and batch[0][0].size != image.size:
            flush()
        batch.append((image, target))
        if len(batch) == arguments.batch:
            flush()
        if done % 100 == 0:
            print(f"{done} of {len(waiting)}", flush=True)
    flush()
    print(f"{len(waiting) - len(failed)} depth maps written below {arguments.depths}")
    if failed:
        sys.exit(f"{len(failed)} photographs could not be read")


if __name__ == "__main__":
    main()
