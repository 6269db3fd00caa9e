"""Computes errors and ratios from the peers' result.json files: peers.json has the figures, peers.md the tables."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scene import LAYERS, SYMBOLS

# Factor by which a peer may exceed a common target: `stock` and `split` estimate T alike, with errors equal to 0.1 %.
PEER_TOLERANCE = 1.02
GOALS = {"mitsuba_stock": 50.0, "mitsuba_split": 10.0, "cycles": 150.0, "embree": 20.0}


@dataclass(frozen=True)
class Pass:
    """One measured rendering: the RMSE of each rendered layer, and the cost."""

    name: str
    samples: int
    cpu_s: float
    process_cpu_s: float | None
    rmse: dict[str, float]
    bias: dict[str, float]


def rms(difference: np.ndarray) -> float:
    """Returns the root mean square over pixels and colours."""
    return float(np.sqrt((difference.astype(np.float64) ** 2).mean()))


def block_rms(difference: np.ndarray, side: int = 16) -> float:
    """Returns the RMS of means over blocks of 16 x 16 px, which have 16 times less noise, so that bias shows."""
    h, w = (n // side * side for n in difference.shape[:2])
    blocks = difference[:h, :w].astype(np.float64).reshape(h // side, side, w // side, side, 3)
    return rms(blocks.mean((1, 3)))


def reference(folder: Path) -> dict[str, np.ndarray]:
    """Returns the four layers of a folder with the most samples; nothing if a layer is missing."""
    images: dict[str, np.ndarray] = {}
    for entry in sorted(entries_of(folder), key=lambda p: p["samples"]):
        images.update({layer: np.load(folder / file) for layer, file in entry["layers"].items()})
    return images if set(images) == set(LAYERS) else {}


def passes(folder: Path, truth: dict[str, np.ndarray]) -> list[Pass]:
    """Returns all passes of a peer, with their errors."""
    found = []
    for entry in entries_of(folder):
        difference = {layer: np.load(folder / file) - truth[layer] for layer, file in entry["layers"].items()}
        found.append(Pass(
            entry["name"], entry["samples"], entry["cpu_s"], entry.get("process_cpu_s"),
            {layer: rms(d) for layer, d in difference.items()},
            {layer: float(d.mean(dtype=np.float64)) for layer, d in difference.items()}))
    return found


def cheapest(candidates: list[Pass], targets: dict[str, float] | None) -> list[Pass] | None:
    """Returns the cheapest pass that reaches the targets for each set of layers; None if a layer is missing."""
    chosen: dict[frozenset[str], Pass] = {}
    for candidate in sorted(candidates, key=lambda p: p.cpu_s):
        if targets is None or all(e <= targets[layer] for layer, e in candidate.rmse.items()):
            chosen.setdefault(frozenset(candidate.rmse), candidate)
    whole = {layer for p in chosen.values() for layer in p.rmse} == set(LAYERS)
    return sorted(chosen.values(), key=lambda p: LAYERS.index(next(iter(p.rmse)))) if whole else None


def summary(chosen: list[Pass]) -> dict:
    """Returns cost and errors of passes that together render the four layers."""
    figures: dict = {
        "samples": {layer: p.samples for p in chosen for layer in p.rmse},
        "passes": [{"name": p.name, "samples": p.samples, "layers": list(p.rmse), "cpu_s": p.cpu_s} for p in chosen],
        "cpu_s": sum(p.cpu_s for p in chosen),
        "rmse": {layer: p.rmse[layer] for p in chosen for layer in p.rmse},
        "bias": {layer: p.bias[layer] for p in chosen for layer in p.rmse},
    }
    processes = [p.process_cpu_s for p in chosen if p.process_cpu_s is not None]
    if len(processes) == len(chosen):
        figures["process_cpu_s"] = sum(processes)
    return figures


def against(peer: dict, ours: list[Pass], targets: dict[str, float]) -> dict | None:
    """Returns the peer's cost over that of the cheapest glasshouse pass that reaches the targets in all four layers."""
    found = cheapest(ours, targets)
    if found is None:
        return None
    us = summary(found)
    return {"peer": peer, "glasshouse": us, "ratio": peer["cpu_s"] / us["cpu_s"],
            "ratio_whole_process": peer["cpu_s"] / us["process_cpu_s"]}


def compare(out: Path) -> dict:
    """Returns all figures of a folder of results, except those of missing results."""
    theirs = reference(out / "mitsuba_reference")
    ours = reference(out / "glasshouse_reference")
    measured: dict[str, list[Pass]] = {}
    differences = {}
    if theirs:
        for folder in sorted([*out.glob("mitsuba_s*/"), *out.glob("cycles/")]):
            measured[folder.name] = passes(folder, theirs)
        cycles = reference(out / "cycles")
        if cycles:
            differences["Cycles, most samples, - Mitsuba"] = difference(cycles, theirs)
    if ours:
        measured["glasshouse"] = passes(out / "glasshouse", ours)
    measured = {name: found for name, found in measured.items() if found}
    if ours and theirs:
        differences["glasshouse - Mitsuba"] = difference(ours, theirs)
    return {"reference_noise": reference_noise(out / "mitsuba_reference") if theirs else {}, "references_differ": differences,
            "ladders": ladders(measured), "at_most_samples": at_most_samples(measured),
            "at_common_errors": at_common_errors(measured), "embree": embree_ratios(out / "embree"), "goals": GOALS}


def difference(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> dict[str, dict[str, float]]:
    """Returns, by layer, the mean of a - b, its RMS, and the RMS of its means over 16 x 16 px."""
    return {layer: {"mean": float((a[layer] - b[layer]).mean(dtype=np.float64)), "rms": rms(a[layer] - b[layer]),
                    "rms_16x16": block_rms(a[layer] - b[layer])} for layer in LAYERS}


def reference_noise(folder: Path) -> dict[str, float]:
    """Returns the recorded RMS noise of the reference with the most samples, by layer."""
    entries = sorted(entries_of(folder), key=lambda entry: entry["samples"])
    return {layer: entry["noise"] for entry in entries for layer in entry["layers"]}


def entries_of(folder: Path) -> list[dict]:
    """Returns the passes in a folder's result.json; none if the file does not exist."""
    path = folder / "result.json"
    return json.loads(path.read_text())["passes"] if path.is_file() else []


def at(found: list[Pass], samples: int) -> dict | None:
    """Returns a peer's four layers at a sample count; a layer with two passes takes the cheaper pass."""
    chosen = cheapest([p for p in found if p.samples == samples], None)
    return summary(chosen) if chosen else None


def ladders(measured: dict[str, list[Pass]]) -> dict[str, list[dict]]:
    """Returns every peer's cost and errors by sample count."""
    counts = {name: sorted({p.samples for p in found}) for name, found in measured.items()}
    return {name: [row for n in counts[name] if (row := at(found, n))] for name, found in measured.items()}


def at_most_samples(measured: dict[str, list[Pass]]) -> dict[str, dict | None]:
    """Compares each peer at its largest sample count with glasshouse at errors no larger in any layer."""
    rows = {}
    for name, found in measured.items():
        if name != "glasshouse" and "glasshouse" in measured:
            peer = at(found, max(p.samples for p in found))
            rows[name] = against(peer, measured["glasshouse"], peer["rmse"]) if peer else None
    return rows


def at_common_errors(measured: dict[str, list[Pass]]) -> dict:
    """Compares all at the errors of `mitsuba_stock` with the most samples; peers choose a count for each layer."""
    if not {"glasshouse", "mitsuba_stock"} <= set(measured):
        return {}
    most = max(p.samples for p in measured["mitsuba_stock"])
    stock = at(measured["mitsuba_stock"], most)
    if not stock:
        return {}
    targets = stock["rmse"]
    found: dict = {"targets": targets, "samples": most, "peers": {}}
    for name, all_passes in measured.items():
        if name != "glasshouse":
            chosen = cheapest(all_passes, {layer: e * PEER_TOLERANCE for layer, e in targets.items()})
            found["peers"][name] = against(summary(chosen), measured["glasshouse"], targets) if chosen else None
    return found


def embree_ratios(folder: Path) -> list[dict]:
    """Compares the kernel's rays per second with Embree's best, its best watertight and its best single-ray variant."""
    path, rows = folder / "result.json", []
    for entry in json.loads(path.read_text())["classes"] if path.is_file() else []:
        best = lambda keep: max((w for w in entry["ways"] if keep(w)), key=lambda w: w["mrays_per_s"])
        ways = {"best": best(lambda w: True), "best_robust": best(lambda w: w["robust"]),
                "best_single": best(lambda w: w["rays_a_call"] == "1")}
        ours = entry["kernel_mrays_per_s"]
        rows.append({"class": entry["name"], "kernel_mrays_per_s": ours, **ways,
                     "ratios": {k: ours / w["mrays_per_s"] if ours else None for k, w in ways.items()}})
    return rows


def markdown(result: dict) -> str:
    """Formats the tables."""
    text = ["# Peers, side by side\n", machine_text(result), "\n## Cost and error by samples\n",
            "CPU seconds of rendering the four layers, one thread; RMSE in linear light against each renderer's own reference.\n",
            "| | samples | CPU s | by pass | I | T | R~ | R |", "|---|---|---|---|---|---|---|---|"]
    for name, rows in result["ladders"].items():
        text += [ladder_row(name, row) for row in rows]
    text += ["\n## Ratios\n", "| peer | its samples | its CPU s | glasshouse's samples | CPU s | ratio | whole process | goal |",
             "|---|---|---|---|---|---|---|---|"]
    for name, row in result["at_most_samples"].items():
        text.append(ratio_row(name, row))
    common = result["at_common_errors"]
    if common:
        errors = ", ".join(f"{SYMBOLS[k]} {common['targets'][k]:.2e}" for k in LAYERS)
        text += [f"\nAll at the errors of `mitsuba_stock` with {common['samples']} samples ({errors}), each layer with as few "
                 "samples as possible:\n",
                 "| peer | its samples | its CPU s | glasshouse's samples | CPU s | ratio | whole process | goal |",
                 "|---|---|---|---|---|---|---|---|"]
        text += [ratio_row(name, row) for name, row in common["peers"].items()]
    text += embree_text(result["embree"])
    if result["reference_noise"]:
        text += ["\n## References\n", "| | I | T | R~ | R |", "|---|---|---|---|---|"]
        noise = " | ".join(f"{result['reference_noise'][k]:.1e}" for k in LAYERS)
        text.append(f"| noise of Mitsuba's reference, from its two halves | {noise} |")
    for pair, layers in result["references_differ"].items():
        for what in ("mean", "rms", "rms_16x16"):
            text.append(f"| {pair}, {what} | " + " | ".join(f"{layers[k][what]:.1e}" for k in LAYERS) + " |")
    return "\n".join(text) + "\n"


def machine_text(result: dict) -> str:
    """Describes the scene, the machine and the programs."""
    programs = "; ".join(f"{k}: {v}" for k, v in result.get("programs", {}).items())
    return f"Scene `{result.get('scene', '?')}`. {result.get('machine', '')}. {programs}."


def ladder_row(name: str, row: dict) -> str:
    """Formats a table row: a peer at one sample count."""
    samples = sorted(set(row["samples"].values()))
    parts = ", ".join(f"{'+'.join(SYMBOLS[k] for k in p['layers'])} {p['cpu_s']:.2f}" for p in row["passes"])
    whole = f" (process {row['process_cpu_s']:.2f})" if "process_cpu_s" in row else ""
    errors = " | ".join(f"{row['rmse'][k]:.2e}" if k in row["rmse"] else "-" for k in LAYERS)
    return f"| {name} | {samples[-1]} | {row['cpu_s']:.3f}{whole} | {parts if len(row['passes']) > 1 else ''} | {errors} |"


def ratio_row(name: str, row: dict | None) -> str:
    """Formats a table row: a peer compared with glasshouse."""
    if row is None:
        return f"| {name} | a target was not reached with the samples measured: raise --samples or --our-samples | | | | | | |"
    goal = next(value for prefix, value in GOALS.items() if name.startswith(prefix))
    count = lambda side: "/".join(str(n) for n in sorted(set(row[side]["samples"].values())))
    return (f"| {name} | {count('peer')} | {row['peer']['cpu_s']:.2f} | {count('glasshouse')} | {row['glasshouse']['cpu_s']:.3f} | "
            f"**{row['ratio']:.1f}** | {row['ratio_whole_process']:.1f} | {goal:.0f} |")


def embree_text(rows: list[dict]) -> list[str]:
    """Formats the table of intersection speeds."""
    if not rows:
        return []
    text = ["\n## Intersection alone, Mrays/s\n",
            "| rays | glasshouse | Embree's best | ratio | its best watertight | ratio | its best single rays | ratio "
            "| watertight: differ | miss |",
            "|---|---|---|---|---|---|---|---|---|---|"]
    show = lambda w: f"{w['mrays_per_s']:.1f} ({w['rays_a_call']}, {w['shape']}, {w['quality']})"
    for row in rows:
        ours, ratio = row["kernel_mrays_per_s"], row["ratios"]
        cells = " | ".join(f"{show(row[k])} | {f'**{ratio[k]:.1f}**' if ratio[k] else '?'}" for k in row["ratios"])
        robust = row["best_robust"]
        shares = f"{robust.get('differing_share', '?')} | {robust['missed_share']}"
        text.append(f"| {row['class']} | {f'{ours:.0f}' if ours else '?'} | {cells} | {shares} |")
    return text
