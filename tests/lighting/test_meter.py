"""The light meter against closed forms: lamps, sky, panels and windows, enclosures; grids, what lies in solids, and units."""

from __future__ import annotations

import json

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.color import LUMINOUS_EFFICACY, photometric
from irrsplat.core.errors import InputError
from irrsplat.meter.light_meter import LightMeter
from irrsplat.meter.plane import Plane, horizontal
from irrsplat.meter.readings import Readings, Status
from irrsplat.meter.solids import inside_solids
from irrsplat.scene.model import Camera, Light, Mesh, Scene
from tests.support import worlds

UP = (0.0, 1.0, 0.0)
BLACK = worlds.material(0.0)
POINTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.3], [-1.5, 0.0, 1.2], [0.4, 0.5, 1.9]])  # the last one floats


def read(ctx: moderngl.Context, scene: Scene, points: np.ndarray = POINTS, normal: object = UP, **settings: object) -> Readings:
    """What a meter reads."""
    with LightMeter(scene, ctx=ctx, **settings) as meter:  # type: ignore[arg-type]
        return meter.measure(points, normal)  # type: ignore[arg-type]


# ---- closed forms ------------------------------------------------------------------------------------------------------


def test_a_lamp_over_an_open_plane(ctx: moderngl.Context) -> None:
    """E = I·cosθ/d²; a black floor sends nothing back."""
    found = read(ctx, worlds.scene(worlds.floor(paint=BLACK), lights=(worlds.lamp((0.2, 2.0, -0.1), 10.0),)))
    way = np.array([0.2, 2.0, -0.1]) - POINTS
    expected = 10.0 * way[:, 1] / np.linalg.norm(way, axis=1) ** 3
    assert np.abs(found.direct / expected[:, None] - 1.0).max() < 1e-3
    assert not found.indirect.any() and found.counts.all()


def test_a_uniform_sky_over_an_open_plane(ctx: moderngl.Context) -> None:
    """E = π·L, whatever the floor reflects."""
    found = read(ctx, worlds.scene(worlds.floor(), sky=(1.0, 2.0, 4.0)))
    assert np.abs(found.total / (np.pi * np.array([1.0, 2.0, 4.0])) - 1.0).max() < 1e-3
    assert not found.direct.any()


def parallel_corner(a: float, b: float) -> float:
    """Form factor from a point to a parallel rectangle a × b at distance 1, one corner of which lies above the point (Howell,
    "A Catalog of Radiation Heat Transfer Configuration Factors", B-3)."""
    x, y = np.hypot(1.0, a), np.hypot(1.0, b)
    return float((a / x * np.arctan(b / x) + b / y * np.arctan(a / y)) / (2.0 * np.pi))


def test_a_panel_over_a_plane_in_a_black_room(ctx: moderngl.Context) -> None:
    """E = π·L·F. The panel is 1.2 × 0.8 m, 2 m above the floor; a corner of it lies at x = -0.6, z = -0.4."""
    panel = worlds.quad((-0.6, 2.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8), worlds.material(0.0, 5.0))
    scene = worlds.scene(worlds.box((-2, 0, -2), (2, 2.5, 2), BLACK, outward=False), panel)
    points = np.array([[0.0, 0.0, 0.0], [-0.6, 0.0, -0.4]])
    found = read(ctx, scene, points).total[:, 0]
    expected = np.pi * 5.0 * np.array([4.0 * parallel_corner(0.3, 0.2), parallel_corner(0.6, 0.4)])
    assert np.abs(found / expected - 1.0).max() < 0.01


@pytest.mark.parametrize("normal", [UP, (0.0, 0.0, 1.0)])
def test_a_window_in_a_black_room(ctx: moderngl.Context, normal: tuple[float, float, float]) -> None:
    """Lambert's formula for the polygon of a window that glows, onto a level plane and onto one that faces it."""
    corner, u, v = np.array([-1.0, 0.9, 1.95]), np.array([1.6, 0.0, 0.0]), np.array([0.0, 1.2, 0.0])
    room, pane = worlds.box((-2, 0, -2), (2, 2.5, 2), BLACK, outward=False), worlds.quad(corner, u, v, worlds.material(0.0, 3.0))
    points = np.array([[0.0, 0.8, 0.0], [1.2, 0.8, 1.0], [-0.5, 0.8, -1.5]])
    found = read(ctx, worlds.scene(room, pane), points, normal).total[:, 0]
    expected = 3.0 * worlds.polygon_vector(np.array([corner, corner + u, corner + u + v, corner + v]), points) @ np.array(normal)
    assert np.abs(found / expected - 1.0).max() < 0.01


@pytest.mark.all_sites
def test_all_bounces_in_an_enclosure(ctx: moderngl.Context) -> None:
    """In a closed room of reflectance ρ that emits L everywhere, E = π·L/(1 - ρ), in the air too."""
    scene = worlds.scene(worlds.box((-1, 0, -1), (1, 2, 1), worlds.material(0.6, 1.0), outward=False))
    found = read(ctx, scene, np.array([[0.0, 1.0, 0.0], [0.9, 0.3, -0.5], [0.0, 0.0, 0.0]]))
    assert np.abs(found.total / (np.pi / 0.4) - 1.0).max() < 0.01


def test_what_is_below_a_table_lies_in_its_shadow(ctx: moderngl.Context) -> None:
    table = worlds.quad((-0.5, 0.7, 0.5), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), BLACK)
    scene = worlds.scene(worlds.floor(paint=BLACK), table, lights=(worlds.lamp((0.0, 2.0, 0.0), 4.0),))
    found = read(ctx, scene, np.array([[0.0, 0.0, 0.0], [0.0, 0.7, 0.0], [1.0, 0.0, 0.0]]))
    assert not found.total[0].any() and found.counts.all()
    assert found.direct[1] == pytest.approx(4.0 / 1.3**2, rel=1e-3)
    assert found.direct[2] == pytest.approx(4.0 * 2.0 / 5.0**1.5, rel=1e-3)


@pytest.mark.parametrize(
    "light",
    [worlds.lamp((0.0, 3.0, 0.0), 1.0), Light((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), directional=True)],
    ids=["lamp", "sun"],
)
def test_points_beyond_the_scene_are_lit(ctx: moderngl.Context, light: Light) -> None:
    """Shadow maps cover the bounding box of all meshes; nothing stands between a light and what lies outside of their tiles."""
    roof = worlds.quad((-1.0, 1.0, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, -2.0), BLACK)
    scene = worlds.scene(roof, worlds.floor(1.0, paint=BLACK), lights=(light,))
    points = np.array([[3.0, 0.9, 0.0], [0.0, 1.5, -9.0], [4.0, -3.0, 4.0], [1.3, -3.0, 0.0], [0.0, 0.5, 0.0]])
    found = read(ctx, scene, points).direct[:, 0]
    way = np.array(light.position) - (0.0 if light.directional else points)
    cosine = np.broadcast_to(way[..., 1] / np.linalg.norm(way, axis=-1), len(points))
    expected = cosine * (np.pi if light.directional else 1.0 / np.linalg.norm(way, axis=-1) ** 2)
    assert found[:4] == pytest.approx(expected[:4] * [1, 1, 1, light.directional], rel=1e-3), "a lamp's light meets the roof"
    assert found[4] == 0.0, "between roof and floor"


# ---- points ------------------------------------------------------------------------------------------------------------


def test_a_point_does_not_depend_on_those_after_it(ctx: moderngl.Context) -> None:
    panel = worlds.quad((-0.6, 2.0, -0.4), (1.2, 0.0, 0.0), (0.0, 0.0, 0.8), worlds.material(0.0, 5.0))
    scene = worlds.scene(worlds.floor(), panel, sky=0.1)
    points = np.random.default_rng(1).uniform((-1, 0, -1), (1, 1, 1), (600, 3))
    rough = {"gather_size": 8, "bounces": 1, "light_samples": 4}
    many, few = (read(ctx, scene, points[:count], **rough) for count in (600, 520))
    assert np.array_equal(many.total[:520], few.total)
    assert np.ptp(many.total[:, 0]) > 0.1


def test_irradiance_is_the_total(ctx: moderngl.Context) -> None:
    scene = worlds.scene(worlds.floor(), lights=(worlds.lamp((0, 2, 0)),), sky=0.2)
    found = read(ctx, scene, bounces=1, gather_size=16)
    total = irrsplat.irradiance(scene, POINTS, UP, bounces=1, gather_size=16)
    assert total.shape == (len(POINTS), 3) and total.dtype == np.float32
    assert np.array_equal(total, found.direct + found.indirect)
    with ctx:
        assert np.array_equal(read(ctx, scene, bounces=0).total, found.direct)


@pytest.mark.parametrize(
    ("points", "normals", "words"),
    [
        ([[0, 0]], UP, "points are an array"),
        ([0, 0, 0], UP, "points are an array"),
        ([[0, 0, 0]], [[0, 1, 0]] * 2, "points are an array"),
        ([["a", 0, 0]], UP, "points are an array"),
        ([[0, np.nan, 0]], UP, "must be finite"),
        ([[0, 0, 0]], (0, 0, 0), "a normal is 0 0 0"),
    ],
)
def test_what_are_no_points_is_refused(ctx: moderngl.Context, points: object, normals: object, words: str) -> None:
    with LightMeter(worlds.scene(worlds.floor()), ctx=ctx) as meter, pytest.raises(InputError, match=words):
        meter.measure(points, normals)  # type: ignore[arg-type]


def test_a_meter_frees_what_it_made(ctx: moderngl.Context) -> None:
    scene = worlds.scene(worlds.floor(), lights=(worlds.lamp((0, 2, 0)),), sky=0.2)
    with LightMeter(scene, ctx=ctx, bounces=1, gather_size=16) as meter:
        meter.measure(POINTS, UP)
        assert meter.lit.shadow_pass.target is not None and meter.lit.shadow_pass.target.depth is not None
        made = [meter.cache.records.textures["position"], meter.lit.shadow_pass.target.depth, meter.world.geometry.vertices]
        assert not any(isinstance(getattr(one, "mglo", None), moderngl.InvalidObject) for one in made)
    assert all(isinstance(getattr(one, "mglo", None), moderngl.InvalidObject) for one in made)


# ---- solids ------------------------------------------------------------------------------------------------------------

ASIDE = Camera((9.0, 9.0, 9.0), (0.0, 0.0, 0.0))


@pytest.fixture
def furnished() -> Scene:
    """A room, wound outward, with a lamp in it; a closed block, a box without a bottom, a table top and a sphere stand there."""
    room = worlds.box((-3, 0, -3), (3, 3, 3))
    block = worlds.box((1, 0, 1), (2, 1, 2))
    hood = worlds.box((-2, 0, -2), (-1, 1, -1))
    hood = Mesh(hood.positions, hood.normals, np.delete(hood.faces, [4, 5], axis=0))  # two pairs an axis, x first
    assert not (hood.positions[hood.faces][..., 1] == 0.0).all(1).any(), "its bottom is gone"
    table = worlds.quad((1.0, 0.7, -1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    ball = worlds.sphere((-1.5, 1.5, 1.5), 0.5)
    return worlds.scene(room, block, hood, table, ball, lights=(worlds.lamp((0, 2.8, 0)),), camera=ASIDE)


SOLID = [[1.5, 0.5, 1.5], [1.5, 0.001, 1.5], [-1.5, 0.001, -1.5], [-1.5, 0.9, -1.5], [-1.5, 1.5, 1.5], [-1.5, 1.95, 1.5]]
FREE = [[0.0, 0.001, 0.0], [1.5, 1.001, 1.5], [0.99, 0.5, 1.5], [1.5, 0.3, -1.5], [1.5, 0.699, -1.5], [-1.5, 2.05, 1.5]]
FREE += [[-1.5, 1.1, -1.5], [2.9, 2.9, 2.9], [5.0, 1.0, 0.0]]


def test_what_lies_in_a_solid(furnished: Scene) -> None:
    points = np.array([*SOLID, *FREE])
    found = inside_solids(furnished, points, np.broadcast_to(np.array(UP), points.shape))
    assert found.tolist() == [True] * len(SOLID) + [False] * len(FREE)


def test_what_faces_down_in_a_solid_or_beside_it(furnished: Scene) -> None:
    """Under the box without a bottom it is open below."""
    points = np.array([[1.5, 0.5, 1.5], [-1.5, 0.5, -1.5], [0.0, 0.5, 0.0], [1.5, -0.5, 1.5]])
    found = inside_solids(furnished, points, np.broadcast_to(-np.array(UP), points.shape))
    assert found.tolist() == [True, False, False, False]


def test_what_lies_in_a_solid_of_many_triangles() -> None:
    """Half of the points in a box around a sphere, in random places, in or out of it by their distance from its middle."""
    ball = worlds.sphere((0.3, 0.2, -0.1), 1.0, rings=120, segments=240)
    points = np.random.default_rng(0).uniform(-1.2, 1.2, (400, 3))
    distance = np.linalg.norm(points - (0.3, 0.2, -0.1), axis=1)
    clear = np.abs(distance - 1.0) > 2e-3  # the sphere is a polyhedron
    found = inside_solids(worlds.scene(ball, camera=ASIDE), points, np.broadcast_to(np.array(UP), points.shape))
    assert np.array_equal(found[clear], distance[clear] < 1.0)


def test_what_counts_and_what_does_not(ctx: moderngl.Context, furnished: Scene) -> None:
    """In a block; on the floor; three millimetres below the table's top and well below it."""
    points = np.array([[1.5, 0.5, 1.5], [0.0, 0.0, 0.0], [1.5, 0.697, -1.5], [1.5, 0.4, -1.5]])
    found = read(ctx, furnished, points, bounces=1, gather_size=16)
    assert found.status.tolist() == [Status.INSIDE, Status.OK, Status.BEHIND, Status.OK]
    summary = found.summary("W/m2")
    counted = found.total[[1, 3]] @ np.array([0.2126, 0.7152, 0.0722])
    assert (summary["points"], summary["inside"], summary["behind"]) == (2, 1, 1)
    assert summary["mean"] == pytest.approx(counted.mean(), rel=1e-5)
    assert summary["minimum"] == pytest.approx(counted.min(), rel=1e-5)


# ---- grids and sums ----------------------------------------------------------------------------------------------------


def test_the_uniformity_of_a_grid(ctx: moderngl.Context) -> None:
    """A lamp of 10 W/sr, 2 m above the middle of a black floor of 4 × 2 m: I·h/d³ at the cells' centres."""
    scene = worlds.scene(worlds.floor(paint=BLACK), lights=(worlds.lamp((0, 2, 0), 10.0),))
    grid = Plane((-2.0, 0.0, 1.0), (4.0, 0.0, 0.0), (0.0, 0.0, -2.0)).grid(0.5)
    assert (grid.columns, grid.rows) == (8, 4)
    with LightMeter(scene, ctx=ctx) as meter:
        found = meter.measure(grid.points, grid.normals)
    x, z = np.meshgrid(-1.75 + 0.5 * np.arange(8), 0.75 - 0.5 * np.arange(4))
    assert np.allclose(grid.points, np.stack([x, 0.0 * x, z], -1).reshape(-1, 3))
    E = 20.0 / (x**2 + 4.0 + z**2) ** 1.5
    for unit, factor in (("W/m2", 1.0), ("lux", 179.0)):
        summary = found.summary(unit)  # type: ignore[arg-type]
        values = [summary[name] for name in ("mean", "minimum", "maximum", "uniformity")]
        assert values == pytest.approx([factor * E.mean(), factor * E.min(), factor * E.max(), E.min() / E.mean()], rel=1e-3)
        assert json.loads(json.dumps(summary)) == summary


def test_lux_are_watts_of_the_eye_s_colours() -> None:
    """179 lm/W, as Radiance has it for white light, and the weights of Rec. 709, whose colours all of irrsplat's are."""
    assert photometric(np.ones((2, 3))) == pytest.approx([179.0, 179.0])
    assert photometric(np.array([1.0, 0.0, 0.0])) == pytest.approx(179.0 * 0.2126)
    colours = np.array([[0.2, 0.9, 0.4]], np.float32)
    found = Readings(0.0 * colours, 0.0 * colours, colours, 2.0 * colours, np.zeros(1, int))
    assert found.values("lux")["indirect"] == pytest.approx(2.0 * 179.0 * (0.2 * 0.2126 + 0.9 * 0.7152 + 0.4 * 0.0722))
    assert np.array_equal(found.values("W/m2")["total"], 3.0 * colours)
    lux, watts = found.summary("lux")["mean"], found.summary("W/m2")["mean"]
    assert lux is not None and watts is not None and lux == pytest.approx(LUMINOUS_EFFICACY * watts)


def test_nothing_is_summed_up_in_the_dark() -> None:
    dark = Readings(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), np.array([Status.OK, Status.INSIDE]))
    assert dark.summary("lux")["uniformity"] is None and dark.summary("lux")["mean"] == 0.0
    nowhere = Readings(dark.position, dark.normal, dark.direct, dark.indirect, np.full(2, Status.BEHIND))
    assert nowhere.summary("lux")["mean"] is None and nowhere.summary("lux")["behind"] == 2


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
    """EN 12464-1: 0.2·5^log₁₀(d): 0.2 m at 1 m, 1 m at 10 m; d is the shorter edge of a long plane; 10 m at most."""
    assert Plane((0, 0, 0), (1, 0, 0), (0, 0, -0.6)).usual_spacing() == pytest.approx(0.2)
    assert Plane((0, 0, 0), (10, 0, 0), (0, 0, -6)).usual_spacing() == pytest.approx(1.0)
    for side, shown in ((0.6, 0.15), (2, 0.3), (5, 0.6), (25, 2.0), (50, 3.0), (100, 5.0)):  # rounded, as tables of it have it
        assert Plane((0, 0, 0), (side, 0, 0), (0, 0, -0.7 * side)).usual_spacing() == pytest.approx(shown, abs=0.1 * shown)
    assert Plane((0, 0, 0), (5, 0, 0), (0, 0, -4)).usual_spacing() == pytest.approx(0.61601, abs=1e-5)
    assert Plane((0, 0, 0), (50, 0, 0), (0, 0, -10)).usual_spacing() == pytest.approx(1.0)
    assert Plane((0, 0, 0), (11, 0, 0), (0, 0, -7)).usual_spacing(margin=0.5) == pytest.approx(1.0)
    assert Plane((0, 0, 0), (900, 0, 0), (0, 0, -900)).usual_spacing() == 10.0


@pytest.mark.parametrize("up", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.6, 0.8)])
def test_a_level_plane_lies_above_the_lowest_point(up: tuple[float, float, float]) -> None:
    scene = worlds.scene(worlds.box((-1, -2, -3), (4, 5, 6)))
    scene = Scene(scene.meshes, (), scene.cameras, up=up)
    plane = horizontal(scene, 0.8)
    assert np.allclose(plane.normal, up)
    rise = scene.corners @ np.array(up)
    assert np.array(plane.corner) @ np.array(up) == pytest.approx(rise.min() + 0.8)
    if up == (0.0, 0.0, 1.0):
        points = plane.grid(100.0).points
        assert np.allclose(points, [[1.5, 1.5, -2.2]])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Plane((0, 0, 0), (1, 0, 0), (2, 0, 0)), "span no area"),
        (lambda: Plane((0, 0, 0), (0, 0, 0), (2, 0, 0)), "span no area"),
        (lambda: Plane((0, 0, 0), (1, 0, 0), (0, 0, np.inf)), "finite"),
        (lambda: Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)).grid(0.0), "spacing is 0"),
        (lambda: Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)).grid(0.1, margin=0.5), "leaves nothing"),
        (lambda: Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)).grid(0.1, margin=-1.0), "margin is -1"),
        (lambda: Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)).grid(1e-4), "at most 1,000,000"),
    ],
)
def test_a_plane_that_cannot_be_is_refused(make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()  # type: ignore[operator]
