#!/usr/bin/env python3
"""Converts a TensorFlow checkpoint of Kim, Huo and Yoon or of Zhang, Ng and Chen to a checkpoint of Glasshouse.

PREFIX is the common beginning of PREFIX.index and PREFIX.data-*; FOLDER gets model.safetensors, optimizer.safetensors
(empty) and state.json. The script needs no TensorFlow, only Python 3.9 or later.

    b3sum vgg19-caffe.safetensors      # digest of the feature network's file
    python3 docs/convert_tensorflow.py pre-trained/model --features-blake3 DIGEST --out converted
    glasshouse separate photo.jpg --network converted --features vgg19-caffe.safetensors --out separated

Variables, from main.py of sookim813/Reflection_removal_rendering and of ceciliavision/perceptual-reflection-removal: SCOPE is
g_conv0 to g_conv7 and g_conv9 for SP-net, and the same after R_reconnet/ for BT-net. SCOPE/weights, SCOPE/w0, SCOPE/w1 and
SCOPE/BatchNorm/beta make a layer; g_conv_last has weights and biases. All others (Adam, moving means, the discriminator)
are ignored: these programs always normalise by the statistics of the batch. They work on pictures in the order B, G, R;
the first and the last kernels are reordered for R, G, B. Zhang's network has no BT-net: its place gets the identity.
"""

import argparse
import array
import json
import re
import struct
import sys
from pathlib import Path

LAYERS = [*range(8), 9]
TABLE_MAGIC = 0xDB4775248B80FB57
FLOAT = 1
HYPERCOLUMN = 1472


class Damaged(Exception):
    """A file that is not a usable checkpoint."""


def crc32c_table():
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (0x82F63B78 if byte & 1 else 0)
        table.append(byte)
    return table


CRC32C = crc32c_table()


def masked_crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc = CRC32C[(crc ^ byte) & 255] ^ crc >> 8
    crc ^= 0xFFFFFFFF
    return ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF


def varint(data, at):
    value = shift = 0
    while True:
        if at >= len(data):
            raise Damaged("the index ends within a number")
        byte = data[at]
        at, value, shift = at + 1, value | (byte & 127) << shift, shift + 7
        if byte < 128:
            return value, at


def message(data):
    """Reads the fields of a protocol buffer: number to list of values."""
    fields, at = {}, 0
    while at < len(data):
        key, at = varint(data, at)
        kind = key & 7
        if kind == 0:
            value, at = varint(data, at)
        elif kind == 5:
            value, at = struct.unpack_from("<I", data, at)[0], at + 4
        elif kind == 1:
            value, at = struct.unpack_from("<Q", data, at)[0], at + 8
        elif kind == 2:
            size, at = varint(data, at)
            value, at = data[at : at + size], at + size
        else:
            raise Damaged(f"the index has a field of kind {kind}")
        fields.setdefault(key >> 3, []).append(value)
    return fields


def block(data, offset, size):
    """Returns the keys and values of a block of the index, a sorted string table."""
    content, (kind, crc) = data[offset : offset + size], struct.unpack_from("<BI", data, offset + size)
    if kind != 0:
        raise Damaged("the index is compressed")
    if masked_crc32c(data[offset : offset + size + 1]) != crc:
        raise Damaged("a block of the index does not match its checksum")
    end = size - 4 - 4 * struct.unpack_from("<I", content, size - 4)[0]
    at, key = 0, b""
    while at < end:
        shared, at = varint(content, at)
        fresh, at = varint(content, at)
        length, at = varint(content, at)
        key = key[:shared] + content[at : at + fresh]
        at += fresh
        yield key, content[at : at + length]
        at += length


def read_index(path):
    """Returns the number of data files, and the entries of the tensors by name."""
    data = path.read_bytes()
    if len(data) < 48 or struct.unpack_from("<Q", data, len(data) - 8)[0] != TABLE_MAGIC:
        raise Damaged("it is not the index of a checkpoint (TensorFlow's format V2)")
    at = len(data) - 48
    _, at = varint(data, at)
    _, at = varint(data, at)
    offset, at = varint(data, at)
    size, at = varint(data, at)
    shards, entries = 1, {}
    for _, handle in block(data, offset, size):
        start, at = varint(handle, 0)
        length, _ = varint(handle, at)
        for key, value in block(data, start, length):
            if key:
                entries[key.decode()] = message(value)
            else:
                shards = message(value).get(1, [1])[0]
    return shards, entries


class Tensor:
    def __init__(self, shape, values):
        self.shape, self.values = shape, values


class Bundle:
    """The variables of a checkpoint."""

    def __init__(self, prefix):
        self.prefix = prefix
        self.shards, self.entries = read_index(Path(f"{prefix}.index"))

    def find(self, pattern):
        """Returns the only variable whose whole name matches a pattern; None if there is none."""
        names = [name for name in self.entries if re.fullmatch(pattern, name)]
        if len(names) > 1:
            raise Damaged(f"several variables match {pattern}: {', '.join(sorted(names))}")
        return names[0] if names else None

    def read(self, pattern, shape):
        """Reads a variable of 32-bit floats; None in `shape` stands for any size."""
        name = self.find(pattern)
        if name is None:
            raise Damaged(f"it has no variable {pattern}; it has {', '.join(sorted(self.entries)[:8])}, ...")
        entry = self.entries[name]
        sizes = [message(size).get(1, [0])[0] for size in message(entry.get(2, [b""])[0]).get(2, [])]
        fits = len(sizes) == len(shape) and all(b in (None, a) for a, b in zip(sizes, shape))
        if entry.get(1) != [FLOAT] or not fits:
            raise Damaged(f"{name} has the type {entry.get(1)} and the shape {sizes} instead of floats of {shape}")
        shard, offset, size = (entry.get(field, [0])[0] for field in (3, 4, 5))
        path = Path(f"{self.prefix}.data-{shard:05}-of-{self.shards:05}")
        with path.open("rb") as file:
            file.seek(offset)
            data = file.read(size)
        count = 1
        for side in sizes:
            count *= side
        if len(data) != size or size != 4 * count or masked_crc32c(data) != entry.get(6, [0])[0]:
            raise Damaged(f"{name} does not match its checksum in {path.name}")
        values = array.array("f", data)
        if sys.byteorder == "big":
            values.byteswap()
        return Tensor(sizes, values)


def turned(kernel, inputs, outputs):
    """Reorders a kernel from (rows, columns, inputs, outputs) to (outputs, inputs, rows, columns), with these channels."""
    rows, columns, channels, width = kernel.shape
    places = range(rows * columns)
    order = ((place * channels + i) * width + o for o in outputs for i in inputs for place in places)
    values = array.array("f", (kernel.values[at] for at in order))
    return Tensor([width, channels, rows, columns], values)


def network(bundle, scope, outputs):
    """Reads a generator under Glasshouse's names; returns it with its width and number of inputs."""
    tensors, width, inputs = {}, None, None
    reversed_outputs = [3 * (o // 3) + 2 - o % 3 for o in range(outputs)]
    for layer, number in enumerate(LAYERS):
        # A scope that is opened again gets a number.
        at = rf"{scope}g_conv{number}(_\d+)?/"
        kernel = bundle.read(at + "weights", [1, 1, None, None] if layer == 0 else [3, 3, width, width])
        order = list(range(kernel.shape[2]))
        if layer == 0:
            inputs, width = kernel.shape[2:]
            order[-3:] = order[:-4:-1]
        tensors[f"kernel.{layer}"] = turned(kernel, order, range(width))
        for ours, theirs in (("by_itself", "w0"), ("by_norm", "w1")):
            tensors[f"{ours}.{layer}"] = Tensor([1], bundle.read(at + theirs + r"(_\d+)?", []).values)
        tensors[f"offset.{layer}"] = bundle.read(at + "BatchNorm/beta", [width])
    at = rf"{scope}g_conv_last(_\d+)?/"
    last = bundle.read(at + "weights", [1, 1, width, outputs])
    tensors["last"] = turned(last, range(width), reversed_outputs)
    biases = bundle.read(at + "biases", [outputs]).values
    tensors["last_bias"] = Tensor([outputs], array.array("f", (biases[o] for o in reversed_outputs)))
    return tensors, width, inputs


def identity(width, inputs):
    """Makes a generator whose output is its input image, for values of at least 0."""
    tensors = {}
    for layer in range(len(LAYERS)):
        channels, places = (inputs, 1) if layer == 0 else (width, 9)
        kernel = array.array("f", bytes(4 * width * channels * places))
        for colour in range(3):
            source = inputs - 3 + colour if layer == 0 else colour
            kernel[(colour * channels + source) * places + places // 2] = 1.0
        side = 1 if layer == 0 else 3
        tensors[f"kernel.{layer}"] = Tensor([width, channels, side, side], kernel)
        tensors[f"by_itself.{layer}"] = Tensor([1], array.array("f", [1.0]))
        tensors[f"by_norm.{layer}"] = Tensor([1], array.array("f", [0.0]))
        tensors[f"offset.{layer}"] = Tensor([width], array.array("f", bytes(4 * width)))
    last = array.array("f", bytes(4 * 3 * width))
    for colour in range(3):
        last[colour * width + colour] = 1.0
    tensors["last"] = Tensor([3, width, 1, 1], last)
    tensors["last_bias"] = Tensor([3], array.array("f", bytes(12)))
    return tensors


def safetensors(tensors):
    """Returns the bytes of a .safetensors file."""
    header, parts, at = {}, [], 0
    for name, tensor in sorted(tensors.items()):
        values = array.array("f", tensor.values)
        if sys.byteorder == "big":
            values.byteswap()
        part = values.tobytes()
        header[name] = {"dtype": "F32", "shape": tensor.shape, "data_offsets": [at, at + len(part)]}
        parts.append(part)
        at += len(part)
    head = json.dumps(header, separators=(",", ":")).encode()
    head += b" " * (-len(head) % 8)
    return struct.pack("<Q", len(head)) + head + b"".join(parts)


IV = [0x6A09E667, 0xBB67AE85, 0x3C6EF372, 0xA54FF53A, 0x510E527F, 0x9B05688C, 0x1F83D9AB, 0x5BE0CD19]
PERMUTATION = [2, 6, 3, 10, 7, 0, 4, 13, 1, 11, 12, 5, 9, 14, 15, 8]
MIXES = [(0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15), (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14)]
CHUNK_START, CHUNK_END, PARENT, ROOT = 1, 2, 4, 8


def compress(chaining, words, counter, length, flags):
    mask = 0xFFFFFFFF
    s = [*chaining, *IV[:4], counter & mask, counter >> 32, length, flags]
    for round_number in range(7):
        for k, (a, b, c, d) in enumerate(MIXES):
            for x, right, left in ((words[2 * k], 16, 12), (words[2 * k + 1], 8, 7)):
                s[a] = (s[a] + s[b] + x) & mask
                t = s[d] ^ s[a]
                s[d] = (t >> right | t << 32 - right) & mask
                s[c] = (s[c] + s[d]) & mask
                t = s[b] ^ s[c]
                s[b] = (t >> left | t << 32 - left) & mask
        words = [words[k] for k in PERMUTATION]
    return [s[k] ^ s[k + 8] for k in range(8)]


def blake3(data):
    """Returns the BLAKE3 digest in hexadecimal digits; takes a minute for 3 MB without the package of this name."""
    try:
        from blake3 import blake3 as fast

        return fast(data).hexdigest()
    except ImportError:
        pass

    def chunk(start, size, root):
        chaining, pieces = IV, range(start, start + max(size, 1), 64)
        for at in pieces:
            piece = data[at : min(at + 64, start + size)]
            words = list(struct.unpack("<16I", piece.ljust(64, b"\0")))
            flags = (CHUNK_START if at == start else 0) | (CHUNK_END | root if at == pieces[-1] else 0)
            chaining = compress(chaining, words, start // 1024, len(piece), flags)
        return chaining

    def tree(start, size, root):
        if size <= 1024:
            return chunk(start, size, root)
        left = 1 << (size - 1).bit_length() - 1
        words = tree(start, left, 0) + tree(start + left, size - left, 0)
        return compress(IV, words, 0, 64, PARENT | root)

    return struct.pack("<8I", *tree(0, len(data), ROOT)).hex()


def state(width, inputs, parameters, features_blake3, files):
    divisor = HYPERCOLUMN // (inputs - 3) if inputs > 3 else 1
    if inputs > 3 and divisor * (inputs - 3) != HYPERCOLUMN:
        raise Damaged(f"g_conv0 has {inputs} inputs: no hypercolumn of a VGG-19 and 3 colours")
    if (inputs > 3) != (features_blake3 is not None):
        need = "needs" if inputs > 3 else "has no place for"
        raise Damaged(f"the network {need} the features of a file: --features-blake3")
    settings = {
        "features": "file" if inputs > 3 else "none",
        "feature_style": "caffe",
        "vgg_divisor": divisor,
        "width": width,
        "pixel_weight": 52.0,
        "learning_rate": 2e-4,
        "adversarial_weight": 0.0,
    }
    origin = {"vgg_blake3": features_blake3, "scenes_blake3": "", "backtrack": None}
    return {
        "schema": "glasshouse.checkpoint/1",
        "stage": "separation",
        "step": 0,
        "generator_steps": 0,
        "discriminator_steps": 0,
        "parameters": parameters,
        "settings": settings,
        "origin": origin,
        "code_path": "converted from TensorFlow",
        "validation_psnr_db": None,
        "files": {name: blake3(data) for name, data in files.items()},
    }


def convert(prefix, features_blake3, out):
    bundle = Bundle(prefix)
    separation, width, inputs = network(bundle, "", 6)
    has_backtrack = bundle.find(r"R_reconnet(_\d+)?/g_conv0(_\d+)?/weights") is not None
    if has_backtrack:
        backtrack, *found = network(bundle, r"R_reconnet(_\d+)?/", 3)
        if found != [width, inputs]:
            raise Damaged(f"BT-net has {found} channels and inputs, and SP-net {[width, inputs]}")
    else:
        backtrack = identity(width, inputs)
    tensors = {f"separation.{name}": tensor for name, tensor in separation.items()}
    tensors.update({f"backtrack.{name}": tensor for name, tensor in backtrack.items()})
    files = {"model.safetensors": safetensors(tensors), "optimizer.safetensors": safetensors({})}
    parameters = sum(len(tensor.values) for tensor in tensors.values())
    record = state(width, inputs, parameters, features_blake3, files)
    out.mkdir(parents=True)
    for name, data in files.items():
        (out / name).write_bytes(data)
    (out / "state.json").write_text(json.dumps(record, indent=2) + "\n")
    print(f"{out}: {parameters} weights, width {width}, {inputs} inputs")
    if not has_backtrack:
        print("no R_reconnet/: BT-net is the identity, so R* (clean_reflection) repeats R~* (glass_reflection)")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("prefix", help="path of the checkpoint without .index")
    parser.add_argument("--out", type=Path, required=True, help="new folder for the checkpoint")
    parser.add_argument("--features-blake3", help="BLAKE3 of the file of VGG-19 weights for the networks")
    typed = parser.parse_args()
    try:
        convert(typed.prefix, typed.features_blake3, typed.out)
    except (Damaged, OSError, struct.error) as error:
        sys.exit(f"cannot convert {typed.prefix}: {error}")


if __name__ == "__main__":
    main()
