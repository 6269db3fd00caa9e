"""Reads scan line OpenEXR files of 32-bit floats, uncompressed or ZIP, as written by glasshouse and Blender."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

LINES_IN_BLOCK = {0: 1, 2: 1, 3: 16}  # none, ZIPS, ZIP


def read(path: Path) -> dict[str, np.ndarray]:
    """Returns the channels by name, each (H,W) float32."""
    data = path.read_bytes()
    magic, version = struct.unpack_from("<II", data)
    if magic != 20000630 or version & 0x1A00:
        raise ValueError(f"{path} is not an EXR with a single part of scan lines")
    attributes, offset = header(data)
    channels = channel_names(attributes["channels"], path)
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    compression = attributes["compression"][0]
    if compression not in LINES_IN_BLOCK:
        raise ValueError(f"{path}: compression {compression} is not supported, only none, ZIPS and ZIP")
    width, height, lines = x1 - x0 + 1, y1 - y0 + 1, LINES_IN_BLOCK[compression]
    pixels = np.empty((height, len(channels), width), np.float32)
    for (start,) in struct.iter_unpack("<Q", data[offset : offset + 8 * -(-height // lines)]):
        y, size = struct.unpack_from("<ii", data, start)
        rows = min(lines, y1 + 1 - y)
        raw = data[start + 8 : start + 8 + size]
        if compression and size < rows * len(channels) * width * 4:
            raw = unzip(raw)
        pixels[y - y0 : y - y0 + rows] = np.frombuffer(raw, "<f4").reshape(rows, len(channels), width)
    return {name: pixels[:, k] for k, name in enumerate(channels)}


def rgb(channels: dict[str, np.ndarray], prefix: str = "") -> np.ndarray:
    """Stacks the channels PREFIXR, PREFIXG, PREFIXB to (H,W,3)."""
    return np.stack([channels[prefix + c] for c in "RGB"], -1)


def header(data: bytes) -> tuple[dict[str, bytes], int]:
    """Returns the attributes, and the position of the offset table."""
    attributes, at = {}, 8
    while data[at]:
        name, _kind = (data[at:].split(b"\0", 2))[:2]
        at += len(name) + len(_kind) + 2
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name.decode()] = data[at + 4 : at + 4 + size]
        at += 4 + size
    return attributes, at + 1


def channel_names(text: bytes, path: Path) -> list[str]:
    """Returns the names in file order; all channels must be full-resolution floats."""
    names, at = [], 0
    while text[at]:
        name = text[at:].split(b"\0", 1)[0]
        at += len(name) + 1
        kind, _linear, x_step, y_step = struct.unpack_from("<iIii", text, at)
        if (kind, x_step, y_step) != (2, 1, 1):
            raise ValueError(f"{path}: channel {name.decode()} is not a 32-bit float for every pixel")
        names.append(name.decode())
        at += 16
    return names


def unzip(block: bytes) -> bytes:
    """Inflates a block, undoes the differences between bytes and interleaves the two halves."""
    delta = np.frombuffer(zlib.decompress(block), np.uint8).astype(np.int64)
    delta[1:] -= 128
    plain = np.cumsum(delta).astype(np.uint8)
    half = (len(plain) + 1) // 2
    out = np.empty_like(plain)
    out[0::2], out[1::2] = plain[:half], plain[half:]
    return out.tobytes()
