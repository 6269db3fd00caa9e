"""Makes step.safetensors, a step of the separation stage in PyTorch in double precision, for src/train/step_tests.rs.

    pip install torch numpy safetensors; python3 tests/train/step.py

Networks are narrow: VGG-19 with widths / 32, generators of width 6, a discriminator of width 4. Image sizes are odd.
With this seed, no unit is at a kink of ReLU, max or |x|, so that single and double precision agree in PyTorch.
"""

import pathlib
import sys

import torch
import torch.nn.functional as F
from safetensors.torch import save_file

DIVISOR, WIDTH, DISCRIMINATOR, ROWS, COLUMNS = 32, 6, 4, 37, 45
SEED = int(sys.argv[1]) if len(sys.argv) > 1 else 2
PLACES = [0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25, 28, 30]
WIDTHS = [64, 64, 128, 128, 256, 256, 256, 256, 512, 512, 512, 512, 512, 512]
TAPS, POOLS = [1, 3, 5, 9, 13], [2, 4, 8, 12]
DILATIONS = [1, 2, 4, 8, 16, 32, 64, 1]
DIVISORS = [2.6, 4.8, 3.7, 5.6, 0.15]
FEATURE, ADVERSARIAL, RATE = 0.2, 0.01, 1e-4


def draw(seed):
    """Draws the weights and images of the step, as float32 values."""
    make = torch.Generator().manual_seed(seed)
    normal = lambda *shape, scale=1.0: torch.randn(*shape, generator=make) * scale
    tensors, channels = {}, 3
    for place, width in zip(PLACES, WIDTHS):
        width //= DIVISOR
        tensors[f"features.{place}.weight"] = normal(width, channels, 3, 3, scale=(2 / (9 * channels)) ** 0.5)
        tensors[f"features.{place}.bias"] = normal(width, scale=0.1)
        channels = width
    inputs = sum(WIDTHS[tap] // DIVISOR for tap in TAPS) + 3
    for net, outputs in (("separation", 6), ("backtrack", 3)):
        for layer in range(9):
            shape = (WIDTH, inputs, 1, 1) if layer == 0 else (WIDTH, WIDTH, 3, 3)
            fan = shape[1] * shape[2] * shape[3]
            tensors[f"{net}.kernel.{layer}"] = normal(*shape, scale=(2 / fan) ** 0.5)
            tensors[f"{net}.by_itself.{layer}"] = 1 + normal(1, scale=0.1)
            tensors[f"{net}.by_norm.{layer}"] = normal(1, scale=0.3)
            tensors[f"{net}.offset.{layer}"] = normal(WIDTH, scale=0.1)
        tensors[f"{net}.last"] = normal(outputs, WIDTH, 1, 1, scale=(2 / WIDTH) ** 0.5)
        tensors[f"{net}.last_bias"] = normal(outputs, scale=0.1)
    channels = 6
    for layer, width in enumerate([1, 2, 4, 8, None]):
        width = 1 if width is None else width * DISCRIMINATOR
        tensors[f"discriminator.kernel.{layer}"] = normal(width, channels, 4, 4, scale=(2 / (16 * channels)) ** 0.5)
        if 1 <= layer <= 3:
            tensors[f"discriminator.gain.{layer - 1}"] = 1 + normal(width, scale=0.1)
            tensors[f"discriminator.offset.{layer - 1}"] = normal(width, scale=0.1)
        channels = width
    for name in ("input", "transmission", "glass_reflection", "clean_reflection"):
        tensors[f"image.{name}"] = torch.rand(1, 3, ROWS, COLUMNS, generator=make)
    return tensors


def vgg(w, x):
    mean, deviation = (torch.tensor(v, dtype=x.dtype).view(1, 3, 1, 1) for v in ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]))
    x, taps = (x - mean) / deviation, []
    for index, place in enumerate(PLACES):
        if index in POOLS:
            x = F.max_pool2d(x, 2)
        x = F.relu(F.conv2d(x, w[f"features.{place}.weight"], w[f"features.{place}.bias"], padding=1))
        if index in TAPS:
            taps.append(x)
    return taps


def generator(w, net, x, slope):
    features = [F.interpolate(f, size=x.shape[2:], mode="bilinear", align_corners=False) for f in vgg(w, x)]
    h = torch.cat(features[::-1] + [x], 1)
    for layer in range(9):
        rate = 0 if layer == 0 else DILATIONS[layer - 1]
        h = F.conv2d(h, w[f"{net}.kernel.{layer}"], padding=rate, dilation=max(rate, 1))
        normed = F.batch_norm(h, None, None, None, w[f"{net}.offset.{layer}"], training=True, eps=1e-3)
        h = F.leaky_relu(w[f"{net}.by_itself.{layer}"] * h + w[f"{net}.by_norm.{layer}"] * normed, slope)
    return F.conv2d(h, w[f"{net}.last"], w[f"{net}.last_bias"])


def discriminator(w, x, slope):
    for layer, stride in enumerate([2, 2, 2, 1, 1]):
        x = F.conv2d(x, w[f"discriminator.kernel.{layer}"], stride=stride, padding=1)
        if 1 <= layer <= 3:
            gain, offset = w[f"discriminator.gain.{layer - 1}"], w[f"discriminator.offset.{layer - 1}"]
            x = F.batch_norm(x, None, None, gain, offset, training=True, eps=1e-5)
        if layer < 4:
            x = F.leaky_relu(x, slope)
    return x


def l1(a, b):
    return (a - b).abs().mean()


def feature(w, a, b):
    return sum(l1(p, q) / k for p, q, k in zip(vgg(w, a), vgg(w, b), DIVISORS))


def images(w):
    return (w[f"image.{name}"] for name in ("input", "transmission", "glass_reflection", "clean_reflection"))


def generator_loss(w, slope, made=None):
    i, t, rt, r = images(w)
    o = generator(w, "separation", i, slope) if made is None else made
    to, ro = o[:, :3], o[:, 3:]
    b = generator(w, "backtrack", ro, slope)
    verdict = discriminator(w, torch.cat([i, to], 1), slope)
    terms = [l1(to, t), FEATURE * feature(w, to, t), l1(ro, rt), FEATURE * feature(w, ro, rt), l1(b, r)]
    return sum(terms) + FEATURE * feature(w, b, r) + ADVERSARIAL * F.softplus(-verdict).mean()


LEARNED = ("separation.", "backtrack.")


def prepared(tensors, dtype):
    w = {name: t.clone().to(dtype) for name, t in tensors.items()}
    for name in w:
        w[name].requires_grad_(name.startswith(LEARNED) or name.startswith("discriminator."))
    return w


def gradients(tensors, dtype, slope):
    w = prepared(tensors, dtype)
    loss = generator_loss(w, slope)
    names = [name for name in w if name.startswith(LEARNED)]
    return loss.detach(), dict(zip(names, torch.autograd.grad(loss, [w[name] for name in names])))


def five_steps(tensors, dtype):
    w = prepared(tensors, dtype)
    of_generators = torch.optim.Adam([t for n, t in w.items() if n.startswith(LEARNED)], RATE)
    of_discriminator = torch.optim.Adam([t for n, t in w.items() if n.startswith("discriminator.")], RATE)
    losses, told = [], []
    for step in range(5):
        i, t, _, _ = images(w)
        made = generator(w, "separation", i, 0.2)
        if step % 2 == 0:
            real = discriminator(w, torch.cat([i, t], 1), 0.2)
            fake = discriminator(w, torch.cat([i, made[:, :3].detach()], 1), 0.2)
            loss = 0.5 * (F.softplus(-real).mean() + F.softplus(fake).mean())
            of_discriminator.zero_grad()
            loss.backward()
            of_discriminator.step()
            told.append(loss.detach())
        loss = generator_loss(w, 0.2, made)
        of_generators.zero_grad()
        loss.backward()
        of_generators.step()
        losses.append(loss.detach())
    return torch.stack(losses), torch.stack(told)


if __name__ == "__main__":
    tensors = draw(SEED)
    loss, grads = gradients(tensors, torch.float64, 1.0)
    _, single = gradients(tensors, torch.float32, 1.0)
    worst = max(float((single[n] - g).norm() / g.norm()) for n, g in grads.items())
    print(f"seed {SEED}: loss {float(loss):.9f}; worst difference of PyTorch's single precision {worst:.1e}")
    losses, told = five_steps(tensors, torch.float64)
    leaky, _ = gradients(tensors, torch.float64, 0.2)
    print("five steps", losses.tolist(), told.tolist())
    out = dict(tensors)
    out["loss.linear"], out["loss.leaky"], out["losses"], out["discriminator_losses"] = loss, leaky, losses, told
    out |= {f"gradient.{name}": g for name, g in grads.items()}
    out = {name: t.detach().to(torch.float32).contiguous() for name, t in out.items()}
    save_file(out, pathlib.Path(__file__).with_name("step.safetensors"))
