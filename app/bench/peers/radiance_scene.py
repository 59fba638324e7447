"""Scenes in Radiance's format, for its programs obj2mesh and oconv."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from irrsplat.app.bench.peers.judging import check_plain
from irrsplat.core.errors import IrrsplatError
from irrsplat.scene.model import Light, Mesh, Scene

BULB = 0.002  # metres: radius of the sphere in place of a point light
SUN = 0.2  # degrees across: the disc in place of a directional light


def text(scene: Scene) -> str:
    """Return the scene's description; it refers to mesh0.rtm and so on, with positions and normals.

    Raises IrrsplatError for a scene that Radiance cannot express.
    """
    check_plain(scene)
    parts = []
    for number, mesh in meshes(scene):
        albedo, emission = mesh.material.albedo, mesh.material.emission
        if max(emission) > 0.0 and max(albedo) > 0.0:
            raise IrrsplatError("a surface that both emits and reflects has no counterpart")
        words = f"glow paint{number} 0 0 4 {_row(*emission, 0)}"  # 0: hit by ambient rays, never sampled directly
        if not max(emission) > 0.0:
            words = f"plastic paint{number} 0 0 5 {_row(*albedo, 0, 0)}"
        parts.append(f"void {words}\npaint{number} mesh mesh{number} 1 mesh{number}.rtm 0 0\n")
    parts += [_light(light, number) for number, light in enumerate(scene.lights)]
    if max(scene.sky) > 0.0:
        parts.append(f"void glow sky 0 0 4 {_row(*scene.sky, 0)}\nsky source around 0 0 4 0 0 1 360\n")
    return "\n".join(parts)


def meshes(scene: Scene) -> Iterator[tuple[int, Mesh]]:
    """Return the meshes with faces, and their file numbers."""
    return ((number, mesh) for number, mesh in enumerate(scene.meshes) if len(mesh.faces))


def _light(light: Light, number: int) -> str:
    """Return a light: a small invisible sphere of radiance I/(π r²), or a small disc in the sky of radiance E/Ω."""
    colour, place = np.asarray(light.color, float), np.asarray(light.position, float)
    if light.directional:
        radiance = np.pi * colour / (2.0 * math.pi * (1.0 - math.cos(math.radians(SUN / 2.0))))
        return f"void light lamp{number} 0 0 3 {_row(*radiance)}\nlamp{number} source from{number} 0 0 4 {_row(*place, SUN)}\n"
    factor, numbers = _factor(light)
    radiance = colour / (np.pi * BULB**2)
    shape = f"lamp{number} sphere bulb{number} 0 0 4 {_row(*place, BULB)}\n"
    if not factor:
        return f"void illum lamp{number} 1 void 0 3 {_row(*radiance)}\n{shape}"
    pattern = f"void brightfunc look{number} 2 {factor} . 0 {len(numbers)} {_row(*numbers)}\n"
    return f"{pattern}look{number} illum lamp{number} 1 void 0 3 {_row(*radiance)}\n{shape}"


def _factor(light: Light) -> tuple[str, list[float]]:
    """Return the formula of a light's factor in direction D at distance T metres, and its arguments A1, A2, …."""
    factors: list[str] = []
    numbers: list[float] = []

    def number(value: float) -> str:
        numbers.append(value)
        return f"A{len(numbers)}"

    if not light.physical:
        constant, linear, quadratic = (number(k) for k in light.attenuation)
        factors.append(f"PI*T*T/({constant}+{linear}*T+{quadratic}*T*T)")
    if light.spot_target is not None and light.spot_cutoff not in (90.0, 180.0):
        axis = np.subtract(light.spot_target, light.position)
        x, y, z = (number(float(a)) for a in axis / np.linalg.norm(axis))
        cosine = f"bound(-1,-({x}*Dx+{y}*Dy+{z}*Dz),1)"
        inner = min(light.spot_inner, light.spot_cutoff - 1e-3)
        cutoff, width = number(light.spot_cutoff), number(light.spot_cutoff - inner)
        factors.append(f"bound(0,({cutoff}-acos({cosine})*180/PI)/{width},1)")
        if light.spot_exponent > 0.0:
            factors.append(f"bound(0,{cosine},1)^{number(light.spot_exponent)}")
    return "*".join(factors), numbers


def _row(*numbers: float) -> str:
    return " ".join(f"{float(x):.9g}" for x in numbers)
