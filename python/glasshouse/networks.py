"""The networks of training in PyTorch, with the parameters' names and shapes of a checkpoint's `model.safetensors`.

Images are float32 tensors (batch, 3, rows, columns) of sRGB codes from 0 to 1. Under `torch.autocast`, convolutions run
in its type, except the last ones of generators. Parameters begin with zeros: a checkpoint or the package's
`initial_weights` fills them.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, cast

import torch
import torch.distributed as dist
import torch.nn.functional as F
from torch import Tensor, nn

DILATIONS = (1, 2, 4, 8, 16, 32, 64, 1)
VGG_PLACES = (0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25, 28, 30)
VGG_POOLS, VGG_TAPS = (2, 4, 8, 12), (1, 3, 5, 9, 13)
FEATURE_DIVISORS = (2.6, 4.8, 3.7, 5.6, 0.15)
UNET_WIDTHS = (1, 2, 3, 4, 4)
# torchvision's mean and deviation of R, G, B; what the programs of Zhang et al. and Kim et al. subtract from B, G, R.
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
CAFFE_MEAN = (123.68, 116.779, 103.939)


def process_count() -> int:
    """Returns the number of processes that train together."""
    return dist.get_world_size() if dist.is_available() and dist.is_initialized() else 1


class _MeanOfProcesses(torch.autograd.Function):
    """The mean of a tensor over all processes. Gradients of all processes' results flow to each process's tensor."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        return mean_of_processes(x)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        return mean_of_processes(gradients[0])


def mean_of_processes(x: Tensor) -> Tensor:
    """Returns the mean of a tensor over all processes, without a gradient."""
    total = x.detach().clone(memory_format=torch.contiguous_format)
    if process_count() > 1:
        dist.all_reduce(total)
    return total / process_count()


def normed(x: Tensor, by_itself: Tensor | float, by_norm: Tensor, offset: Tensor, epsilon: float) -> Tensor:
    """Returns `by_itself x + by_norm norm(x) + offset` in float32, (batch, channels, rows, columns) like `x`.

    `norm` normalises channels by mean and variance over the batch of all processes. Coefficients are (1) or (channels).
    """
    x = x.float()
    variance, mean = torch.var_mean(x, (0, 2, 3), correction=0)
    if process_count() > 1:
        of_all: Tensor = _MeanOfProcesses.apply(mean)
        variance = _MeanOfProcesses.apply(variance + (mean - of_all).square())
        mean = of_all
    scale = by_norm * torch.rsqrt(variance + epsilon)
    return torch.addcmul((offset - mean * scale).view(-1, 1, 1), x, (by_itself + scale).view(-1, 1, 1))


def parameters(*shapes: Sequence[int]) -> nn.ParameterList:
    """Returns parameters of zeros, which a state dictionary names by their index."""
    return nn.ParameterList([nn.Parameter(torch.zeros(*shape)) for shape in shapes])


def resized(x: Tensor, size: Sequence[int], style: str) -> Tensor:
    """Resizes (batch, channels, rows, columns) to `size` (rows, columns) bilinearly.

    The style `torch` has pixel centres at halves; with `caffe`, position k is k times the ratio of the sizes, as in
    TensorFlow 1.
    """
    if tuple(x.shape[2:]) == tuple(size):
        return x
    if style == "torch":
        return F.interpolate(x, size=tuple(size), mode="bilinear", align_corners=False)
    for axis, count in ((2, size[0]), (3, size[1])):
        at = torch.arange(count, dtype=torch.float64, device=x.device) * (x.shape[axis] / count)
        first = at.long().clamp(max=x.shape[axis] - 1)
        second = (first + 1).clamp(max=x.shape[axis] - 1)
        weight = (at - first).to(x.dtype).view((-1, 1) if axis == 2 else (-1,))
        x = x.index_select(axis, first) * (1 - weight) + x.index_select(axis, second) * weight
    return x


class Vgg(nn.Module):
    """The frozen VGG-19 up to conv5_2 (Simonyan and Zisserman, ICLR 2015)."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, weights: Mapping[str, Tensor], style: str) -> None:
        """Copies torchvision's `features.N.weight` and `features.N.bias`; raises KeyError if one is missing."""
        super().__init__()
        names = [f"features.{place}" for place in VGG_PLACES]
        self.kernel = parameters(*(weights[f"{name}.weight"].shape for name in names))
        self.bias = parameters(*(weights[f"{name}.bias"].shape for name in names))
        for name, kernel, bias in zip(names, self.kernel, self.bias, strict=True):
            kernel.data.copy_(weights[f"{name}.weight"])
            bias.data.copy_(weights[f"{name}.bias"])
        self.requires_grad_(False)
        self.style = style
        mean, deviation = (MEAN, DEVIATION) if style == "torch" else (CAFFE_MEAN, (1.0, 1.0, 1.0))
        self.register_buffer("mean", torch.tensor(mean).view(1, 3, 1, 1))
        self.register_buffer("deviation", torch.tensor(deviation).view(1, 3, 1, 1))

    def widths(self) -> list[int]:
        """Returns the number of channels of each feature, finest first."""
        return [self.bias[tap].numel() for tap in VGG_TAPS]

    def forward(self, images: Tensor) -> list[Tensor]:
        """Returns relu(conv1_2) to relu(conv5_2), finest first. With caffe's style, they are divided by 255."""
        x = images if self.style == "torch" else images.flip(1) * 255
        x = (x - self.mean) / self.deviation
        taps = []
        for index, (kernel, bias) in enumerate(zip(self.kernel, self.bias, strict=True)):
            if index in VGG_POOLS:
                x = F.max_pool2d(x, 2) if self.style == "torch" else F.avg_pool2d(x, 2)
            x = F.relu(F.conv2d(x, kernel, bias, padding=1))
            if index in VGG_TAPS:
                taps.append(x if self.style == "torch" else x / 255)
        return taps


class Generator(nn.Module):
    """The generator of Zhang, Ng and Chen (CVPR 2018): SP-net or BT-net."""

    def __init__(self, width: int, outputs: int, features: Sequence[int], start: str, style: str) -> None:
        """Takes the numbers of hidden and output channels, and those of the input features, finest first."""
        super().__init__()
        layers = len(DILATIONS) + 1
        self.kernel = parameters((width, sum(features) + 3, 1, 1), *[(width, width, 3, 3)] * len(DILATIONS))
        self.by_itself, self.by_norm = parameters(*[(1,)] * layers), parameters(*[(1,)] * layers)
        self.offset = parameters(*[(width,)] * layers)
        self.last = nn.Parameter(torch.zeros(outputs, width, 1, 1))
        self.last_bias = nn.Parameter(torch.zeros(outputs))
        self.is_residual, self.style = start == "residual", style

    def forward(self, images: Tensor, features: Sequence[Tensor]) -> Tensor:
        """Returns (batch, outputs, rows, columns), not clamped, of images and their features, finest first."""
        # The 1 x 1 convolution commutes with resizing, so it runs at the size of each feature.
        parts = [*reversed(features), images]
        kernels = self.kernel[0].split([part.shape[1] for part in parts], 1)
        sizes = images.shape[2:]
        made = [resized(F.conv2d(part, kernel), sizes, self.style) for part, kernel in zip(parts, kernels, strict=True)]
        x = self._activated(0, sum(made[1:], made[0]))
        for layer, dilation in enumerate(DILATIONS, 1):
            x = self._activated(layer, F.conv2d(x, self.kernel[layer], padding=dilation, dilation=dilation))
        with torch.autocast(x.device.type, enabled=False):
            y = F.conv2d(x.float(), self.last, self.last_bias)
        return y + F.pad(images, (0, 0, 0, 0, 0, y.shape[1] - 3)) if self.is_residual else y

    def _activated(self, layer: int, x: Tensor) -> Tensor:
        by_norm = self.by_norm[layer]
        return F.leaky_relu(normed(x, self.by_itself[layer], by_norm, by_norm * self.offset[layer], 1e-3), 0.2)


class Discriminator(nn.Module):
    """The conditional PatchGAN discriminator of Isola et al. (CVPR 2017)."""

    def __init__(self, width: int) -> None:
        """Takes the number of channels after the first convolution."""
        super().__init__()
        widths = [6, width, 2 * width, 4 * width, 8 * width, 1]
        self.kernel = parameters(*((after, before, 4, 4) for before, after in pairwise(widths)))
        self.gain = parameters(*((count,) for count in widths[2:5]))
        self.offset = parameters(*((count,) for count in widths[2:5]))

    def forward(self, image: Tensor, layer_of_it: Tensor) -> Tensor:
        """Returns logits (batch, 1, ...), above 0 if real, of an image and one of its layers, both (batch, 3, ...)."""
        x = torch.cat([image, layer_of_it], 1)
        for layer, stride in enumerate((2, 2, 2, 1, 1)):
            x = F.conv2d(x, self.kernel[layer], stride=stride, padding=1)
            if 1 <= layer <= 3:
                x = normed(x, 0.0, self.gain[layer - 1], self.offset[layer - 1], 1e-5)
            if layer < 4:
                x = F.leaky_relu(x, 0.2)
        return x


class Unet(nn.Module):
    """The residual U-Net for T* alone, at half of the image's size. It has no norms."""

    def __init__(self, width: int) -> None:
        """Takes the number of channels at the largest size."""
        super().__init__()
        widths = [factor * width for factor in UNET_WIDTHS]
        pairs = list(pairwise(widths))
        joined = [(small + large, large) for large, small in reversed(pairs)]
        steps = [(12, widths[0]), *pairs, *joined]
        shapes = [shape for i, o in steps for shape in ((o, i, 3, 3), (o, o, 3, 3))]
        self.kernel, self.bias = parameters(*shapes), parameters(*(shape[:1] for shape in shapes))
        self.last = nn.Parameter(torch.zeros(12, width, 3, 3))
        self.last_bias = nn.Parameter(torch.zeros(12))

    def forward(self, images: Tensor, features: Sequence[Tensor] = ()) -> Tensor:
        """Returns T* (batch, 3, rows, columns), not clamped, of images of any size; features are ignored."""
        rows, columns = images.shape[2:]
        padded = F.pad(images, (0, -columns % 32, 0, -rows % 32), "replicate")
        x, skips = self._two(0, F.pixel_unshuffle(padded - 0.5, 2)), []
        for size in range(1, 5):
            skips.append(x)
            x = self._two(size, F.avg_pool2d(x, 2))
        for size in range(5, 9):
            x = self._two(size, torch.cat([F.interpolate(x, scale_factor=2, mode="nearest"), skips.pop()], 1))
        residual = F.pixel_shuffle(F.conv2d(x, self.last, self.last_bias, padding=1), 2)
        return images + residual[..., :rows, :columns]

    def _two(self, size: int, x: Tensor) -> Tensor:
        for layer in (2 * size, 2 * size + 1):
            x = F.leaky_relu(F.conv2d(x, self.kernel[layer], self.bias[layer], padding=1), 0.1)
        return x


class _Bounded(torch.autograd.Function):
    """The lesser of x and a bound. Above the bound, only gradients that lower x pass."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, bound: Tensor) -> Tensor:
        ctx.save_for_backward(x > bound)
        return torch.where(x > bound, bound, x)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        (is_above,) = ctx.saved_tensors
        return torch.where(is_above, gradients[0].clamp(min=0), gradients[0]), None


def bounded(x: Tensor, images: Tensor, factor: float) -> Tensor:
    """Returns the lesser of x and the codes of `factor` times the images' light, at most 1; both (batch, 3, ...)."""
    if factor == 1:
        return cast(Tensor, _Bounded.apply(x, images.clamp(max=1)))
    light = torch.where(images <= 0.04045, images / 12.92, ((images.clamp(min=0) + 0.055) / 1.055) ** 2.4) * factor
    codes = torch.where(light <= 0.0031308, 12.92 * light, 1.055 * light.clamp(min=0) ** (1 / 2.4) - 0.055)
    return cast(Tensor, _Bounded.apply(x, codes.clamp(max=1)))
