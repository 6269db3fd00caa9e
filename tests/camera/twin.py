"""The camera in double precision, after docs/camera.md, with numpy and scipy: twin.safetensors.

    pip install numpy scipy safetensors
    python tests/camera/twin.py

The test `a_twin_in_double_precision_agrees` of src/compose/camera/tests.rs draws the same chart, and compares its codes without
noise with `codes` (3, rows, columns), and means and variances of its converter's numbers over many seeds with `mean_dn` and
`variance_dn` (height, width).
"""

from pathlib import Path

import numpy as np
from safetensors.numpy import save_file
from scipy.ndimage import convolve

WIDTH, HEIGHT = 64, 48
PATTERN = "grbg"
GAIN, BITS, BLACK, READ, ROW = 4.0, 14, 512, 5.0, 1.5
BALANCE = np.array([2.1, 1.0, 1.7])
ERROR = np.array([1.03, 1.0, 0.96])
MATRIX = np.array([[1.7, -0.5, -0.2], [-0.15, 1.5, -0.35], [0.02, -0.5, 1.48]])
BLUR_PX, GAMMA, S_CURVE, SCALE, SHARPEN, SHARPEN_PX = 0.5, 0.95, 0.2, 0.75, 0.4, 0.8
PERCENTILE, LEVEL = 99.0, 0.8


def chart():
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    ramp = (x + 1) / WIDTH * (y + 2) / HEIGHT
    edge = np.where(3 * x + y > 2 * WIDTH, 0.6, 0.15)
    lamp = np.where((y < 6) & (x < 6), 3.0, 0.0)
    return np.stack([edge * (0.5 + ramp) * c + lamp for c in (1.0, 0.8, 0.5)])


def blur(planes, sigma):
    radius = int(np.ceil(2.5 * sigma))
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    weights /= weights.sum()
    rows = convolve(planes, weights[None, None, :], mode="nearest")
    return convolve(rows, weights[None, :, None], mode="nearest")


def channels():
    index = ["rgb".index(letter) for letter in PATTERN]
    tile = np.array(index).reshape(2, 2)
    return np.tile(tile, (HEIGHT // 2, WIDTH // 2))


def demosaic(raw):
    """The filters of Malvar, He and Cutler, figure 2."""
    green = np.array([[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]) / 8
    beside = np.array([[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]]) / 8
    other = np.array([[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]]) / 8
    here = channels()
    made = np.stack([raw] * 3)
    in_row = [(here == channel).any(axis=1, keepdims=True) for channel in range(3)]
    for channel in (0, 2):
        made[channel] = np.where(here == 1, np.where(in_row[channel], convolve(raw, beside, mode="mirror"), convolve(raw, beside.T, mode="mirror")), made[channel])
        made[channel] = np.where(here == 2 - channel, convolve(raw, other, mode="mirror"), made[channel])
    made[1] = np.where(here == 1, raw, convolve(raw, green, mode="mirror"))
    return made


def curve(light):
    light = np.clip(light, 0, 1)
    srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    c = srgb**GAMMA
    return c + S_CURVE * (3 * c**2 - 2 * c**3 - c)


def reduce(plane, count):
    """A triangle filter as wide as the factor, along rows."""
    size = plane.shape[1]
    factor = size / count
    centres = (np.arange(count) + 0.5) * factor
    weights = np.clip(1 - np.abs((np.arange(size) + 0.5)[None, :] - centres[:, None]) / factor, 0, None)
    return plane @ (weights / weights.sum(axis=1, keepdims=True)).T


light = chart()
brightest = np.sort(light.max(axis=0).ravel())
# The nearest rank, halves away from zero.
factor = LEVEL / brightest[int(np.floor(PERCENTILE / 100 * (brightest.size - 1) + 0.5))]
camera = np.tensordot(np.linalg.inv(MATRIX), blur(light * factor, BLUR_PX), axes=1) / BALANCE[:, None, None]
raw = np.clip(np.take_along_axis(camera, channels()[None], axis=0)[0], 0, None)

balanced = np.minimum(demosaic(raw) * BALANCE[:, None, None], 1)
codes = curve(np.tensordot(MATRIX, balanced, axes=1) * ERROR[:, None, None])
rows, columns = round(HEIGHT * SCALE), round(WIDTH * SCALE)
small = np.stack([reduce(reduce(plane, columns).T, rows).T for plane in codes])
sharp = np.clip(small + SHARPEN * (small - blur(small, SHARPEN_PX)), 0, 1)

white_e = (2**BITS - 1 - BLACK) / GAIN
electrons = raw * white_e
tensors = {
    "codes": sharp,
    # Only where nothing is clipped: the test looks at numbers well below white.
    "mean_dn": BLACK + GAIN * electrons,
    "variance_dn": GAIN**2 * electrons + READ**2 + ROW**2 + 1 / 12,
}
tensors = {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in tensors.items()}
save_file(tensors, Path(__file__).with_suffix(".safetensors"))
