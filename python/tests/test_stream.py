"""Streams in PyTorch's loaders, and examples in XReflection's data set class. Skipped without torch."""

from __future__ import annotations

import importlib
import sys
import types
from importlib.metadata import PackageNotFoundError, distribution
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glasshouse
from glasshouse import adapters

torch = pytest.importorskip("torch", reason="streams need torch")

from torch.utils.data import DataLoader  # noqa: E402

from glasshouse.torch import Stream  # noqa: E402

COUNT = 11


def first(loader: Any, count: int) -> list[dict[str, Any]]:
    return list(islice(iter(loader), count))


def same(a: list[dict[str, Any]], b: list[dict[str, Any]]) -> bool:
    pairs = list(zip(a, b, strict=True))
    return all(x.get("id") == y.get("id") and torch.equal(x["input"], y["input"]) for x, y in pairs)


@pytest.fixture(scope="module")
def tuples(recipe: Path) -> glasshouse.Tuples:
    return glasshouse.Tuples(recipe, split="train", layers=["input"])


def test_orders_are_permutations_of_every_epoch(tuples: glasshouse.Tuples) -> None:
    stream = Stream(tuples, batch=4, seed=1)
    numbers = [index for k in range(6) for index in stream.indices(k)]
    epochs = [numbers[at : at + 6] for at in range(0, 24, 6)]
    assert all(sorted(epoch) == list(range(6)) for epoch in epochs) and epochs[0] != epochs[1]
    assert stream.indices(3) == Stream(tuples, batch=4, seed=1).indices(3)
    assert stream.indices(0) != Stream(tuples, batch=4, seed=2).indices(0)
    assert Stream(tuples, batch=4, shuffle=False).indices(1) == [4, 5, 0, 1]


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_workers_change_no_bit(tuples: glasshouse.Tuples, method: str) -> None:
    """The batches of 0, 1, 2 and 4 workers are equal, and in the same order."""
    stream = Stream(tuples, batch=4, seed=3, batches=COUNT)
    expected = first(DataLoader(stream, batch_size=None), COUNT)
    assert len(expected) == COUNT
    for workers in (1, 2, 4):
        loader = DataLoader(stream, batch_size=None, num_workers=workers, multiprocessing_context=method)
        assert same(list(loader), expected), workers


def test_map_style_loaders_have_the_same_bits(tuples: glasshouse.Tuples) -> None:
    expected = [tuples[index]["input"] for index in range(6)]
    for workers in (0, 2):
        context = "fork" if workers else None
        loader = DataLoader(tuples, batch_size=2, num_workers=workers, multiprocessing_context=context)
        batches = list(loader)
        found = np.concatenate([batch["input"].numpy() for batch in batches])
        assert np.array_equal(found, np.stack(expected))
        assert [name for batch in batches for name in batch["id"]] == [tuples.line(index)["id"] for index in range(6)]


def test_ranks_take_turns(tuples: glasshouse.Tuples) -> None:
    whole = first(Stream(tuples, batch=2, batches=8), 8)
    of_ranks = [list(Stream(tuples, batch=2, batches=8, rank=rank, ranks=2)) for rank in (0, 1)]
    assert same(whole[0::2], of_ranks[0]) and same(whole[1::2], of_ranks[1])


def test_a_stream_continues_at_its_state(tuples: glasshouse.Tuples) -> None:
    stream = Stream(tuples, batch=4, seed=3, batches=COUNT)
    expected = list(stream)
    running = iter(stream)
    begun = [next(running) for _ in range(5)]
    state = stream.state_dict()
    running.close()
    resumed = Stream(tuples, batch=4, seed=3, batches=COUNT)
    resumed.load_state_dict(state)
    assert same(begun + list(resumed), expected)
    assert same(list(resumed), expected)
    with pytest.raises(ValueError, match="seed"):
        Stream(tuples, batch=4, seed=4).load_state_dict(state)


@pytest.mark.parametrize("workers", [0, 2])
def test_stateful_loaders_resume(tuples: glasshouse.Tuples, workers: int) -> None:
    loaders = pytest.importorskip("torchdata.stateful_dataloader", reason="torchdata is not installed")

    def loader() -> Any:
        context = "fork" if workers else None
        stream = Stream(tuples, batch=4, seed=3, batches=COUNT)
        return loaders.StatefulDataLoader(stream, batch_size=None, num_workers=workers, multiprocessing_context=context)

    expected = list(loader())
    begun_loader = loader()
    running = iter(begun_loader)
    begun = [next(running) for _ in range(5)]
    state = begun_loader.state_dict()
    resumed = loader()
    resumed.load_state_dict(state)
    assert same(begun + list(resumed), expected)


def test_mixtures_stream(run: Path) -> None:
    mixtures = glasshouse.Mixtures(run, size=32)
    stream = Stream(mixtures, batch=4, batches=3)
    batches = list(stream)
    assert batches[0]["input"].shape == (4, 3, 32, 32) and batches[0]["input"].dtype == torch.float32
    loader = DataLoader(stream, batch_size=None, num_workers=2, multiprocessing_context="fork")
    assert all(torch.equal(a["target_r"], b["target_r"]) for a, b in zip(loader, batches, strict=True))


def xreflection_data(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """Returns XReflection's module of data sets, without its packages, which import much more."""
    try:
        folder = Path(str(distribution("xreflection").locate_file("xreflection")))
    except PackageNotFoundError:
        pytest.skip("XReflection is not installed")
    for name in ("scipy", "torchvision", "cv2", "PIL"):
        pytest.importorskip(name, reason=f"XReflection's data sets need {name}")
    for name in ("xreflection", "xreflection.data", "xreflection.utils"):
        package = types.ModuleType(name)
        package.__path__ = [str(folder.joinpath(*name.split(".")[1:]))]
        monkeypatch.setitem(sys.modules, name, package)
    return importlib.import_module("xreflection.data.dsit_dataset")


def test_xreflection_takes_the_examples(run: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Its fused data set mixes ours with real pairs, and a step of a small network lowers the loss."""
    data = xreflection_data(monkeypatch)
    Image = pytest.importorskip("PIL.Image")
    for layer in ("blended", "transmission_layer"):
        (tmp_path / layer).mkdir()
        Image.new("RGB", (400, 340), (90, 120, 60)).save(tmp_path / layer / "real.png")
    mixtures = glasshouse.Mixtures(run, size=32, length=16)
    monkeypatch.setitem(data.DATASET_TYPES, "Glasshouse", lambda _: adapters.xreflection(mixtures))
    options = {
        "size": 16,
        "fused_datasets": [
            {"type": "Glasshouse", "ratio": 0.7},
            {"type": "DSRTestDataset", "ratio": 0.3, "datadir": str(tmp_path)},
        ],
    }
    fused = data.DSITFusionDataset(options)
    examples = [fused[index] for index in range(16)]
    ours = [example for example in examples if not example["real"]]
    real = next(example for example in examples if example["real"])
    assert 4 < len(ours) < 16 and set(ours[0]) == set(real)
    batch = torch.utils.data.default_collate(ours[:4])
    for name in ("input", "target_t", "target_r"):
        assert batch[name].dtype == torch.float32 and batch[name].shape == (4, 3, 32, 32)
    torch.manual_seed(0)
    network = torch.nn.Conv2d(3, 6, 3, padding=1)
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-2)

    def loss() -> Any:
        made = network(batch["input"])
        return (made[:, :3] - batch["target_t"]).abs().mean() + (made[:, 3:] - batch["target_r"]).abs().mean()

    before = loss()
    before.backward()
    optimizer.step()
    assert loss() < before
    fused.reset()
    assert fused.datasets[0].epoch == 1
