"""Makes tests/train/unet.safetensors: the U-Net and five of its steps in PyTorch, for src/train/unet_tests.rs.

    pip install torch safetensors numpy

The network, its loss, AdamW with warm-up, cosine, clipping and running means are those of a trained U-Net, in f64. The last
layer does not begin with zeros, so that every layer has a gradient; the output is bounded by 1.2 times the input's light."""

import math

import torch
import torch.nn as nn
import torch.nn.functional as F
from safetensors.torch import save_file

torch.manual_seed(3)
torch.set_default_dtype(torch.float64)
WIDTH, RATE, WARMUP, STEPS, CLIP, DECAY, BOUND = 3, 2e-3, 2, 20, 0.05, 0.9, 1.2
WIDTHS = [WIDTH * k for k in (1, 2, 3, 4, 4)]


class Bound(torch.autograd.Function):
    """min(y, bound); above the bound, only gradients that pull y down pass."""

    @staticmethod
    def forward(ctx, y, bound):
        ctx.is_above = y > bound
        return torch.minimum(y, bound)

    @staticmethod
    def backward(ctx, gradient):
        return torch.where(ctx.is_above, gradient.clamp(min=0), gradient), None


def light(code):
    return torch.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def code(light):
    return torch.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


class Unet(nn.Module):
    def __init__(self):
        super().__init__()
        two = lambda i, o: [nn.Conv2d(i, o, 3, padding=1), nn.Conv2d(o, o, 3, padding=1)]
        pairs = list(zip(WIDTHS, WIDTHS[1:]))
        layers = two(12, WIDTHS[0])
        for small, large in pairs:
            layers += two(small, large)
        for small, large in reversed(pairs):
            layers += two(large + small, small)
        self.layers, self.last = nn.ModuleList(layers), nn.Conv2d(WIDTHS[0], 12, 3, padding=1)

    def forward(self, image):
        rows, columns = image.shape[2:]
        layers = iter(self.layers)
        one = lambda x: F.leaky_relu(next(layers)(x), 0.1)
        two = lambda x: one(one(x))
        padded = F.pad(image, (0, -columns % 32, 0, -rows % 32), "replicate")
        x, skips = two(F.pixel_unshuffle(padded - 0.5, 2)), []
        for _ in range(4):
            skips.append(x)
            x = two(F.avg_pool2d(x, 2))
        while skips:
            x = two(torch.cat([F.interpolate(x, scale_factor=2, mode="nearest"), skips.pop()], 1))
        y = image + F.pixel_shuffle(self.last(x), 2)[..., :rows, :columns]
        return Bound.apply(y, code((BOUND * light(image)).clamp(max=1)))

    def names(self):
        for k, layer in enumerate(self.layers):
            yield f"separation.kernel.{k}", layer.weight
            yield f"separation.bias.{k}", layer.bias
        yield "separation.last", self.last.weight
        yield "separation.last_bias", self.last.bias


net = Unet()
with torch.no_grad():
    for parameter in net.parameters():
        parameter.copy_(parameter.float().double())
means = {name: p.detach().clone() for name, p in net.names()}
out = {name: p.detach().clone() for name, p in net.names()}
image = torch.rand(2, 3, 40, 72).float().double()
target = (image * (0.6 + 0.3 * torch.rand(2, 3, 40, 72))).float().double()
optimizer = torch.optim.AdamW(net.parameters(), RATE, (0.9, 0.99), weight_decay=1e-2)
losses = []
for step in range(1, 6):
    for group in optimizer.param_groups:
        group["lr"] = RATE * min(1, step / WARMUP) * 0.5 * (1 + math.cos(math.pi * step / STEPS))
    made = net(image)
    d = made - target
    slopes = (d[..., 1:] - d[..., :-1]).abs().mean() + (d[..., 1:, :] - d[..., :-1, :]).abs().mean()
    loss = d.abs().mean() + slopes
    optimizer.zero_grad()
    loss.backward()
    if step == 1:
        out["made"] = made.detach()
        out |= {f"gradient.{name}": p.grad.clone() for name, p in net.names()}
        norm = torch.stack([p.grad.norm() for p in net.parameters()]).norm()
        assert norm > CLIP, "the step is not clipped"
        assert (made.detach() >= code((BOUND * light(image)).clamp(max=1))).any(), "nothing is bounded"
    nn.utils.clip_grad_norm_(net.parameters(), CLIP)
    optimizer.step()
    losses.append(loss.item())
    for name, p in net.names():
        means[name].lerp_(p.detach(), 1 - min(DECAY, step / (step + 20)))
out |= {f"mean.{name}": mean for name, mean in means.items()}
out |= {"input": image, "transmission": target, "losses": torch.tensor(losses)}
save_file({k: v.float().contiguous() for k, v in out.items()}, "tests/train/unet.safetensors")
print(len(out), "tensors, losses", losses)
