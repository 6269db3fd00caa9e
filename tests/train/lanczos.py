"""Prints the expected digests in src/compose/lanczos.rs.   pip install pillow numpy"""

import numpy as np
from PIL import Image

SIZES = [
    ((101, 67), (50, 33)),
    ((101, 67), (64, 42)),
    ((97, 131), (96, 130)),
    ((64, 48), (64, 17)),
    ((64, 48), (9, 48)),
    ((300, 5), (7, 1)),
    ((41, 29), (83, 60)),
    ((1, 1), (5, 4)),
]


def picture(width, height):
    y, x, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(3), indexing="ij")
    texture = (x * x * 7 + y * y * 3 + x * y * (c + 2) + c * 85) % 256
    return np.where((x // 9 + y // 5) % 3 == c, 255 * (texture // 128), texture).astype(np.uint8)


def digest(codes):
    """FNV-1a, 64 bits."""
    hash = 0xCBF29CE484222325
    for code in codes.reshape(-1).tolist():
        hash = (hash ^ code) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return hash


for old, new in SIZES:
    resized = Image.fromarray(picture(*old)).resize(new, Image.LANCZOS)
    print(f"({list(old)}, {list(new)}, {digest(np.asarray(resized)):#018x}),")
