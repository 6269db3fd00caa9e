"""Makes caffe.safetensors, features and a network in the style of Zhang et al.'s program, in PyTorch in double precision,
for src/train/caffe_tests.rs.

    pip install torch numpy safetensors; python3 tests/train/caffe.py

The weights and images are those of step.py. As in ceciliavision/perceptual-reflection-removal main.py: codes from 0 to 255
in the order B, G, R less RGB's means, average pools, features divided by 255 in the hypercolumn only, and TensorFlow 1's
bilinear resizing, whose position k is k times the ratio of the sizes.
"""

import pathlib

import torch
import torch.nn.functional as F
from safetensors.torch import save_file

import step


def features(w, x):
    """Computes the features of images from 0 to 1, of codes from 0 to 255."""
    x = 255 * x.flip(1) - torch.tensor([123.68, 116.779, 103.939], dtype=x.dtype).view(1, 3, 1, 1)
    taps = []
    for index, place in enumerate(step.PLACES):
        if index in step.POOLS:
            x = F.avg_pool2d(x, 2)
        x = F.relu(F.conv2d(x, w[f"features.{place}.weight"], w[f"features.{place}.bias"], padding=1))
        if index in step.TAPS:
            taps.append(x)
    return taps


def along(x, axis, size):
    """Resizes one axis as TensorFlow 1 does."""
    count = x.shape[axis]
    at = torch.arange(size, dtype=x.dtype) * (count / size)
    first = at.long().clamp(max=count - 1)
    second = (first + 1).clamp(max=count - 1)
    shape = [1, 1, 1, 1]
    shape[axis] = size
    weight = (at - first).view(shape)
    return x.index_select(axis, first) * (1 - weight) + x.index_select(axis, second) * weight


def generator(w, net, x):
    taps = [along(along(f / 255, 2, x.shape[2]), 3, x.shape[3]) for f in features(w, x)]
    h = torch.cat(taps[::-1] + [x], 1)
    for layer in range(9):
        rate = 0 if layer == 0 else step.DILATIONS[layer - 1]
        h = F.conv2d(h, w[f"{net}.kernel.{layer}"], padding=rate, dilation=max(rate, 1))
        normed = F.batch_norm(h, None, None, None, w[f"{net}.offset.{layer}"], training=True, eps=1e-3)
        h = F.leaky_relu(w[f"{net}.by_itself.{layer}"] * h + w[f"{net}.by_norm.{layer}"] * normed, 0.2)
    return F.conv2d(h, w[f"{net}.last"], w[f"{net}.last_bias"])


w = {name: t.double() for name, t in step.draw(2).items()}
image, truth = w["image.input"].clone().requires_grad_(), w["image.transmission"]
pairs = zip(features(w, image), features(w, truth), step.DIVISORS)
loss = sum((a - b).abs().mean() / divisor for a, b, divisor in pairs)
(gradient,) = torch.autograd.grad(loss, image)
made = generator(w, "separation", w["image.input"])
out = {"conv5_2": features(w, image)[-1].detach() / 255, "loss": loss.detach(), "gradient": gradient, "made": made}
out = {name: value.float().contiguous() for name, value in out.items()}
save_file(out, pathlib.Path(__file__).with_name("caffe.safetensors"))
print({name: list(value.shape) for name, value in out.items()}, float(loss))
