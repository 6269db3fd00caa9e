"""Mixtures: bits of the trainer, labels, processes."""

from __future__ import annotations

import pickle
import subprocess
from pathlib import Path

import numpy as np
import pytest

import glasshouse
from glasshouse import adapters


@pytest.fixture(scope="module")
def mixtures(run: Path) -> glasshouse.Mixtures:
    return glasshouse.Mixtures(run, seed=5, size=32)


def test_examples_are_functions_of_seed_and_number(mixtures: glasshouse.Mixtures, run: Path) -> None:
    assert len(mixtures) == 6
    first = mixtures[0]
    assert set(first) == {"input", "target_t", "target_r"}
    for values in first.values():
        assert values.shape == (3, 32, 32) and values.dtype == np.float32
        assert values.min() >= 0 and values.max() <= 1
    batch = mixtures.batch([7, 0, 0])
    assert all(np.array_equal(batch[name][1], first[name]) for name in first)
    assert not np.array_equal(batch["input"][0], batch["input"][1])
    again = pickle.loads(pickle.dumps(mixtures))
    assert np.array_equal(again[0]["input"], first["input"])
    other = glasshouse.Mixtures(run, seed=6, size=32)
    assert not np.array_equal(other[0]["input"], first["input"])
    with pytest.raises(IndexError):
        mixtures[6]
    assert len(glasshouse.Mixtures(run, size=32, length=100)) == 100


def test_examples_are_those_of_a_training(run: Path) -> None:
    """The trainer's batches are consecutive examples, whatever their number."""
    mixtures = glasshouse.Mixtures(run, seed=5, size=32)
    of_steps = glasshouse.Examples(run, {**mixtures.settings, "batch": 3}).step(4)
    batch = mixtures.batch([12, 13, 14])
    assert np.array_equal(of_steps["input"], batch["input"])
    assert np.array_equal(of_steps["transmission"], batch["target_t"])
    assert np.array_equal(of_steps["glass_reflection"], batch["target_r"])


def test_an_export_has_the_same_examples(run: Path, program: str, tmp_path: Path) -> None:
    """Shards of half floats, mapped into memory, give the bits of the run's own tuples."""
    out = tmp_path / "shards"
    subprocess.run([program, "export", run, "--format", "safetensors", "--out", out, "-q"], check=True)
    of_run = glasshouse.Mixtures(run, seed=5, size=32)
    of_shards = glasshouse.Mixtures(out, seed=5, settings=of_run.settings)
    assert len(of_shards) == 6
    numbers = list(range(12))
    ours, theirs = of_shards.batch(numbers), of_run.batch(numbers)
    assert all(np.array_equal(ours[name], theirs[name]) for name in ours)
    with pytest.raises(glasshouse.GlasshouseError, match="composed"):
        glasshouse.Examples(out, {**of_run.settings, "examples": "rendered"})
    (out / "train-000000.safetensors").unlink()
    with pytest.raises(glasshouse.GlasshouseError, match="export the run again"):
        glasshouse.Mixtures(out, seed=5, size=32)


def test_the_reflection_label(run: Path) -> None:
    code = glasshouse.Mixtures(run, size=32)[1]
    difference = glasshouse.Mixtures(run, size=32, label="difference")[1]
    assert np.array_equal(code["input"], difference["input"])
    assert np.array_equal(difference["target_r"], code["input"] - code["target_t"])
    with pytest.raises(ValueError, match="label"):
        glasshouse.Mixtures(run, size=32, label="other")  # type: ignore[arg-type]


def test_nothing_drawn_gives_the_bits_of_the_tuple(run: Path) -> None:
    """Without any draw, an example is the tuple in sRGB codes."""
    composition = {
        "other_share": 0.0,
        "strength": "of_tuple",
        "none_share": 0.0,
        "partial_cover": 0.0,
        "rough": 0.0,
        "textured": 0.0,
        "white_balance": 0.0,
        "reflection_white_balance": 0.0,
        "front_scale": [1.0, 1.0],
        "exposure": "of_tuple",
        "camera": {"enabled": False},
    }
    settings = {"composition": composition, "flip": False}
    example = glasshouse.Mixtures(run, size=40, settings=settings)[2]
    stored = [np.moveaxis(each.input, -1, 0) for each in glasshouse.read(run)]
    linear = example["input"]
    codes = [np.where(s <= 0.0031308, 12.92 * s, 1.055 * np.maximum(s, 0.0031308) ** (1 / 2.4) - 0.055) for s in stored]
    codes = [np.clip(code, 0, 1) for code in codes]
    cuts = [code[:, :, x : x + 40] for code in codes for x in range(9)]
    assert min(np.abs(cut - linear).max() for cut in cuts) < 1e-6


def test_errors_name_the_remedy(run: Path, tmp_path: Path) -> None:
    with pytest.raises(glasshouse.GlasshouseError, match="smaller"):
        glasshouse.Mixtures(run, size=256)[0]
    with pytest.raises(glasshouse.GlasshouseError, match="glasshouse plan"):
        glasshouse.Mixtures(tmp_path)
    with pytest.raises(glasshouse.GlasshouseError, match="validation"):
        glasshouse.Mixtures(run, split="validation")
    with pytest.raises(glasshouse.GlasshouseError, match="unknown field"):
        glasshouse.Mixtures(run, settings={"colour": 1})
    assert glasshouse.train_settings(run, name="other") == glasshouse.train_settings(run)
    with pytest.raises(glasshouse.GlasshouseError, match='no training "other"; it has: none'):
        glasshouse.Mixtures(run, name="other")


def test_adapters_have_the_keys_of_the_programs(mixtures: glasshouse.Mixtures) -> None:
    assert glasshouse.adapters is adapters  # as in docs/python.md, which imports the package alone
    plain = mixtures[1]
    keys = {
        adapters.xreflection: {"input", "target_t", "target_r", "fn", "real", "inp_path"},
        adapters.rdnet: {"input", "target_t", "target_r", "fn", "real"},
        adapters.dsrnet: {"input", "target_t", "target_r", "fn", "real"},
        adapters.errnet: {"input", "target_t", "target_r", "fn"},
    }
    for adapter, names in keys.items():
        adapted = adapter(mixtures)
        example = adapted[1]
        assert set(example) == names and len(adapted) == 6
        assert np.array_equal(example["input"], plain["input"])
        is_difference = adapter in (adapters.xreflection, adapters.rdnet)
        expected = plain["input"] - plain["target_t"] if is_difference else plain["target_r"]
        assert np.array_equal(example["target_r"], expected)
        adapted.reset()
        assert np.array_equal(adapted[1]["input"], mixtures.batch([7])["input"][0])
        adapted.reset(shuffle=False)
        assert np.array_equal(adapted[1]["input"], plain["input"])
