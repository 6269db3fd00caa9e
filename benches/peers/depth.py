#!/usr/bin/env python3
"""Measures `glasshouse depth` and PyTorch's `transformers` on the same pictures and weights, and the ratio of the CPU seconds.

    pip install torch torchvision transformers safetensors pillow numpy
    cargo build --release
    benches/peers/depth.py [--glasshouse target/release/glasshouse] [--rounds 3] [--json]

Both use one thread, and turn JPEGs of 640 x 480 px into depth maps: decoding, resizing to 686 x 518 px, Depth Anything V2 with
random weights, resizing to the picture's size, and a file. The programs alternate. Time to start and to load the weights does
not count: that of six pictures less that of two is divided by four.
"""

import argparse
import json
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

SIZES = {"vits": (384, 12, 6, 64), "vitb": (768, 12, 12, 128)}
FEW, MANY = 2, 6


def network(size):
    """A network of `transformers` with random weights."""
    import torch
    from transformers import DepthAnythingConfig, DepthAnythingForDepthEstimation, Dinov2Config

    width, blocks, heads, fused = SIZES[size]
    levels = [48, 96, 192, 384] if size == "vits" else [96, 192, 384, 768]
    read = [f"stage{k}" for k in (3, 6, 9, 12)]
    backbone = Dinov2Config(
        hidden_size=width, num_hidden_layers=blocks, num_attention_heads=heads, image_size=518, patch_size=14,
        out_features=read, apply_layernorm=True, reshape_hidden_states=False,
    )
    config = DepthAnythingConfig(
        backbone_config=backbone, reassemble_hidden_size=width, neck_hidden_sizes=levels, fusion_hidden_size=fused,
        head_hidden_size=32, patch_size=14,
    )
    torch.manual_seed(0)
    return DepthAnythingForDepthEstimation(config).eval()


def save_weights(size, path):
    """Writes the weights under their published names; version 5 of `transformers` renames the parts of the attention."""
    from safetensors.torch import save_file

    parts = {"q_proj": "attention.query", "k_proj": "attention.key", "v_proj": "attention.value", "o_proj": "output.dense"}
    tensors = {}
    for name, tensor in network(size).state_dict().items():
        for own, published in parts.items():
            name = name.replace(f".attention.{own}.", f".attention.{published}.")
        tensors[name] = tensor.contiguous()
    save_file(tensors, path)


def pytorch_seconds(size, pictures):
    """CPU seconds of PyTorch for one picture, after a warm-up."""
    import numpy as np
    import torch
    from PIL import Image
    from transformers import DPTImageProcessor

    torch.set_num_threads(1)
    net = network(size)
    processor = DPTImageProcessor(
        size={"height": 518, "width": 518}, keep_aspect_ratio=True, ensure_multiple_of=14, resample=3,
        image_mean=[0.485, 0.456, 0.406], image_std=[0.229, 0.224, 0.225],
    )
    seconds = []
    with torch.no_grad():
        for picture in sorted(pictures.glob("*.jpg")):
            begin = time.process_time()
            image = Image.open(picture).convert("RGB")
            depth = net(**processor(images=image, return_tensors="pt"))
            depth = processor.post_process_depth_estimation(depth, target_sizes=[(image.height, image.width)])
            np.save(picture.with_suffix(".theirs.npy"), depth[0]["predicted_depth"].numpy())
            seconds.append(time.process_time() - begin)
    return {"seconds": statistics.mean(seconds[1:]), "version": torch.__version__}


def glasshouse_seconds(glasshouse, weights, folders):
    """CPU seconds of glasshouse for one picture."""
    used = []
    for pictures in folders:
        with tempfile.TemporaryDirectory() as out:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            command = [glasshouse, "depth", pictures, "--weights", weights, "--out", f"{out}/depth", "-j", "1", "-q", "--json"]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            used.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return (used[1] - used[0]) / (MANY - FEW)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--glasshouse", default=str(pathlib.Path(__file__).parents[2] / "target/release/glasshouse"))
    parser.add_argument("--rounds", type=int, default=3, help="rounds of each program")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--only-pytorch", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.only_pytorch:
        size, pictures = args.only_pytorch
        print(json.dumps(pytorch_seconds(size, pathlib.Path(pictures))))
        return

    import numpy as np
    from PIL import Image

    found = {}
    with tempfile.TemporaryDirectory() as work:
        work = pathlib.Path(work)
        folders = [work / "few", work / "many"]
        for folder, count in zip(folders, (FEW, MANY)):
            folder.mkdir()
            for k in range(count):
                pixels = np.random.default_rng(k).integers(0, 256, (12, 16, 3), np.uint8)
                Image.fromarray(pixels).resize((640, 480), Image.BICUBIC).save(folder / f"{k}.jpg")
        for size in SIZES:
            weights = work / f"{size}.safetensors"
            save_weights(size, weights)
            ours, theirs = [], []
            for _ in range(args.rounds):
                ours.append(glasshouse_seconds(args.glasshouse, weights, folders))
                this = [sys.executable, __file__, "--only-pytorch", size, folders[1]]
                other = json.loads(subprocess.run(this, check=True, stdout=subprocess.PIPE).stdout)
                theirs.append(other["seconds"])
            own, torch_s = statistics.median(ours), statistics.median(theirs)
            found[size] = {"glasshouse_cpu_s": own, "pytorch_cpu_s": torch_s, "ratio": own / torch_s}
            if not args.json:
                print(f"{size}: glasshouse {own:.2f} CPU s, PyTorch {other['version']} {torch_s:.2f} CPU s, ratio {own / torch_s:.2f}")
    if args.json:
        print(json.dumps(found | {"pytorch_version": other["version"]}))


if __name__ == "__main__":
    main()
