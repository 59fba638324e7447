"""Reader of `.scene` files, the text format of the seed paper, which maps to OpenGL's matrix commands."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.core.load_options import LoadOptions
from irrsplat.core.paths import take_copies
from irrsplat.core.vectors import Vector, vector
from irrsplat.core.words import is_number, quote
from irrsplat.scene.io.defaults import finish
from irrsplat.scene.io.lights.light_text import LightReader, placed
from irrsplat.scene.io.lines import Line, lines
from irrsplat.scene.io.mesh_builder import Part, build_meshes
from irrsplat.scene.io.obj.reader import Shape, load_obj
from irrsplat.scene.model import Camera, Light, Material, Scene
from irrsplat.sky import sky_text

USAGE = {
    "units": "units radiometric, or: units photometric",
    "cam": "cam EX EY EZ TX TY TZ UX UY UZ",
    "proj": "proj FOVY ASPECT NEAR FAR",
    "light": "light FILE.light, or: light FILE.ies",
    "brdf": "brdf diffuse R G B A, or: brdf emission R G B",
    "sky": f"sky {sky_text.USAGE}",
    "push": "push",
    "pop": "pop",
    "trans": "trans X Y Z",
    "rotate": "rotate DEG X Y Z",
    "scale": "scale X Y Z",
    "obj": "obj FILE.obj",
}
_MOST_OBJECTS = 1 << 16  # `obj` lines, each of which becomes a mesh
_NAMED = "cam NAME EX EY EZ TX TY TZ UX UY UZ"


def load_text(path: Path, options: LoadOptions = LoadOptions()) -> Scene:  # noqa: B008  # it is frozen
    """Load the scene in the `.scene` file at `path`; raise InputError with file and line for an invalid file.

    Matrices multiply on the right, as glTranslate, glRotate and glScale do, in float64. Scene.cameras[0] is the unnamed
    `cam`, else the first named one, else a camera that sees everything. Notices list omissions and defaults.
    options: only the sky applies, in place of the file's.
    """
    reader = _Reader(other_sky=sky_text.sky_of(options.sky))
    for line in lines(path):
        command = getattr(reader, f"_{line.word}", None) if line.word in USAGE else None
        if command is None:
            raise line.error(f"unknown word {quote(line.word)}; expected one of {', '.join(USAGE)}")
        command(line)
    return reader.scene(path)


@dataclass
class _Reader:
    """Interpreter of the commands, one method each: OpenGL's state, and the scene so far.

    other_sky: in place of the file's.
    """

    other_sky: sky_text.Sky | None = None
    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))  # world_from_object
    stack: list[tuple[Line, np.ndarray]] = field(default_factory=list)
    material: Material = Material()
    once: dict[str, Line] = field(default_factory=dict)
    fov: float = 45.0  # degrees
    per_unit: float = 1.0  # W/sr per unit of lights, and W/(m² sr) per unit of emission and sky
    first_brightness: Line | None = None  # the first line with a radiance or intensity
    camera_lines: list[tuple[Line, str, tuple[float, ...]]] = field(default_factory=list)
    sky: sky_text.Sky | None = None
    lights: list[Light] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    paths: dict[str, Path] = field(default_factory=dict)  # of `obj` and `light` lines, by their text
    shapes: dict[Path, Shape] = field(default_factory=dict)
    light_reader: LightReader = field(default_factory=LightReader)

    def scene(self, path: Path) -> Scene:
        if self.stack:
            raise self.stack[-1][0].error("this 'push' has no 'pop'; add one, or remove it")
        cameras = []
        for line, name, values in sorted(self.camera_lines, key=lambda cam: cam[1] != ""):  # stable: the unnamed one first
            eye, target, up = (vector(values[i : i + 3]) for i in (0, 3, 6))
            with line.named_in_errors():
                cameras.append(Camera(eye, target, up, self.fov, name))
        meshes, dropped = [], Counter[str]()
        found, origin = build_meshes(self.parts)
        for built in found:
            if built.mesh is None:
                raise built.part.source.error(built.problem)
            meshes.append(built.mesh)
            dropped[str(built.part.files[0])] += built.dropped
        files, sky = [*self.shapes, *self.light_reader.files], self.other_sky or self.sky
        sky = sky and sky.in_watts(self.per_unit)
        return finish(path, meshes, self.lights, cameras, sky, dropped, self.light_reader.notices, files, None, origin)

    def _once(self, key: str, line: Line) -> None:
        if key in self.once:
            raise line.error(f"'{key}' is given twice; first in line {self.once[key].number}")
        self.once[key] = line

    def _cam(self, line: Line) -> None:
        name, args = "", line.args
        if len(args) == 10:
            name, args = args[0], args[1:]
            if is_number(name):
                raise line.error(f"'cam' has 10 numbers; expected: {USAGE['cam']}, or: {_NAMED}")
        elif len(args) != 9:
            raise line.error(f"'cam' has {len(args)} values; expected: {USAGE['cam']}, or: {_NAMED}")
        self._once(f"cam {name}".strip(), line)
        self.camera_lines.append((line, name, line.numbers(_NAMED if name else USAGE["cam"], args)))

    def _proj(self, line: Line) -> None:
        fov, aspect, near, far = line.numbers(USAGE["proj"])
        self._once("proj", line)
        if not 0.0 < fov < 180.0:
            raise line.error(f"the field of view is {fov:g}; expected FOVY between 0 and 180 degrees")
        if not (aspect > 0.0 and near >= 0.0 and far > near):
            raise line.error(f"expected ASPECT above 0 and 0 <= NEAR < FAR: {USAGE['proj']}")
        self.fov = fov

    def _units(self, line: Line) -> None:
        if line.args not in (("radiometric",), ("photometric",)):
            raise line.error(f"{quote(line.rest)} are no units; expected: {USAGE['units']}")
        self._once("units", line)
        if self.first_brightness is not None:
            raise line.error(
                f"'units' stands before all light, but line {self.first_brightness.number} has some; move it to the top"
            )
        self.per_unit = 1.0 / LUMINOUS_EFFICACY if line.args == ("photometric",) else 1.0

    def _radiance(self, line: Line, r: float, g: float, b: float) -> Vector:
        """Return W/(m² sr) for values in the file's units."""
        self.first_brightness = self.first_brightness or line
        return r * self.per_unit, g * self.per_unit, b * self.per_unit

    def _path(self, line: Line) -> Path:
        """Return the file that an `obj` or `light` line names."""
        if line.rest not in self.paths:
            self.paths[line.rest] = line.file(USAGE[line.word])
        return self.paths[line.rest]

    def _light(self, line: Line) -> None:
        self.first_brightness = self.first_brightness or line
        path = self._path(line)
        if path.suffix.lower() not in (".ies", ".ldt"):  # the reader of .ies refuses .ldt with a remedy
            self.lights.append(self.light_reader.light(path, self.per_unit))
            return
        photometry = self.light_reader.photometry(path)
        with line.named_in_errors():
            self.lights.append(placed(photometry, self.matrix))

    def _brdf(self, line: Line) -> None:
        kind = line.args[0] if line.args else ""
        if kind == "diffuse":
            r, g, b, _ = line.numbers("diffuse R G B A", line.args[1:])
            if not 0.0 <= min(r, g, b) <= max(r, g, b) <= 1.0:
                raise line.error(f"the reflectance is {r:g} {g:g} {b:g}; expected values from 0 to 1")
            self.material = replace(self.material, albedo=(r, g, b))
        elif kind == "emission":
            r, g, b = line.numbers("emission R G B", line.args[1:])
            if min(r, g, b) < 0.0:
                raise line.error(f"the emission is {r:g} {g:g} {b:g}; expected values of 0 or more")
            self.material = replace(self.material, emission=self._radiance(line, r, g, b))
        else:
            raise line.error(f"{quote(kind)} is no kind of brdf; expected: {USAGE['brdf']}")

    def _sky(self, line: Line) -> None:
        self._once("sky", line)
        self.first_brightness = self.first_brightness or line
        self.sky = sky_text.parse(line.rest, line.path.parent, line.error)

    def _push(self, line: Line) -> None:
        line.numbers(USAGE["push"])
        self.stack.append((line, self.matrix))

    def _pop(self, line: Line) -> None:
        line.numbers(USAGE["pop"])
        if not self.stack:
            raise line.error("this 'pop' has no 'push' before it; add one, or remove it")
        _, self.matrix = self.stack.pop()

    def _trans(self, line: Line) -> None:
        step = np.eye(4)
        step[:3, 3] = line.numbers(USAGE["trans"])
        self.matrix = self.matrix @ step

    def _rotate(self, line: Line) -> None:
        angle, *axis = line.numbers(USAGE["rotate"])
        if not any(axis):
            raise line.error(f"the rotation axis is 0 0 0; expected: {USAGE['rotate']}, with an axis of any other length")
        self.matrix = self.matrix @ _rotation(angle, axis)

    def _scale(self, line: Line) -> None:
        values = line.numbers(USAGE["scale"])
        if 0.0 in values:
            raise line.error("a scale of 0 flattens what follows; expected three values other than 0")
        self.matrix = self.matrix @ np.diag([*values, 1.0])

    def _obj(self, line: Line) -> None:
        path = self._path(line)
        if len(self.parts) == _MOST_OBJECTS:
            raise line.error(f"the scene has more than {_MOST_OBJECTS} 'obj' lines; join some of its objects in one file")
        if path not in self.shapes:
            self.shapes[path] = load_obj(path)
        else:
            with line.named_in_errors():
                take_copies(len(self.shapes[path].positions))
        shape = self.shapes[path]
        self.parts.append(
            Part(
                shape.positions,
                shape.corners,
                shape.normals,
                shape.corner_normals,
                self.matrix,
                self.material,
                name=path.stem,
                files=(path,),
                source=line,
            )
        )


def _rotation(angle: float, axis: Sequence[float]) -> np.ndarray:
    """Return (4, 4): a rotation by `angle` degrees about `axis` (of any length), as glRotate, by Rodrigues' formula."""
    greatest = max(map(abs, axis))
    length = math.hypot(*(a / greatest for a in axis))
    x, y, z = (a / greatest / length for a in axis)
    s, c = math.sin(math.radians(angle)), math.cos(math.radians(angle))
    k = 1.0 - c
    return np.array(
        [
            [k * x * x + c, k * x * y - s * z, k * x * z + s * y, 0.0],
            [k * x * y + s * z, k * y * y + c, k * y * z - s * x, 0.0],
            [k * x * z - s * y, k * y * z + s * x, k * z * z + c, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
