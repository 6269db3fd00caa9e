"""Prints the expected numbers in src/compose/veil.rs.   pip install numpy"""

import numpy as np

SIZES = [(45, 31), (90, 60), (7, 3), (1, 1), (201, 1), (640, 421)]
G, K = 0.88, 0.8


def light(x):
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def code(x):
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)


def picture(width, height):
    y, x, c = np.meshgrid(np.arange(height), np.arange(width), np.arange(3), indexing="ij")
    return (9 + 17 * c + (x * x * 3 + y * 7 + x * y * (c + 2) + c * 41) % (200 + c)).astype(np.uint8)


for size in SIZES:
    codes = picture(*size)
    veil = np.percentile(codes, 0.5, axis=(0, 1)).astype(int)
    left = np.maximum(G * (light(codes / 255.0) - K * light(veil / 255.0)), 0)
    made = np.rint(255 * np.clip(code(left), 0, 1)).astype(np.uint64)
    print(f"({list(size)}, {veil.tolist()}, [{made.sum()}, {(made * made).sum()}]),")
