"""Prints the expected SSIM in src/compose/ssim.rs.   pip install scikit-image numpy"""

import numpy as np
from skimage.metrics import structural_similarity

WIDTH, HEIGHT = 23, 17


def at(k):
    return (k * k * 31 + k * 7) % 251


a = np.array([at(k) for k in range(WIDTH * HEIGHT)], dtype=np.uint8).reshape(HEIGHT, WIDTH)
b = np.array([(at(k) * 3 + at(k + 5)) // 4 for k in range(WIDTH * HEIGHT)], dtype=np.uint8).reshape(HEIGHT, WIDTH)
print(repr(structural_similarity(a, b)))
