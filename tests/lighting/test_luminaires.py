"""Luminaires on the GPU: E = I(θ, φ)·cosθ/d² on planes around them, however they are turned; shadows, bounces, tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.core.errors import InputError
from irrsplat.lighting import gl_limits
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.luminaire_table import halvings, photometries, photometry_size, photometry_texels
from irrsplat.scene import load
from irrsplat.scene.model import Camera, Light
from tests.lighting.test_direct import SIZE, directed
from tests.support.luminaires import Intensity, bilinear, ies_text, isotropic, lambert, lopsided, photometry, steps, street
from tests.support.worlds import assert_pictures, box, floor, lamp, material, scene

WHITE = material(1.0)
AROUND, ODD = steps(0, 360, 73), [0, 1, 40, 180, 200, 300.7, 360]
FILES: dict[str, tuple[list[float], list[float], Intensity, list[float]]] = {  # angles, intensities, and the angles all around
    "isotropic": (steps(0, 180, 5), [0.0], isotropic, [0.0]),
    "downlight": (steps(0, 90, 37), [0.0], lambert, [0.0]),
    "street": (steps(0, 90, 37), steps(0, 180, 37), street, AROUND),
    "odd angles": ([0, 3, 7.3, 20, 21, 55.5, 90, 130, 180], ODD, lopsided, ODD),
    "lopsided": (steps(0, 180, 37), AROUND, lopsided, AROUND),
}  # fmt: skip
TURNS = {  # of the matrix stack, and the same as a matrix
    "as it is": ("", np.eye(3)),
    "down": ("rotate -90 1 0 0\n", np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])),
    "askew": ("rotate -90 1 0 0\nrotate 90 0 1 0\nscale 1 -1 1\n", np.array([[0.0, 0, 1], [-1, 0, 0], [0, 1, 0]])),
}


def room() -> list:
    """Six walls, seen from within, of 4 m."""
    return [box((-2, -2, -2), (2, 2, 2), WHITE, outward=False)]


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("name", FILES)
def test_what_it_brings_to_all_walls(ctx: moderngl.Context, tmp_path: Path, name: str, turn: str) -> None:
    """Every pixel of six walls holds ρ/π·I·cosθ/d² to 0.5 %, I by an interpolation of its own and by the turn written out."""
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
        # a table's end is as hard an edge as rounding makes it; at the room's edges texels of the maps meet both walls
        corner = np.sort(2.0 - np.abs(found["position"]), axis=-1)[..., 1] < 0.05
        end = np.degrees(np.arccos(np.clip(-(way @ matrix)[..., 2] / d, -1, 1))) - min(vertical[-1], 179.0)
        assert_pictures(f"luminaire_{name}_{turn}", found["direct"], truth, 5e-3 * truth + 1e-6, ~corner & (np.abs(end) > 0.01))


def test_colour_and_other_lights_beside_it(ctx: moderngl.Context) -> None:
    """Its colour is a factor; two of one photometry, one of another and lights that are none add up to what each brings alone."""
    one, other = photometry(steps(0, 180, 19), steps(0, 360, 13), lopsided), photometry(steps(0, 90, 10), [0.0], lambert)
    lights = (
        lamp((0.5, 1.0, 0.3), 2.0),
        Light((-0.6, 1.2, 0.1), (1.0, 0.5, 0.0), physical=True, photometry=one, spot_target=(0.0, 0.0, 0.3)),
        Light((0.6, 1.1, -0.4), (0.2, 0.2, 1.0), physical=True, photometry=other, spot_target=(0.6, 0.0, -0.4)),
        lamp((0.0, 1.5, 0.0), 3.0, spot_target=(0.3, 0.0, 0.3), spot_cutoff=40.0, spot_inner=10.0),
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


@pytest.mark.parametrize("outside", [False, True])
def test_it_throws_shadows_inside_the_scene_and_from_outside(ctx: moderngl.Context, outside: bool) -> None:
    """A sheet of ±0.3 m at half the height of the lamp throws a shadow of ±0.6 m; around it the formula holds."""
    at = np.array([0.0, 3.0 if outside else 1.0, 0.0])
    light = Light(
        tuple(at), (1.0, 1.0, 1.0), physical=True, photometry=photometry([0, 60, 90], [0.0], lambert), spot_target=(0, 0, 0)
    )
    sheets = [floor(2.0, 0.0, WHITE), floor(0.3, float(at[1] / 2), WHITE)]
    sheets += [] if outside else [floor(0.1, 1.5, WHITE)]  # so that the box reaches above the lamp
    camera = Camera((0.0, at[1] / 2 - 0.05, 1.9), (0.0, 0.0, -0.2), fov=90.0)
    found = directed(ctx, scene(*sheets, lights=(light,), camera=camera), shadow=512)
    p, on = found["position"], (np.abs(found["position"][..., 1]) < 1e-4) & (found["depth"] > 0.0)
    rim = np.abs(p[..., [0, 2]]).max(-1) - 0.6
    assert (on & (rim < -0.03)).sum() > 100 and (on & (rim > 0.03)).sum() > 1000
    assert not found["direct"][on & (rim < -0.03)].any()
    assert (found["direct"][on & (rim > 0.03)] > 0.0).all()


def test_it_follows_where_it_is_moved_and_aimed(ctx: moderngl.Context) -> None:
    """A renderer relit with other luminaires shows what a new one does: other aims, another file, and none."""
    narrow = photometry(steps(0, 30, 7), [0.0], lambert)
    first = Light((0.0, 1.5, 0.0), (1.0, 1.0, 1.0), physical=True, photometry=narrow, spot_target=(0.5, 0.0, 0.0))
    changes = (
        (replace(first, spot_target=(-0.5, 0.0, 0.2)),),
        (replace(first, photometry=photometry(steps(0, 180, 91), steps(0, 360, 25), lopsided)),),
        (lamp((0.0, 1.0, 0.0), 1.0),),
        (first, first),
    )
    world = scene(floor(1.0, 0.0, material(0.5)), lights=(first,))
    with Renderer(world, SIZE, bounces=1, gather_size=8) as renderer:
        before = renderer.render()
        for lights in changes:
            renderer.relight(lights)
            shown = renderer.render()
            with Renderer(replace(world, lights=lights), SIZE, bounces=1, gather_size=8) as fresh:
                assert np.array_equal(shown.direct, fresh.render().direct) and not np.array_equal(shown.direct, before.direct)


def test_all_bounces_bring_what_it_sends_out() -> None:
    """In a closed white-ish room Σ E·A of direct light is its flux, whichever way it is aimed: the mean of E over the walls of a
    cube of 24·s² m² is Φ/(179·A), and that of all light with albedo ρ is 1/(1 − ρ) times it (a furnace on average)."""
    shape = photometry(steps(0, 180, 37), AROUND, lopsided)
    light = Light((0.1, 0.2, -0.1), (1.0, 1.0, 1.0), physical=True, photometry=shape, spot_target=(1.0, 0.5, 0.3))
    rho, mean = 0.5, shape.flux / LUMINOUS_EFFICACY / 24.0
    walls = [box((-1, -1, -1), (1, 1, 1), material(rho), outward=False)]
    total, weight = 0.0, 0.0
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):  # a face fills the view of 90° of its camera in the middle
        up = (0.0, 0.0, 1.0) if abs(axis[2]) < 0.5 else (0.0, 1.0, 0.0)
        world = scene(*walls, lights=(light,), camera=Camera((0.0, 0.0, 0.0), tuple(axis), up, 90.0))
        with Renderer(world, (32, 32), bounces="all", gather_size=16, samples=1) as renderer:
            frame = renderer.render()
        E = (frame.direct / (rho / np.pi) + frame.irradiance)[..., 0]
        total, weight = total + float(E.sum()), weight + E.size
    assert total / weight == pytest.approx(mean / (1.0 - rho), rel=0.02)


def test_scenes_without_luminaires_pay_nothing(ctx: moderngl.Context) -> None:
    assert light_defines(scene(lights=(lamp((0, 1, 0)),)))["LIGHTS_WITH_LUMINAIRE"] == 0
    spot = lamp((0, 1, 0), spot_target=(0, 0, 0), spot_cutoff=30.0, spot_inner=30.0)
    aimed = Light((0, 1, 0), (1, 1, 1), physical=True, photometry=photometry([0, 90], [0.0], lambert), spot_target=(0, 0, 0))
    assert [light_defines(scene(lights=(light,)))["LIGHTS_WITH_CONE"] for light in (spot, aimed)] == [1, 0]


@pytest.mark.parametrize(("angles", "expected"), [((2, 1), 0), ((3, 1), 1), ((5, 2), 2), ((6, 2), 3), ((10, 73), 7)])
def test_intervals_are_halved_until_one_is_left(angles: tuple[int, int], expected: int) -> None:
    polar, azimuth = angles
    shape = photometry(steps(0, 180, polar), steps(0, 360, azimuth) if azimuth > 1 else [0.0], isotropic)
    assert halvings([shape]) == expected and 2**expected >= max(polar, azimuth) - 1


def test_the_texture_holds_a_photometry_once() -> None:
    one, other = photometry([0, 90, 180], [0, 360], isotropic), photometry([0, 90], [0.0], lambert)
    lights = [Light((0, i, 0), (1, 1, 1), physical=True, photometry=p) for i, p in enumerate((one, other, one))]
    assert photometries(lights) == (one, other) and photometry_size((one, other)) == (4, 5)
    expected: list[list[float]] = [
        [0, 0, 90, 180],
        [0, *[100 / 179] * 3],
        [360, *[100 / 179] * 3],
        [0, 0, 90, 0],
        [0, 1000 / 179, 0, 0],
    ]
    np.testing.assert_allclose(photometry_texels((one, other)), np.array(expected), rtol=1e-6, atol=1e-6)


def test_a_photometry_that_no_texture_holds_is_refused(ctx: moderngl.Context) -> None:
    limit = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    wide = replace(photometry([0, 90], [0.0], lambert), polar=np.linspace(0, 180, limit + 1), candela=np.ones((1, limit + 1)))
    world = scene(floor(), lights=(Light((0, 1, 0), (1, 1, 1), physical=True, photometry=wide),))
    with pytest.raises(InputError, match="luminaires"):
        gl_limits.check(ctx, SIZE, world, 64)
