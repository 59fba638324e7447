"""Scenes in Blender, and their irradiance by Cycles; imported only in a process of its own, see cycles.py."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np
import OpenEXR

from irrsplat.app.bench.peers.judging import CPUS
from irrsplat.reference.timed_levels import JudgedView, TimedLevels, levels
from irrsplat.scene.change import emits
from irrsplat.scene.model import Camera, Light, Mesh, Scene

_SAMPLES = 1, 4, 16, 64, 256, 1024
_POINT = 4.0 * np.pi  # power in Blender's unit of a point light with a radiant intensity of 1 W/sr


def timed(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    bounces: int,
    view: JudgedView,
    report: Callable[[float], object],
) -> TimedLevels:
    """Return times and errors of indirect irradiance with `bounces` at the pixels' centres. view: these, and the reference."""
    start = time.perf_counter()
    there, lamps = _scene(scene, camera, size, bounces)
    with tempfile.TemporaryDirectory(prefix="irrsplat-") as folder:
        there.render.filepath = str(Path(folder) / "picture.exr")

        def irradiance(count: int) -> np.ndarray:
            E = _drawn(there, count, "Diffuse Indirect")
            if emits(scene).any():  # light of the sky and of emitters is part of E, light of point lights and of the sun is not
                E = E + _without(lamps, lambda: _drawn(there, count, "Diffuse Direct"))
            return np.asarray(np.pi * E[view.mask])

        irradiance(1)  # makes the tree of the rays
        load = time.perf_counter() - start
        return {"load": load, "threads": CPUS, "levels": levels(irradiance, _SAMPLES, view, report)}


def _scene(scene: Scene, camera: Camera, size: tuple[int, int], bounces: int) -> tuple[Any, list[Any]]:
    """Return Blender's scene, and its lights."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    there = bpy.context.scene
    there.render.engine = "CYCLES"
    cycles = there.cycles
    cycles.device, cycles.use_adaptive_sampling = "CPU", False
    cycles.max_bounces = cycles.diffuse_bounces = bounces
    cycles.sample_clamp_indirect = cycles.light_sampling_threshold = 0.0  # else a third of the light is missing in cornell
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01  # E at the centres of pixels
    there.render.use_persistent_data = True
    there.render.threads_mode, there.render.threads = "FIXED", CPUS
    there.render.resolution_x, there.render.resolution_y = size
    there.render.image_settings.media_type = "MULTI_LAYER_IMAGE"
    there.render.image_settings.color_depth = "32"
    there.view_layers[0].use_pass_diffuse_direct = there.view_layers[0].use_pass_diffuse_indirect = True
    lamps = [_light(light) for light in scene.lights]
    for made in (*(_mesh(mesh) for mesh in scene.meshes if len(mesh.faces)), *lamps, _camera(camera)):
        there.collection.objects.link(made)
    there.camera = made
    there.world = bpy.data.worlds.new("sky")
    there.world.use_nodes = True
    there.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*scene.sky, 1.0)
    return there, lamps


def _mesh(mesh: Mesh) -> Any:
    """Return a mesh of a Lambertian surface, which may emit light as well."""
    made, paint, material = bpy.data.meshes.new("mesh"), bpy.data.materials.new("paint"), mesh.material
    made.from_pydata(mesh.positions.tolist(), [], mesh.faces.tolist())
    made.shade_smooth()
    made.normals_split_custom_set_from_vertices(mesh.normals.tolist())
    paint.use_nodes = True
    tree = paint.node_tree
    tree.nodes.clear()
    diffuse, emission, both, out = (
        tree.nodes.new(f"ShaderNode{name}") for name in ("BsdfDiffuse", "Emission", "AddShader", "OutputMaterial")
    )
    diffuse.inputs["Color"].default_value = (*material.albedo, 1.0)
    emission.inputs["Color"].default_value = (*material.emission, 1.0)
    tree.links.new(diffuse.outputs[0], both.inputs[0])
    if any(material.emission):
        tree.links.new(emission.outputs[0], both.inputs[1])
    tree.links.new(both.outputs[0], out.inputs["Surface"])
    made.materials.append(paint)
    return bpy.data.objects.new("mesh", made)


def _light(light: Light) -> Any:
    """Return a point light, a spot or the sun. The falloff of a spot is linear in the angle, by nodes."""
    made = bpy.data.lights.new("light", "SUN" if light.directional else "POINT")
    made.energy = np.pi if light.directional else _POINT
    made.use_nodes = True
    tree, there = made.node_tree, bpy.data.objects.new("light", made)
    emission = tree.nodes["Emission"]
    emission.inputs["Color"].default_value = (*light.color, 1.0)
    if light.directional:
        made.angle = 0.0
        there.rotation_mode = "QUATERNION"
        there.rotation_quaternion = mathutils.Vector(light.position).to_track_quat("Z", "Y")
        return there
    made.shadow_soft_size, there.location = 0.0, light.position
    if light.spot_target is not None and light.spot_cutoff not in (90.0, 180.0):
        axis = np.subtract(light.spot_target, light.position)
        geometry, cosine, angle, falloff = (
            tree.nodes.new(f"ShaderNode{name}") for name in ("NewGeometry", "VectorMath", "Math", "MapRange")
        )
        cosine.operation, angle.operation = "DOT_PRODUCT", "ARCCOSINE"
        cosine.inputs[1].default_value = (axis / np.linalg.norm(axis)).tolist()
        for name, value in (("From Min", min(light.spot_inner, light.spot_cutoff - 1e-3)), ("From Max", light.spot_cutoff)):
            falloff.inputs[name].default_value = np.radians(value)
        falloff.inputs["To Min"].default_value, falloff.inputs["To Max"].default_value = 1.0, 0.0
        tree.links.new(geometry.outputs["Normal"], cosine.inputs[0])
        tree.links.new(cosine.outputs["Value"], angle.inputs[0])
        tree.links.new(angle.outputs[0], falloff.inputs["Value"])
        tree.links.new(falloff.outputs[0], emission.inputs["Strength"])
    return there


def _camera(camera: Camera) -> Any:
    made = bpy.data.cameras.new("camera")
    made.sensor_fit, made.angle, made.clip_start = "VERTICAL", np.radians(camera.fov), 1e-3
    there, matrix = bpy.data.objects.new("camera", made), np.linalg.inv(camera.view_from_world)
    there.matrix_world = mathutils.Matrix(matrix.tolist())
    return there


def _without(lamps: list[Any], draw: Callable[[], np.ndarray]) -> np.ndarray:
    """Return the result of `draw` without these lights and without further bounces."""
    cycles, bounces = bpy.context.scene.cycles, bpy.context.scene.cycles.max_bounces
    for lamp in lamps:
        lamp.hide_render = True
    cycles.max_bounces = 0
    found = draw()
    for lamp in lamps:
        lamp.hide_render = False
    cycles.max_bounces = bounces
    return found


def _drawn(there: Any, samples: int, layer: str) -> np.ndarray:
    """Return (H, W, 3) of a pass, top row first, after a render with so many samples a pixel."""
    there.cycles.samples = there.cycles.seed = samples
    there.update_tag()
    bpy.context.view_layer.update()
    bpy.ops.render.render(write_still=True)
    picture = OpenEXR.File(there.render.filepath)
    found = next(
        channel
        for part in range(len(picture.parts))
        for name, channel in picture.channels(part).items()
        if name.endswith(f".{layer}")
    )
    return np.asarray(found.pixels[..., :3].astype(float))
