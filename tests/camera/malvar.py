"""Demosaiced charts of colour-demosaicing 0.2.7 (Malvar, He and Cutler 2004): malvar.safetensors.

    pip install colour-demosaicing pillow safetensors
    glasshouse sample rooms --count 2 --width 256 --height 192
    python tests/camera/malvar.py rooms/DIODE_FOLDER/PHOTOGRAPH.png

`NAME.raw` is a mosaic (height, width), and `NAME.planes` its colours (3, height, width), 32-bit floats. The tests of
src/compose/camera/demosaic.rs draw the charts again, and compare everything inside a border of 4 px.
"""

import sys
from pathlib import Path

import numpy as np
from colour_demosaicing import demosaicing_CFA_Bayer_Malvar2004
from PIL import Image
from safetensors.numpy import save_file


def zone_plate(width, height):
    """Rings around the upper left corner, which reach the highest frequency at the far corner."""
    y, x = np.mgrid[0:height, 0:width].astype(float)
    phase = np.pi * (x * x + y * y) / (2 * (width + height))
    return np.stack([0.5 + 0.4 * np.cos(phase + 0.5 * c) for c in range(3)])


def slanted_edge(width, height):
    """An edge of five degrees between two colours."""
    y, x = np.mgrid[0:height, 0:width].astype(float)
    beyond = np.clip(x - 0.5 * width - 0.0875 * y + 2.0, 0.0, 1.0)
    return np.stack([a + (b - a) * beyond for a, b in ((0.8, 0.1), (0.7, 0.2), (0.2, 0.9))])


def photograph(path):
    """A part of a procedural photograph, as codes."""
    return np.asarray(Image.open(path).convert("RGB"), float)[60:100, 100:156].transpose(2, 0, 1) / 255.0


def mosaic(planes, pattern):
    raw = np.empty(planes.shape[1:])
    for k, colour in enumerate(pattern):
        raw[k // 2 :: 2, k % 2 :: 2] = planes["RGB".index(colour), k // 2 :: 2, k % 2 :: 2]
    return raw


charts = {
    "zone_plate": (zone_plate(48, 40), "RGGB"),
    "slanted_edge": (slanted_edge(40, 48), "GBRG"),
    "photograph": (photograph(sys.argv[1]), "GRBG"),
    "photograph_bggr": (photograph(sys.argv[1]), "BGGR"),
}
tensors = {}
for name, (planes, pattern) in charts.items():
    raw = mosaic(planes, pattern).astype(np.float32)
    colours = demosaicing_CFA_Bayer_Malvar2004(raw.astype(float), pattern)
    tensors[f"{name}.raw"] = raw
    tensors[f"{name}.planes"] = np.ascontiguousarray(colours.transpose(2, 0, 1), dtype=np.float32)
save_file(tensors, Path(__file__).with_suffix(".safetensors"))
