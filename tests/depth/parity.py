"""Depth Anything V2 of `transformers` with random weights: parity.safetensors.

    pip install torch transformers safetensors
    python tests/depth/parity.py

The tests of src/depth/tests.rs make the same weights and pictures from the hash below, and compare all outputs. Small networks have
whole outputs; those of ViT-S have every seventh row and column. The weights are random, so the outputs are no depths.
"""

import time
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from transformers import DepthAnythingConfig, DepthAnythingForDepthEstimation, Dinov2Config


def uniform(name, count):
    """Numbers from -1 to 1: a function of the name and the place alone."""
    seed = 2166136261
    for byte in name.encode():
        seed = (seed ^ byte) * 16777619 & 0xFFFFFFFF
    x = (np.arange(count, dtype=np.uint64) * 0x9E3779B9 + seed) & 0xFFFFFFFF
    for shift, factor in ((16, 0x21F0AAAD), (15, 0x735A2D97)):
        x ^= x >> np.uint64(shift)
        x = x * np.uint64(factor) & 0xFFFFFFFF
    x ^= x >> np.uint64(15)
    return ((x >> np.uint64(8)).astype(np.float64) / 2**23 - 1.0).astype(np.float32)


def weight(name, shape):
    values = torch.from_numpy(uniform(name, int(np.prod(shape)))).reshape(shape)
    if name == "head.conv3.bias":
        return values * 0 + 3.0  # keeps the outputs above 0
    if name.endswith("lambda1"):
        return 0.5 + 0.25 * values
    if "norm" in name and name.endswith("weight"):
        return 1.0 + 0.2 * values
    if name.endswith("bias") or "embeddings.cls_token" in name or "position_embeddings" in name:
        return 0.2 * values
    fan_in = int(np.prod(shape[1:]))
    if ".resize.weight" in name and shape[2] in (2, 4):
        fan_in = shape[0]
    return values * (1.7 / fan_in**0.5)


def published(name):
    """The name in the published files; version 5 of `transformers` renames the parts of the attention."""
    for own, theirs in (("q_proj", "attention.query"), ("k_proj", "attention.key"), ("v_proj", "attention.value"), ("o_proj", "output.dense")):
        name = name.replace(f".attention.{own}.", f".attention.{theirs}.")
    return name


def network(config, metric_m):
    backbone = Dinov2Config(
        hidden_size=config["width"],
        num_hidden_layers=config["blocks"],
        num_attention_heads=config["heads"],
        image_size=14 * config["position_side"],
        patch_size=14,
        out_indices=config["read"],
        apply_layernorm=True,
        reshape_hidden_states=False,
    )
    settings = dict(
        backbone_config=backbone,
        neck_hidden_sizes=config["levels"],
        fusion_hidden_size=config["fused"],
        head_hidden_size=config["last"],
        reassemble_hidden_size=config["width"],
        reassemble_factors=[4, 2, 1, 0.5],
        head_in_index=-1,
        patch_size=14,
    )
    if metric_m:
        settings.update(depth_estimation_type="metric", max_depth=int(metric_m))
    model = DepthAnythingForDepthEstimation(DepthAnythingConfig(**settings)).eval()
    with torch.no_grad():
        for name, tensor in model.state_dict().items():
            tensor.copy_(weight(published(name), tensor.shape))
    return model


TINY = dict(width=48, blocks=4, heads=3, read=[1, 2, 3, 4], levels=[16, 24, 32, 48], fused=16, last=8, position_side=9)
VITS = dict(width=384, blocks=12, heads=6, read=[3, 6, 9, 12], levels=[48, 96, 192, 384], fused=64, last=32, position_side=37)
CASES = [
    ("tiny", TINY, None, 126, 126, 1),
    ("tiny", TINY, None, 126, 182, 1),
    ("tiny", TINY, None, 98, 70, 1),
    ("tiny", TINY, 20.0, 154, 112, 1),
    ("vits", VITS, None, 518, 518, 7),
    ("vits", VITS, 80.0, 518, 686, 7),
    ("vits", VITS, None, 574, 518, 7),
]

torch.set_num_threads(1)
outputs = {}
for name, config, metric_m, rows, columns, step in CASES:
    model = network(config, metric_m)
    planes = torch.from_numpy(uniform(f"picture {rows} {columns}", 3 * rows * columns)).reshape(1, 3, rows, columns) * 2
    with torch.no_grad():
        started = time.process_time()
        depth = model(pixel_values=planes).predicted_depth[0]
        seconds = time.process_time() - started
    kind = "metric" if metric_m else "relative"
    outputs[f"{name} {kind} {rows} {columns}"] = depth[::step, ::step].contiguous()
    print(f"{name} {kind} {rows} {columns}: {depth.min():.3f} to {depth.max():.3f}, {seconds:.2f} CPU s")
save_file(outputs, Path(__file__).with_suffix(".safetensors"))
