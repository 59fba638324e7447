"""Reader of the lights of a `.scene`: `.light` files, with OpenGL's terms, W/sr or a photometry, and `.ies` files."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from irrsplat.core.errors import InputError
from irrsplat.core.vectors import Vector, vector
from irrsplat.core.words import quote
from irrsplat.scene.io.lights.ies import load_ies
from irrsplat.scene.io.lines import Line, lines
from irrsplat.scene.model import Light, Photometry

USAGE = {
    usage.split()[0]: usage
    for usage in (
        "position X Y Z W",
        "diffuse R G B A",
        "ambient R G B A",
        "specular R G B A",
        "spotDirection X Y Z",
        "spotCutoff DEG",
        "spotExponent E",
        "constantAttenuation K",
        "linearAttenuation K",
        "quadraticAttenuation K",
        "intensity R G B",
        "spotInner DEG",
        "ies FILE.ies",
        "zeroDirection X Y Z",
    )
}
_OF_LUMINAIRES = ("ies", "position", "spotDirection", "zeroDirection", "intensity", "ambient", "specular")
_ATTENUATION = ("constantAttenuation", "linearAttenuation", "quadraticAttenuation")


@dataclass
class LightReader:
    """Lights of one scene, which has one unit of light; each file is read once.

    files: all files read. notices: remarks for users.
    """

    files: list[Path] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    _photometries: dict[Path, Photometry] = field(default_factory=dict)
    _lights: dict[Path, Light] = field(default_factory=dict)

    def light(self, path: Path, per_unit: float = 1.0) -> Light:
        """Return the light in the `.light` file at `path`; raise InputError with file and line for an invalid file.

        W of `position` is 1 for a point or spot light and 0 for a directional one, which comes *from* X Y Z. `spotDirection` is
        the point that the light is aimed at. A `spotCutoff` of 90 or 180 degrees, or none, means no cone. per_unit: W/sr for each
        unit of `intensity` and `diffuse`; it does not apply to a luminaire's candela.
        """
        if path in self._lights:
            return self._lights[path]
        self.files.append(path)
        found: dict[str, tuple[float, ...]] = {}
        at: dict[str, Line] = {}
        for line in lines(path):
            if line.word not in USAGE:
                raise line.error(f"unknown word {quote(line.word)}; expected one of {', '.join(USAGE)}")
            if line.word in at:
                raise line.error(f"'{line.word}' is given twice; first in line {at[line.word].number}")
            found[line.word] = () if line.word == "ies" else line.numbers(USAGE[line.word])
            at[line.word] = line
        if "ies" in at:
            light = _luminaire(path, found, at, self.photometry(at["ies"].file(USAGE["ies"])))
        elif "zeroDirection" in at:
            raise at["zeroDirection"].error(f"'zeroDirection' turns a luminaire about its aim; expected as well: {USAGE['ies']}")
        else:
            light = _light(path, found, at, per_unit)
        self._lights[path] = light
        return light

    def photometry(self, path: Path) -> Photometry:
        """Read the photometry in the `.ies` file at `path`; raise InputError as `load_ies`."""
        if path not in self._photometries:
            self.files.append(path)
            self._photometries[path] = load_ies(path, self.notices, self.files)
        return self._photometries[path]


def placed(photometry: Photometry, matrix: np.ndarray) -> Light:
    """Return a luminaire at the place of the matrix (4, 4), world_from_luminaire, which may rotate, mirror and scale uniformly.

    Its intensity does not depend on the scale. Raises InputError for a matrix with another scale along each axis.
    """
    scale = abs(float(np.linalg.det(matrix[:3, :3]))) ** (1.0 / 3.0)
    turn = matrix[:3, :3] / scale
    if not np.allclose(turn.T @ turn, np.eye(3), atol=1e-6):
        raise InputError("the matrix here stretches the luminaire; expected a scale that is the same along x, y and z")
    if np.linalg.det(turn) < 0.0:
        photometry = replace(photometry, axes=photometry.axes * [1.0, -1.0, 1.0])  # x and z give the place, y follows
    return Light(
        vector(matrix[:3, 3]),
        (1.0, 1.0, 1.0),
        physical=True,
        spot_target=vector(matrix[:3, 3] - turn[:, 2]),
        name=Path(photometry.path).stem,
        photometry=photometry,
        across=vector(turn[:, 0]),
    )


def _position(path: Path, found: dict[str, tuple[float, ...]], at: dict[str, Line]) -> tuple[float, float, float, float]:
    """Return X, Y, Z and W, 0 or 1."""
    if "position" not in at:
        raise InputError(f"the light has no position; add: {USAGE['position']}", path)
    x, y, z, w = found["position"]
    if w not in (0.0, 1.0):
        raise at["position"].error(f"W is {w:g}; expected 1 (a point or spot light) or 0 (a directional one)")
    return x, y, z, w


def _luminaire(path: Path, found: dict[str, tuple[float, ...]], at: dict[str, Line], photometry: Photometry) -> Light:
    for word, line in at.items():
        if word not in _OF_LUMINAIRES:
            raise line.error(f"'{word}' and 'ies' exclude each other; a luminaire takes {', '.join(_OF_LUMINAIRES)}")
    x, y, z, w = _position(path, found, at)
    if w == 0.0:
        raise at["position"].error("a luminaire is not directional; expected W 1")
    if "spotDirection" not in at:
        raise at["ies"].error(f"a luminaire needs the point that it is aimed at; add: {USAGE['spotDirection']}")
    r, g, b = found.get("intensity", (1.0, 1.0, 1.0))
    if min(r, g, b) < 0.0:
        raise at["intensity"].error("'intensity' is negative; expected values of 0 or more")
    u, v, t = _target(found, at, (x, y, z))
    across = found.get("zeroDirection", (1.0, 0.0, 0.0))
    if "zeroDirection" in at and not np.linalg.norm(np.cross(across, np.subtract((u, v, t), (x, y, z)))) > 0.0:
        raise at["zeroDirection"].error("zeroDirection is 0 0 0, or lies along the aim; expected a direction across it")
    return Light(
        (x, y, z),
        (r, g, b),
        physical=True,
        spot_target=(u, v, t),
        name=path.stem,
        photometry=photometry,
        across=vector(across),
    )


def _light(path: Path, found: dict[str, tuple[float, ...]], at: dict[str, Line], per_unit: float) -> Light:
    *position, w = _position(path, found, at)
    directional = w == 0.0
    if directional and not any(position):
        raise at["position"].error("a directional light comes from X Y Z; expected a direction other than 0 0 0")

    physical = "intensity" in at
    if not physical and "diffuse" not in at:
        raise InputError(f"the light has no colour; add: {USAGE['diffuse']}, or: {USAGE['intensity']}", path)
    for word in ("diffuse", *_ATTENUATION):
        if physical and word in at:
            raise at[word].error(f"'{word}' and 'intensity' exclude each other; an intensity falls off with 1/d²")
    if physical and directional:
        raise at["intensity"].error("a directional light (W 0) has no intensity in W/sr; give diffuse R G B A instead")
    color = found["intensity" if physical else "diffuse"][:3]
    for word in ("intensity", "diffuse", *_ATTENUATION, "spotExponent"):
        if word in at and min(found[word][:3]) < 0.0:
            raise at[word].error(f"'{word}' is negative; expected values of 0 or more")
    attenuation = tuple(found.get(word, (default,))[0] for word, default in zip(_ATTENUATION, (1.0, 0.0, 0.0), strict=True))
    if not any(attenuation):
        raise at["constantAttenuation"].error("every attenuation is 0, a division by zero; expected at least one above 0")

    target, cutoff, inner = _cone(found, at, tuple(position), directional)
    return Light(
        position=vector(position),
        color=vector([c * per_unit for c in color]),
        directional=directional,
        physical=physical,
        attenuation=vector(attenuation),
        spot_target=target,
        spot_cutoff=cutoff,
        spot_inner=inner,
        spot_exponent=found.get("spotExponent", (0.0,))[0] if target else 0.0,
        name=path.stem,
    )


def _cone(
    found: dict[str, tuple[float, ...]], at: dict[str, Line], position: tuple[float, ...], directional: bool
) -> tuple[Vector | None, float, float]:
    """Return the target of a spot, its cutoff and its inner half angle; (None, 180, 180) for a light without a cone."""
    cutoff = found.get("spotCutoff", (180.0,))[0]
    if not (0.0 < cutoff <= 90.0 or cutoff == 180.0):
        raise at["spotCutoff"].error(f"spotCutoff is {cutoff:g}; expected a half angle above 0 and up to 90 degrees, or 180")
    if cutoff >= 90.0:
        if "spotInner" in at:
            raise at["spotInner"].error("'spotInner' needs a cone; expected a spotCutoff below 90 degrees as well")
        return None, 180.0, 180.0
    if directional:
        raise at["spotCutoff"].error("a directional light (W 0) has no cone; leave spotCutoff out or set W to 1")
    if "spotDirection" not in at:
        raise at["spotCutoff"].error(f"a cone needs the point that it is aimed at; add: {USAGE['spotDirection']}")
    target = _target(found, at, position)
    inner = found.get("spotInner", (cutoff,))[0]
    if not 0.0 <= inner <= cutoff:
        raise at["spotInner"].error(f"spotInner is {inner:g}; expected 0 to spotCutoff ({cutoff:g}) degrees")
    return target, cutoff, inner


def _target(found: dict[str, tuple[float, ...]], at: dict[str, Line], position: tuple[float, ...]) -> Vector:
    x, y, z = found["spotDirection"]
    if (x, y, z) == position:
        raise at["spotDirection"].error("the light is aimed at its own position; spotDirection is another point in space")
    return x, y, z
