"""Tuples: bits, batches, errors, forks, signals and memory."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import glasshouse

LAYERS = ("input", "transmission", "glass_reflection", "clean_reflection")


def same(a: dict, b: dict) -> bool:
    return a["id"] == b["id"] and all(np.array_equal(a[name], b[name]) for name in LAYERS)


def planes(picture: np.ndarray) -> np.ndarray:
    return np.moveaxis(picture, -1, 0)


def test_scenes_have_shapes_and_ids(recipe: Path) -> None:
    tuples = glasshouse.Tuples(recipe)
    assert len(tuples) == 8
    first = tuples[0]
    assert first["id"] == tuples.line(0)["id"]
    for name in LAYERS:
        assert first[name].shape == (3, 40, 48) and first[name].dtype == np.float32
    assert same(tuples[-1], tuples[7])
    with pytest.raises(IndexError):
        tuples[8]
    assert [len(glasshouse.Tuples(recipe, split=split)) for split in ("train", "test")] == [6, 2]
    with pytest.raises(glasshouse.GlasshouseError, match="validation"):
        glasshouse.Tuples(recipe, split="validation")


def test_bits_are_those_of_the_command(recipe: Path, run: Path, program: str, tmp_path: Path) -> None:
    """Scenes of a recipe, of a run and of a scene's file have the bits of `glasshouse render`, and of each other."""
    tuples, of_run = glasshouse.Tuples(recipe, threads=2), glasshouse.Tuples(run, threads=1)
    for index in (0, 5):
        assert same(tuples[index], of_run[index])
        scene = tmp_path / f"{index}.json"
        scene.write_text(json.dumps(of_run.line(index)))
        roots = {"sample": run / "inputs" / "sample"}
        rendered = glasshouse.render(scene, root=roots)
        out = tmp_path / f"out-{index}"
        subprocess.run([program, "render", scene, "--out", out, "--root", f"sample={roots['sample']}"], check=True)
        for name in LAYERS:
            exr = read_exr(program, out / f"{name}.exr")
            assert np.array_equal(exr, getattr(rendered, name)), name
            assert np.array_equal(planes(exr), of_run[index][name]), name
        # The run's own tuple has half floats.
        stored = glasshouse.read(run)[index]
        assert np.array_equal(stored.input, rendered.input.astype(np.float16).astype(np.float32))


def read_exr(program: str, path: Path) -> np.ndarray:
    """Reads an uncompressed or ZIP-compressed OpenEXR file of three float channels."""
    OpenEXR = pytest.importorskip("OpenEXR", reason="OpenEXR is not installed")
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([channels[name].pixels for name in "RGB"], axis=-1).astype(np.float32)


def test_values_replace_those_of_the_lines(recipe: Path, tmp_path: Path) -> None:
    tuples = glasshouse.Tuples(recipe, spp=4, size=(24, 16), seed=9, layers=["input", "coverage"])
    line = tuples.line(3)
    assert (line["film"]["spp"], line["film"]["width"], line["film"]["height"], line["seed"]) == (4, 24, 16, 9)
    assert line["film"]["layers"] == ["input", "coverage"]
    made = tuples[3]
    assert set(made) == {"input", "coverage", "id"}
    assert made["input"].shape == (3, 16, 24) and made["coverage"].shape == (1, 16, 24)
    manifest = tmp_path / "lines.jsonl"
    base, roots = tuples._given[2], tuples._given[1]
    manifest.write_text(json.dumps(line))
    again = glasshouse.Tuples(manifest, root=roots)
    assert np.array_equal(again[0]["input"], made["input"]) and base.is_dir()
    assert glasshouse.Tuples(recipe, size=32)[0]["input"].shape == (3, 32, 32)
    for wrong in ({"spp": 3}, {"size": 0}, {"layers": ["colour"]}):
        with pytest.raises(glasshouse.GlasshouseError):
            glasshouse.Tuples(recipe, **wrong)


def test_batches_are_the_scenes_and_fill_given_arrays(recipe: Path) -> None:
    tuples = glasshouse.Tuples(recipe)
    chosen = [6, 1, 1, -1]
    batch = tuples.batch(chosen)
    assert batch["id"] == [tuples[index]["id"] for index in chosen]
    for at, index in enumerate(chosen):
        assert same({name: values[at] for name, values in batch.items()}, tuples[index])
    out = {name: np.full((4, 3, 40, 48), np.nan, np.float32) for name in LAYERS}
    filled = tuples.batch(chosen, out)
    assert all(filled[name] is out[name] and np.array_equal(out[name], batch[name]) for name in LAYERS)
    assert tuples.batch([]) == {"id": []}
    for wrong in (np.zeros((4, 3, 40, 40), np.float32), np.zeros((4, 3, 40, 48)), out["input"].transpose(0, 1, 3, 2)):
        with pytest.raises(glasshouse.GlasshouseError, match="out"):
            tuples.batch(chosen, {**out, "input": wrong})
    frozen = out["input"].copy()
    frozen.flags.writeable = False
    with pytest.raises(glasshouse.GlasshouseError, match="written"):
        tuples.batch(chosen, {**out, "input": frozen})


def test_arrays_take_over_the_renderers_memory(recipe: Path) -> None:
    tuples = glasshouse.Tuples(recipe)
    rendered = glasshouse.render(tuples.line(0), root=tuples._given[1])
    for name in LAYERS:
        picture = getattr(rendered, name)
        assert picture.shape == (40, 48, 3) and picture.dtype == np.float32 and picture.flags.c_contiguous
        owner = picture
        while isinstance(owner.base, np.ndarray):
            owner = owner.base
        # The memory belongs to an object of the module, not to numpy.
        assert not owner.flags.owndata and type(owner.base).__name__ == "PySliceContainer"
        picture += 1
    assert rendered.metadata["scene"]["film"]["spp"] == 16 and rendered.metadata["facts"]


def test_bad_scenes_are_exceptions_or_skipped(recipe: Path, tmp_path: Path) -> None:
    tuples = glasshouse.Tuples(recipe)
    lines = [tuples.line(index) for index in range(4)]
    lines[1]["front"]["color"] = "sample:missing.png"
    lines[2]["glass"]["distance_m"] = 500.0
    manifest = tmp_path / "bad.jsonl"
    manifest.write_text("\n".join(json.dumps(line) for line in lines))
    with pytest.warns(UserWarning, match="missing.png"):
        bad = glasshouse.Tuples(manifest, root=tuples._given[1])
    assert same(bad[0], tuples[0])
    for index, reason in ((1, "missing.png"), (2, "nearer")):
        with pytest.raises(glasshouse.SceneError, match=reason) as caught:
            bad[index]
        assert caught.value.scene == lines[index]["id"] and lines[index]["id"] in str(caught.value)


def test_a_file_that_vanishes_later_names_its_scene(recipe: Path, tmp_path: Path) -> None:
    plain = glasshouse.Tuples(recipe, inputs=tmp_path / "inputs")
    skipping = glasshouse.Tuples(recipe, inputs=tmp_path / "inputs", on_error="skip")
    lines = [plain.line(index) for index in range(8)]
    color = lines[2]["front"]["color"].split(":")[1]
    users = [at for at, line in enumerate(lines) if color in json.dumps(line)]
    (tmp_path / "inputs" / "inputs" / "sample" / color).unlink()
    with pytest.raises(glasshouse.SceneError, match="cannot read") as caught:
        plain[users[0]]
    assert caught.value.scene == lines[users[0]]["id"]
    with pytest.raises(glasshouse.SceneError):
        plain.batch(range(8))
    good = next(at % 8 for at in range(users[0] + 1, 16) if at % 8 not in users)
    with pytest.warns(UserWarning, match="is skipped"):
        replaced = skipping[users[0]]
    assert replaced["id"] == lines[good]["id"] and same(replaced, plain[good])
    assert len(skipping.batch(range(8))["id"]) == 8


def test_a_fork_in_the_middle_of_a_batch(recipe: Path) -> None:
    """Both processes go on: the child with threads of its own, and the parent with its batch."""
    tuples = glasshouse.Tuples(recipe, spp=1024, threads=2)
    expected = {index: glasshouse.Tuples(recipe, spp=1024, threads=1)[index]["input"] for index in (0, 7)}
    done: list[np.ndarray] = []
    thread = threading.Thread(target=lambda: done.append(tuples.batch(range(8))["input"]))
    thread.start()
    time.sleep(0.05)
    assert thread.is_alive() and not done
    child = os.fork()
    if child == 0:
        try:
            os._exit(0 if np.array_equal(tuples[7]["input"], expected[7]) else 3)
        finally:
            os._exit(4)
    for _ in range(600):
        finished, status = os.waitpid(child, os.WNOHANG)
        if finished:
            break
        time.sleep(0.1)
    else:
        os.kill(child, signal.SIGKILL)
        pytest.fail("the child hangs")
    assert os.waitstatus_to_exitcode(status) == 0
    thread.join()
    assert np.array_equal(done[0][7], expected[7]) and np.array_equal(done[0][0], expected[0])


def _first(tuples: glasshouse.Tuples) -> bytes:
    return tuples[0]["input"].tobytes()


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_processes_have_the_same_bits(recipe: Path, method: str) -> None:
    tuples = glasshouse.Tuples(recipe)
    expected = _first(tuples)
    assert _first(pickle.loads(pickle.dumps(tuples))) == expected
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.map(_first, [tuples] * 3) == [expected] * 3


def test_ctrl_c_ends_a_batch(recipe: Path) -> None:
    script = (
        "import glasshouse, signal\n"
        # Shells let their background processes ignore the signal, and Python then installs no handler.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"t = glasshouse.Tuples({str(recipe)!r}, spp=1024, size=2048, threads=1)\n"
        "print('ready', flush=True)\n"
        "t.batch(range(8))\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, text = process.communicate(timeout=60)
    assert process.returncode in (-signal.SIGINT, 130) and "KeyboardInterrupt" in text


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def test_memory_is_flat(recipe: Path) -> None:
    """The process takes no more memory after the 2,000th scene than after the 1,000th, within 2 %."""
    tuples = glasshouse.Tuples(recipe, spp=1)
    sizes = []
    for number in range(2000):
        tuples[number % 8]
        if number in (999, 1999):
            sizes.append(resident_mb())
    assert sizes[1] <= 1.02 * sizes[0], sizes


def test_plan_and_read(recipe: Path, run: Path) -> None:
    lines = glasshouse.plan(recipe)
    assert [line["id"] for line in lines] == [line["id"] for line in glasshouse.plan(run)]
    tuples = glasshouse.read(run)
    assert len(tuples) == 8 and tuples.missing == 0 and tuples.lines[0] == lines[0]
    one = glasshouse.read(run / "tuples" / lines[3]["id"])
    assert one.id == lines[3]["id"] and np.array_equal(one.input, tuples[3].input)
    assert [each.id for each in tuples[2:4]] == [line["id"] for line in lines[2:4]]
    with pytest.raises(glasshouse.GlasshouseError, match="nothing.toml"):
        glasshouse.plan("nothing.toml")
    with pytest.raises(glasshouse.GlasshouseError, match="cannot read"):
        glasshouse.read(run / "tuples" / "none")
    damaged = run.parent / "damaged"
    damaged.mkdir()
    for name in ("tuple.json", "tuple.exr"):
        data = bytearray((run / "tuples" / lines[0]["id"] / name).read_bytes())
        if name == "tuple.exr":
            data[-9] ^= 1
        (damaged / name).write_bytes(data)
    with pytest.raises(glasshouse.GlasshouseError, match="digest"):
        glasshouse.read(damaged)
