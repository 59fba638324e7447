"""Luminaires on the GPU: E = I(θ, φ)·cosθ/d² on planes around them, in any orientation; shadows, bounces, tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.scene import load
from irrsplat.scene.model import Camera, Light
from tests.lighting.test_direct import directed
from tests.support.luminaires import Intensity, bilinear, ies_text, isotropic, lambert, lopsided, photometry, steps, street
from tests.support.worlds import assert_pictures, box, floor, material, point_light, scene

WHITE = material(1.0)
AROUND, ODD = steps(0, 360, 73), [0, 1, 40, 180, 200, 300.7, 360]
FILES: dict[str, tuple[list[float], list[float], Intensity, list[float]]] = {  # angles, intensities, and the angles all around
    "isotropic": (steps(0, 180, 5), [0.0], isotropic, [0.0]),
    "downlight": (steps(0, 90, 37), [0.0], lambert, [0.0]),
    "street": (steps(0, 90, 37), steps(0, 180, 37), street, AROUND),
    "odd angles": ([0, 3, 7.3, 20, 21, 55.5, 90, 130, 180], ODD, lopsided, ODD),
    "lopsided": (steps(0, 180, 37), AROUND, lopsided, AROUND),
}  # fmt: skip
TURNS = {  # as matrix stack commands and as a matrix
    "as it is": ("", np.eye(3)),
    "down": ("rotate -90 1 0 0\n", np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])),
    "askew": ("rotate -90 1 0 0\nrotate 90 0 1 0\nscale 1 -1 1\n", np.array([[0.0, 0, 1], [-1, 0, 0], [0, 1, 0]])),
}


def room() -> list:
    """Return six walls of 4 m, facing inward."""
    return [box((-2, -2, -2), (2, 2, 2), WHITE, outward=False)]


@pytest.mark.parametrize(
    ("name", "turn"),
    [("isotropic", "as it is"), ("downlight", "down"), ("street", "askew"), ("odd angles", "askew"), ("lopsided", "down")],
)
def test_what_it_brings_to_all_walls(ctx: moderngl.Context, tmp_path: Path, name: str, turn: str) -> None:
    """Every pixel of six walls has ρ/π·I·cosθ/d² to 0.5 %, with I interpolated in the test and rotated explicitly."""
    vertical, horizontal, candela, around = FILES[name]
    text, matrix = TURNS[turn]
    (tmp_path / "a.ies").write_text(ies_text(vertical, horizontal, candela))
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "a.scene").write_text(f"obj t.obj\ntrans 0.3 0.2 -0.4\n{text}light a.ies\n")
    lights = load(tmp_path / "a.scene").lights
    for target in ((1, 0.2, 0.1), (-1, -0.3, 0.2), (0.2, 1, 0.4), (0.3, -1, 0.5)):
        found = directed(
            ctx, scene(*room(), lights=lights, camera=Camera((-0.1, 0.0, 0.1), target, (0, 0, 1), 100.0)), shadow=128
        )
        way = found["position"] - (0.3, 0.2, -0.4)
        d = np.linalg.norm(way, axis=-1)
        intensity = bilinear(candela, vertical, around, way @ matrix)
        E = intensity / LUMINOUS_EFFICACY * np.maximum(-(way * found["normal"]).sum(-1), 0.0) / d**3
        truth = np.repeat(E[..., None] / np.pi, 3, axis=-1)
        # a table's end is a hard edge; at the room's edges map texels cover both walls
        corner = np.sort(2.0 - np.abs(found["position"]), axis=-1)[..., 1] < 0.05
        end = np.degrees(np.arccos(np.clip(-(way @ matrix)[..., 2] / d, -1, 1))) - min(vertical[-1], 179.0)
        assert_pictures(f"luminaire_{name}_{turn}", found["direct"], truth, 5e-3 * truth + 1e-6, ~corner & (np.abs(end) > 0.01))


def test_colour_and_other_lights_beside_it(ctx: moderngl.Context) -> None:
    """Colour is a factor; luminaires of equal and of different photometry and plain lights add up."""
    one, other = photometry(steps(0, 180, 19), steps(0, 360, 13), lopsided), photometry(steps(0, 90, 10), [0.0], lambert)
    lights = (
        point_light((0.5, 1.0, 0.3), 2.0),
        Light((-0.6, 1.2, 0.1), (1.0, 0.5, 0.0), physical=True, photometry=one, spot_target=(0.0, 0.0, 0.3)),
        Light((0.6, 1.1, -0.4), (0.2, 0.2, 1.0), physical=True, photometry=other, spot_target=(0.6, 0.0, -0.4)),
        point_light((0.0, 1.5, 0.0), 3.0, spot_target=(0.3, 0.0, 0.3), spot_cutoff=40.0, spot_inner=10.0),
        Light((0.1, 1.4, 0.6), (0.5, 0.5, 0.5), physical=True, photometry=one, across=(0.0, 1.0, 0.0)),
        Light((0.2, 1.0, 0.1), (0.1, 0.2, 0.3), directional=True),
    )
    ground = floor(1.0, 0.0, WHITE)
    together = directed(ctx, scene(ground, lights=lights))["direct"]
    alone = [directed(ctx, scene(ground, lights=(light,)))["direct"] for light in lights]
    assert all(picture.max() > 0.0 for picture in alone)
    assert np.allclose(together, sum(alone), rtol=1e-4, atol=1e-6)
    assert not alone[1][..., 2].any() and np.allclose(alone[1][..., 1], 0.5 * alone[1][..., 0], rtol=1e-5)
    darker = directed(ctx, scene(ground, lights=(replace(lights[1], color=(0.0, 0.0, 0.0)),)))["direct"]
    assert not darker.any()


def test_all_bounces_bring_what_it_sends_out() -> None:
    """In a closed room, Σ E·A of direct light is the luminaire's flux in any orientation.

    The mean of E over the walls of a cube of 24·s² m² is Φ/(179·A). With all bounces and albedo ρ it is 1/(1 − ρ) times
    that (a furnace on average).
    """
    shape = photometry(steps(0, 180, 37), AROUND, lopsided)
    light = Light((0.1, 0.2, -0.1), (1.0, 1.0, 1.0), physical=True, photometry=shape, spot_target=(1.0, 0.5, 0.3))
    rho, mean = 0.5, shape.flux / LUMINOUS_EFFICACY / 24.0
    walls = [box((-1, -1, -1), (1, 1, 1), material(rho), outward=False)]
    total, weight = 0.0, 0.0
    with Renderer(scene(*walls, lights=(light,)), (12, 12), bounces="all", gather_size=8, samples=1) as renderer:
        for axis in np.concatenate([np.eye(3), -np.eye(3)]):  # a face fills the 90° view of a camera at the centre
            up = (0.0, 0.0, 1.0) if abs(axis[2]) < 0.5 else (0.0, 1.0, 0.0)
            frame = renderer.render(Camera((0.0, 0.0, 0.0), tuple(axis), up, 90.0))
            E = (frame.direct / (rho / np.pi) + frame.irradiance)[..., 0]
            total, weight = total + float(E.sum()), weight + E.size
    assert total / weight == pytest.approx(mean / (1.0 - rho), rel=0.02)
