"""Renders with Mitsuba 3 in three set-ups: a user's with stock plugins, an expert's, and the reference.

stock      `path` through slabs of `dielectric` or `roughdielectric`, waved faces as meshes; T without glass, the camera moved forward by
           t (1 - 1/n), or through faces that only refract, if they have waves; R in a mirror.
split      a custom integrator: the slab in closed form, every order followed, Mitsuba traces the rays.
reference  `split` with more orders and many `multijitter` samples; Cycles is compared with it, too.

The sheets carry a black `conductor`: a black `diffuse` makes `path` sample the textured emitter at every hit, 4.6 times
the time for the same image. Rough faces would do so, too (3.7 times); the glass hides the sheets from them, so that `path` samples
a dark point light instead. Fresnel factors are averaged over polarisations at each face, as Mitsuba and Cycles do.
"""

from __future__ import annotations

import argparse
import glob
import os
import sys
from pathlib import Path

import numpy as np

import scene as scenes
from record import Record, cpu_s, timed

LLVM = ("/usr/lib/x86_64-linux-gnu/libLLVM.so.19*", "/usr/lib/llvm-19/lib/libLLVM*.so*", "/usr/lib/*/libLLVM.so.[12]*")
if "DRJIT_LIBLLVM_PATH" not in os.environ:
    found = [path for pattern in LLVM for path in sorted(glob.glob(pattern))]
    if not found:
        sys.exit("error: no LLVM for Mitsuba's compiler: apt install libllvm19, or set DRJIT_LIBLLVM_PATH")
    os.environ["DRJIT_LIBLLVM_PATH"] = found[0]
try:
    import drjit as dr
    import mitsuba as mi
except ImportError:
    sys.exit("error: Mitsuba is not installed: pip install mitsuba==3.9.1 numpy pillow")
mi.set_variant("llvm_ad_rgb")
mi.set_log_level(mi.LogLevel.Error)

BLACK = {"type": "conductor", "specular_reflectance": {"type": "rgb", "value": 0.0}}
SLAB_HALF_M = 2.0
# Strips of a waved face in a wave. Normals, which are exact at the edges, are 3e-4 of the largest slope off between them.
STRIPS_OF_WAVE = 64
REFERENCE_CHUNK = 256


def mesh(scene: scenes.Scene, side: str) -> mi.Mesh:
    """Makes a sheet that emits its photograph."""
    sheet = scenes.sheet(scene, side)
    photo = scene.front if side == "front" else scene.back
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(photo.radiance), "raw": True, "filter_type": "bilinear", "wrap_mode": "clamp"}
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(BLACK)
    properties["emitter"] = mi.load_dict({"type": "area", "radiance": texture, "sampling_weight": float(scene.is_smooth)})
    properties["face_normals"] = True
    shape = mi.Mesh(side, len(sheet.vertices_m), len(sheet.triangles), has_vertex_texcoords=True, props=properties)
    values = mi.traverse(shape)
    values["vertex_positions"] = sheet.vertices_m.ravel()
    values["vertex_texcoords"] = sheet.uv.ravel()
    values["faces"] = sheet.triangles.ravel()
    values.update()
    return shape


def sensor(scene: scenes.Scene, layer: str, sampler: str, spp: int, forward_m: float = 0.0) -> mi.Sensor:
    """Makes a thin lens, or a pinhole for R, at z = `forward_m` with the view along +z."""
    film = {"type": "hdrfilm", "width": scene.width, "height": scene.height, "pixel_format": "rgb",
            "component_format": "float32", "rfilter": {"type": "box"}}
    place = mi.ScalarTransform4f().look_at(origin=[0, 0, forward_m], target=[0, 0, 1], up=[0, -1, 0])
    camera = {"type": "perspective", "to_world": place, "fov": float(np.degrees(2 * np.arctan(scene.tan_half_x))),
              "fov_axis": "x", "near_clip": 0.001, "far_clip": 1e5, "film": film,
              "sampler": {"type": sampler, "sample_count": spp}}
    if layer != "clean_reflection":
        camera.update(type="thinlens", aperture_radius=scene.aperture_radius_m, focus_distance=scene.focus_distance_m)
    return mi.load_dict(camera)


class Refracting(mi.BSDF):
    """A smooth face of glass that only refracts, with weight 1: the virtual glass of T."""

    def __init__(self, props: mi.Properties) -> None:
        mi.BSDF.__init__(self, props)
        self.ior = props["int_ior"]
        self.m_components = [mi.BSDFFlags.DeltaTransmission | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide]
        self.m_flags = self.m_components[0]

    def sample(self, ctx, si, sample1, sample2, active=True):
        _, cos_t, _, eta_ti = mi.fresnel(mi.Frame3f.cos_theta(si.wi), self.ior)
        found = mi.BSDFSample3f()
        found.wo = mi.refract(si.wi, cos_t, eta_ti)
        found.eta, found.pdf, found.sampled_component = mi.Float(1.0), mi.Float(1.0), mi.UInt32(0)
        found.sampled_type = mi.UInt32(+mi.BSDFFlags.DeltaTransmission)
        return found, mi.Color3f(1.0) & active

    def eval(self, ctx, si, wo, active=True):
        return mi.Color3f(0.0)

    def pdf(self, ctx, si, wo, active=True):
        return mi.Float(0.0)

    def to_string(self) -> str:
        return f"Refracting[{self.ior}]"


mi.register_bsdf("refracting", Refracting)


def glass(pane: scenes.Pane) -> dict:
    """Returns the material of a pane."""
    index = {"int_ior": pane.ior, "ext_ior": 1.0}
    if pane.roughness:
        return {"type": "roughdielectric", "distribution": "beckmann", "alpha": pane.roughness, **index}
    return {"type": "dielectric", **index}


def face(pane: scenes.Pane, depth_m: float, outwards: int, bsdf: dict) -> mi.Mesh:
    """Makes a face of a pane with its waves; `outwards` is the sign of its normal's z."""
    waves = int(np.ceil(2 * SLAB_HALF_M / pane.wave_length_m))
    x = np.linspace(-SLAB_HALF_M, SLAB_HALF_M, waves * STRIPS_OF_WAVE + 1)
    height, slope = pane.wave(x)
    points = np.stack([np.stack([x, np.full_like(x, y), pane.near_m + depth_m + height], -1) for y in (-SLAB_HALF_M, SLAB_HALF_M)])
    normals = np.stack([-slope, np.zeros_like(x), np.ones_like(x)], -1) * outwards
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    a, n = np.arange(len(x) - 1), len(x)
    triangles = np.concatenate([np.stack([a, a + 1, a + n], 1), np.stack([a + 1, a + n + 1, a + n], 1)])
    triangles = triangles if outwards > 0 else triangles[:, ::-1]
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    shape = mi.Mesh("face", 2 * n, len(triangles), has_vertex_normals=True, props=properties)
    values = mi.traverse(shape)
    values["vertex_positions"] = points.astype(np.float32).ravel()
    values["vertex_normals"] = np.concatenate([normals, normals]).astype(np.float32).ravel()
    values["faces"] = np.ascontiguousarray(triangles).astype(np.uint32).ravel()
    values.update()
    return shape


def slab(pane: scenes.Pane, bsdf: dict) -> list:
    """Returns the shapes of a pane."""
    if pane.wave_m:
        return [face(pane, 0.0, -1, bsdf), face(pane, pane.thickness_m, 1, bsdf)]
    half = pane.thickness_m / 2
    place = mi.ScalarTransform4f().translate([0, 0, pane.near_m + half]).scale([SLAB_HALF_M, SLAB_HALF_M, half])
    return [{"type": "cube", "to_world": place, "bsdf": bsdf}]


def moves_camera(scene: scenes.Scene, layer: str) -> bool:
    """True if T is rendered without glass: flat faces only move the camera."""
    return layer == "transmission" and not any(pane.wave_m for pane in scene.panes)


def stock_scene(scene: scenes.Scene, layer: str) -> mi.Scene:
    """Makes the sheets of a layer, with real glass (I, R~), a mirror (R), and faces that only refract or nothing (T)."""
    parts: dict = {"type": "scene"}
    if not scene.is_smooth:
        parts["dark"] = {"type": "point", "position": [0, 0, 0], "intensity": 0.0}
    if layer in ("input", "transmission"):
        parts["front"] = mesh(scene, "front")
    if layer != "transmission":
        parts["back"] = mesh(scene, "back")
    shapes = []
    if layer == "clean_reflection":
        mirror, pane = {"type": "conductor", "material": "none"}, scene.panes[0]
        place = mi.ScalarTransform4f().translate([0, 0, pane.near_m]).rotate([0, 1, 0], 180).scale([SLAB_HALF_M, SLAB_HALF_M, 1])
        flat = {"type": "rectangle", "to_world": place, "bsdf": mirror}
        shapes = [face(pane, 0.0, -1, mirror) if pane.wave_m else flat]
    elif not moves_camera(scene, layer):
        for pane in scene.panes:
            shapes += slab(pane, {"type": "refracting", "int_ior": pane.ior} if layer == "transmission" else glass(pane))
    parts.update({f"glass_{k}": shape for k, shape in enumerate(shapes)})
    return mi.load_dict(parts)


class SlabSplit(mi.SamplingIntegrator):
    """The slab in closed form (docs/physics.md): traces every order up to a count, without random choices."""

    def __init__(self, scene: scenes.Scene, layer: str, front: mi.Scene, back: mi.Scene, orders: tuple[int, int]) -> None:
        super().__init__(mi.Properties())
        self.scene, self.layer, self.front, self.back = scene, layer, front, back
        self.transmitted, self.reflected = orders

    def radiance(self, sheet: mi.Scene, origin, direction, active):
        """Returns the sheet's radiance where the ray hits it; nothing is between the pane and a sheet."""
        hit = sheet.ray_intersect(mi.Ray3f(origin, direction), ray_flags=+mi.RayFlags.UV, coherent=True, active=active)
        active &= hit.is_valid()
        return hit.emitter(sheet, active).eval(hit, active)

    def sample(self, scene, sampler, ray, medium=None, active=True):
        n, h, d = self.scene.ior, self.scene.thickness_m, ray.d
        at_pane = ray.o + d * ((self.scene.glass_distance_m - ray.o.z) / d.z)
        cos_t = dr.sqrt(1 - (1 - d.z * d.z) / (n * n))
        s, p = (d.z - n * cos_t) / (d.z + n * cos_t), (n * d.z - cos_t) / (n * d.z + cos_t)
        r = 0.5 * (s * s + p * p)
        step = mi.Vector3f(d.x, d.y, 0) * (h / (n * cos_t))
        total = mi.Spectrum(0.0)
        if self.layer in ("input", "transmission"):
            for k in range(1 if self.layer == "transmission" else self.transmitted):
                weight = 1.0 if self.layer == "transmission" else (1 - r) * (1 - r) * r ** (2 * k)
                origin = at_pane + step * (2 * k + 1) + mi.Vector3f(0, 0, h)
                total += weight * self.radiance(self.front, origin, d, active)
        if self.layer != "transmission":
            back = mi.Vector3f(d.x, d.y, -d.z)
            for k in range(1 if self.layer == "clean_reflection" else self.reflected):
                weight = r if k == 0 else (1 - r) * (1 - r) * r ** (2 * k - 1)
                if self.layer == "clean_reflection":
                    weight = 1.0
                total += weight * self.radiance(self.back, at_pane + step * (2 * k), back, active)
        return total, mi.Bool(True), []


def stock_set_up(scene: scenes.Scene, layer: str) -> tuple[mi.Scene, mi.Integrator, float]:
    """Returns scene and integrator of Mitsuba's own plugins, and the camera's move."""
    # rr_depth: no path ends by chance.
    path = mi.load_dict({"type": "path", "max_depth": 8 * len(scene.panes), "rr_depth": 100})
    return stock_scene(scene, layer), path, scene.focus_shift_m if moves_camera(scene, layer) else 0.0


def stock(scene: scenes.Scene, record: Record, samples: list[int], sampler: str) -> None:
    """Measures Mitsuba's own plugins."""
    for layer in scenes.LAYERS:
        todo = [spp for spp in samples if not record.has(layer, spp)]
        if not todo:
            continue
        (world, path, forward_m), build_s = cpu_s(lambda: stock_set_up(scene, layer))
        for spp in todo:
            measure(record, layer, sampler, spp, world, path, sensor(scene, layer, sampler, spp, forward_m), build_s)


def split(scene: scenes.Scene, record: Record, samples: list[int], sampler: str) -> None:
    """Measures the expert's integrator, with the orders that matter (the rest is below 1e-5)."""
    if all(record.has(layer, spp) for layer in scenes.LAYERS for spp in samples):
        return
    (front, back), build_s = cpu_s(lambda: sheets(scene))
    for layer in scenes.LAYERS:
        integrator = SlabSplit(scene, layer, front, back, (2, 3))
        for spp in samples:
            if not record.has(layer, spp):
                measure(record, layer, sampler, spp, front, integrator, sensor(scene, layer, sampler, spp), build_s)


def sheets(scene: scenes.Scene) -> tuple[mi.Scene, mi.Scene]:
    """Makes a separate scene of each sheet."""
    front, back = (mi.load_dict({"type": "scene", "sheet": mesh(scene, side)}) for side in ("front", "back"))
    return front, back


def measure(record: Record, layer: str, sampler: str, spp: int, world, integrator, camera, build_s: float) -> None:
    """Measures one layer at one sample count."""
    if camera.sampler().sample_count() != spp:
        print(f"{record.folder.name}: {sampler} cannot take {spp} samples: left out", flush=True)
        return
    render = lambda seed: np.array(mi.render(world, sensor=camera, integrator=integrator, spp=spp, seed=seed))
    image, figures = timed(render, warm_up=True)
    record.add(layer, spp, {layer: image}, build_cpu_s=build_s, **figures)


def reference(scene: scenes.Scene, record: Record, spp: int) -> None:
    """Renders many samples in chunks, by `split` or, if the pane is not plain, by `stock`; the noise is half the RMS difference between even and odd
    chunks."""
    chunks = max(2, spp // REFERENCE_CHUNK)
    each = spp // chunks
    if all(record.has(layer, spp) for layer in scenes.LAYERS):
        return
    front, back = sheets(scene) if scene.is_plain else (None, None)
    for layer in scenes.LAYERS:
        if record.has(layer, spp):
            continue
        if scene.is_plain:
            world, integrator, forward_m = front, SlabSplit(scene, layer, front, back, (3, 4)), 0.0
        else:
            world, integrator, forward_m = stock_set_up(scene, layer)
        camera = sensor(scene, layer, "multijitter", each, forward_m)
        halves = np.zeros((2, scene.height, scene.width, 3))

        def render_all() -> None:
            for k in range(chunks):
                halves[k % 2] += np.array(mi.render(world, sensor=camera, integrator=integrator, spp=each, seed=1000 + k))

        _, seconds = cpu_s(render_all)
        halves /= chunks / 2
        noise = float(np.sqrt(((halves[0] - halves[1]) ** 2).mean()) / 2)
        record.add(layer, spp, {layer: halves.mean(0)}, cpu_s=seconds, noise=noise)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder with a scene.json")
    parser.add_argument("--set-up", choices=("stock", "split", "reference"), required=True)
    parser.add_argument("--out", type=Path, required=True, help="folder for result.json and the layers")
    parser.add_argument("--samples", type=lambda t: [int(n) for n in t.split(",")], default=[16, 64, 256])
    parser.add_argument("--sampler", default="ldsampler", help="ldsampler (default), multijitter, independent, orthogonal")
    args = parser.parse_args()
    dr.set_thread_count(1)
    scene = scenes.load(args.scene, only_plain=args.set_up == "split")
    sampler = "multijitter" if args.set_up == "reference" else args.sampler
    record = Record(args.out, program=f"Mitsuba {mi.__version__}, {mi.variant()}", set_up=args.set_up, sampler=sampler)
    if args.set_up == "reference":
        reference(scene, record, args.samples[-1])
    else:
        (stock if args.set_up == "stock" else split)(scene, record, args.samples, args.sampler)


if __name__ == "__main__":
    main()
