"""Moved meshes: the scene as if it had been loaded so, what goes, what stays, what is gathered again, and no ghosts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import InputError, Renderer
from irrsplat.core.clock import RayClock, use_clock
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.image.view import read
from irrsplat.indirect.gathering.change_probe import change, correction, take_in
from irrsplat.records import motion
from irrsplat.records.motion import carried, concerned, passed_through, swallowed, winding
from irrsplat.records.record_cache import PROBED, RecordCache
from irrsplat.scene.change import SceneChange
from irrsplat.scene.io.mesh_builder import is_closed
from irrsplat.scene.model import Camera, Scene
from irrsplat.scene.motion import find, moved, transformed
from tests.renderer.test_live import ticks
from tests.renderer.test_relight import errors
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.worlds import assert_pictures, box, floor, lamp, material, scene, sites, sphere

BOX = 1  # of `room`


def shift(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """(4, 4): a move by so many metres."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def named() -> Scene:
    """Four meshes, two of one name."""
    names = ("floor", "ball", "case", "case")
    meshes = (floor(), sphere((0, 0.5, 0), 0.3, rings=6, segments=8), box((1, 0, 0), (2, 1, 1)), box((-2, 0, 0), (-1, 1, 1)))
    return scene(*(replace(m, name=n) for m, n in zip(meshes, names, strict=True)), lights=(lamp((0, 3, 0)),))


# ---- the scene --------------------------------------------------------------------------------------------------------


def test_a_move_is_from_where_a_mesh_was_loaded() -> None:
    """By index and by name, 4×4 and 3×4; rounding does not pile up, and what does not move is the very same."""
    world = named()
    once = moved(world, world.meshes, "ball", shift(0.3, 0.1))
    twice = moved(moved(world, world.meshes, 1, shift(5.0)), world.meshes, "ball", shift(0.3, 0.1)[:3])
    assert np.array_equal(once.meshes[1].positions, twice.meshes[1].positions)
    assert np.allclose(once.meshes[1].positions, world.meshes[1].positions + np.array([0.3, 0.1, 0.0]), atol=1e-6)
    assert all(once.meshes[i] is world.meshes[i] for i in (0, 2, 3)) and once.lights is world.lights
    back = moved(once, world.meshes, 1, np.eye(4)).meshes[1]
    assert np.array_equal(back.positions, world.meshes[1].positions)


def test_normals_turn_and_mirrored_meshes_are_wound_anew() -> None:
    """A stretched sphere's normals are those of the ellipsoid, across its tangents; a mirrored box is still closed."""
    ball = sphere((0, 0, 0), 1.0)
    stretched = transformed(ball, np.diag([3.0, 1.0, 0.5, 1.0]))
    p = stretched.positions.astype(float)
    n = p / np.square([3.0, 1.0, 0.5])  # the gradient of x²/9 + y² + 4z²
    assert np.allclose(stretched.normals, n / np.linalg.norm(n, axis=1, keepdims=True), atol=1e-5)
    mirrored = transformed(box((0, 0, 0), (1, 2, 3)), np.diag([-1.0, 1.0, 1.0, 1.0]))
    assert mirrored.closed and is_closed(mirrored.positions, mirrored.faces)
    a, b, c = mirrored.positions[mirrored.faces].swapaxes(0, 1)
    assert (np.cross(b - a, c - a) * mirrored.normals[mirrored.faces[:, 0]]).sum(1).min() > 0.0


@pytest.mark.parametrize(
    ("mesh", "transform", "words"),
    [
        (4, np.eye(4), r"no mesh 4; the scene has 4"),
        (-1, np.eye(4), r"no mesh -1"),
        ("cup", np.eye(4), r"no mesh 'cup'; the named meshes here: 'floor', 'ball', 'case'$"),
        ("case", np.eye(4), r"2 meshes are called 'case'; give an index: 2, 3"),
        (1.0, np.eye(4), r"index or its name, not by float"),
        (True, np.eye(4), r"not by bool"),
        (1, np.eye(3), r"not one of shape 3x3"),
        (1, "east", r"4x4 or 3x4 matrix of numbers"),
        (1, np.diag([1.0, 1.0, np.nan, 1.0]), r"finite"),
        (1, np.diag([1.0, 1.0, 0.0, 1.0]), r"singular"),
        (1, np.diag([1.0, 1.0, 1.0, 2.0]), r"last row"),
        (1, shift(1e39), r"32-bit"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(mesh: Any, transform: Any, words: str) -> None:
    world = named()
    with pytest.raises(InputError, match=words) as told:
        moved(world, world.meshes, mesh, transform)
    assert "\n" not in str(told.value)
    assert find(world, np.int64(2)) == 2 == find(world, 2)


# ---- what is left as it was -------------------------------------------------------------------------------------------


def test_a_mesh_winds_about_what_is_inside() -> None:
    """Once about points within a closed box, not at all about those beside it; half where it lacks its floor, on that."""
    case = box((-0.5, 0.0, -0.5), (0.5, 1.0, 0.5))
    p = np.array([(0.0, 0.5, 0.0), (0.4, 0.9, -0.4), (0.51, 0.5, 0.0), (0.0, -3.0, 0.0), (0.1, 1e-6, 0.2)])
    assert np.allclose(winding(p, case), [1.0, 1.0, 0.0, 0.0, 1.0], atol=1e-5)
    low = case.positions[case.faces].reshape(-1, 3, 3)[:, :, 1].max(1) == 0.0
    assert low.sum() == 2
    assert np.allclose(winding(p[-1:], replace(case, faces=case.faces[~low])), 0.5, atol=1e-5)


def test_what_is_within_goes_and_what_sees_much_is_looked_at_first() -> None:
    """Points below where a mesh is now, but not those on it, by their triangle's number; without one, all in the bounding box of
    where it was."""
    world = scene(floor(4.0), box((-0.5, 0, -0.5), (0.5, 1, 0.5)))  # the box's triangles come first, it is closed
    after = moved(world, world.meshes, 1, shift(2.0))
    p = np.array([(0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.6, 0.0, 0.0), (2.0, 0.0, 0.0), (2.6, 0.0, 0.0), (-3.0, 0.0, 0.0)])
    n = np.tile([0.0, 1.0, 0.0], (len(p), 1))
    change = SceneChange.between(world, after)
    triangle = np.array([4, 12, 12, 12, 12, 12])
    gone = np.array([False, False, False, True, False, False])
    assert np.array_equal(swallowed(p, n, triangle, change), gone)
    known = concerned(p, n, triangle, change)
    assert known[0] > 0.3 and known[1] > 0.9 and 0.0 < known[5] < 0.3 < known[4]
    gone[:2] = True
    assert np.array_equal(swallowed(p, n, np.full(len(p), -1), change), gone)
    assert not swallowed(p, n, triangle, SceneChange.between(world, world)).any()


def test_what_passes_through_a_surface_is_told() -> None:
    """From either side, but not beside its edge, along it, above it, or with it; a surface that is beside the way counts not."""
    world = scene(floor(2.0), box((-0.5, 0, -0.5), (0.5, 1, 0.5)))
    change = SceneChange.between(world, moved(world, world.meshes, 1, shift(0.0, -0.3)))
    start = np.array([(0.5, 0.2, 0.1), (0.5, 0.4, 0.1), (0.3, -0.1, -0.4), (1.9, 0.1, 1.9), (2.1, 0.1, 0.0), (0.1, 0.0, 0.2)])
    end = start + np.array([(0, -0.3, 0)] * 2 + [(0, 0.3, 0)] + [(0, -0.3, 0)] * 2 + [(0.3, 0, 0)])
    assert passed_through(start, end, change).tolist() == [True, False, True, True, False, False]
    assert not passed_through(start[:0], end[:0], change).any()
    both = moved(moved(world, world.meshes, 1, shift(0.0, -0.3)), world.meshes, 0, shift(0.0, -0.3))
    assert not passed_through(start, end, SceneChange.between(world, both)).any()


@pytest.mark.parametrize("length", [0.05, 0.5, 4.0])
def test_ways_through_many_triangles_are_held_against_those_about_them(length: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Long and short ones, side by side, come to what holding each against all triangles does."""
    draw = np.random.default_rng(5)
    start = draw.uniform(-1.0, 1.0, (60, 3)) * (0.2, 0.2, 0.02)
    end = start + length * np.array([0.6, 0.64, 0.48])
    corners = draw.uniform(-0.5, 4.0, (3000, 1, 3)) + draw.normal(0.0, 0.08, (3000, 3, 3))
    expected = motion._crosses(start, end, corners)
    monkeypatch.setattr(motion, "_AT_ONCE", 256)
    assert np.array_equal(motion._blocked(start, end, corners), expected)
    assert expected.any() == (length > 0.1) and not expected.all()


@pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "mirrored and stretched"])
def test_points_move_with_their_mesh(rigid: bool) -> None:
    """As the matrix says: places and normals of random points of a ball, and vectors by its linear part."""
    turned = np.array([[0.36, 0.48, -0.8, 0.3], [-0.8, 0.6, 0.0, 1.0], [0.48, 0.64, 0.6, -0.2], [0, 0, 0, 1]])
    matrix = turned if rigid else turned @ np.diag([-1.0, 2.0, 1.0, 1.0])
    world = scene(floor(), sphere((0.2, 1.0, 0.1), 0.5), floor(1.0, 2.0))  # the ball's triangles come first: it is closed
    after = moved(world, world.meshes, 1, matrix)
    ball = world.meshes[1]
    triangle = np.random.default_rng(3).integers(0, len(ball.faces) + 2, 200)
    own = triangle < len(ball.faces)
    corners = ball.positions[ball.faces[np.where(own, triangle, 0)]].astype(float)
    p = np.einsum("nk,nkx->nx", np.random.default_rng(4).dirichlet(np.ones(3), 200), corners)
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    found = carried(p, triangle, SceneChange.between(world, after))
    assert np.array_equal(found.numbers, np.flatnonzero(own)) and found.rigid.all() == rigid and found.rigid.any() == rigid
    assert np.allclose(found.position, p[own] @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-5)
    across = n[own] @ np.linalg.inv(matrix[:3, :3])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    assert np.allclose(found.normals(n[own]), across, atol=1e-3)
    side = corners[own, 1] - corners[own, 0]
    assert np.allclose(np.einsum("nij,nj->ni", found.linear_map, side), side @ matrix[:3, :3].T, atol=1e-5)


def test_a_turned_room_is_the_same_room() -> None:
    """All that there is turns, the eye too: records say the same as before without being gathered again."""
    walls = box((-1, -1, -1), (1, 1, 1), material((0.8, 0.6, 0.4), 0.5), outward=False)
    world = scene(walls, camera=FRONT)
    turned = np.array([[0.36, 0.48, -0.8, 0.0], [-0.8, 0.6, 0.0, 0.0], [0.48, 0.64, 0.6, 0.0]])
    eye, target, up = (tuple(turned[:, :3] @ v) for v in (FRONT.eye, FRONT.target, FRONT.up))
    with Renderer(world, SIZE, **{**FAST, "gather_size": 32}) as renderer:
        before = renderer.render()
        renderer.move(0, turned)
        renderer.frame(Camera(eye, target, up, FRONT.fov), gather=False)
        view, progress = renderer.frame(Camera(eye, target, up, FRONT.fov), gather=False)
        sums = pixels(view.sums)
        assert progress.coverage == 1.0 and progress.records == before.stats["records"]
    assert_pictures("turned", sums[..., :3] / sums[..., 3:], before.irradiance, 0.01 * before.irradiance.mean())


# ---- renderers --------------------------------------------------------------------------------------------------------


@pytest.fixture
def renderer() -> Iterator[Renderer]:
    """A renderer of `room` that has served FRONT whole."""
    with Renderer(room(), SIZE, **FAST) as made:
        made.render()
        yield made


@pytest.mark.parametrize("bounces", [1, "all"])
@pytest.mark.parametrize(
    "transform",
    [shift(0.35, 0.0, 0.2), shift(0.0, 3.0), np.array([[-0.8, 0, 0.6, 0], [0.0, 1.1, 0, 0.1], [0.6, 0, 0.8, 0]])],
    ids=["aside", "out of the room", "mirrored"],
)
def test_a_moved_scene_is_as_if_it_had_been_loaded_so(transform: np.ndarray, bounces: Any) -> None:
    """G-buffer, direct light, and what is gathered at the same sites, bit for bit; where the scene grows, too."""
    settings = {**FAST, "bounces": bounces, "gather": "trace"}
    with Renderer(room(), SIZE, **settings) as old:
        old.render()
        old.move(BOX, shift(0.1))
        old.render()
        old.move(BOX, transform)
        old.render()
        old.renew()
        old.frame()
        frame, where = old.render(), old.cache.sites(slice(0, old.cache.count))
        assert frame.stats["triangles"] == room().triangles and frame.stats["converged"]
        after = old.scene
    with Renderer(after, SIZE, **settings) as fresh:
        view, _ = fresh.frame(gather=False)
        assert fresh.shadows is not None
        for name in ("position", "normal", "albedo"):
            there = pixels(getattr(view.gbuffer, name))[..., :3]
            assert np.array_equal(getattr(frame, name), np.where(np.isfinite(frame.depth)[..., None], there, 0.0)), name
        assert np.array_equal(frame.direct, pixels(view.direct)[..., :3])
        fresh.cache.append(where)
        fresh.cache.invalidate()
        assert fresh.scheduler.prepare(fresh.shadows, Budget(None))
        fresh.scheduler.renew(fresh.shadows, fresh.gbuffer, FRONT, Budget(None))
        found = fresh.cache.read()
    assert np.array_equal(found["irradiance"], frame.records_irradiance)
    assert np.array_equal(found["radius"], frame.records_radius)


def test_records_go_that_are_within_and_stay_elsewhere(renderer: Renderer) -> None:
    """What stays holds what it held, until it is looked at again; in the end none is left in the box."""
    before = renderer.cache.read()
    renderer.move(BOX, shift(0.6, 0.0, -0.35))
    left = renderer.cache.read()
    assert 0.8 < len(left["radius"]) / len(before["radius"]) < 1.0
    low, high = renderer.scene.meshes[BOX].positions.min(0), renderer.scene.meshes[BOX].positions.max(0)
    where = renderer.cache.sites(slice(0, len(left["radius"])))
    turn, own = where.frame_rotation, where.triangle < 12  # it alone is closed
    assert 0.05 < own.mean() < 0.5
    lifted = left["position"] + 1e-3 * left["normal"]
    assert np.abs(winding(lifted[~own], renderer.scene.meshes[BOX])).max() < 0.3
    stayed = before["position"][turn] + np.where(own[:, None], (0.6, 0.0, -0.35), 0.0)
    assert np.allclose(stayed, left["position"], atol=1e-5), "and they look in the directions that they did"
    assert np.array_equal(before["position"][turn][~own], left["position"][~own])
    for name in ("normal", "irradiance", "radius"):
        assert np.allclose(before[name][turn], left[name], atol=1e-6), name
    frame = renderer.render()
    inside = ((frame.records_position > low + 0.01) & (frame.records_position < high - 0.01)).all(1)
    assert frame.stats["converged"] and not inside.any()


def test_what_a_mesh_carries_through_a_floor_goes() -> None:
    """Else records below it speak for what is above, where none knows of walls: it was off by up to 0.8 of the mean there."""
    view = Camera((-0.8, 0.7, 0.9), (0.3, -0.5, -0.6), fov=60.0)
    settings: dict[str, Any] = {**FAST, "gather": "trace", "gather_size": 24, "ray_noise": 0.0, "a": 0.5, "walls": False}
    pictures = []
    for looks in ((FRONT, view), ()):
        with Renderer(room(), (48, 40), **settings) as renderer:
            for camera in looks:
                renderer.render(camera)
            renderer.move(BOX, shift(0.0, -0.3))
            pictures.append(renderer.render(view))
            assert (pictures[-1].records_position[:, 1] > -1.0001).all()
    used, new = pictures
    assert np.abs(used.irradiance - new.irradiance).max() < 0.4 * new.irradiance.mean()


@pytest.mark.parametrize("act", ["a box", "a lamp"])
def test_records_follow_what_moves_before_they_are_gathered_again(act: str) -> None:
    """After ticks that had hardly any time, looks alone: what records then say is far nearer to what they will say than
    what they said."""
    with Renderer(room(), SIZE, **{**FAST, "gather_size": 32}) as renderer:
        renderer.render()
        renderer.frame()
        for x in (0.1, 0.2, 0.3):
            if act == "a box":
                renderer.move(BOX, shift(x, 0.0, 0.5 * x))
            else:
                renderer.relight(
                    [replace(room().lights[0], position=tuple(np.add(room().lights[0].position, (-2.0 * x, -x, 0))))]
                )
            if x == 0.1:
                before = renderer.cache.values.copy()
            renderer.frame(seconds=1e-3)
        cache, gatherer = renderer.cache, renderer.scheduler.gatherer
        assert renderer.shadows is not None
        gatherer.settle(renderer.shadows, Budget(None))
        turn = cache.sites(slice(0, cache.count)).frame_rotation  # the number that each had at first
        assert turn is not None
        old, now = np.flatnonzero(turn < len(before)), cache.values.copy()
        gatherer.regather(renderer.shadows, np.arange(cache.count), Budget(None))
        true = cache.values

        def off(values: np.ndarray) -> float:
            return float(np.sqrt(np.mean((values[:, :3] - true[old, :3]) ** 2)))

        assert off(now[old]) < 0.5 * off(before[turn[old]])


def test_a_correction_telescopes_where_light_grows_and_never_makes_less_than_nothing() -> None:
    """E = 2 where probes say 1, then 3: 4; and back to 1: by their ratio, so that a record and a probe that fade stay alike."""
    values, before, after = (np.zeros((1, PROBED), "f4") for _ in range(3))
    for rows, E, R in ((values, 2.0, 1.0), (before, 1.0, 2.0), (after, 3.0, 1.0)):
        rows[:, :3], rows[:, 3], rows[:, 4:7] = E, R, (0.0, E, 0.0)
    grown = correction(values, before, after)
    assert np.allclose(grown[0, :8], [4.0, 4.0, 4.0, 1.0 / 1.5, 0.0, 4.0, 0.0, 0.0])
    faded = correction(grown, after, before)
    assert np.allclose(faded[0, :3], 4.0 / 3.0) and np.allclose(faded[0, 5], 4.0 / 3.0)
    after[:] = 0.0
    assert not correction(grown, before, after)[0, :3].any()


def apart() -> Scene:
    """Two rooms that share nothing, a box in either; FRONT sees the first."""
    grey = material(0.6)
    first = box((-1, -1, -1), (1, 1, 1), grey, outward=False), box((-0.4, -1, -0.6), (0.2, -0.3, 0.0), grey)
    second = box((9, -1, -1), (11, 1, 1), grey, outward=False), box((9.5, -1, -0.5), (10.0, -0.3, 0.0), grey)
    return scene(*first, *second, lights=(lamp((0.3, 0.6, 0.2), 3.0), lamp((10.2, 0.6, 0.3), 3.0)), camera=FRONT)


@pytest.mark.parametrize("bounces", [1, "all"])
def test_what_nobody_sees_concerns_nobody(bounces: Any) -> None:
    """A box that moves in the other room: not a record is gathered again. In this one: many are."""
    with Renderer(apart(), SIZE, **{**FAST, "bounces": bounces}) as renderer:
        count, renewals = renderer.render().stats["records"], renderer.cache.refresh_count
        renderer.move(3, shift(0.4, 0.0, 0.1))
        assert renderer.render().stats["records"] == count and renderer.cache.refresh_count == renewals
        renderer.move(1, shift(0.2))
        _, progress = renderer.frame(seconds=1e-4)
        while progress.surface < 1.0:
            _, progress = renderer.frame(seconds=0.05)
        assert renderer.cache.count < 1.2 * count and progress.stale + progress.renewed > 0
        assert ticks(renderer)[-1].done


def test_small_changes_add_up(ctx: moderngl.Context) -> None:
    """1 % and 1 % again do not concern a record, a third time does; nor what is dark; and one of which nothing is known does."""
    cache = RecordCache(ctx)
    cache.append(sites(np.eye(3), (0, 1, 0)), np.ones((3, 4), "f4"))
    cache.luminance_floor = 1.0
    cache.probes[:2, :4] = (1.0, 2.0, 1.0, 0.5), (0.01, 0.01, 0.01, 0.5)
    found, numbers = cache.probes.copy(), np.arange(3)
    found[2, :4] = 1.0
    for expected in ([2], [], [0]):
        found[0, 1] *= 1.009
        found[1, :3] += 0.002
        cache.due[:] = 1.0
        assert take_in(cache, numbers, found.copy(), (1e-3, 9.0)).tolist() == expected and not cache.due.any()
        cache.mark_refreshed(np.array(expected, int))
    assert change(np.array([[1.0, 1.0, 1.0, 1.0]]), np.array([[1.0, 1.0, 1.0, 1.25]]), 0.0) == pytest.approx(0.2)
    assert np.allclose(cache.values[:, 1], [1.0 + 2.0 * (1.009**3 - 1.0), 1.006, 1.0], atol=1e-4), "what they hold goes along"
    cache.invalidate()
    assert not cache.probes.any() and sorted(cache.stale) == [0, 1, 2]
    cache.mark_refreshed(np.arange(3))
    cache.invalidate(np.array([1]))
    assert cache.stale.tolist() == [1] and cache.age(np.array([0, 1, 2, 9])).tolist() == [0, 1, 0, 0]


def test_the_surface_cache_rides_along() -> None:
    """Until its values are made again, what a box's sides held moves with it: an eye that moves too finds the same there."""
    with Renderer(room(), SIZE, **{**FAST, "bounces": 2}) as renderer:
        renderer.render()
        cache, here = renderer.scheduler.gatherer.surface, FRONT
        assert cache is not None
        before, view = pixels(cache.view(renderer.gbuffer)), pixels(renderer.gbuffer.emission)[..., 3]
        renderer.move(BOX, shift(0.05, 0.0, -0.1))
        there = Camera((0.05, 0.0, 0.85), (0.05, -0.1, -1.1), fov=60.0)
        renderer.frame(there, seconds=1e-4)
        assert not cache.complete and cache.result is not None
        after, same = pixels(cache.view(renderer.gbuffer)), view == pixels(renderer.gbuffer.emission)[..., 3]
        mine = same & (view < 12)  # the box's triangles: it alone is closed
        assert mine.sum() > 100 and (np.abs(after - before)[mine].max(-1) < 1e-3 * before[mine].mean()).mean() > 0.95
        assert ticks(renderer, 0.05, here)[-1].done and cache.complete
        held = cache.result.irradiance
        with Renderer(renderer.scene, SIZE, **{**FAST, "bounces": 2}) as fresh:
            fresh.render()
            assert fresh.scheduler.gatherer.surface is not None and fresh.scheduler.gatherer.surface.result is not None
            assert np.array_equal(fresh.scheduler.gatherer.surface.result.irradiance, held)


@pytest.mark.parametrize("bounces", [1, "all"])
def test_moves_in_ticks_leave_nothing_behind(renderer: Renderer, bounces: Any) -> None:
    """A mesh that moves at every tick, and comes back: the picture is a fresh render's, within what records differ."""
    with Renderer(room(), SIZE, **{**FAST, "bounces": bounces}) as renderer:
        first = renderer.render()
        for x in (0.1, 0.3, 0.2):
            renderer.move(BOX, shift(x))
            view, _ = renderer.frame(seconds=0.02)
            assert np.isfinite(pixels(view.image)).all()
        renderer.move(BOX, np.eye(4))
        last = renderer.render()
    assert np.array_equal(first.position, last.position) and np.array_equal(first.direct, last.direct)
    off = last.irradiance - first.irradiance
    assert abs(off.mean()) < 0.02 * first.irradiance.mean() and np.sqrt(np.mean(off**2)) < 0.12 * first.irradiance.mean()


def test_a_moved_box_leaves_no_ghost() -> None:
    """Errors against the truth are those of a fresh render of the scene as it is then, with what it takes to tell them apart."""
    before = irrsplat.load("cornell")
    after = moved(before, before.meshes, "short", shift(2.2, 0.0, -0.3))
    fresh, later = errors(
        before, lambda r: r.move("short", shift(2.2, 0.0, -0.3)), after, 2, bounces=1, gather_size=32, shadow_size=512
    )
    assert 0.001 < fresh < 0.1 and later < 1.4 * fresh


def test_what_was_renewed_along_few_rays_is_gathered_again_at_rest() -> None:
    """While a box goes on moving records are renewed along few rays; at rest, and in a render, none of these is left."""
    settings = {**FAST, "gather_size": 32, "gather": "trace"}
    with use_clock(RayClock(1e6)), Renderer(room(), SIZE, **settings) as renderer:
        renderer.render()
        for finish in (lambda: ticks(renderer, 0.05), renderer.render):
            for x in (0.1, 0.2):
                renderer.move(BOX, shift(x))
                _, progress = renderer.frame(seconds=0.05)
            rough = renderer.cache.rough
            assert len(rough) and progress.stale and not progress.still
            finish()
            assert not len(renderer.cache.rough) and not renderer.cache.waiting
            held = renderer.cache.values[rough].copy()
            assert renderer.shadows is not None
            renderer.scheduler.gatherer.regather(renderer.shadows, rough, Budget(None))
            assert np.array_equal(held, renderer.cache.values[rough])
            renderer.move(BOX, np.eye(4))
            renderer.render()


def test_every_frame_of_a_carried_box_is_near_its_truth() -> None:
    """A step of 6 cm a frame, each a tick of so many rays: frames against fresh renders of their scenes, whatever the machine."""
    settings = {**FAST, "gather_size": 32, "bounces": "all"}
    off = []
    with use_clock(RayClock(1e6)), Renderer(room(), SIZE, **settings) as renderer:
        renderer.render()
        for step in range(1, 9):
            renderer.move(BOX, shift(0.06 * step, 0.0, 0.03 * step))
            view, _ = renderer.frame(seconds=0.06)
            if step % 4 == 0:
                found = read(view, renderer.cache.read(), {}).irradiance
                with Renderer(renderer.scene, SIZE, **settings) as fresh:
                    true = fresh.render().irradiance
                off.append(np.sqrt(np.mean((found - true) ** 2)) / true.mean())
    assert max(off) < 0.04, off
