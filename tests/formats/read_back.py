"""Reads an export with common packages, and compares every pixel with the run's tuples.

    read_back.py WHAT RUN OUT

WHAT is the name of a function below, without its prefix `read_`. Exit code 77: a package is not installed.
"""

import io
import json
import os
import pathlib
import sys
import tempfile

LAYERS = ["input", "transmission", "glass_reflection", "clean_reflection"]
PAIRS = {
    "input": "blended",
    "transmission": "transmission_layer",
    "glass_reflection": "reflection_layer",
    "clean_reflection": "clean_reflection_layer",
}

# Keeps the packages from using the user's caches or the network.
CACHE = tempfile.TemporaryDirectory()
os.environ.update(HF_HOME=CACHE.name, HF_HUB_OFFLINE="1", HF_DATASETS_OFFLINE="1", CROISSANT_CACHE=CACHE.name)
os.environ.update(HOME=CACHE.name, XDG_CACHE_HOME=CACHE.name, TOKENIZERS_PARALLELISM="false")


def scenes(run, split=None):
    """Returns the scene lines of the manifest that have a tuple, by id."""
    found = {}
    for text in (run / "manifest.jsonl").read_text().splitlines():
        line = json.loads(text)
        there = (run / "tuples" / line["id"] / "tuple.json").exists()
        if there and split in (None, line.get("split", "train")):
            found[line["id"]] = line
    return found


def layers_of(line):
    return line["film"].get("layers", LAYERS)


def coded(run, scene, layer):
    """Returns the pixels of the tuple's PNG."""
    import numpy
    from PIL import Image

    return numpy.array(Image.open(run / "tuples" / scene / f"{layer}.png"))


def linear(run, scene, layer):
    """Returns the pixels of the tuple's EXR; halves stay halves."""
    import numpy
    import OpenEXR

    with OpenEXR.File(str(run / "tuples" / scene / "tuple.exr"), separate_channels=True) as file:
        channels = file.channels()
        return numpy.stack([channels[f"{layer}.{c}"].pixels for c in "RGB"], axis=-1)


def srgb16(values):
    """Encodes linear values by IEC 61966-2-1 in 16 bits."""
    import numpy

    x = numpy.clip(values.astype(numpy.float64), 0, 1)
    code = numpy.where(x <= 0.0031308, 12.92 * x, 1.055 * numpy.power(x, 1 / 2.4) - 0.055)
    return numpy.round(code * 65535).astype(numpy.uint16)


def exr_pixels(data_or_path):
    """Returns the pixels of a file with one part and the channels R, G, B."""
    import OpenEXR

    if isinstance(data_or_path, bytes):
        with tempfile.NamedTemporaryFile(suffix=".exr") as file:
            file.write(data_or_path)
            file.flush()
            return exr_pixels(file.name)
    with OpenEXR.File(str(data_or_path)) as file:
        assert list(file.channels()) == ["RGB"], file.channels()
        return file.channels()["RGB"].pixels.copy()


def same(found, expected):
    assert found.dtype == expected.dtype, (found.dtype, expected.dtype)
    assert found.shape == expected.shape, (found.shape, expected.shape)
    assert (found == expected).all()


def png16(data):
    """Returns the RGB pixels that OpenCV reads from a 16-bit PNG."""
    import cv2
    import numpy

    return cv2.imdecode(numpy.frombuffer(data, numpy.uint8), cv2.IMREAD_UNCHANGED)[:, :, ::-1]


def shards(out, split):
    return sorted(str(path) for path in out.glob(f"{split}-*.tar"))


def read_webdataset(run, out):
    import numpy
    import webdataset

    count = 0
    for split in ("train", "test"):
        expected = scenes(run, split)
        if not expected:
            continue
        dataset = webdataset.WebDataset(shards(out, split), shardshuffle=False).decode("pil")
        seen = []
        for sample in dataset:
            scene = sample["__key__"]
            seen.append(scene)
            assert sample["json"] == json.loads((run / "tuples" / scene / "tuple.json").read_text())
            for layer in LAYERS:
                assert (f"{layer}.png" in sample) == (layer in layers_of(expected[scene]))
                if f"{layer}.png" in sample:
                    same(numpy.array(sample[f"{layer}.png"]), coded(run, scene, layer))
                    count += 1
        assert seen == sorted(expected), (seen, sorted(expected))
    return count


def read_webdataset_srgb16(run, out):
    import numpy
    import webdataset

    count = 0
    for sample in webdataset.WebDataset(shards(out, "train"), shardshuffle=False):
        for layer in LAYERS:
            # The power function may differ in the last bit, so that a value between two codes rounds differently.
            found = png16(sample[f"{layer}.png"]).astype(numpy.int32)
            expected = srgb16(linear(run, sample["__key__"], layer)).astype(numpy.int32)
            assert found.shape == expected.shape and numpy.abs(found - expected).max() <= 1
            assert (found == expected).mean() > 0.999
            count += 1
    return count


def read_webdataset_linear(run, out):
    import webdataset

    count = 0
    for sample in webdataset.WebDataset(shards(out, "train"), shardshuffle=False):
        for layer in LAYERS:
            same(exr_pixels(sample[f"{layer}.exr"]), linear(run, sample["__key__"], layer))
            count += 1
    return count


def read_loader(run, out):
    """Reads with a torch DataLoader with workers; each tuple occurs once."""
    import numpy
    import torch
    import webdataset

    def tensors(sample):
        image = torch.from_numpy(numpy.array(sample["input.png"]))
        return image.permute(2, 0, 1).float() / 255, sample["__key__"]

    dataset = webdataset.WebDataset(
        shards(out, "train"), shardshuffle=100, seed=1, empty_check=False, workersplitter=webdataset.split_by_worker
    )
    dataset = dataset.shuffle(100, seed=1).decode("pil").map(tensors)
    seen = []
    for images, names in torch.utils.data.DataLoader(dataset, batch_size=2, num_workers=2):
        for image, scene in zip(images, names):
            expected = torch.from_numpy(coded(run, scene, "input")).permute(2, 0, 1).float() / 255
            assert torch.equal(image, expected)
            seen.append(scene)
    assert sorted(seen) == sorted(scenes(run, "train")), seen
    return len(seen)


def check_rows(run, dataset):
    import numpy

    count = 0
    for split, rows in dataset.items():
        expected = scenes(run, split)
        assert [row["id"] for row in rows] == sorted(expected)
        for row in rows:
            line = expected[row["id"]]
            assert row["glass_ior"] == line["glass"]["ior"]
            assert row["glass_yaw_deg"] == line["glass"]["tilt_deg"][1]
            for layer in LAYERS:
                picture = row.get(layer)
                assert (picture is not None) == (layer in layers_of(line)), (layer, row)
                if picture is not None:
                    same(numpy.array(picture), coded(run, row["id"], layer))
                    count += 1
    return count


def read_imagefolder(run, out):
    from datasets import load_dataset

    # `datasets` accepts the name of the loader, and finds the files by the card's header.
    count = check_rows(run, load_dataset("imagefolder", data_dir=str(out)))
    assert count == check_rows(run, load_dataset(str(out)))
    return count


def read_hub_webdataset(run, out):
    """Reads the tars with `datasets`, which finds them by the card's header."""
    import numpy
    from datasets import load_dataset

    count = 0
    for split, rows in load_dataset(str(out)).items():
        assert [row["__key__"] for row in rows] == sorted(scenes(run, split))
        for row in rows:
            for layer in LAYERS:
                same(numpy.array(row[f"{layer}.png"]), coded(run, row["__key__"], layer))
                count += 1
    return count


def read_pairs(run, out):
    import numpy
    from PIL import Image

    count = 0
    for scene, line in scenes(run).items():
        for layer, folder in PAIRS.items():
            path = out / line.get("split", "train") / folder / f"{scene}.png"
            assert path.exists() == (layer in layers_of(line)), path
            if path.exists():
                same(numpy.array(Image.open(path)), coded(run, scene, layer))
                count += 1
    return count


def read_pairs_linear(run, out):
    count = 0
    for scene, line in scenes(run).items():
        for layer in layers_of(line):
            path = out / line.get("split", "train") / PAIRS[layer] / f"{scene}.exr"
            same(exr_pixels(path), linear(run, scene, layer))
            count += 1
    return count


def read_exr(run, out):
    import OpenEXR

    count = 0
    for scene, line in scenes(run).items():
        with OpenEXR.File(str(out / line.get("split", "train") / f"{scene}.exr")) as file:
            parts = {part.name(): part for part in file.parts}
            # Even a single part has a name.
            assert list(parts) == [layer for layer in LAYERS if layer in layers_of(line)], list(parts)
            for layer, part in parts.items():
                same(part.channels["RGB"].pixels, linear(run, scene, layer))
                count += 1
    return count


def each_shard(out, framework):
    """Returns the opened shards of tensors of each split, in order."""
    from safetensors import safe_open

    for split in ("train", "test"):
        for path in sorted(out.glob(f"{split}-*.safetensors")):
            with safe_open(path, framework=framework) as shard:
                metadata = shard.metadata()
                assert metadata["schema"] == "glasshouse.tuples/1", metadata
                yield split, json.loads(metadata["scenes"]), shard


def read_safetensors(run, out):
    import numpy

    count = 0
    seen = {"train": [], "test": []}
    for split, names, shard in each_shard(out, "np"):
        seen[split] += names
        keys = [f"{scene}.{layer}" for scene in names for layer in layers_of(scenes(run)[scene])]
        assert sorted(shard.keys()) == sorted(keys), shard.keys()
        for key in keys:
            same(shard.get_tensor(key), numpy.moveaxis(linear(run, *key.split(".")), -1, 0))
            count += 1
    for split, names in seen.items():
        assert names == sorted(scenes(run, split)), names
        lines = (out / f"{split}.jsonl").read_text().splitlines()
        records = [(run / "tuples" / scene / "tuple.json").read_text() for scene in names]
        assert [json.loads(line) for line in lines] == [json.loads(record) for record in records]
    return count


def read_safetensors_torch(run, out):
    """Reads with PyTorch, whose tensors are parts of the mapped file."""
    import torch

    count = 0
    for _, names, shard in each_shard(out, "pt"):
        for scene in names:
            found = shard.get_tensor(f"{scene}.input")
            expected = torch.from_numpy(linear(run, scene, "input")).permute(2, 0, 1)
            assert found.dtype == expected.dtype and torch.equal(found, expected)
            count += 1
    return count


def read_croissant(run, out):
    import mlcroissant
    import numpy

    dataset = mlcroissant.Dataset(jsonld=str(out / "croissant.json"))
    issues = dataset.metadata.issues
    assert not issues.errors, issues.report()
    print(f"warnings: {sorted(issues.warnings)}", file=sys.stderr)
    expected = scenes(run)
    text = lambda value: value.decode() if isinstance(value, bytes) else value
    tuples = list(dataset.records("tuples"))
    assert sorted(text(record["tuples/id"]) for record in tuples) == sorted(expected)
    for record in tuples:
        line = expected[text(record["tuples/id"])]
        if "tuples/json" in record:
            assert json.loads(record["tuples/json"])["scene"] == {**line, "split": line.get("split", "train")}
        else:
            assert record["tuples/glass_thickness_m"] == line["glass"]["thickness_m"]
    count = 0
    for layer in LAYERS:
        seen = []
        for record in dataset.records(layer):
            scene = text(record[f"{layer}/id"])
            same(numpy.array(record[f"{layer}/image"]), coded(run, scene, layer))
            seen.append(scene)
            count += 1
        assert sorted(seen) == sorted(expected), seen
    return count


def main():
    what, run, out = sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])
    try:
        count = globals()[f"read_{what}"](run, out)
    except ModuleNotFoundError as error:
        print(f"skipped: {what}: {error}")
        sys.exit(77)
    assert count > 0
    print(f"{what}: {count}")


if __name__ == "__main__":
    main()
