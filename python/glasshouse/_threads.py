"""The number of threads of a process."""

from __future__ import annotations

import os
import sys


def thread_count(given: int | None) -> int:
    """Returns `given`, or 1 in a worker of PyTorch's DataLoader, or else the number of processors of this process."""
    if given is not None:
        return given
    data = sys.modules.get("torch.utils.data")
    if data is not None and data.get_worker_info() is not None:
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
