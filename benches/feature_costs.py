#!/usr/bin/env python3
"""Measures the cost of each feature: CPU seconds of a scene with it over those of a plain scene, as a Markdown table.

    cargo build --release
    benches/feature_costs.py [--rounds 5] [--spp 256] [--only NAME] [--glasshouse FILE] [--against OTHER_BUILD]

The plain scene has two procedural photographs of 1024 x 768 px (`glasshouse sample`), 256 x 256 px, --spp samples, the
paper's lens and pane, and apex `mirror`. Each row changes only the setting in its name. Every round renders all rows
once, with one thread; figures are medians of the rounds:

- trace: user and system seconds of `render -j 1`, minus those of `render -n` (which reads, decodes and stops), minus
  the shortest wall time of writing the images. CPU seconds, because machines are shared.
- ratio: the median over that of the plain scene; in brackets, minimum and maximum of the rounds over the latter.
- files: user and system seconds of `render -n`.

`--against` adds a row: the plain scene with another build of the program (such as one without a feature). The script
needs only Python 3.9, on Linux or macOS.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import statistics
import struct
import subprocess
import tempfile
import zlib
from array import array
from pathlib import Path

INTRINSICS = {"fx": 886.81, "fy": 927.06, "cx": 512.0, "cy": 384.0, "size": [1024, 768]}
LAYERS = ["input", "transmission", "glass_reflection", "clean_reflection"]

PANE = {"glass_m": 0.004, "ior": 1.52}
FRAME = {"x_m": [-0.06, 0.065], "y_m": [-0.055, 0.06], "frame_m": 0.012, "frame_radiance": [0.3, 0.25, 0.2]}
CARD = {"color": "card.png", "distance_m": 0.1, "center_m": [0.02, 0.05], "width_m": 0.2}
SMUDGES = {"seed": 7, "coverage": 0.3, "mark_m": 0.05, "roughness": 0.05, "haze": 0.5, "transmittance": 0.95}
COATING = {"face": 1, "reflectance": [0.12, 0.06, 0.16], "transmittance": [0.8, 0.86, 0.78]}
# The coating of the glazing `double-low-e` (docs/glass.md).
LOW_E = {
    "face": 1,
    "angles_deg": [0, 20, 40, 55, 65, 75, 82, 90],
    "reflectance": [[0.0745, 0.0332, 0.0301], [0.0793, 0.0352, 0.0282], [0.1013, 0.0496, 0.0336], [0.1501, 0.0914, 0.0717],
                    [0.2227, 0.16, 0.1453], [0.3677, 0.3045, 0.3061], [0.5513, 0.4971, 0.5185], [1, 1, 1]],
    "reflectance_back": [[0.0761, 0.0317, 0.0255], [0.0813, 0.034, 0.0238], [0.1053, 0.0504, 0.0301], [0.159, 0.097, 0.0707],
                         [0.2394, 0.1733, 0.1483], [0.4004, 0.3343, 0.3175], [0.6039, 0.5485, 0.5409], [1, 1, 1]],
    "transmittance": [[0.8908, 0.9354, 0.9537], [0.8855, 0.9328, 0.955], [0.8615, 0.916, 0.9481], [0.8089, 0.87, 0.9076],
                      [0.7309, 0.7957, 0.8314], [0.5756, 0.6402, 0.6658], [0.38, 0.4339, 0.4477], [0, 0, 0]],
}

# Name of each row, and the scene line's values that it changes, by dotted key.
ROWS: list[tuple[str, dict]] = [
    ("plain", {}),
    ("plain again (noise)", {}),
    ("no lens: `aperture_radius_m` 0", {"camera.aperture_radius_m": 0.0}),
    ("aperture four times as wide", {"camera.aperture_radius_m": 0.03572}),
    ("tilt of 30 degrees", {"glass.tilt_deg": [0, 30]}),
    ("absorption", {"glass.absorption_per_m": [4.0, 1.0, 2.0]}),
    ("apex `camera`", {"back.apex": "camera"}),
    ("filter `gaussian`", {"film.filter": "gaussian"}),
    ("pane of 40 mm", {"glass.thickness_m": 0.04}),
    ("double pane, 4-16-4 mm", {"glass.layers": [PANE, {"gap_m": 0.016}, PANE]}),
    ("double pane, tilt of 30 degrees", {"glass.layers": [PANE, {"gap_m": 0.016}, PANE], "glass.tilt_deg": [0, 30]}),
    ("double pane, a coating of colour", {"glass.layers": [PANE, {"gap_m": 0.016}, PANE], "glass.coatings": [COATING]}),
    ("outline with a frame", {"glass.outline": FRAME}),
    ("card behind the camera", {"back.cards": [CARD]}),
    ("outline, frame and card", {"glass.outline": FRAME, "back.cards": [CARD]}),
    ("bent pane, radius of 8 m", {"glass.bow_radius_m": 8.0}),
    ("waves of 0.1 mm over 0.3 m", {"glass.wave": {"amplitude_m": 1e-4, "length_m": 0.3}}),
    ("wedge of 0.1 degrees", {"glass.layers": [{**PANE, "wedge_deg": [0, 0.1]}]}),
    ("waves and wedge", {"glass.layers": [{**PANE, "wedge_deg": [0, 0.1]}], "glass.wave": {"amplitude_m": 1e-4, "length_m": 0.3}}),
    ("double low-E", {"glass.layers": [PANE, {"gap_m": 0.016}, PANE], "glass.coatings": [LOW_E]}),
    ("double pane, wedge of 0.1 degrees", {"glass.layers": [PANE, {"gap_m": 0.016, "wedge_deg": [0, 0.1]}, PANE]}),
    ("rough faces, alpha of 0.003", {"glass.roughness": 0.003}),
    ("rough faces, alpha of 0.02", {"glass.roughness": 0.02}),
    ("smudges on 0.3 of the pane", {"glass.smudges": SMUDGES}),
    ("light of 16 times white, both sides", {"front.exposure": 16.0, "back.exposure": 16.0}),
    ("`order_tolerance` 0 (all orders, all samples)", {"film.order_tolerance": 0.0}),
    ("`layers`: T", {"film.layers": LAYERS[1:2]}),
    ("`layers`: T, R", {"film.layers": [LAYERS[1], LAYERS[3]]}),
    ("`layers`: I, T", {"film.layers": LAYERS[:2]}),
    ("`layers`: all four, written out", {"film.layers": LAYERS}),
    ("`target_error` 2e-3", {"film.target_error": 2e-3, "film.spp": 4096}),
    ("`target_error` 1e-3", {"film.target_error": 1e-3, "film.spp": 4096}),
    ("meshes of 1.57 million triangles, same shapes", {"front": "mesh", "back": "mesh"}),
]


def cpu_seconds(command: list[str]) -> tuple[float, str]:
    """Runs a child process; returns its user and system seconds, and its stdout."""
    with tempfile.TemporaryFile() as out:
        child = subprocess.Popen(command, stdout=out, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        text = out.read().decode()
    if child.returncode != 0:
        raise SystemExit(f"{' '.join(command)} ended with {child.returncode}: {text}")
    return usage.ru_utime + usage.ru_stime, text


def read_npy(path: Path) -> tuple[list[int], array]:
    """Returns shape and values of a little-endian f4 .npy."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<H", data, 8)
    header = ast.literal_eval(data[10 : 10 + length].decode())
    assert header["descr"] == "<f4", header
    values = array("f")
    values.frombytes(data[10 + length :])
    return list(header["shape"]), values


def write_mesh(photograph: dict, folder: Path, path: Path) -> None:
    """Writes the sheet of a photograph (`fill` `far`) as a PLY with a black and white checkerboard as its colours."""
    (rows, columns, *_), depth = read_npy(folder / photograph["depth"])
    _, mask = read_npy(folder / photograph["mask"])
    valid = [z for z, m in zip(depth, mask) if m > 0 and 0 < z < float("inf")]
    far = max(valid)
    k = INTRINSICS
    out = bytearray(
        f"ply\nformat binary_little_endian 1.0\nelement vertex {rows * columns}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        f"element face {(rows - 1) * (columns - 1) * 2}\nproperty list uchar int vertex_indices\nend_header\n".encode()
    )
    for j in range(rows):
        for i in range(columns):
            at = j * columns + i
            z = depth[at] if mask[at] > 0 and 0 < depth[at] < float("inf") else far
            grey = 255 * ((i // 16 + j // 16) % 2)
            x, y = (i + 0.5 - k["cx"]) / k["fx"] * z, (j + 0.5 - k["cy"]) / k["fy"] * z
            out += struct.pack("<fffBBB", x, y, z, grey, grey, grey)
    for j in range(rows - 1):
        for i in range(columns - 1):
            a = j * columns + i
            b, c, d = a + 1, a + columns, a + columns + 1
            out += struct.pack("<BiiiBiii", 3, a, b, c, 3, b, d, c)
    path.write_bytes(out)


def write_card(path: Path) -> None:
    """Writes a grey disc with a soft edge as a PNG with alpha."""
    size = 256
    rows = bytearray()
    for j in range(size):
        rows.append(0)
        for i in range(size):
            beyond = ((i - 127.5) ** 2 + (j - 127.5) ** 2) ** 0.5 - 110
            rows += bytes([60, 50, 45, round(255 * min(max(0.5 - beyond / 8, 0), 1))])

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", size, size, 8, 6, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def scene_line(folder: Path, color: list[str], spp: int, changes: dict) -> dict:
    """Returns the plain scene with `changes`."""

    def photograph(path: str) -> dict:
        stem = path.removesuffix(".png")
        names = {"color": path, "depth": f"{stem}_depth.npy", "mask": f"{stem}_depth_mask.npy"}
        return {**names, "fill": "far", "intrinsics": INTRINSICS}

    line = {
        "schema": "glasshouse.scene/1",
        "id": "scene",
        "seed": 1,
        "film": {"width": 256, "height": 256, "spp": spp},
        "camera": {"focal_length_mm": 55.0, "aperture_radius_m": 0.00893, "focus": {"at": "front_center"}},
        "glass": {"distance_m": 0.3, "thickness_m": 0.01, "ior": 1.6},
        "front": photograph(color[0]),
        "back": photograph(color[1]),
    }
    for key, value in changes.items():
        if value == "mesh":
            mesh = folder / f"{key}.ply"
            if not mesh.is_file():
                write_mesh(line[key], folder, mesh)
            line[key] = {"mesh": mesh.name}
        else:
            part, name = key.split(".")
            line[part][name] = value
    if "layers" in line["glass"]:
        del line["glass"]["thickness_m"], line["glass"]["ior"]
    return line


def main() -> None:
    """Makes the scenes, measures them round by round and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    root = Path(__file__).resolve().parent.parent
    parser.add_argument("--glasshouse", type=Path, default=root / "target/release/glasshouse")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel")
    parser.add_argument("--only", action="append", default=[], help="rows with this text in their name (repeatable)")
    parser.add_argument("--against", type=Path, help="another build of the program")
    args = parser.parse_args()
    wanted = [r for r in ROWS if r[0] == "plain" or not args.only or any(o in r[0] for o in args.only)]
    rows = [(name, changes, args.glasshouse) for name, changes in wanted]
    if args.against:
        rows.append(("plain, the other build", {}, args.against))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        _, made = cpu_seconds([str(args.glasshouse), "sample", str(folder), "--count", "2", "--json"])
        color = json.loads(made)["color"]
        trace: list[list[float]] = [[] for _ in rows]
        files: list[list[float]] = [[] for _ in rows]
        records: list[dict] = [{} for _ in rows]
        written = [float("inf")] * len(rows)
        used: list[list[float]] = [[] for _ in rows]
        write_card(folder / "card.png")
        for k, (_, changes, _) in enumerate(rows):
            (folder / f"{k}.json").write_text(json.dumps(scene_line(folder, color, args.spp, changes)))
        for turn in range(args.rounds + 1):
            # Each round begins with a different row, so that no row always runs first.
            for k in [(turn + k) % len(rows) for k in range(len(rows))]:
                program = rows[k][2]
                command = [str(program), "render", str(folder / f"{k}.json"), "--out", str(folder / "out"), "-j", "1", "--json"]
                load, _ = cpu_seconds([*command, "-n"])
                all_of_it, text = cpu_seconds(command)
                records[k] = json.loads(text)
                written[k] = min(written[k], records[k]["seconds"]["write"])
                if turn > 0:  # The first round only warms the file cache.
                    files[k].append(load)
                    used[k].append(all_of_it - load)
        for k in range(len(rows)):
            trace[k] = [seconds - written[k] for seconds in used[k]]
    print("| scene | trace, CPU s | ratio (least, most) | files, CPU s | samples of I, T, R~, R | stated error of I, R~ |")
    print("|---|---|---|---|---|---|")
    for k, (name, _, _) in enumerate(rows):
        plain = statistics.median(trace[0])
        ratios = [seconds / plain for seconds in trace[k]]
        layers = records[k]["layers"]
        counts = [layers[n].get("mean_samples", layers[n]["samples"]) if n in layers else None for n in LAYERS]
        samples = ", ".join("-" if n is None else f"{n:.0f}" for n in counts)
        errors = ", ".join(f"{layers[n]['error_rms']:.1e}" if n in layers else "-" for n in LAYERS[0::2])
        print(
            f"| {name} | {statistics.median(trace[k]):.3f} | {statistics.median(ratios):.2f} "
            f"({min(ratios):.2f}, {max(ratios):.2f}) | {statistics.median(files[k]):.3f} | {samples} | {errors} |"
        )


if __name__ == "__main__":
    main()
