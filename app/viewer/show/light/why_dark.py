"""The light at one point by its sources (lights, emitters and the sky), and the meshes that block sources, by ray casts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from irrsplat.app.viewer.editing.objects import light_name, meshes_of, object_name
from irrsplat.app.viewer.view_options import Point
from irrsplat.core.color import LUMINOUS_EFFICACY, photometric
from irrsplat.core.vectors import unit
from irrsplat.gather.record_frame import tangent_frames
from irrsplat.gather.stratified import ray_directions
from irrsplat.scene.model import Light, Scene
from irrsplat.scene.ray_caster import RayCaster

_SIDE = 64  # its square is the number of rays over the hemisphere; the standard error of a share of one half is at most 0.8 %
_MOST = 16  # the most emitters in the list
_FAR = 10.0  # diagonals: the distance within which meshes block a directional light
_RISE = 1e-5  # diagonals: the height above the surface at which rays start


@dataclass(frozen=True)
class Source:
    """A light or an emitter, and its light at one point.

    lux: the direct illuminance. reason: the cause of no light, such as a blocker; "" if light arrives.
    """

    name: str
    lux: float
    reason: str


@dataclass(frozen=True)
class PointLight:
    """The direct light of a point. sky_share: the share of the sky in the hemisphere, weighted by the cosine."""

    sources: tuple[Source, ...]
    sky_share: float
    sky_lux: float


def light_at(scene: Scene, caster: RayCaster, point: Point, normal: Point) -> PointLight:
    """Return the direct light of a surface point with a unit normal. caster: holds the triangles in the order of drawing."""
    n = np.asarray(normal, float)
    start, frame = np.asarray(point) + _RISE * scene.diagonal * n, tangent_frames(n[None], np.zeros(1), 0)
    rays = ray_directions(_SIDE)
    hits = meshes_of(scene, caster.first_hits(start[None], frame, rays)[0])

    def blocker(end: np.ndarray) -> str:
        """Return the name of the first mesh between start and end; "" for none."""
        if caster.free(start[None], end[None])[0]:
            return ""
        way = unit((end - start)[None])
        (mesh,) = meshes_of(scene, caster.first_hits(start[None], np.eye(3)[None], way)[0])
        return object_name(scene, int(mesh)) if mesh >= 0 else ""

    sources = []
    for number, light in enumerate(scene.lights):
        E, toward = _unoccluded(light, start, n)
        end = start + toward * (_FAR * scene.diagonal if light.directional else 1.0)
        what = blocker(end) if E.any() else ""
        reason = f"blocked by {what}" if what else "" if E.any() else _unlit(light, toward, n)
        sources.append(Source(light_name(light, number), 0.0 if what else float(photometric(E)), reason))
    for i in [i for i, mesh in enumerate(scene.meshes) if any(mesh.material.emission) and len(mesh.faces)][:_MOST]:
        mesh, end = scene.meshes[i], scene.meshes[i].positions.mean(0).astype(float)
        lux = math.pi * float(photometric(np.asarray(mesh.material.emission, float))) * float((hits == i).mean())
        what = "" if lux else blocker(end)
        reason = (
            "" if lux else f"blocked by {what}" if what not in ("", object_name(scene, i)) else "seen from its edge or not at all"
        )
        sources.append(Source(object_name(scene, i), lux, reason))
    sky = scene.sky_radiance(rays @ frame[0], 2.0 * math.pi / len(rays)) * (hits < 0)[:, None]
    return PointLight(tuple(sources), float((hits < 0).mean()), math.pi * float(photometric(sky).mean()))


def _unoccluded(light: Light, p: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the irradiance (3,) of a light without blockers, W/m², and the vector to it (3,), a unit vector if directional."""
    toward = np.asarray(light.position, float) - (0.0 if light.directional else p)
    d = float(np.linalg.norm(toward))
    w = toward / max(d, 1e-30)
    strength = light.strength(d)
    if light.has_cone and light.spot_cutoff not in (90.0, 180.0):  # in scene files, both angles mean no cone
        strength *= _cone(light, -w)
    elif light.photometry is not None:
        strength *= float(light.photometry.intensity(light.frame @ -w)) / LUMINOUS_EFFICACY
    return np.asarray(light.color, float) * strength * max(float(n @ w), 0.0), w if light.directional else toward


def _cone(light: Light, away: np.ndarray) -> float:
    """Return the factor of a spot's cone along the unit direction `away` from it."""
    cosine = float(-light.frame[2] @ away)
    angle, inner = math.degrees(math.acos(min(max(cosine, -1.0), 1.0))), min(light.spot_inner, light.spot_cutoff)
    soft = 1.0 if angle <= inner else max((light.spot_cutoff - angle) / max(light.spot_cutoff - inner, 1e-9), 0.0)
    return soft * max(cosine, 0.0) ** light.spot_exponent if light.spot_exponent else soft


def _unlit(light: Light, toward: np.ndarray, n: np.ndarray) -> str:
    """Return the reason why a light without blockers sends no light to a point."""
    if not any(light.color):
        return "off"
    return "behind the surface" if toward @ n <= 0.0 else "outside of its beam"
