"""Completion of loaded scenes: default light and camera, and notices about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import Vector, vector
from irrsplat.scene.model import Camera, Light, Mesh, Scene, sun_lights
from irrsplat.scene.seen_by_light import face_counts
from irrsplat.scene.stand_ins import camera, light
from irrsplat.scene.stand_ins.surroundings import surface_points
from irrsplat.scene.stand_ins.up_axis import axes, nearest_axis
from irrsplat.sky.environment import frame_of
from irrsplat.sky.sky_text import Sky

NO_CAMERA = ": no camera"  # words of a notice about an added camera


def finish(
    path: Path,
    meshes: Sequence[Mesh],
    lights: Sequence[Light],
    cameras: Sequence[Camera],
    sky: Sky | None,
    dropped: Mapping[str, int],
    remarks: Sequence[str] = (),
    files: Sequence[Path] = (),
    up: Vector | None = None,
    origin: Vector = (0.0, 0.0, 0.0),
    invent: bool = True,
) -> Scene:
    """Return the Scene of these parts; meshes are relative to `origin`. `sky` None: none was requested.

    dropped: degenerate triangles left out, by file. remarks: notices so far. files: read apart from `path`. up: the up vector.
    None: that of the first camera, and a uniform sky for a scene without light, as for a `.scene`. Otherwise a scene with too
    little light gets a sky with a gradient and a key light, and a scene with directional light alone gets only the sky. invent:
    False leaves existing light alone, however weak. Raises InputError for a file with an `up` and no triangle with an area.
    """
    notices = [*remarks]
    notices += [f"{file}: {count} degenerate triangle{'s' * (count > 1)} dropped" for file, count in dropped.items() if count]
    meshes = tuple(mesh for mesh in meshes if len(mesh.faces))
    if not meshes:
        why = "no triangle in this file has an area" if any(dropped.values()) else "there are no triangles in this file"
        if up is not None:
            raise InputError(f"{why}; nothing is left to show", path)
        notices.append(f"{path}: {why}; its sky alone is shown")
    given = sky or Sky()
    scene = Scene(meshes, tuple(lights), tuple(cameras), given.radiance, path.stem, str(path), origin=origin).local
    scene = replace(scene, files=tuple(dict.fromkeys(str(file) for file in (path, *files, *given.files))))
    world = axes(up or (nearest_axis(cameras[0]) if cameras else scene.up))
    scene = replace(scene, up=vector(world[1] + 0.0), own_sky=sky is not None or up is None)
    main_part = scene if cameras else camera.subject(scene)
    if up is not None or not cameras:  # otherwise neither camera nor light depends on rooms
        points = surface_points(main_part)
        room_places = camera.room_places(main_part, points, world)
    inside = False
    if not cameras:
        added, inside = camera.default_camera(main_part, points, world, room_places)
        where = "in the room" if inside else "that sees the whole scene" if main_part is scene else "that sees most of the scene"
        notices.append(f"{path}{NO_CAMERA}; added a camera {where}")
        scene, main_part = replace(scene, cameras=(added,)), replace(main_part, cameras=(added,))
    if up is None:
        if sky is None and not lights and not scene.emissive:
            scene = replace(scene, sky=(1.0, 1.0, 1.0), own_sky=False)
            notices.append(f"{path}: no light, no emission and no sky; added a sky of radiance 1 1 1")
    elif sky is None and (invent or not (lights or scene.emissive)):
        around = camera.enclosure_of_camera(main_part, points, world, room_places)
        inside = inside or around is not None
        own = light.own_light(scene, "closed" if inside else "half" if room_places.places else "none")
        if own == "nothing":
            few = "too little light" if lights or scene.emissive else "no light"
            key = light.stand_in(scene.cameras[0], world[1], around if inside else None)
            what = "a sky and a point light" if inside else "a sky that is brighter above and a key light"
            notices.append(f"{path}: {few}; added {what}")
            scene = replace(scene, sky=light.SKY, sky_gradient=light.GRADIENT, lights=(*scene.lights, key))
        elif own == "sun":
            notices.append(f"{path}: only directional light; added a sky that is brighter above")
            mean, gradient = light.fill_sky(scene)
            scene = replace(scene, sky=mean, sky_gradient=gradient)
    notices += given.notices
    if given.environment is not None:
        environment = replace(given.environment, frame=frame_of(world, given.turn))
        scene = replace(scene, environment=environment, lights=(*scene.lights, *sun_lights(environment)))
    if meshes and not face_counts(scene).lit:
        notices.append(f"{path}: all materials transmit most of the light; only their tints are shown")
    return replace(scene, notices=tuple(notices)).placed(origin)
