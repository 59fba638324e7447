"""Reads a `.light` file: one light in OpenGL's terms, or with a radiant intensity in W/sr."""

from __future__ import annotations

from pathlib import Path

from irrsplat.core.errors import InputError
from irrsplat.scene.io.lines import Line, lines, quote
from irrsplat.scene.model import Light

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
    )
}
_ATTENUATION = ("constantAttenuation", "linearAttenuation", "quadraticAttenuation")


def load_light(path: Path) -> Light:
    """The light that the file at `path` describes; raises InputError with file and line for whatever is wrong in it.

    W of `position` is 1 for a point or spot light and 0 for a directional one, which comes *from* X Y Z. `spotDirection`
    is the point that the light looks at. A `spotCutoff` of 90 or 180 degrees, or none, means no cone.
    """
    found: dict[str, tuple[float, ...]] = {}
    at: dict[str, Line] = {}
    for line in lines(path):
        if line.word not in USAGE:
            raise line.error(f"unknown word {quote(line.word)}; a .light knows {', '.join(USAGE)}")
        if line.word in at:
            raise line.error(f"'{line.word}' is given twice; first in line {at[line.word].number}")
        found[line.word], at[line.word] = line.numbers(USAGE[line.word]), line
    return _light(path, found, at)


def _light(path: Path, found: dict[str, tuple[float, ...]], at: dict[str, Line]) -> Light:
    if "position" not in at:
        raise InputError(f"the light has no position; add: {USAGE['position']}", path)
    *position, w = found["position"]
    if w not in (0.0, 1.0):
        raise at["position"].error(f"W is {w:g}; expected 1 (a point or spot light) or 0 (a directional one)")
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
        position=(position[0], position[1], position[2]),
        color=(color[0], color[1], color[2]),
        directional=directional,
        physical=physical,
        attenuation=(attenuation[0], attenuation[1], attenuation[2]),
        spot_target=target,
        spot_cutoff=cutoff,
        spot_inner=inner,
        spot_exponent=found.get("spotExponent", (0.0,))[0] if target else 0.0,
        name=path.stem,
    )


def _cone(
    found: dict[str, tuple[float, ...]], at: dict[str, Line], position: tuple[float, ...], directional: bool
) -> tuple[tuple[float, float, float] | None, float, float]:
    """The point that a spot looks at, its cutoff and its inner half angle; (None, 180, 180) for a light without a cone."""
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
        raise at["spotCutoff"].error(f"a cone needs the point that it looks at; add: {USAGE['spotDirection']}")
    x, y, z = found["spotDirection"]
    if (x, y, z) == position:
        raise at["spotDirection"].error("the light looks at its own position; spotDirection is another point in space")
    inner = found.get("spotInner", (cutoff,))[0]
    if not 0.0 <= inner <= cutoff:
        raise at["spotInner"].error(f"spotInner is {inner:g}; expected 0 to spotCutoff ({cutoff:g}) degrees")
    return (x, y, z), cutoff, inner
