"""Completes what a loader has read: a sky where nothing shines, a camera where there is none, and notices that say so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from irrsplat.scene.model import Camera, Light, Mesh, Scene


def finish(
    path: Path,
    meshes: Sequence[Mesh],
    lights: Sequence[Light],
    cameras: Sequence[Camera],
    sky: tuple[float, float, float] | None,
    dropped: Mapping[str, int],
    remarks: Sequence[str] = (),
    files: Sequence[Path] = (),
) -> Scene:
    """The Scene of these parts. `sky` None: none was asked for.

    dropped: degenerate triangles left out, by file. remarks: notices so far. files: what was read apart
    from `path`.
    """
    notices = [*remarks]
    notices += [f"{file}: {count} degenerate triangle{'s' * (count > 1)} dropped" for file, count in dropped.items() if count]
    meshes = tuple(mesh for mesh in meshes if len(mesh.faces))
    if sky is None and not lights and not any(any(mesh.material.emission) for mesh in meshes):
        sky = (1.0, 1.0, 1.0)
        notices.append(f"{path}: no light, no emission and no sky; a sky of radiance 1 1 1 stands in")
    scene = Scene(meshes, tuple(lights), tuple(cameras), sky or (0.0, 0.0, 0.0), path.stem, str(path), tuple(notices))
    scene = replace(scene, files=tuple(dict.fromkeys(str(file) for file in (path, *files))))
    if not cameras:
        notices.append(f"{path}: no camera; one that sees the whole scene stands in")
        scene = replace(scene, cameras=(overview(scene),), notices=tuple(notices))
    return scene


def overview(scene: Scene, fov: float = 45.0) -> Camera:
    """A camera with a vertical field of view of `fov` degrees that sees the whole scene, from the front, right and above."""
    centre = scene.bounds.mean(0)
    distance = 0.5 * scene.diagonal / np.sin(np.radians(fov) / 2.0)  # the bounding sphere touches the view's edges
    eye = centre + 1.05 * distance * np.array([0.48, 0.36, 0.8])
    return Camera((eye[0], eye[1], eye[2]), (centre[0], centre[1], centre[2]), fov=fov)
