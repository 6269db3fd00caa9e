"""Reads a scene file (glasshouse.scene/1) for the peers: radiance, sheets of triangles, camera and glass.

World: lens centre at the origin, +x image right, +y image down, +z into the front scene; metres. See docs/physics.md.
Accepts only scenes that some peer can render: an untilted pane without absorption, depth along z, no holes, box filter. The pane may have several
layers, waves across x, and rough faces; only Mitsuba's stock set-up renders these.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

LAYERS = ("input", "transmission", "glass_reflection", "clean_reflection")
SYMBOLS = {"input": "I", "transmission": "T", "glass_reflection": "R~", "clean_reflection": "R"}


class SceneError(Exception):
    """A scene that some peer cannot render; the message names the necessary change."""


@dataclass(frozen=True)
class Photograph:
    """Linear radiance (H,W,3) and depth along z (H,W), both float32, with the intrinsics of the pinhole camera, px."""

    radiance: np.ndarray
    depth_m: np.ndarray
    fx: float
    fy: float
    cx: float
    cy: float


@dataclass(frozen=True)
class Sheet:
    """A photograph as triangles in the world.

    `uv` counts v downwards, from the image's top left corner; the winding makes normals face the capture camera.
    """

    vertices_m: np.ndarray
    uv: np.ndarray
    triangles: np.ndarray


@dataclass(frozen=True)
class Pane:
    """A pane of glass whose faces have the height `wave_m` sin(2 pi x / `wave_length_m`) along z; `roughness` is Beckmann's alpha."""

    near_m: float
    thickness_m: float
    ior: float
    roughness: float
    wave_m: float
    wave_length_m: float

    @property
    def is_plain(self) -> bool:
        """True for a flat, smooth pane."""
        return self.roughness == 0 and self.wave_m == 0

    def wave(self, x_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns height and slope of the faces."""
        k = 2 * np.pi / self.wave_length_m
        return self.wave_m * np.sin(k * x_m), self.wave_m * k * np.cos(k * x_m)


@dataclass(frozen=True)
class Scene:
    """Film, lens, pane and the two photographs of one scene."""

    folder: Path
    line: dict
    width: int
    height: int
    tan_half_x: float
    aperture_radius_m: float
    focus_distance_m: float
    glass_distance_m: float
    panes: tuple[Pane, ...]
    front: Photograph
    back: Photograph
    back_apex_m: np.ndarray

    @property
    def is_plain(self) -> bool:
        """True behind a single flat, smooth pane."""
        return len(self.panes) == 1 and self.panes[0].is_plain

    @property
    def is_smooth(self) -> bool:
        """True if no face is rough."""
        return not any(pane.roughness for pane in self.panes)

    @property
    def thickness_m(self) -> float:
        """Returns the thickness of the first pane."""
        return self.panes[0].thickness_m

    @property
    def ior(self) -> float:
        """Returns the index of refraction of the first pane."""
        return self.panes[0].ior

    @property
    def focus_shift_m(self) -> float:
        """Returns the distance by which flat panes bring objects behind them nearer along the axis: sum of t (1 - 1/n)."""
        return sum(pane.thickness_m * (1.0 - 1.0 / pane.ior) for pane in self.panes)


def load(folder: Path, only_plain: bool = False) -> Scene:
    """Reads FOLDER/scene.json and its photographs; refuses panes that are not `only_plain`, if a peer renders no others."""
    path = folder / "scene.json"
    if not path.is_file():
        raise SceneError(f"{path} is missing: give a folder with a scene.json (README.md has the commands that make one)")
    line = json.loads(path.read_text())
    check(line)
    front, back = (photograph(folder, line[side]) for side in ("front", "back"))
    film, glass = line["film"], line["glass"]
    diagonal = np.hypot(film["width"], film["height"])
    scene = Scene(
        folder=folder,
        line=line,
        width=film["width"],
        height=film["height"],
        tan_half_x=float(np.hypot(36, 24) / (2 * line["camera"]["focal_length_mm"]) * film["width"] / diagonal),
        aperture_radius_m=line["camera"]["aperture_radius_m"],
        focus_distance_m=focus_distance_m(line, front),
        glass_distance_m=glass["distance_m"],
        panes=panes(glass),
        front=front,
        back=back,
        back_apex_m=np.array([0.0, 0.0, 0.0 if apex(line) == "camera" else 2 * glass["distance_m"]]),
    )
    check_clearance(scene)
    if only_plain and not scene.is_plain:
        raise SceneError("this peer renders a single flat, smooth pane only")
    return scene


def panes(glass: dict) -> tuple[Pane, ...]:
    """Returns the panes of glass of a scene, from the camera outwards."""
    if other := set(glass) - {"distance_m", "tilt_deg", "thickness_m", "ior", "absorption_per_m", "layers", "glazing", "roughness", "wave"}:
        raise SceneError(f"no peer renders glass with {', '.join(sorted(other))}")
    wave = glass.get("wave", {"amplitude_m": 0.0, "length_m": 1.0})
    if wave.get("direction_deg", 0.0) != 0.0:
        raise SceneError("the peers take waves across x: leave out direction_deg")
    near_m, found = glass["distance_m"], []
    for layer in glass.get("layers", [{"glass_m": glass.get("thickness_m"), "ior": glass.get("ior")}]):
        if other := set(layer) - {"glass_m", "gap_m", "ior"}:
            raise SceneError(f"the peers take layers without {', '.join(sorted(other))}")
        if "glass_m" in layer:
            found.append(Pane(near_m, layer["glass_m"], layer["ior"], glass.get("roughness", 0.0), wave["amplitude_m"], wave["length_m"]))
        near_m += layer["glass_m"] if "glass_m" in layer else layer["gap_m"]
    return tuple(found)


def apex(line: dict) -> str:
    """Returns the position of the back photograph's camera: `mirror` or `camera`."""
    return line["back"].get("apex", "mirror")


def check(line: dict) -> None:
    """Raises an error if some peer cannot render the scene."""
    glass = line["glass"]
    if any(glass.get("tilt_deg", [0, 0])) or any(glass.get("absorption_per_m", [0, 0, 0])):
        raise SceneError("the peers take an untilted pane without absorption: set tilt_deg and absorption_per_m to 0")
    if line["film"].get("filter", "box") != "box":
        raise SceneError('the peers take the box filter: set film.filter to "box"')
    for side in ("front", "back"):
        if "mesh" in line[side]:
            raise SceneError(f"{side} is a mesh: the peers take photographs, a color PNG and a depth .npy")
        if "mask" in line[side] or line[side].get("depth_kind", "z") != "z":
            raise SceneError(f"{side} has a mask or depth along the ray: make the folder with export_scene.py, which fills holes")


def photograph(folder: Path, entry: dict) -> Photograph:
    """Decodes a color PNG and a depth .npy."""
    from PIL import Image

    codes = np.asarray(Image.open(folder / entry["color"]).convert("RGB"), np.float64) / 255
    linear = codes
    if entry["transfer"] == "srgb":
        linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    depth_m = np.load(folder / entry["depth"]).astype(np.float32).squeeze() * np.float32(entry.get("depth_unit_m", 1.0))
    if not (np.isfinite(depth_m) & (depth_m > 0)).all():
        raise SceneError(f"{entry['depth']} has holes: make the folder with export_scene.py, which fills them")
    k = entry["intrinsics"]
    radiance = (linear * entry.get("exposure", 1.0)).astype(np.float32)
    return Photograph(radiance, depth_m, k["fx"], k["fy"], k["cx"], k["cy"])


def focus_distance_m(line: dict, front: Photograph) -> float:
    """Returns the given distance, or for `front_center` the mean depth of the four centre pixels."""
    focus = line["camera"]["focus"]
    if "distance_m" in focus:
        return float(focus["distance_m"])
    h, w = front.depth_m.shape
    return float(front.depth_m[h // 2 - 1 : h // 2 + 1, w // 2 - 1 : w // 2 + 1].astype(np.float64).mean())


def check_clearance(scene: Scene) -> None:
    """Refuses sheets between lens and pane: a path tracer hits them there, but in glasshouse the pane clips nothing."""
    last = scene.panes[-1]
    if scene.front.depth_m.min() <= last.near_m + last.thickness_m + last.wave_m:
        raise SceneError("part of the front sheet is nearer than the pane: choose another scene")
    if scene.back.depth_m.min() <= scene.back_apex_m[2]:
        raise SceneError("part of the back sheet is in front of the lens: choose another scene")


def sheet(scene: Scene, side: str) -> Sheet:
    """Makes one vertex per pixel centre and two triangles per quad, split along the diagonal (i+1,j)-(i,j+1)."""
    photo = scene.front if side == "front" else scene.back
    h, w = photo.depth_m.shape
    j, i = np.meshgrid(np.arange(h), np.arange(w), indexing="ij")
    z = photo.depth_m.astype(np.float64)
    points = np.stack([(i + 0.5 - photo.cx) / photo.fx * z, (j + 0.5 - photo.cy) / photo.fy * z, z], -1).reshape(-1, 3)
    apex_m = np.zeros(3)
    if side == "back":
        apex_m = scene.back_apex_m
        points = points * [-1, 1, -1] + apex_m
    uv = np.stack([(i + 0.5) / w, (j + 0.5) / h], -1).reshape(-1, 2).astype(np.float32)
    a = (j * w + i)[:-1, :-1].ravel()
    triangles = np.concatenate([np.stack([a, a + 1, a + w], 1), np.stack([a + 1, a + w + 1, a + w], 1)]).astype(np.uint32)
    p = points[triangles[0]]
    if np.dot(np.cross(p[1] - p[0], p[2] - p[0]), apex_m - p.mean(0)) < 0:
        triangles = np.ascontiguousarray(triangles[:, ::-1])
    return Sheet(points.astype(np.float32), uv, triangles)


def digest(folder: Path) -> str:
    """Returns the SHA-256 of scene.json and of the photographs' bytes."""
    text = (folder / "scene.json").read_bytes()
    total = hashlib.sha256(text)
    line = json.loads(text)
    for side in ("front", "back"):
        for key in ("color", "depth"):
            total.update((folder / line[side][key]).read_bytes())
    return total.hexdigest()
