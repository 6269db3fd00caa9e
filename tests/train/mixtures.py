"""Makes tests/train/mixtures.safetensors, for src/examples/mixture/tests.rs.   pip install numpy scipy opencv-python-headless safetensors

Pictures are f32 planes of R, G and B. Each case NAME has its parameters NAME.draw (for Zhang: sigma_px, attenuation, mask_row,
mask_column, transmitted; for CEILNet: sigma_px), NAME.input and NAME.reflection."""

import cv2
import numpy as np
from safetensors.numpy import save_file
from scipy.signal import convolve2d
from scipy.stats import norm

ROWS, COLUMNS = 16, 19
c, y, x = np.meshgrid(np.arange(3), np.arange(ROWS), np.arange(COLUMNS), indexing="ij")
bright = ((x * x * 3 + y * 7 + x * y * (c + 2) + c * 41) % 251 / 255).astype(np.float32)
dim = (bright * 0.3 + 0.02).astype(np.float32)
back = np.where(abs(x - 8) + abs(y - 6) < 5 + c, 0.98, (x * 5 + y * y + 30 * c) % 200 / 255).astype(np.float32)
out = {"bright": bright, "dim": dim, "back": back}


def clip(values):
    return np.clip(values, 0, 1)


# The vignette: square roots of a Gaussian's shares in 560 x 560 cells up to 3 sigma, scaled to a maximum of 1.
half_cell = 7 / 560 / 2
shares = np.diff(norm.cdf(np.linspace(-3 - half_cell, 3 + half_cell, 561)))
vignette = np.sqrt(np.outer(shares, shares))
vignette /= vignette.max()


def zhang(name, front, sigma, attenuation, row, column, transmitted):
    t, r = front.astype(float) ** 2.2, back.astype(float) ** 2.2
    side = 2 * int(np.ceil(2 * sigma)) + 1
    r = np.stack([cv2.GaussianBlur(plane, (side, side), sigma) for plane in r])
    for channel in range(3):
        total = r[channel] + t[channel]
        over = total > 1
        mean = max(1.0, total[over].sum() / (over.sum() + 1e-6))
        r[channel] -= (mean - 1) * attenuation
    r = clip(r) * vignette[row : row + ROWS, column : column + COLUMNS]
    out[f"{name}.draw"] = np.array([sigma, attenuation, row, column, transmitted])
    out[f"{name}.input"] = clip((r + t * transmitted) ** (1 / 2.2))
    out[f"{name}.reflection"] = r ** (1 / 2.2)


def ceilnet(name, front, sigma):
    t, r = front.astype(float), back.astype(float)
    line = cv2.getGaussianKernel(11, sigma)
    r = np.stack([convolve2d(plane, line @ line.T, mode="same") for plane in r])
    total = r + t
    if total.max() > 1:
        r = clip(r - (total[total > 1].mean() - 1) * 1.3)
        total = clip(r + t)
    out[f"{name}.draw"] = np.array([sigma])
    out[f"{name}.input"] = total
    out[f"{name}.reflection"] = total - t


for name, front in (("bright", bright), ("dim", dim)):
    zhang(f"zhang {name} narrow", front, 1.5, 1.125, 250, 300, 0.875)
    zhang(f"zhang {name} wide", front, 4.25, 1.0859375, 190, 201, 0.96875)
    ceilnet(f"ceilnet {name}", front, 3.5)
    print(name, "share above 1:", [float((out[f"{k} {name}{s}.input"] >= 1).mean()) for k, s in (("zhang", " narrow"), ("ceilnet", ""))])

save_file({k: np.ascontiguousarray(v, dtype=np.float32) for k, v in out.items()}, "tests/train/mixtures.safetensors")
