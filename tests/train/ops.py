"""Makes tests/train/ops.safetensors, PyTorch's results in f64, for src/train/ops/tests.rs.   pip install torch safetensors numpy

Each case NAME has its inputs NAME.x, NAME.w, ..., the result NAME.y, the gradient of the result NAME.g, and the gradients of
the inputs NAME.dx, NAME.dw, ..., all as f32."""

import torch
import torch.nn.functional as F
from safetensors.torch import save_file

torch.manual_seed(1)
out = {}


def case(name, compute, **inputs):
    inputs = {k: v.to(torch.float32).to(torch.float64).requires_grad_() for k, v in inputs.items()}
    y = compute(**inputs)
    g = torch.randn(y.shape, dtype=torch.float64).to(torch.float32).to(torch.float64)
    y.backward(g)
    out[f"{name}.y"], out[f"{name}.g"] = y.detach(), g
    for key, value in inputs.items():
        out[f"{name}.{key}"], out[f"{name}.d{key}"] = value.detach(), value.grad


def conv(name, x, w, padding, stride, dilation):
    def compute(x, w):
        return F.conv2d(x, w, padding=padding, stride=stride, dilation=dilation)

    case(f"conv {name} p{padding} s{stride} d{dilation}", compute, x=torch.randn(x), w=torch.randn(w))


for dilation in (1, 2, 4, 8, 16, 32, 64):
    conv("same", (2, 3, 18, 20), (4, 3, 3, 3), dilation, 1, dilation)
conv("point", (2, 5, 9, 11), (3, 5, 1, 1), 0, 1, 1)
for rows, columns in ((16, 16), (17, 17), (12, 20), (17, 16), (16, 17)):
    conv(f"four {rows}x{columns}", (2, 3, rows, columns), (4, 3, 4, 4), 1, 2, 1)
    conv(f"three {rows}x{columns}", (1, 3, rows, columns), (5, 3, 3, 3), 1, 2, 1)
conv("four", (1, 4, 9, 8), (2, 4, 4, 4), 1, 1, 1)
conv("oblong", (1, 2, 9, 8), (3, 2, 1, 3), 0, 1, 1)
conv("narrow padding", (1, 2, 9, 8), (3, 2, 3, 3), 0, 1, 2)
conv("wide padding", (1, 2, 6, 7), (3, 2, 1, 1), 2, 1, 1)

case("relu", lambda x, w, b: F.relu(F.conv2d(x, w, b, padding=1)), x=torch.randn(2, 3, 7, 9), w=torch.randn(4, 3, 3, 3), b=torch.randn(4))

for rows, columns in ((8, 6), (9, 6), (8, 7), (17, 18)):
    case(f"pool {rows}x{columns}", lambda x: F.max_pool2d(x, 2), x=torch.randn(2, 3, rows, columns))
case("pool ties", lambda x: F.max_pool2d(x, 2), x=torch.randint(0, 2, (1, 2, 6, 6)).double())

for (rows, columns), size in (((4, 4), (8, 8)), ((5, 7), (13, 11)), ((9, 8), (4, 3)), ((1, 1), (3, 2)), ((6, 5), (6, 9))):
    case(
        f"resize {rows}x{columns} to {size[0]}x{size[1]}",
        lambda x: F.interpolate(x, size=size, mode="bilinear", align_corners=False),
        x=torch.randn(2, 3, rows, columns),
    )


def norm(x, c, epsilon, slope):
    normed = F.batch_norm(x, None, None, training=True, eps=epsilon)
    a, b, offset = (row.view(1, -1, 1, 1) for row in c)
    return F.leaky_relu(a * x + b * normed + offset, slope)


for batch in (1, 3):
    case(f"norm {batch}", lambda x, c: norm(x, c, 1e-3, 0.2), x=torch.randn(batch, 5, 6, 7) * 2 + 1, c=torch.randn(3, 5))
case("norm straight", lambda x, c: norm(x, c, 1e-5, 1.0), x=torch.randn(2, 4, 33, 40) + 3, c=torch.randn(3, 4))

case("absolute", torch.abs, x=torch.tensor([-2.0, -0.0, 0.0, 0.5, 3.0]))

# New cases come last, so that the random numbers of the others stay the same.
for slope in (0.1, 1.0):
    case(f"leaky {slope}", lambda x, w, b: F.leaky_relu(F.conv2d(x, w, b, padding=1), slope), x=torch.randn(2, 3, 7, 9), w=torch.randn(4, 3, 3, 3), b=torch.randn(4))
case("mean pool", lambda x: F.avg_pool2d(x, 2), x=torch.randn(2, 3, 6, 10))
case("join", lambda x, s: torch.cat([F.interpolate(x, scale_factor=2, mode="nearest"), s], 1), x=torch.randn(2, 3, 3, 5), s=torch.randn(2, 4, 6, 10))
case("unshuffle", lambda x: F.pixel_unshuffle(x, 2), x=torch.randn(2, 3, 6, 10))
case("shuffle", lambda x: F.pixel_shuffle(x, 2), x=torch.randn(2, 8, 3, 5))
case("pad", lambda x: F.pad(x, (0, 6, 0, 3), "replicate"), x=torch.randn(2, 3, 5, 10))


def slopes(x, t):
    d = x - t.detach()
    return (d[..., 1:] - d[..., :-1]).abs().mean() + (d[..., 1:, :] - d[..., :-1, :]).abs().mean()


target = torch.randn(2, 3, 6, 7)
target[0, 0] = 0.5
image = torch.randn(2, 3, 6, 7)
image[0, 0, 2:] = 0.25
case("slopes", lambda x: slopes(x, target.double()), x=image)
out["slopes.t"] = target

save_file({k: v.to(torch.float32).contiguous() for k, v in out.items()}, "tests/train/ops.safetensors")
print(len(out), "tensors")
