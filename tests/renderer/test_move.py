"""Moved meshes: equal to a scene loaded in this state; removed, kept and renewed records, and no ghosts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat import InputError, Renderer
from irrsplat.gpu import world
from irrsplat.gpu.target import pixels
from irrsplat.records.motion import carried
from irrsplat.scene.change import SceneChange
from irrsplat.scene.io.mesh_builder import is_closed
from irrsplat.scene.model import Camera, Scene
from irrsplat.scene.motion import find, moved, transformed
from tests.renderer.test_live import ticks
from tests.renderer.test_relight import HELD, gathered_afresh
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.worlds import assert_pictures, box, floor, material, point_light, scene, sphere

BOX = 1  # of `room`


def shift(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """Return the translation (4, 4) by these metres."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def named() -> Scene:
    """Return four meshes, two with the same name."""
    names = ("floor", "ball", "case", "case")
    meshes = (floor(), sphere((0, 0.5, 0), 0.3, rings=6, segments=8), box((1, 0, 0), (2, 1, 1)), box((-2, 0, 0), (-1, 1, 1)))
    return scene(*(replace(m, name=n) for m, n in zip(meshes, names, strict=True)), lights=(point_light((0, 3, 0)),))


# ---- the scene --------------------------------------------------------------------------------------------------------


def test_a_move_is_from_where_a_mesh_was_loaded() -> None:
    """By index and by name, 4×4 and 3×4: rounding errors do not accumulate, and unmoved meshes are identical objects."""
    world = named()
    once = moved(world, world.meshes, "ball", shift(0.3, 0.1))
    twice = moved(moved(world, world.meshes, 1, shift(5.0)), world.meshes, "ball", shift(0.3, 0.1)[:3])
    assert np.array_equal(once.meshes[1].positions, twice.meshes[1].positions)
    assert np.allclose(once.meshes[1].positions, world.meshes[1].positions + np.array([0.3, 0.1, 0.0]), atol=1e-6)
    assert all(once.meshes[i] is world.meshes[i] for i in (0, 2, 3)) and once.lights is world.lights
    assert moved(once, world.meshes, 1, shift(0.3, 0.1)) is once, "a move to the present place changes nothing"
    back = moved(once, world.meshes, 1, np.eye(4)).meshes[1]
    assert np.array_equal(back.positions, world.meshes[1].positions)


def test_normals_turn_and_mirrored_meshes_are_wound_anew() -> None:
    """A stretched sphere has the ellipsoid's normals, perpendicular to its tangents; a mirrored box is still closed."""
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
    number: Any = np.int64(2)
    assert find(world, number) == 2 == find(world, 2)


# ---- unchanged values -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "mirrored and stretched"])
def test_points_move_with_their_mesh(rigid: bool) -> None:
    """Positions and normals of random points of a ball follow the matrix, and vectors its linear part."""
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


def test_a_turned_room_is_the_same_room(ctx: moderngl.Context) -> None:
    """All meshes and the eye rotate together: rotated records hold rotated values without a new gather."""
    walls = box((-1, -1, -1), (1, 1, 1), material((0.8, 0.6, 0.4), 0.5), outward=False)
    world = scene(walls, camera=FRONT)
    turned = np.array([[0.36, 0.48, -0.8, 0.0], [-0.8, 0.6, 0.0, 0.0], [0.48, 0.64, 0.6, 0.0]])
    eye, target, up = (tuple(turned[:, :3] @ v) for v in (FRONT.eye, FRONT.target, FRONT.up))
    with Renderer(world, SIZE, ctx=ctx, **{**FAST, "gather_size": 32}) as renderer:
        before = renderer.render()
        renderer.move(0, turned)
        renderer.frame(Camera(eye, target, up, FRONT.fov), gather=False)
        view, progress = renderer.frame(Camera(eye, target, up, FRONT.fov), gather=False)
        sums = pixels(view.splats.sums)
        assert progress.coverage == 1.0 and progress.records == before.stats["records"]
    assert_pictures("turned", sums[..., :3] / sums[..., 3:], before.irradiance, 0.01 * before.irradiance.mean())


# ---- renderers --------------------------------------------------------------------------------------------------------


@pytest.fixture
def renderer(ctx: moderngl.Context) -> Iterator[Renderer]:
    """A renderer of `room` with a converged view of FRONT."""
    with Renderer(room(), SIZE, ctx=ctx, **FAST) as made:
        made.render()
        yield made


@pytest.mark.few_sites
@pytest.mark.parametrize(
    ("transform", "bounces", "gather", "large"),
    [
        (shift(0.0, 3.0), 1, "trace", 20_000),
        (np.array([[-0.8, 0, 0.6, 0], [0.0, 1.1, 0, 0.1], [0.6, 0, 0.8, 0]]), "all", "trace", 20_000),
        (shift(0.3), "all", "trace", 12),
        (shift(0.0, 0.2), 1, "embree", 12),
    ],
    ids=["out of the room", "mirrored", "large", "large, by Embree"],
)
def test_a_moved_scene_is_as_if_it_had_been_loaded_so(
    ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch, transform: np.ndarray, bounces: Any, gather: str, large: int
) -> None:
    """G-buffer, direct light, and values at equal sites are equal bit for bit, also if the scene grows.

    large: triangles from which ray structures of still triangles stay; the box has 12.
    """
    monkeypatch.setattr(world, "_LARGE", large)
    settings = {**FAST, "bounces": bounces, "gather": gather}
    with Renderer(room(), SIZE, ctx=ctx, **settings) as old:
        old.render()
        old.move(BOX, shift(0.1))
        old.render()
        old.move(BOX, transform)
        old.render()
        old.forget(records=False)
        old.scheduler.expire()
        old.frame()
        frame, after = old.render(), old.scene
        assert frame.stats["triangles"] == room().triangles and frame.stats["converged"]
        found, truth = old.cache.records.read(*HELD), gathered_afresh(old)
        assert all(np.array_equal(found[name], truth[name]) for name in HELD)
    with Renderer(after, SIZE, ctx=ctx, **settings) as fresh:
        view, _ = fresh.frame(gather=False)
        for name in ("position", "normal", "albedo"):
            there = pixels(getattr(view.gbuffer, name))[..., :3]
            assert np.array_equal(getattr(frame, name), np.where(np.isfinite(frame.depth)[..., None], there, 0.0)), name
        assert np.array_equal(frame.direct, pixels(view.direct)[..., :3])


def test_records_within_a_moved_mesh_go(renderer: Renderer) -> None:
    """The values of other records stay until they are gathered again; after convergence no record lies in the box."""
    before = renderer.cache.read()
    renderer.move(BOX, shift(0.6, 0.0, -0.35))
    left, turn = renderer.cache.read(), renderer.cache.sites(slice(0, renderer.cache.count)).frame_rotation
    assert turn is not None and 0.8 < len(left["radius"]) / len(before["radius"]) < 1.0
    for name in ("normal", "irradiance", "radius"):
        assert np.allclose(before[name][turn], left[name], atol=1e-6), name
    low, high = renderer.scene.meshes[BOX].positions.min(0), renderer.scene.meshes[BOX].positions.max(0)
    frame = renderer.render()
    inside = ((frame.records_position > low + 0.01) & (frame.records_position < high - 0.01)).all(1)
    assert frame.stats["converged"] and not inside.any()


def test_what_no_record_sees_leaves_the_records(ctx: moderngl.Context) -> None:
    """A box moves in a closed room next door: no record is renewed. With the box in view, many are."""
    grey = material(0.6)
    here = box((-1, -1, -1), (1, 1, 1), grey, outward=False), box((-0.4, -1, -0.6), (0.2, -0.3, 0.0), grey)
    there = box((9, -1, -1), (11, 1, 1), grey, outward=False), box((9.5, -1, -0.5), (10.0, -0.3, 0.0), grey)
    point_lights = point_light((0.3, 0.6, 0.2), 3.0), point_light((10.2, 0.6, 0.3), 3.0)
    with Renderer(scene(*here, *there, lights=point_lights, camera=FRONT), SIZE, ctx=ctx, **FAST) as renderer:
        count = renderer.render().stats["records"]
        renderer.move(3, shift(0.4, 0.0, 0.1))
        told = ticks(renderer)
        assert told[-1].records == count and not any(p.new or p.renewed or p.stale for p in told)
        renderer.move(1, shift(0.2))
        progress = renderer.frame(seconds=1e-4)[1]
        assert progress.stale + progress.renewed > 0 and ticks(renderer)[-1].done


@pytest.mark.few_sites
def test_moves_in_ticks_leave_nothing_behind(ctx: moderngl.Context) -> None:
    """A mesh moves in every frame and returns: the picture is a fresh render's, within the noise of records."""
    with Renderer(room(), SIZE, ctx=ctx, **{**FAST, "bounces": "all"}) as renderer:
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


@pytest.mark.long
def test_every_frame_of_a_carried_box_is_near_its_truth() -> None:
    """A step of 6 cm per frame with a ray budget: each frame is compared with a fresh render of its scene."""
    settings = {**FAST, "gather_size": 32, "bounces": "all"}
    off = []
    with Renderer(room(), SIZE, **settings) as renderer:
        renderer.render()
        for step in range(1, 9):
            renderer.move(BOX, shift(0.06 * step, 0.0, 0.03 * step))
            view, _ = renderer.frame(seconds=0.06)
            if step % 4 == 0:
                found = view.read().irradiance
                with Renderer(renderer.scene, SIZE, ctx=renderer.ctx, **settings) as fresh:
                    true = fresh.render().irradiance
                off.append(np.sqrt(np.mean((found - true) ** 2)) / true.mean())
    assert max(off) < 0.04, off
