"""Prints the expected scores in src/compose/score.rs.   pip install scikit-image numpy opencv-python-headless"""

import cv2
import numpy as np
from skimage.metrics import peak_signal_noise_ratio as psnr
from skimage.metrics import structural_similarity as ssim

WIDTH, HEIGHT = 45, 31


def at(x, y, c):
    return (x * x * 3 + y * 7 + x * y * (c + 2) + c * 41) % 251


y, x, c = np.meshgrid(np.arange(HEIGHT), np.arange(WIDTH), np.arange(3), indexing="ij")
truth = at(x, y, c).astype(np.uint8)
output = ((at(x, y, c) * 5 + at(x + 2, y + c, c)) // 6).astype(np.uint8)


def grey(image):
    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)


def channels(metric):
    return np.mean([metric(truth[..., c], output[..., c]) for c in range(3)])


print("psnr_colour_db:", repr(psnr(truth, output)))
light = np.arange(256) / 255
light = np.where(light <= 0.04045, light / 12.92, ((light + 0.055) / 1.055) ** 2.4)


def factored(factor):
    """Multiplies linear light and rounds codes."""
    value = np.clip(light * factor, 0, 1)
    code = np.where(value <= 0.0031308, 12.92 * value, 1.055 * np.maximum(value, 1e-9) ** (1 / 2.4) - 0.055)
    return np.rint(255 * code).astype(np.uint8)[output]


print("psnr_own_factor_db:", repr(max(psnr(truth, factored(k / 100)) for k in range(30, 201))))
print("ssim_grey:", repr(ssim(grey(truth), grey(output))))
print("psnr_channels_db:", repr(channels(psnr)))
print("ssim_channels:", repr(channels(ssim)))
