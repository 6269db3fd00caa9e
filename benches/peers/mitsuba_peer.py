"""Renders with Mitsuba 3 in three set-ups: a user's with stock plugins, an expert's, and the reference.

stock      `path` through a slab of `dielectric`; T without glass, the camera moved forward by t (1 - 1/n); R in a mirror.
split      a custom integrator: the slab in closed form, every order followed, Mitsuba traces the rays.
reference  `split` with more orders and many `multijitter` samples; Cycles is compared with it, too.

The sheets carry a black `conductor`: a black `diffuse` makes `path` sample the textured emitter at every hit, 4.6 times
the time for the same image. Fresnel factors are averaged over polarisations at each face, as Mitsuba and Cycles do.
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
REFERENCE_CHUNK = 256


def mesh(scene: scenes.Scene, side: str) -> mi.Mesh:
    """Makes a sheet that emits its photograph."""
    sheet = scenes.sheet(scene, side)
    photo = scene.front if side == "front" else scene.back
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(photo.radiance), "raw": True, "filter_type": "bilinear", "wrap_mode": "clamp"}
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(BLACK)
    properties["emitter"] = mi.load_dict({"type": "area", "radiance": texture})
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


def stock_scene(scene: scenes.Scene, layer: str) -> mi.Scene:
    """Makes the sheets of a layer, with real glass (I, R~), a mirror (R) or nothing (T)."""
    parts: dict = {"type": "scene"}
    if layer in ("input", "transmission"):
        parts["front"] = mesh(scene, "front")
    if layer != "transmission":
        parts["back"] = mesh(scene, "back")
    move = mi.ScalarTransform4f()
    if layer in ("input", "glass_reflection"):
        half = scene.thickness_m / 2
        place = move.translate([0, 0, scene.glass_distance_m + half]).scale([SLAB_HALF_M, SLAB_HALF_M, half])
        glass = {"type": "dielectric", "int_ior": scene.ior, "ext_ior": 1.0}
        parts["slab"] = {"type": "cube", "to_world": place, "bsdf": glass}
    elif layer == "clean_reflection":
        place = move.translate([0, 0, scene.glass_distance_m]).rotate([0, 1, 0], 180).scale([SLAB_HALF_M, SLAB_HALF_M, 1])
        parts["mirror"] = {"type": "rectangle", "to_world": place, "bsdf": {"type": "conductor", "material": "none"}}
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


def stock(scene: scenes.Scene, record: Record, samples: list[int], sampler: str) -> None:
    """Measures Mitsuba's own plugins."""
    path = mi.load_dict({"type": "path", "max_depth": 8, "rr_depth": 100})
    for layer in scenes.LAYERS:
        todo = [spp for spp in samples if not record.has(layer, spp)]
        if not todo:
            continue
        world, build_s = cpu_s(lambda: stock_scene(scene, layer))
        forward_m = scene.focus_shift_m if layer == "transmission" else 0.0
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
    """Renders many samples in chunks; the noise is half the RMS difference between even and odd chunks."""
    chunks = max(2, spp // REFERENCE_CHUNK)
    each = spp // chunks
    if all(record.has(layer, spp) for layer in scenes.LAYERS):
        return
    front, back = sheets(scene)
    for layer in scenes.LAYERS:
        if record.has(layer, spp):
            continue
        integrator = SlabSplit(scene, layer, front, back, (3, 4))
        camera = sensor(scene, layer, "multijitter", each)
        halves = np.zeros((2, scene.height, scene.width, 3))

        def render_all() -> None:
            for k in range(chunks):
                halves[k % 2] += np.array(mi.render(front, sensor=camera, integrator=integrator, spp=each, seed=1000 + k))

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
    scene = scenes.load(args.scene)
    sampler = "multijitter" if args.set_up == "reference" else args.sampler
    record = Record(args.out, program=f"Mitsuba {mi.__version__}, {mi.variant()}", set_up=args.set_up, sampler=sampler)
    if args.set_up == "reference":
        reference(scene, record, args.samples[-1])
    else:
        (stock if args.set_up == "stock" else split)(scene, record, args.samples, args.sampler)


if __name__ == "__main__":
    main()
