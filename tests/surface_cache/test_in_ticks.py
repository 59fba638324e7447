"""Surface cache within small frame budgets: one-bounce records before it exists, and indirect light of a moving light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from threading import Event

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.gpu import world
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.world import World
from irrsplat.image.view import Progress
from irrsplat.scene.model import Light
from irrsplat.scene.spatial.bvh import Bvh, build
from irrsplat.surface_cache.site_layout import COARSE
from tests.renderer.test_live import TICK
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.worlds import box, material, point_light, quad, scene, sphere
from tests.surface_cache.test_bounces import ALL, advance, few, gathered, made, values
from tests.surface_cache.test_surface import clusters

__all__ = ["few"]
pytestmark = pytest.mark.usefixtures("few")

TRACED = {**FAST, "bounces": "all", "gather": "trace", "light_samples": 0}
STEPS = 10


def ticks(renderer: Renderer, until: Callable[[Progress], bool]) -> Progress:
    """Render frames with a small budget until one fulfils the condition; return its progress."""
    for _ in range(5000):
        progress = renderer.frame(seconds=2e-3)[1]
        if until(progress):
            return progress
    raise AssertionError(progress)


def agrees(renderer: Renderer) -> None:
    """Assert that the converged picture is that of a fresh renderer, within the noise of different records."""
    ours = renderer.render()
    with Renderer(renderer.scene, renderer.size, ctx=renderer.ctx, **asdict(renderer.settings)) as fresh:
        theirs = fresh.render()
    assert ours.stats["bounces"] == theirs.stats["bounces"] and ours.stats["bounces_converged"]
    assert np.sqrt(np.mean((ours.irradiance - theirs.irradiance) ** 2)) < 0.05 * theirs.irradiance.mean()
    assert ours.irradiance.mean() == pytest.approx(theirs.irradiance.mean(), rel=0.01)


def test_coarse_light_comes_first(ctx: moderngl.Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames gather records with coarse further bounces, and correct them when the full surface cache exists.

    The coarse cache has 15 % of the sites and of the rays: its light is within 10 % on average. A file of provisional
    records does not count as converged, and a light may move meanwhile. The first frame with values draws a picture, even
    before the next one is due.
    """
    for name in ("_PICTURE_SHARE", "_OLDEST_PICTURE"):
        monkeypatch.setattr(f"irrsplat.renderer.frames.{name}", 1e9)
    monkeypatch.setattr("irrsplat.indirect.gathering.record_gatherer._FIRST_LIGHT", 1.0)  # not within the first frame
    fine = {**TRACED, "gather_size": 32}  # a smaller gather has a surface cache as coarse as the first one
    with Renderer(room(), SIZE, ctx=ctx, **fine) as renderer:
        before = view = renderer.frame(seconds=2e-3)[0]
        while renderer.scheduler.gatherer.surface_now is None:
            before, view = view, renderer.frame(seconds=2e-3)[0]
        assert view is not before
        monkeypatch.undo()
        early = ticks(renderer, lambda now: now.records > 20)
        assert early.surface < 1.0 and not early.still and not early.done
        where, coarse = renderer.cache.sites(slice(0, early.records)), renderer.cache.read()["irradiance"][: early.records]
        renderer.save_cache(tmp_path / "early")
        ticks(renderer, lambda now: now.still)
        corrected = renderer.cache.read()["irradiance"][: early.records]
        agrees(renderer)
    with made(ctx, room(), **fine) as whole:
        full = gathered(whole, where)
    assert coarse.mean() == pytest.approx(full.mean(), rel=0.1)
    assert np.abs(corrected - full).mean() < 0.01 * full.mean() < 0.5 * np.abs(coarse - full).mean() + 0.01 * full.mean()
    with Renderer(room(), SIZE, ctx=ctx, **fine) as fresh:
        fresh.load_cache(tmp_path / "early")
        assert len(fresh.cache.stale) == fresh.cache.count > 0
        agrees(fresh)
    with Renderer(room(), SIZE, ctx=ctx, **fine) as renderer:
        assert ticks(renderer, lambda now: now.records > 5).surface < 1.0
        renderer.relight([point_light((0.3, 0.5, 0.4), 5.0)])
        ticks(renderer, lambda now: now.still)
        agrees(renderer)


def carried(share: float) -> tuple[float, float, float]:
    """Return a position on a path from just under the ceiling, with a small bright spot, across the room."""
    return -0.7 + 1.3 * share, 0.95 - 0.6 * share, 0.0


ROOM = scene(
    box((-1, -1, -1), (1, 1, 1), material((0.8, 0.6, 0.5)), outward=False),
    box((-0.4, -1, -0.6), (0.2, -0.3, 0.0), material((0.2, 0.6, 0.8))),
    lights=(point_light(carried(0.0)),),
    camera=FRONT,
)


def lit(share: float) -> list[Light]:
    """Return the lights at this share 0..1 of the path."""
    return [replace(ROOM.lights[0], position=carried(share))]


def test_a_coarse_level_merges_close_members_of_one_mesh_alone(ctx: moderngl.Context) -> None:
    """Each point on two spheres that are a thousandth apart has a near member on its own sphere; the area stays the same."""
    spheres = scene(sphere((0, 0, 0), 1.0, rings=48, segments=96), sphere((0, 0, 0), 1.001, rings=48, segments=96))
    merged = clusters(World(ctx, spheres), COARSE)
    cut, member, faces = merged.tessellation, merged.member[0], len(spheres.meshes[0].faces)
    apart = np.linalg.norm(merged.members.position[member] - cut.position, axis=1)
    assert len(np.unique(member)) < 0.5 * len(member) and apart.max() < 0.25 * merged.spacing
    assert merged.members.triangle is not None
    assert np.array_equal(merged.members.triangle[member] < faces, cut.face < faces)
    assert merged.area.sum() == pytest.approx(2.0 * cut.area.sum())


def test_coarse_light_does_not_wait_for_the_tree(
    ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """Only virtual point lights need the tree of a large scene: the first records are gathered while it is built, and the last
    ones with those lights.

    The first have 16×16 rays, whose noise is less than the error of coarse light; all are gathered again.
    """
    pytest.importorskip("embreex")
    built = Event()

    def late(corners: np.ndarray) -> Bvh:
        built.wait()
        return build(corners)

    monkeypatch.setattr(world, "_LARGE", 1)
    monkeypatch.setattr(world, "build", late)
    request.addfinalizer(built.set)
    with Renderer(room(), SIZE, ctx=ctx, **{**TRACED, "gather": "embree", "gather_size": 64, "light_samples": 8}) as renderer:
        early = ticks(renderer, lambda now: now.records > 20)
        assert not renderer.world.has_tree and early.surface < 1.0 and not early.still
        assert (renderer.cache.column("gather_size") == 16).all()
        built.set()
        ticks(renderer, lambda now: now.still)
        assert not (renderer.cache.column("gather_size") == 16).any()
        agrees(renderer)


def test_light_at_sites_goes_with_a_lamp(ctx: moderngl.Context) -> None:
    """The bright spot above a light moves with it: updated values are close to newly computed ones.

    With 64 rays a site, the noise of the transport is a tenth of the light; it is a twentieth with the usual number of rays.
    """
    with made(ctx, ROOM) as renderer, made(ctx, ROOM) as other:
        surface = renderer.scheduler.gatherer.surface
        assert surface is not None
        for step in range(1, STEPS + 1):
            renderer.relight(lit(step / STEPS))
            surface.advance(renderer.draw_shadows(), Budget(TICK))
        other.relight(lit(1.0))
        advance(other)
        assert not surface.level.complete and surface.in_use.shown is not None
        area, found, true = surface.in_use.shown.area[:, None], values(renderer), values(other)
        assert np.sqrt((area * (found - true) ** 2).sum() / (area * true**2).sum()) < 0.15
        assert (area * found).sum() == pytest.approx((area * true).sum(), rel=0.1)


def test_light_at_sites_returns_with_a_light_that_has_left_the_room(ctx: moderngl.Context) -> None:
    """The residual of the gather counts again, and bounces beyond the first do not wait for further ticks.

    The last step changes the light by less than 5 %. Surfaces reflect up to 80 %, so that further steps would add a few times as
    much in red.
    """
    with made(ctx, ROOM) as renderer:
        surface, before = renderer.scheduler.gatherer.surface, values(renderer)
        assert surface is not None and surface.in_use.shown is not None
        for lights in ([point_light((0.0, 3.0, 0.0), 5.0)], ROOM.lights):
            renderer.relight(lights)
            surface.advance(renderer.draw_shadows(), Budget(TICK))
        area, found = surface.in_use.shown.area[:, None], values(renderer)
        assert np.sqrt((area * (found - before) ** 2).sum() / (area * before**2).sum()) < 0.15


def test_sites_gathered_after_a_light_has_moved_keep_their_residual(ctx: moderngl.Context) -> None:
    """A light moves, so that no residual of its old position counts, then a block: sites are gathered with the present light.

    The light at their places is that of a fresh surface cache, within the noise of 64 rays a site.
    """
    named = replace(ROOM, meshes=(ROOM.meshes[0], replace(ROOM.meshes[1], name="block")))
    lights, matrix = [point_light((0.6, -0.5, 0.6))], np.array([[1, 0, 0, 0.3], [0, 1, 0, 0], [0, 0, 1, 0]])
    with made(ctx, named) as renderer, made(ctx, named) as other:
        surface, fresh = renderer.scheduler.gatherer.surface, other.scheduler.gatherer.surface
        assert surface is not None and fresh is not None
        renderer.relight(lights)
        surface.advance(renderer.draw_shadows(), Budget(TICK))
        renderer.move("block", matrix)
        for _ in range(4):
            surface.advance(renderer.draw_shadows(), Budget(TICK))
        other.relight(lights)
        other.move("block", matrix)
        advance(other)
        shown = surface.in_use.shown
        assert shown is not None and surface.in_use.follower is not None
        where = shown.records.sites(slice(0, shown.records.count))
        found, true = ((shown.area[:, None] * one.at(where)).sum() for one in (surface, fresh))
    assert found == pytest.approx(true, rel=0.017)  # measured: 0.013


def test_the_gap_above_a_moved_panel_lights_nothing_else(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """The gap between a ceiling and an emissive panel is bright. While the panel moves, this light reaches no other surface.

    The room after the move is the mirror image of the room before: equal light reaches its lower half.
    """
    monkeypatch.setattr("irrsplat.surface_cache.site_rays.FEW_RAYS", 64 * 64)  # a frame gathers a quarter of the sites
    panel = replace(quad((-0.2, 0.98, -0.4), (0.8, 0, 0), (0, 0, 0.8), material(0.5, 10.0)), name="panel")
    walls = box((-1, -1, -1), (1, 1, 1), material(0.7), outward=False)
    with made(ctx, scene(walls, panel, camera=FRONT)) as renderer:
        surface = renderer.scheduler.gatherer.surface
        assert surface is not None and surface.in_use.shown is not None
        lower = surface.in_use.shown.area[:, None] * (surface.in_use.shown.records.positions[:, 1:2] < 0.0)
        before = (lower * values(renderer)).sum()
        for step in range(1, STEPS + 1):
            renderer.move("panel", np.array([[1, 0, 0, -0.4 * step / STEPS], [0, 1, 0, 0], [0, 0, 1, 0]]))
            surface.advance(renderer.draw_shadows(), Budget(TICK))
        assert (lower * values(renderer)).sum() == pytest.approx(before, rel=0.09)


def test_no_pixel_goes_dark_while_a_lamp_is_carried() -> None:
    """Minimal frames never darken a pixel; soon after, the picture is that of a fresh render."""
    after = replace(ROOM, lights=tuple(lit(1.0)))
    with Renderer(ROOM, SIZE, **ALL) as renderer, Renderer(after, SIZE, **ALL) as fresh:
        renderer.render()
        true = fresh.render().irradiance
        for step in range(1, STEPS + 1):
            renderer.relight(lit(step / STEPS))
            view, _ = renderer.frame(seconds=TICK)
            found = view.read()
            seen = np.isfinite(found.depth)
            assert (found.irradiance[seen].sum(1) > 0.05 * true[seen].sum(1)).all()
        last = renderer.render().irradiance
        assert np.sqrt(((last - true) ** 2).mean()) < 0.06 * true.mean()
