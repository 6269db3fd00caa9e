"""Examples as the dictionaries that published training programs read.

Each function turns `Mixtures` into a map-style data set with the keys of a program's own synthetic data set, so that it
can stand in that data set's place, or beside it in the program's `FusionDataset`:

    XReflection   input, target_t, target_r = M - B, fn, real, inp_path    DSRDataset
    RDNet         input, target_t, target_r = M - B, fn, real              DSRDataset
    DSRNet        input, target_t, target_r = R, fn, real                  DSRDataset
    ERRNet        input, target_t, target_r = R, fn                        CEILDataset

M is the input, B the transmission and R the reflection; all are float32 (3, S, S) codes from 0 to 1, M - B from -1 to
1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .examples import Mixtures


class Adapted(Sequence[dict[str, Any]]):
    """Examples with other keys. `reset`, which the programs call after each epoch, moves on to new examples."""

    def __init__(self, mixtures: Mixtures, *, difference: bool, real: bool, path: bool) -> None:
        self.mixtures = mixtures
        self.epoch = 0
        self._difference, self._real, self._path = difference, real, path

    def __len__(self) -> int:
        return len(self.mixtures)

    def reset(self, shuffle: bool = True) -> None:
        """Begins the next epoch; without `shuffle`, the first."""
        self.epoch = self.epoch + 1 if shuffle else 0

    def __getitem__(self, index: Any) -> Any:
        if not -len(self) <= index < len(self):
            raise IndexError(f"example {index} of {len(self)}")
        number = self.epoch * len(self) + index % len(self)
        example: dict[str, Any] = {name: values[0] for name, values in self.mixtures.batch([number]).items()}
        if self._difference:
            example["target_r"] = example["input"] - example["target_t"]
        example["fn"] = f"{number:08}.png"
        if self._real:
            example["real"] = False
        if self._path:
            example["inp_path"] = example["fn"]
        return example


def xreflection(mixtures: Mixtures) -> Adapted:
    """Returns examples as XReflection's `DSRDataset` does."""
    return Adapted(mixtures, difference=True, real=True, path=True)


def rdnet(mixtures: Mixtures) -> Adapted:
    """Returns examples as RDNet's `DSRDataset` does."""
    return Adapted(mixtures, difference=True, real=True, path=False)


def dsrnet(mixtures: Mixtures) -> Adapted:
    """Returns examples as DSRNet's `DSRDataset` does."""
    return Adapted(mixtures, difference=False, real=True, path=False)


def errnet(mixtures: Mixtures) -> Adapted:
    """Returns examples as ERRNet's `CEILDataset` does."""
    return Adapted(mixtures, difference=False, real=False, path=False)
