"""Scenes from Mitsuba 3: shapes with the diffuse part of their BSDFs, emitters and perspective cameras.

Loaded scenes are read through `mitsuba.traverse`, so that files, dicts and scenes changed by programs have one path.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.scene.io.objects.arrays import Up, completed, sky_map
from irrsplat.scene.io.objects.mitsuba_surfaces import Remarks, Surfaces, color, numbers, three, values_of
from irrsplat.scene.model import Camera, Light, Scene, sun_lights
from irrsplat.sky.sky_text import Sky

if TYPE_CHECKING:
    import mitsuba

_VARIANT = "scalar_rgb"  # for files and dicts, if no RGB variant is set


def from_mitsuba(
    source: mitsuba.Scene | Mapping[str, Any] | str | os.PathLike[str], *, up: Up = "y", name: str = "scene"
) -> Scene:
    """Return the Scene of a Mitsuba 3 scene: a mitsuba.Scene, an argument of `mitsuba.load_dict`, or the path of an XML file.

    Supported are meshes, rectangles, disks, spheres and cylinders; diffuse BSDFs, also two-sided, with bitmaps and checkerboards,
    and the diffuse part of others or a default; emitters area, point, spot, directional, constant and envmap; perspective
    cameras. An area emitter emits from its front only, as in Mitsuba. Unsupported parts are left out or replaced, with
    Scene.notices. A file may refer to any other files. up: the vertical axis, as for `make_scene`. Needs the extra: pip install
    'irrsplat[reference]'. Raises InputError for a variant without RGB, and for a scene that Mitsuba cannot load; IrrsplatError
    without Mitsuba.
    """
    try:
        import mitsuba
    except ModuleNotFoundError as error:
        raise IrrsplatError(f"this needs the Python module '{error.name}'; run: pip install 'irrsplat[reference]'") from None
    if isinstance(source, (str, os.PathLike)):
        name = Path(source).stem
    with _rgb(mitsuba):
        return _Reader(mitsuba, _loaded(mitsuba, source), name).scene(up)


@contextmanager
def _rgb(mitsuba: Any) -> Iterator[None]:
    """A `with` block with an RGB variant, which restores the former variant."""
    before = mitsuba.variant()
    if before is None or "rgb" not in before:
        mitsuba.set_variant(_VARIANT)
    try:
        yield
    finally:
        if before is not None and mitsuba.variant() != before:
            mitsuba.set_variant(before)


def _loaded(mitsuba: Any, source: Any) -> Any:
    """Return the mitsuba.Scene of a caller's source."""
    if isinstance(source, (str, os.PathLike)):
        if not os.path.isfile(source):
            raise InputError("there is no such file", source)
    elif not isinstance(source, Mapping):
        modules = {kind.__module__.split(".")[0] for kind in type(source).__mro__}
        if "mitsuba" not in modules or not hasattr(source, "shapes") or not hasattr(source, "sensors"):
            raise InputError(
                f"from_mitsuba takes a mitsuba.Scene, a dict or the path of an XML file, not {type(source).__name__}"
            )
        return source
    try:
        found = mitsuba.load_dict(dict(source)) if isinstance(source, Mapping) else mitsuba.load_file(os.fspath(source))
    except Exception as error:  # Mitsuba raises bare RuntimeErrors of many lines
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        raise InputError(
            f"Mitsuba cannot load it: {' '.join(lines)[:200]}", source if isinstance(source, (str, os.PathLike)) else None
        ) from None
    if not hasattr(found, "shapes"):
        raise InputError(f"this is not a Mitsuba scene, but {type(found).__name__}; give one of type 'scene'")
    return found


class _Reader:
    """Conversion of one mitsuba.Scene."""

    def __init__(self, mitsuba: Any, source: Any, name: str) -> None:
        self.mitsuba, self.source, self.name = mitsuba, source, name
        self.remarks = Remarks(name)

    def scene(self, up: Up) -> Scene:
        """Return the whole scene."""
        if not isinstance(self.source, self.mitsuba.Scene):  # each variant has classes of its own
            raise InputError("this scene is not of the RGB variant that is set; load it after mitsuba.set_variant('scalar_rgb')")
        surfaces = Surfaces(self.mitsuba, self.remarks)
        meshes, dropped = surfaces.meshes(self.source.shapes(), self._diagonal())
        cameras = [camera for sensor in self.source.sensors() for camera in self._camera(sensor)]
        lights, sky, turned = self._lights()
        scene = completed(meshes, lights, cameras, sky, up, self.name, self.remarks.lines, dropped)
        if scene.environment is not None and turned is not None:
            environment = replace(scene.environment, frame=turned)
            own = tuple(light for light in scene.lights if light not in sun_lights(scene.environment))
            scene = replace(scene, environment=environment, lights=(*own, *sun_lights(environment)))
        return scene

    def _diagonal(self) -> float:
        box = self.source.bbox()
        return float(np.linalg.norm(numbers(box.max) - numbers(box.min)))

    def _camera(self, sensor: Any) -> Iterator[Camera]:
        kind, values = sensor.class_name(), values_of(self.mitsuba, sensor)
        if "x_fov" not in values:
            self.remarks.add(f"the sensor {kind} is no perspective camera, and is left out")
            return
        if kind != "PerspectiveCamera":
            self.remarks.add(f"the sensor {kind} is shown as a pinhole")
        if any(abs(float(numbers(values.get(f"principal_point_offset_{axis}", 0.0))[0])) > 1e-6 for axis in "xy"):
            self.remarks.add("the offset of a camera's principal point is not shown")
        width, height = numbers(values["film.size"])[:2]
        half = math.tan(math.radians(float(numbers(values["x_fov"])[0])) / 2.0) * height / width
        matrix = _matrix(values["to_world"])
        eye, forward, up = matrix[:3, 3], matrix[:3, 2], matrix[:3, 1]
        identifier = str(sensor.id())
        named = "" if identifier.startswith(("__", "object_")) else identifier
        yield Camera(three(eye), three(eye + forward), three(up), math.degrees(2.0 * math.atan(half)), named)

    def _lights(self) -> tuple[list[Light], Sky | None, np.ndarray | None]:
        """Return the lights, the sky, and the axes of an environment map."""
        lights: list[Light] = []
        sky, turned = None, None
        for emitter in self.source.emitters():
            kind, values = emitter.class_name(), values_of(self.mitsuba, emitter)
            named = str(emitter.id())
            if kind == "AreaLight":
                continue  # belongs to a shape
            if kind == "PointLight":
                lights.append(
                    Light(three(numbers(values["position"])), self._strength(values, "intensity"), physical=True, name=named)
                )
            elif kind == "SpotLight":
                lights.append(self._spot(values, str(emitter), named))
            elif kind == "DirectionalEmitter":
                toward = -_matrix(values["to_world"])[:3, 2]
                red, green, blue = (value / math.pi for value in self._strength(values, "irradiance"))
                lights.append(Light(three(toward), (red, green, blue), directional=True, name=named))
            elif kind == "ConstantBackgroundEmitter":
                sky = Sky(self._strength(values, "radiance"))
            elif kind == "EnvironmentMapEmitter":
                sky, turned = self._map(values)
            else:
                self.remarks.add(f"the emitter {kind} is not supported, and is left out")
        return lights, sky, turned

    def _spot(self, values: Mapping[str, Any], text: str, name: str) -> Light:
        matrix = _matrix(values["to_world"])
        place = matrix[:3, 3]
        cutoff, beam = (_angle(values, text, key) for key in ("cutoff_angle", "beam_width"))
        if "texture.data" in values:
            self.remarks.add("the texture of a spot is not shown")
        return Light(
            three(place),
            self._strength(values, "intensity"),
            physical=True,
            spot_target=three(place + matrix[:3, 2]),
            spot_cutoff=cutoff,
            spot_inner=min(beam, cutoff),
            name=name,
        )

    def _map(self, values: Mapping[str, Any]) -> tuple[Sky, np.ndarray]:
        """Return the sky of an environment map, and its axes.

        Mitsuba's map has its middle at +z of the emitter and goes round towards −x; ours has −z (north) and +x (east) there.
        """
        data = np.array(values["data"], np.float32)[..., :3]
        data = data[:, :-1]  # Mitsuba repeats the first column after the last one
        scale = float(numbers(values.get("scale", 1.0))[0])
        rotation = _matrix(values["to_world"])[:3, :3]
        rotation = rotation / np.linalg.norm(rotation, axis=0)
        frame = (rotation @ np.diag([-1.0, 1.0, -1.0])).T
        return Sky(environment=sky_map(np.maximum(data, 0.0) * np.float32(scale))), frame

    def _strength(self, values: Mapping[str, Any], key: str) -> tuple[float, float, float]:
        found = color(values, key)
        if found is None:
            self.remarks.add(f"an emitter's {key} is no colour; using 1 1 1")
            return 1.0, 1.0, 1.0
        return found


def _angle(values: Mapping[str, Any], text: str, key: str) -> float:
    """Return an angle of a spot in degrees; Mitsuba before 3.8 only prints it, in radians."""
    if key in values:
        return float(numbers(values[key])[0])
    found = re.search(rf"{key} = ([\d.e+-]+)", text)
    if found is None:
        raise InputError(f"this version of Mitsuba does not expose the {key} of a spot; pip install -U mitsuba")
    return math.degrees(float(found[1]))


def _matrix(transform: Any) -> np.ndarray:
    """Return (4, 4) of a Mitsuba transform."""
    return np.array(transform.matrix, float).reshape(4, 4)
