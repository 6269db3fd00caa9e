"""Renders with Blender Cycles (`bpy`): real glass, I and R~ in one render with light groups, T and R separately.

Caustics on; no clamp, denoiser, adaptive sampling or glossy filter; 16 bounces; one thread; default sampling pattern.
Sheets have emission shaders that Cycles does not sample as lights: each would be a light of 390,000 triangles.
T is rendered in two ways, and the cheaper counts: through a box of `Refraction BSDF`, which bends with weight 1, and
without glass but with the camera moved forward by t (1 - 1/n). World axes are those of scene.py; image rows go upwards.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

import exr
import scene as scenes
from record import Record, cpu_s, timed

try:
    import bpy
except ImportError:
    sys.exit("error: bpy is not installed: with Python 3.11, pip install 'bpy==4.5.*' (and Debian's libxi6 libxxf86vm1 libxfixes3 libgl1)")

SLAB_HALF_M = 2.0
PASSES = {
    "glass": ("input", "glass_reflection"),
    "moved": ("transmission",),
    "box": ("transmission",),
    "mirror": ("clean_reflection",),
}


def empty_file() -> None:
    """Starts a Blender session without objects that renders with one thread, the box filter and float EXR."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    settings = bpy.context.scene
    render, cycles = settings.render, settings.cycles
    render.engine = "CYCLES"
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.max_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 16
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    render.threads_mode, render.threads = "FIXED", 1
    # Keeps the scene between renders: the first render builds it and is not timed.
    render.use_persistent_data = True
    render.resolution_percentage = 100
    render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    render.image_settings.color_depth, render.image_settings.exr_codec = "32", "NONE"
    settings.view_settings.view_transform = "Raw"


def texture(name: str, radiance: np.ndarray) -> bpy.types.Image:
    """Makes a float image of the photograph's radiance, without colour conversion."""
    h, w, _ = radiance.shape
    image = bpy.data.images.new(name, w, h, alpha=False, float_buffer=True, is_data=True)
    rgba = np.ones((h, w, 4), np.float32)
    rgba[..., :3] = radiance[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    return image


def material(name: str, shader: str) -> tuple[bpy.types.Material, bpy.types.Node]:
    """Makes a material of one shader node."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    node, output = nodes.new(shader), nodes.new("ShaderNodeOutputMaterial")
    links.new(node.outputs[0], output.inputs["Surface"])
    return made, node


def add(name: str, mesh: bpy.types.Mesh, made: bpy.types.Material) -> bpy.types.Object:
    """Puts a mesh with its material into the scene."""
    mesh.materials.append(made)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_sheet(scene: scenes.Scene, side: str) -> None:
    """Adds the photograph as an emitting mesh, in a light group named after its side."""
    sheet = scenes.sheet(scene, side)
    mesh = bpy.data.meshes.new(side)
    corners = sheet.triangles.ravel()
    mesh.vertices.add(len(sheet.vertices_m))
    mesh.vertices.foreach_set("co", sheet.vertices_m.ravel())
    mesh.loops.add(len(corners))
    mesh.loops.foreach_set("vertex_index", corners)
    mesh.polygons.add(len(sheet.triangles))
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
    up = sheet.uv * [1, -1] + [0, 1]
    mesh.uv_layers.new(name="uv").data.foreach_set("uv", up[corners].astype(np.float32).ravel())
    mesh.update()
    made, emission = material(side, "ShaderNodeEmission")
    image = made.node_tree.nodes.new("ShaderNodeTexImage")
    image.image = texture(side, (scene.front if side == "front" else scene.back).radiance)
    image.interpolation, image.extension = "Linear", "EXTEND"
    made.node_tree.links.new(image.outputs["Color"], emission.inputs["Color"])
    made.cycles.emission_sampling = "NONE"
    add(side, mesh, made).lightgroup = side


def add_box(scene: scenes.Scene, shader: str) -> None:
    """Adds the pane as a closed box with a refracting shader."""
    near, far, a = scene.glass_distance_m, scene.glass_distance_m + scene.thickness_m, SLAB_HALF_M
    points = [(x, y, z) for z in (near, far) for y in (-a, a) for x in (-a, a)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    mesh = bpy.data.meshes.new("pane")
    mesh.from_pydata(points, [], faces)
    made, node = material("pane", shader)
    node.inputs["IOR"].default_value, node.inputs["Roughness"].default_value = scene.ior, 0.0
    add("pane", mesh, made)


def add_mirror(scene: scenes.Scene) -> None:
    """Adds a perfect mirror in the pane's front face."""
    a, z = SLAB_HALF_M, scene.glass_distance_m
    mesh = bpy.data.meshes.new("mirror")
    mesh.from_pydata([(-a, -a, z), (a, -a, z), (a, a, z), (-a, a, z)], [], [(0, 3, 2, 1)])
    made, node = material("mirror", "ShaderNodeBsdfAnisotropic")  # the "Glossy BSDF" of the menus
    node.inputs["Color"].default_value, node.inputs["Roughness"].default_value = (1, 1, 1, 1), 0.0
    add("mirror", mesh, made)


def add_camera(scene: scenes.Scene, pinhole: bool, forward_m: float) -> None:
    """Adds a thin lens or a pinhole, turned by 180 degrees about x: Blender's cameras look along -z with +y up."""
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", 36.0
    camera.lens = 18.0 / scene.tan_half_x
    camera.clip_start, camera.clip_end = 1e-3, 1e5
    camera.dof.use_dof = not pinhole
    camera.dof.focus_distance = scene.focus_distance_m
    camera.dof.aperture_fstop = camera.lens * 1e-3 / (2 * scene.aperture_radius_m)
    thing = bpy.data.objects.new("camera", camera)
    thing.rotation_euler, thing.location = (math.pi, 0, 0), (0, 0, forward_m)
    settings = bpy.context.scene
    settings.collection.objects.link(thing)
    settings.camera = thing
    settings.render.resolution_x, settings.render.resolution_y = scene.width, scene.height


def build(scene: scenes.Scene, name: str) -> None:
    """Starts the session of one pass."""
    empty_file()
    groups = bpy.context.view_layer.lightgroups
    sides = {"glass": ("front", "back"), "moved": ("front",), "box": ("front",), "mirror": ("back",)}[name]
    for side in sides:
        groups.add(name=side)
        add_sheet(scene, side)
    if name == "glass":
        add_box(scene, "ShaderNodeBsdfGlass")
    elif name == "box":
        add_box(scene, "ShaderNodeBsdfRefraction")
    elif name == "mirror":
        add_mirror(scene)
    add_camera(scene, pinhole=name == "mirror", forward_m=scene.focus_shift_m if name == "moved" else 0.0)


def render(samples: int, seed: int, folder: Path) -> dict[str, np.ndarray]:
    """Renders the session's scene; each light group has its own channels."""
    settings = bpy.context.scene
    settings.cycles.samples, settings.cycles.seed = samples, seed
    settings.render.filepath = str(folder / "render.exr")
    bpy.ops.render.render(write_still=True)
    return exr.read(folder / "render.exr")


def layers(name: str, channels: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Returns a pass's layers from the channels of its render."""
    prefix = bpy.context.view_layer.name + ".Combined"
    combined = exr.rgb(channels, prefix + ".")
    if name != "glass":
        return {PASSES[name][0]: combined}
    return {"input": combined, "glass_reflection": exr.rgb(channels, prefix + "_back.")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder with a scene.json")
    parser.add_argument("--out", type=Path, required=True, help="folder for result.json and the layers")
    parser.add_argument("--samples", type=lambda t: [int(n) for n in t.split(",")], default=[16, 64, 256])
    args = parser.parse_args()
    scene = scenes.load(args.scene, only_plain=True)
    record = Record(args.out, program=f"Blender {bpy.app.version_string} Cycles, CPU")
    with tempfile.TemporaryDirectory() as folder:
        for name in PASSES:
            todo = [n for n in args.samples if not record.has(name, n)]
            if not todo:
                continue
            _, build_s = cpu_s(lambda: (build(scene, name), render(1, 0, Path(folder))))
            for samples in todo:
                channels, figures = timed(lambda seed: render(samples, seed, Path(folder)), warm_up=False)
                record.add(name, samples, layers(name, channels), build_cpu_s=build_s, **figures)
    sys.stdout.flush()
    os._exit(0)  # bpy 4.5 may crash when Python unloads it


if __name__ == "__main__":
    main()
