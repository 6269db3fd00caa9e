"""Data sets for PyTorch: an endless stream of batches that several ranks and workers share, and that resumes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import Any, Protocol

import numpy as np
import torch
import torch.distributed
from torch.utils.data import IterableDataset, get_worker_info


class Batches(Protocol):
    """A data set of this package: `Tuples` or `Mixtures`."""

    def __len__(self) -> int:
        """Returns the number of examples of an epoch."""

    def batch(self, indices: list[int]) -> dict[str, Any]:
        """Returns the arrays (B, C, H, W) of examples, by name."""


class Stream(IterableDataset[dict[str, Any]]):
    """Batches of a data set, epoch after epoch, each epoch in an order of its own.

    Use it without a batch size of the loader: `DataLoader(Stream(tuples, batch=16), batch_size=None, num_workers=4)`.
    Batch k is a function of the seed and of k. Ranks take turns, and so do the workers of a rank; so the loader of one
    rank returns the same batches in the same order for any number of workers. torchdata's `StatefulDataLoader` saves
    and restores the position.

    Without workers, the next batches are made on the threads of the data set while the network computes.

    Args:
        source: `Tuples` or `Mixtures`.
        batch: Examples of a batch. An incomplete last batch of an epoch is filled from the next epoch.
        seed: Seed of the orders.
        shuffle: False for the order of the data set.
        batches: Number of batches until the end, over all ranks; None for no end.
        ahead: Number of batches that are made ahead without workers.
        rank, ranks: This process and the number of processes; by default those of `torch.distributed` or of torchrun's
            variables.

    """

    def __init__(
        self,
        source: Batches,
        batch: int,
        *,
        seed: int = 0,
        shuffle: bool = True,
        batches: int | None = None,
        ahead: int = 2,
        rank: int | None = None,
        ranks: int | None = None,
    ) -> None:
        super().__init__()
        if batch < 1 or len(source) < 1:
            raise ValueError(f"a batch of {batch} and a data set of {len(source)} examples must have one or more")
        self.source, self.size, self.seed, self.shuffle = source, batch, seed, shuffle
        self.batches, self.ahead = batches, ahead
        self._rank = _rank() if rank is None else rank
        self._ranks = _ranks() if ranks is None else ranks
        self._done = 0
        self._start = 0
        self._orders: dict[int, np.ndarray[Any, np.dtype[np.int64]]] = {}

    def indices(self, number: int) -> list[int]:
        """Returns the numbers of the examples of a batch."""
        count = len(self.source)
        return [self._index(position, count) for position in range(number * self.size, (number + 1) * self.size)]

    def _index(self, position: int, count: int) -> int:
        epoch, place = divmod(position, count)
        if not self.shuffle:
            return place
        if epoch not in self._orders:
            self._orders = {old: order for old, order in self._orders.items() if old == epoch - 1}
            self._orders[epoch] = np.random.Generator(np.random.Philox(key=[self.seed, epoch])).permutation(count)
        return int(self._orders[epoch][place])

    def __iter__(self) -> Iterator[dict[str, Any]]:
        worker = get_worker_info()
        workers, own = (1, 0) if worker is None else (worker.num_workers, worker.id)
        step = self._ranks * workers
        self._done, self._start = self._start, 0
        numbers = self._numbers(self._rank + self._ranks * own, step)
        if worker is not None or self.ahead < 1:
            for number in numbers:
                batch = self._batch(number)
                self._done += 1
                yield batch
            return
        with ThreadPoolExecutor(1, thread_name_prefix="glasshouse-stream") as pool:
            waiting: list[Future[dict[str, Any]]] = []
            try:
                while True:
                    for number in islice(numbers, self.ahead + 1 - len(waiting)):
                        waiting.append(pool.submit(self._batch, number))
                    if not waiting:
                        return
                    batch = waiting.pop(0).result()
                    self._done += 1
                    yield batch
            finally:
                for future in waiting:
                    future.cancel()

    def _numbers(self, first: int, step: int) -> Iterator[int]:
        number = first + self._done * step
        while self.batches is None or number < self.batches:
            yield number
            number += step

    def _batch(self, number: int) -> dict[str, Any]:
        made = self.source.batch(self.indices(number))
        return {
            name: torch.from_numpy(value) if isinstance(value, np.ndarray) else value for name, value in made.items()
        }

    def state_dict(self) -> dict[str, Any]:
        """Returns the position of this worker: the number of its batches so far, and what they depend on."""
        return {"done": self._done, **self._identity()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continues at the position of a state.

        Raises:
            ValueError: The state is that of a stream with other batches.

        """
        own = self._identity()
        other = {name: state.get(name) for name in own}
        if other != own:
            raise ValueError(f"the state is that of a stream of {other}, but this one has {own}")
        self._start = int(state["done"])

    def _identity(self) -> dict[str, Any]:
        of = {"batch": self.size, "seed": self.seed, "shuffle": self.shuffle, "examples": len(self.source)}
        return {**of, "ranks": self._ranks}


def _rank() -> int:
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        return int(torch.distributed.get_rank())
    return int(os.environ.get("RANK", "0"))


def _ranks() -> int:
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        return int(torch.distributed.get_world_size())
    return int(os.environ.get("WORLD_SIZE", "1"))
