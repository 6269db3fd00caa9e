"""Prints the expected numbers of src/train/adam.rs: AdamW with clipping and running means in PyTorch.   pip install torch"""

import torch

scale = torch.tensor([3.0, 0.5, -1.0], dtype=torch.float64)
w = torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64, requires_grad=True)
mean = w.detach().clone()
optimizer = torch.optim.AdamW([w], 0.1, (0.9, 0.99), weight_decay=0.2)
print("    const EXPECTED: [(usize, [f32; 6]); 3] = [")
for step in range(1, 31):
    optimizer.zero_grad()
    (w.square() * scale).sum().mul(0.5).backward()
    torch.nn.utils.clip_grad_norm_([w], 1.0)
    optimizer.step()
    mean.lerp_(w.detach(), 1 - min(0.8, step / (step + 20)))
    if step in (1, 2, 30):
        numbers = ", ".join(f"{v:.6g}" for v in [*w.tolist(), *mean.tolist()])
        print(f"        ({step}, [{numbers}]),")
print("    ];")
