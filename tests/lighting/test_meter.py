"""Light meter against closed forms: lights, sky, panels and windows, enclosures; grids, points in solids, and units."""

from __future__ import annotations

import json
from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import Sites
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.core.vectors import check_finite
from irrsplat.meter.light_meter import LightMeter
from irrsplat.meter.light_scale import LightScale
from irrsplat.meter.plane import Plane, horizontal, line_points
from irrsplat.meter.readings import Readings, Status
from irrsplat.scene.model import Camera, Light, Mesh, Scene
from irrsplat.scene.spatial.solids import inside_solids
from tests.support import worlds

UP = (0.0, 1.0, 0.0)
BLACK = worlds.material(0.0)


def read(ctx: moderngl.Context, scene: Scene, points: np.ndarray, normal: object = UP, **settings: object) -> Readings:
    """Return the readings of a meter."""
    with LightMeter(scene, ctx=ctx, **settings) as meter:  # type: ignore[arg-type]
        return meter.measure(points, normal)  # type: ignore[arg-type]


@pytest.mark.parametrize(("kind", "side", "limit"), [("trace", 64, 0.06), ("embree", 128, 0.02)])
def test_the_sky_through_a_skylight(ctx: moderngl.Context, kind: str, side: int, limit: float) -> None:
    """Lambert's formula for a square of 0.3 m, 3 m above the floor of a black room.

    Of 64² rays, 13 reach it from straight below, and 5 from the farthest point.
    """
    walls = worlds.box((-3, 0, -3), (3, 3, 3), BLACK, outward=False)
    room = replace(walls, faces=np.delete(walls.faces, (6, 7), axis=0))  # no ceiling
    parts = (-3, -3, 6, 2.85), (-3, 0.15, 6, 2.85), (-3, -0.15, 2.85, 0.3), (0.15, -0.15, 2.85, 0.3)
    ceiling = (worlds.quad((x, 3, z), (width, 0, 0), (0, 0, depth), BLACK) for x, z, width, depth in parts)
    hole = np.array([(-0.15, 3, -0.15), (0.15, 3, -0.15), (0.15, 3, 0.15), (-0.15, 3, 0.15)])
    points = np.linspace((0.0, 0.0, 0.0), (1.6, 0.0, 1.2), 9)
    found = read(ctx, worlds.scene(room, *ceiling, sky=1000.0), points, gather=kind, gather_size=side).total[:, 0]
    assert np.abs(found / (1000.0 * worlds.polygon_vector(hole, points)[:, 1]) - 1.0).max() < limit


def test_the_sky_through_a_slit_has_no_bias(ctx: moderngl.Context) -> None:
    """A slit of 5 cm in a black wall, half an azimuth of a record wide: the mean of 200 rotations is the closed form.

    One rotation has a standard deviation of 12 %, so that 5 % are five standard errors of the mean.
    """
    sides = [((0, 0, 0), (0, 3, 0), (0, 0, 5)), ((4, 0, 0), (0, 3, 0), (0, 0, 5)), ((0, 0, 5), (4, 0, 0), (0, 3, 0))]
    sides += [((0, y, 0), (4, 0, 0), (0, 0, 5)) for y in (0, 3)]
    front = [((x, 0, 0), (width, 0, 0), (0, 3, 0)) for x, width in ((0, 2), (2.05, 1.95))]
    room = (worlds.quad(corner, u, v, BLACK) for corner, u, v in sides + front)
    slit = np.array([(2, 0, 0), (2, 3, 0), (2.05, 3, 0), (2.05, 0, 0)])
    points = np.tile((2.5, 0.01, 2.0), (200, 1))
    found = read(ctx, worlds.scene(*room, sky=1000.0), points).total[:, 0].mean()
    assert found == pytest.approx(1000.0 * abs(worlds.polygon_vector(slit, points[:1])[0, 1]), rel=0.05)


def test_no_eye_is_lifted_through_a_thin_wall(ctx: moderngl.Context) -> None:
    """A wall of 1 mm separates a lit and a dark room; a ground of 600 m raises the ray offset to 8.5 mm.

    Sensors towards the wall, 1 to 6 mm in front of it, measure darkness in the dark room. In the lit room E hardly changes
    over this distance.
    """
    room, wall = worlds.box((-2, 0, -2), (2, 2.5, 2), outward=False), worlds.box((-5e-4, 0, -2), (5e-4, 2.5, 2))
    points = np.stack([np.array([1.5, 3.5, 6.5, 500.0]) * 1e-3, np.ones(4), np.zeros(4)], 1)
    scene = worlds.scene(room, wall, worlds.floor(300.0, -0.1), lights=(worlds.point_light((-1.0, 1.5, 0.3), 10.0),))
    dark = read(ctx, scene, points[:3], (-1.0, 0.0, 0.0), gather_size=16)
    lit = read(ctx, scene, points * (-1, 1, 1), (1.0, 0.0, 0.0), gather_size=16).total[:, 0]
    assert dark.total.max() < 1e-3 * lit.min() and (dark.status == Status.BEHIND).all()
    assert lit[:3] == pytest.approx(lit[2], rel=0.03)


@pytest.mark.parametrize(
    "light", [worlds.point_light((0, 3, 0), 1.0), Light((0, 1, 0), (1, 1, 1), directional=True)], ids=["lamp", "sun"]
)
def test_points_beyond_the_scene_are_lit(ctx: moderngl.Context, light: Light) -> None:
    """Shadow maps cover the bounding box of all meshes; points outside their tiles have no occluder."""
    roof = worlds.quad((-1.0, 1.0, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, -2.0), BLACK)
    scene = worlds.scene(roof, worlds.floor(1.0, paint=BLACK), lights=(light,))
    points = np.array([[3.0, 0.9, 0.0], [0.0, 1.5, -9.0], [4.0, -3.0, 4.0], [1.3, -3.0, 0.0], [0.0, 0.5, 0.0]])
    found = read(ctx, scene, points, bounces=0).direct[:, 0]
    way = np.array(light.position) - (0.0 if light.directional else points)
    cosine = np.broadcast_to(way[..., 1] / np.linalg.norm(way, axis=-1), len(points))
    expected = cosine * (np.pi if light.directional else 1.0 / np.linalg.norm(way, axis=-1) ** 2)
    assert found[:4] == pytest.approx(expected[:4] * [1, 1, 1, light.directional], rel=1e-3), "a lamp's light meets the roof"
    assert found[4] == 0.0, "between roof and floor"


def test_a_point_does_not_depend_on_those_after_it(ctx: moderngl.Context) -> None:
    panel = worlds.quad((-0.6, 2.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8), worlds.material(0.0, 5.0))
    points = np.random.default_rng(1).uniform((-1, 0, -1), (1, 1, 1), (600, 3))
    scene, rough = worlds.scene(worlds.floor(), panel, sky=0.1), {"gather_size": 8, "bounces": 1, "light_samples": 4}
    many, few = (read(ctx, scene, points[:count], **rough).total for count in (600, 520))
    assert np.array_equal(many[:520], few) and np.ptp(few[:, 0]) > 0.1


@pytest.mark.parametrize(
    ("points", "normals", "words"),
    [
        ([[0, 0]], UP, "points are an array"),
        ([[0, 0, 0]], [[0, 1, 0]] * 2, "points are an array"),
        ([[0, np.nan, 0]], UP, "must be finite"),
        ([[0, 0, 0]], (0, 0, 0), "a normal is 0 0 0"),
    ],
)
def test_what_are_no_points_is_refused(ctx: moderngl.Context, points: object, normals: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(ctx, worlds.scene(worlds.floor()), points, normals)  # type: ignore[arg-type]


ASIDE = Camera((9.0, 9.0, 9.0), (0.0, 0.0, 0.0))


@pytest.fixture
def furnished() -> Scene:
    """A room, wound outward, with a light; inside stand a closed block, a box without a bottom, a table top and a sphere."""
    room = worlds.box((-3, 0, -3), (3, 3, 3))
    block = worlds.box((1, 0, 1), (2, 1, 2))
    hood = worlds.box((-2, 0, -2), (-1, 1, -1))
    hood = Mesh(hood.positions, hood.normals, np.delete(hood.faces, [4, 5], axis=0))  # two pairs per axis, x first
    table = worlds.quad((1.0, 0.7, -1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    ball = worlds.sphere((-1.5, 1.5, 1.5), 0.5)
    return worlds.scene(room, block, hood, table, ball, lights=(worlds.point_light((0, 2.8, 0)),), camera=ASIDE)


SOLID = [[1.5, 0.5, 1.5], [1.5, 0.001, 1.5], [-1.5, 0.001, -1.5], [-1.5, 0.9, -1.5], [-1.5, 1.5, 1.5], [-1.5, 1.95, 1.5]]
FREE = [[0.0, 0.001, 0.0], [1.5, 1.001, 1.5], [0.99, 0.5, 1.5], [1.5, 0.3, -1.5], [1.5, 0.699, -1.5], [-1.5, 2.05, 1.5]]
FREE += [[-1.5, 1.1, -1.5], [2.9, 2.9, 2.9], [5.0, 1.0, 0.0]]


@pytest.mark.parametrize("step", [1, -1], ids=["wound outward", "wound inward"])
def test_what_lies_in_a_solid(furnished: Scene, step: int) -> None:
    """Closed meshes are solids, and a mesh with a light is a room, however they are wound."""
    meshes = [replace(m, faces=m.faces[:, ::step], closed=step > 0) if m.closed else m for m in furnished.meshes]
    points = np.array([*SOLID, *FREE])
    found = inside_solids(replace(furnished, meshes=tuple(meshes)), points, np.broadcast_to(np.array(UP), points.shape))
    assert found.tolist() == [True] * len(SOLID) + [False] * len(FREE)


def test_what_counts_and_what_does_not(ctx: moderngl.Context, furnished: Scene) -> None:
    """Points in a block, on the floor, three millimetres below the table's top, and well below it."""
    points = np.array([[1.5, 0.5, 1.5], [0.0, 0.0, 0.0], [1.5, 0.697, -1.5], [1.5, 0.4, -1.5]])
    found = read(ctx, furnished, points, bounces=1, gather_size=16)
    assert found.status.tolist() == [Status.INSIDE, Status.OK, Status.BEHIND, Status.OK]
    summary, counted = found.summary("W/m2"), found.total[[1, 3]] @ np.array([0.2126, 0.7152, 0.0722])
    assert (summary["points"], summary["inside"], summary["behind"]) == (2, 1, 1)
    assert (summary["mean"], summary["minimum"]) == pytest.approx((counted.mean(), counted.min()), rel=1e-5)


def test_the_uniformity_of_a_grid(ctx: moderngl.Context) -> None:
    """A light of 10 W/sr, 2 m above the centre of a black floor of 4 × 2 m: I·h/d³ at the cells' centres.

    Lux use 179 lm/W, as in Radiance, and the weights of Rec. 709.
    """
    light = Light((0, 2, 0), (10.0, 20.0, 0.0), physical=True)
    grid = Plane((-2.0, 0.0, 1.0), (4.0, 0.0, 0.0), (0.0, 0.0, -2.0)).grid(0.5)
    found = read(ctx, worlds.scene(worlds.floor(paint=BLACK), lights=(light,)), grid.points, grid.normals, bounces=1)
    x, z = np.meshgrid(-1.75 + 0.5 * np.arange(8), 0.75 - 0.5 * np.arange(4))
    assert np.allclose(grid.points, np.stack([x, 0.0 * x, z], -1).reshape(-1, 3)) and not found.indirect.any()
    E = (0.2126 * 10.0 + 0.7152 * 20.0) * 2.0 / (x**2 + 4.0 + z**2) ** 1.5
    for summary, factor in ((found.summary("W/m2"), 1.0), (found.summary("lux"), 179.0)):
        values = [summary[name] for name in ("mean", "minimum", "maximum", "uniformity")]
        assert values == pytest.approx([factor * E.mean(), factor * E.min(), factor * E.max(), E.min() / E.mean()], rel=1e-3)
        assert json.loads(json.dumps(summary)) == summary


def test_a_grid_shares_any_parallelogram_out_evenly() -> None:
    plane = Plane((1.0, 2.0, 3.0), (2.0, 0.0, 0.0), (1.0, 0.0, -3.0))
    grid = plane.grid(0.99)
    assert (grid.columns, grid.rows) == (3, 4)
    assert np.allclose(grid.points[0], np.array([1, 2, 3]) + np.array([2, 0, 0]) / 6 + np.array([1, 0, -3]) / 8)
    assert np.allclose(grid.points.mean(0), [2.5, 2.0, 1.5]) and np.allclose(grid.normals, UP)
    inner = Plane((0, 0, 0), (4, 0, 0), (0, 0, -3)).grid(1.0, margin=0.5)
    assert (inner.columns, inner.rows) == (3, 2)
    assert np.allclose(inner.points.min(0), [1.0, 0.0, -2.0]) and np.allclose(inner.points.max(0), [3.0, 0.0, -1.0])


def test_the_spacing_of_the_standard() -> None:
    """EN 12464-1: 0.2·5^log₁₀(d), 0.2 m at 1 m, 1 m at 10 m, 10 m at most; d is the shorter edge of a long plane."""
    for side, shown in ((0.6, 0.15), (2, 0.3), (5, 0.6), (25, 2.0), (50, 3.0), (100, 5.0)):  # rounded, as tables of it have it
        assert Plane((0, 0, 0), (side, 0, 0), (0, 0, -0.7 * side)).usual_spacing() == pytest.approx(shown, abs=0.1 * shown)
    assert Plane((0, 0, 0), (10, 0, 0), (0, 0, -6)).usual_spacing() == pytest.approx(1.0)
    assert Plane((0, 0, 0), (50, 0, 0), (0, 0, -10)).usual_spacing() == pytest.approx(1.0)
    assert Plane((0, 0, 0), (11, 0, 0), (0, 0, -7)).usual_spacing(margin=0.5) == pytest.approx(1.0)
    assert Plane((0, 0, 0), (900, 0, 0), (0, 0, -900)).usual_spacing() == 10.0


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 0.6, 0.8)])
def test_a_level_plane_lies_above_the_lowest_point(up: tuple[float, float, float]) -> None:
    """A ground that is much wider than the rest counts for its height only: the plane is that of the scene without it."""
    scene = worlds.scene(worlds.box((-1, -2, -3), (4, 5, 6)))
    ground = worlds.scene(*scene.meshes, worlds.quad((-90.0, -3.0, 90.0), (180.0, 0, 0), (0, 0, -180.0)))
    assert (ground.near_bounds == scene.bounds).all() and horizontal(ground, 1.0) == horizontal(scene, 0.0)
    plane = horizontal(Scene(scene.meshes, (), scene.cameras, up=up), 0.8)
    assert np.allclose(plane.normal, up)
    assert np.array(plane.corner) @ np.array(up) == pytest.approx((scene.corners @ np.array(up)).min() + 0.8)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Plane((0, 0, 0), (1, 0, 0), (2, 0, 0)), "span no area"),
        (lambda: horizontal(worlds.scene(worlds.quad((0, 0, 0), (4, 0, 0), (0, 5, 0))), 0.8), "no horizontal extent"),
        (lambda: Plane((0, 0, 0), (1, 0, 0), (0, 0, np.inf)), "finite"),
        (lambda: Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)).grid(0.0), "spacing is 0"),
        (lambda: Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)).grid(1e-4), "at most 1,000,000"),
        (lambda: Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)).grid(0.1, margin=-1.0), "margin is -1"),
        (lambda: line_points((0, 0, 1), (0, 0, 1)), "two ends are one point"),
        (lambda: line_points((0, 0, 0), (1, 0, 0), 0.0), "spacing is 0"),
        (lambda: line_points((0, 0, 0), (1, 0, 0), 1e-7), "1e.07 points, at most"),
    ],
)
def test_a_plane_or_line_that_cannot_be_is_refused(make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()  # type: ignore[operator]


def test_irradiance_along_a_line_and_no_summary_of_nothing(ctx: moderngl.Context) -> None:
    """A light h above a black floor: I·h/d³ at equal distances from end to end, in several parts, with progress.

    A summary of points that all lie on a surface has no mean. A scale with an upper end keeps it.
    """
    told: list[float] = []
    points, metres = line_points((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.3)
    world = worlds.scene(worlds.floor(paint=BLACK), lights=(worlds.point_light((0, 2, 0), 10.0),))
    with LightMeter(world, ctx=ctx, bounces=1, gather_size=8) as meter:
        found = [meter.measure(part, UP, told.append).direct[:, 0] for part in (points[:3], points[3:])]
    assert metres == pytest.approx(np.linspace(0.0, 2.0, 8)) and told == [1.0, 1.0]
    assert np.concatenate(found) == pytest.approx(20.0 / (4.0 + (metres - 1.0) ** 2) ** 1.5, rel=1e-3)
    nowhere = Readings(points, points, points, points, np.full(len(points), Status.BEHIND))
    assert nowhere.summary("lux")["mean"] is None and nowhere.summary("lux")["behind"] == 8
    assert LightScale(highest=300.0).up_to(1e3).highest == 300.0 and (LightScale().up_to(1.0).highest or 0.0) >= 179.0


def test_light_that_is_no_number_is_an_error_with_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    def gathered(_: object, __: object, sites: Sites) -> tuple[np.ndarray, np.ndarray]:
        return np.where(sites.position[:, :1] > 2.0, np.inf, 1.0) * np.ones(3), np.ones(len(sites))

    with pytest.raises(IrrsplatError, match=r"E is not finite at point 1 \(1 of 6 numbers\)"):
        check_finite("E", np.array([[1.0] * 3, [np.inf, 1.0, 1.0]]), lambda at: f"point {at[0]}")
    monkeypatch.setattr(LightMeter, "_gathered", gathered)
    with pytest.raises(IrrsplatError, match=r"the light is not finite at 2\.5 1 1 "):
        irrsplat.irradiance(irrsplat.load("cornell"), np.array([[1, 1, 1], [2.5, 1, 1]]), (0, 1, 0), bounces=1)
