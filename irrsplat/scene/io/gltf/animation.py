"""Animations of a glTF file at a time: transforms of nodes and morph weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from irrsplat.scene.io.gltf import accessors
from irrsplat.scene.io.gltf.document import Damaged, Document

Pose = dict[tuple[int, str], np.ndarray]  # value by (node, "translation", "rotation", "scale" or "weights")
_WIDTHS = {"translation": (3,), "rotation": (4,), "scale": (3,), "weights": (1,)}


def pose(document: Document, time: float) -> Pose:
    """Return the animated values at `time` in seconds, constant before the first key and after the last.

    The first of several animations of one property applies: files with separate actions play the first, files with one animation
    for each object play all.
    """
    found: Pose = {}
    for i, animation in enumerate(document.entries("animations")):
        with document.part(f"animation {i}"):
            mine: Pose = {}
            for channel in document.entries("channels", animation):
                with document.part(f"a channel of animation {i}"):
                    target = channel["target"]
                    node, path = target.get("node"), target.get("path")
                    if path not in _WIDTHS or node is None:
                        continue  # a pointer, which extensionsUsed reports, or an invalid target
                    document.entry("nodes", node)
                    if (node, path) not in found:
                        sampler = document.entry("samplers", channel["sampler"], animation)
                        mine[node, path] = _sample(document, sampler, path, time)
            found = {**mine, **found}
    return found


def _sample(document: Document, sampler: Mapping[str, Any], path: str, time: float) -> np.ndarray:
    """Return (n,) the value of an animation's sampler at a time; glTF 2.0, appendix C."""
    keys = accessors.values(document, sampler["input"], (1,))[:, 0].astype(float)
    output = accessors.values(document, sampler["output"], _WIDTHS[path]).astype(float)
    cubic = sampler.get("interpolation") == "CUBICSPLINE"
    if not len(keys) or not np.isfinite(keys).all() or not np.isfinite(output).all():
        raise Damaged("it has no keys, or damaged ones")
    table = output.reshape(len(keys), 3 if cubic else 1, -1)  # key, (in-tangent, value, out-tangent) or value, component
    value = table[:, 1 if cubic else 0]
    i = int(np.searchsorted(keys, time, "right")) - 1
    if i < 0 or i >= len(keys) - 1 or sampler.get("interpolation") == "STEP":
        return _unit(value[np.clip(i, 0, len(keys) - 1)], path)
    span = keys[i + 1] - keys[i]
    t = (time - keys[i]) / span
    if cubic:
        t2, t3 = t * t, t * t * t
        rise = span * (table[i, 2] * (t3 - 2.0 * t2 + t) + table[i + 1, 0] * (t3 - t2))
        return _unit(value[i] * (2.0 * t3 - 3.0 * t2 + 1.0) + value[i + 1] * (3.0 * t2 - 2.0 * t3) + rise, path)
    if path == "rotation":
        return _slerp(_unit(value[i], path), _unit(value[i + 1], path), t)
    return np.asarray(value[i] + t * (value[i + 1] - value[i]))


def _unit(value: np.ndarray, path: str) -> np.ndarray:
    length = float(np.linalg.norm(value))
    return value / length if path == "rotation" and length > 0.0 else value


def _slerp(a: np.ndarray, b: np.ndarray, t: float) -> np.ndarray:
    """Return the unit quaternion at `t` of the shorter arc from a to b (Shoemake 1985)."""
    cosine = float(a @ b)
    if cosine < 0.0:
        b, cosine = -b, -cosine
    angle = np.arccos(min(cosine, 1.0))
    if angle < 1e-6:
        return _unit(a + t * (b - a), "rotation")
    return np.asarray((np.sin((1.0 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle))
