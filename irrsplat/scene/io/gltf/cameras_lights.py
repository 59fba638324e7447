"""Cameras and lights (KHR_lights_punctual) of a glTF file's nodes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from irrsplat.core.vectors import Vector, vector
from irrsplat.core.words import GREATEST
from irrsplat.scene.io.gltf.document import Damaged, Document, extension, number, numbers, printable
from irrsplat.scene.io.gltf.nodes import Node
from irrsplat.scene.io.gltf.nodes import name as node_name
from irrsplat.scene.model import Camera, Light

_LIGHTS = "KHR_lights_punctual"
_DISTANCE = 1000.0  # of the pinhole camera that replaces an orthographic one, in diagonals of the scene


def cameras(document: Document, nodes: Iterable[Node], bounds: np.ndarray) -> list[Camera]:
    """Return the cameras of these nodes, named by node, else by camera, else "camera 1" and so on.

    bounds: (2, 3) of the scene. A camera's target is as far away as the scene's centre. An orthographic camera becomes a distant
    pinhole: parallel lines converge by less than a thousandth of the scene's size.
    """
    found: list[Camera] = []
    taken: dict[str, int] = {}  # names, with the last number that was appended to each
    for node in nodes:
        if "camera" not in node.entry:
            continue
        with document.part(f"the camera of {node_name(document, node.index)}"):
            entry = document.entry("cameras", node.entry["camera"])
            name = node.name or printable(entry.get("name") or "") or f"camera {len(found) + 1}"
            free, i = name, taken.get(name, 0)
            while free in taken:
                i += 1
                free = f"{name} {i + 1}"
            found.append(_camera(entry, node.world, bounds, free))
            taken[name], taken[free] = i, taken.get(free, 0)
    return found


def _camera(entry: Mapping[str, Any], world: np.ndarray, bounds: np.ndarray, name: str) -> Camera:
    eye, forward, up = world[:3, 3], -_direction(world[:, 2]), _direction(world[:, 1])
    diagonal = float(np.linalg.norm(bounds[1] - bounds[0])) or 1.0
    depth = max(float((bounds.mean(0) - eye) @ forward), 0.1 * diagonal)
    target = eye + depth * forward
    if entry.get("type") == "orthographic":
        half = abs(number(_object(entry, "orthographic"), "ymag", 0.0))
        eye = target - _DISTANCE * diagonal * forward
        fov = 2.0 * math.atan(half / (_DISTANCE * diagonal))
    else:
        fov = number(_object(entry, "perspective"), "yfov", 0.0)
    if not 0.0 < fov < math.pi:
        raise Damaged("its field of view is damaged")
    return Camera(_vector(eye), _vector(target), _vector(up), math.degrees(fov), name)


def lights(document: Document, nodes: Iterable[Node]) -> list[Light]:
    """Return the lights of these nodes, named by node, else by light; ranges are ignored: light falls off with 1/d²."""
    found = []
    for node in nodes:
        asked = extension(node.entry, _LIGHTS)
        if asked is None:
            continue
        with document.part(f"the light of {node_name(document, node.index)}"):
            entry = document.entry("lights", asked.get("light"), extension(document.tree, _LIGHTS) or {})
            found.append(_light(entry, node, document.per_unit))
    return found


def _light(entry: Mapping[str, Any], node: Node, per_unit: float) -> Light:
    position, backward = node.world[:3, 3], _direction(node.world[:, 2])
    color = per_unit * number(entry, "intensity", 1.0) * np.array(numbers(entry, "color", (1.0, 1.0, 1.0)))
    if not (color >= 0.0).all():
        raise Damaged("its intensity is negative")
    name, kind = node.name or printable(entry.get("name") or ""), entry.get("type")
    if kind == "directional":  # lux: perpendicular irradiance, π times OpenGL's diffuse
        return Light(_vector(backward), _vector(color / math.pi), directional=True, name=name)
    if kind == "point":
        return Light(_vector(position), _vector(color), physical=True, name=name)
    if kind != "spot":
        raise Damaged("it is of an unknown type")
    cone = spot if isinstance(spot := entry.get("spot"), dict) else {}
    outer, inner = (math.degrees(number(cone, *one)) for one in (("outerConeAngle", math.pi / 4.0), ("innerConeAngle", 0.0)))
    if not 0.0 <= inner <= outer or outer <= 0.0:
        raise Damaged("its cone is damaged")
    outer = min(outer, 89.9)  # a half space; shadow maps cannot cover more
    target = _vector(position - backward)
    inner = min(inner, outer)
    return Light(
        _vector(position), _vector(color), physical=True, spot_target=target, spot_cutoff=outer, spot_inner=inner, name=name
    )


def _object(entry: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    found = entry.get(key)
    if not isinstance(found, dict):
        raise Damaged(f"its {key} is damaged")
    return found


def _direction(axis: np.ndarray) -> np.ndarray:
    """Return (3,) unit: a column of a node's matrix; raise Damaged for a scale of 0."""
    length = float(np.linalg.norm(axis[:3]))
    if not (length > 0.0 and math.isfinite(length)):
        raise Damaged("the scale of its node is 0")
    return np.asarray(axis[:3] / length)


def _vector(values: np.ndarray) -> Vector:
    if not np.abs(values).max() <= GREATEST:  # false for NaN
        raise Damaged("its place or intensity exceeds the range of 32-bit floats")
    return vector(values)
