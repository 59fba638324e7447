"""Renderer in use: limited frame budgets, changes of settings and lights, other sizes, reloaded shaders."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from threading import Event
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat import InputError, Renderer
from irrsplat.core.buffers import CHANNELS, Sites
from irrsplat.core.timing.clock import use_clock
from irrsplat.gpu import world
from irrsplat.image.view import Progress
from irrsplat.renderer.frames import divisor_after
from irrsplat.scene.model import Camera, Light
from irrsplat.scene.motion import hidden
from irrsplat.scene.spatial import bvh
from irrsplat.settings import SETTINGS, preset
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.counted_clock import RayClock
from tests.support.worlds import point_light

TICK = 1e-4  # seconds: each frame gathers only the minimum


@pytest.fixture
def renderer(ctx: moderngl.Context) -> Iterator[Renderer]:
    """A renderer of `room` with a converged view of FRONT."""
    with Renderer(room(), SIZE, ctx=ctx, **FAST) as made:
        made.render()
        yield made


def ticks(renderer: Renderer, seconds: float | None = None, camera: Camera | None = None, most: int = 3000) -> list[Progress]:
    """Render frames until no work is left; return their progress."""
    told: list[Progress] = []
    while len(told) < most and not (told and told[-1].done):
        told.append(renderer.frame(camera, seconds)[1])
    return told


# ---- frame budgets ----------------------------------------------------------------------------------------------------


def test_small_ticks_come_to_what_whole_rounds_come_to() -> None:
    """A round chooses its sites at its start: records lie at the same places for any number of frames."""
    settings = {**FAST, "spread": 0.3, "gather_size": 32}
    with Renderer(room(), SIZE, **settings) as small, Renderer(room(), SIZE, ctx=small.ctx, **settings) as whole:
        with use_clock(RayClock(1e6)):  # 10 000 rays a tick, and rounds of up to a hundred records of 1024 rays
            told, other = ticks(small, 0.01), ticks(whole)
        assert len(told) > 2 * len(other), "the ticks were small"
        assert told[-1].coverage == 1.0 and all(p.new >= 1 for p in told[:5])
        one, two = small.cache.read(), whole.cache.read()
    ended = [{p.round for p in some if p.new == 0 and p.complete} for some in (told, other)]
    assert ended[0] == ended[1] != set(), "a round is whole when all is gathered"
    # batches of other sizes round differently, so that another pixel may request a record in the last rounds
    count = int(0.9 * len(two["position"]))
    assert abs(len(one["position"]) - len(two["position"])) <= 2
    assert np.array_equal(one["position"][:count], two["position"][:count])
    light, other_light = (records["irradiance"][:count] for records in (one, two))
    assert np.allclose(light, other_light, rtol=0.02, atol=1e-3 * other_light.mean())


class _Impatient(RayClock):
    """A clock that waits for no thread."""

    def wait(self, futures: Sequence[Future[Any]], seconds: float) -> bool:
        return all(one.done() for one in futures)


def test_holes_wait_for_no_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a large scene, ticks leave holes without probes while the tree of rays is built in the background."""
    built = Event()
    monkeypatch.setattr(world, "_LARGE", 1)
    monkeypatch.setattr(world, "build", lambda corners: (built.wait(60.0), bvh.build(corners))[1])
    with use_clock(_Impatient(1e6)), Renderer(room(), SIZE, **FAST) as renderer:
        renderer.frame(seconds=0.05)
        assert not renderer.scheduler.gatherer.world.has_tree, "the tick has waited for the tree"
        built.set()
        assert renderer.stages.world.tree
        renderer.frame(seconds=0.05)
        assert renderer.scheduler.hole_probes.cache.count


def test_a_still_view_replaces_probes_that_went_with_the_oldest() -> None:
    """A flight has left many probes elsewhere. The half that goes includes those of the holes in view."""
    with use_clock(RayClock(1e4)), Renderer(room(), SIZE, **FAST) as renderer:
        renderer.frame(seconds=0.01)
        cache = renderer.scheduler.hole_probes.cache
        elsewhere = np.full((40_000, 3), 50.0, "f4")
        cache.append(Sites(elsewhere, elsewhere, elsewhere), np.ones((len(elsewhere), 4), "f4"))
        while cache.count > len(elsewhere) or (cache.positions > 2.0).all():
            assert renderer.frame(seconds=0.01)[1].coverage < 0.9, "holes had no probe until records covered them"


def test_the_scan_gathers_no_probes() -> None:
    """Pictures of the paper's scan show no probes of holes."""
    with use_clock(RayClock(1e6)), Renderer(room(), SIZE, placement="scan", gather="trace", **FAST) as renderer:
        renderer.frame(seconds=0.05)
        assert renderer.settings.fill_holes and not renderer.scheduler.hole_probes.cache.count


@pytest.mark.few_sites
def test_the_first_light_is_not_the_last() -> None:
    """A tick that is spent on the surface cache leaves records to gather: a loop until `still` continues."""
    with Renderer(room(), SIZE, **{**FAST, "bounces": "all"}) as renderer:
        told = [renderer.frame(seconds=TICK)[1]]
        while not told[-1].still:
            told.append(renderer.frame(seconds=TICK)[1])
        assert told[0].records == 0 and told[-1].done and told[-1].records == renderer.cache.count > 0


def test_a_view_is_read_as_a_frame() -> None:
    """A still view has the buffers of a render. A view of an earlier camera is an error, not another picture."""
    with Renderer(room(), SIZE, **FAST) as renderer:
        view, _ = renderer.frame()
        assert view.read().stats["converged"] is False
        ticks(renderer)
        old, _ = renderer.frame()
        found, whole = old.read(), renderer.render()
        for name in CHANNELS:
            assert np.array_equal(getattr(found, name), getattr(whole, name)), name
        assert np.array_equal(found.records_irradiance, whole.records_irradiance) and found.stats["converged"]
        renderer.frame(replace(FRONT, fov=50.0))
        with pytest.raises(InputError, match="use a view before the next frame"):
            old.read()
        old, _ = renderer.frame()
        renderer.relight((Light((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), directional=True),))
        renderer.frame()
        with pytest.raises(InputError, match="use a view before the next frame"):
            old.read()
        renderer.resize((40, 30))
        with pytest.raises(InputError, match="use a view before the next frame"):
            renderer.accumulate(old, 4)
    del renderer
    with pytest.raises(InputError, match="is gone"):
        old.read()


@pytest.mark.parametrize(("fixed", "pixels"), [(0.0, 0.02), (0.01, 0.02), (0.01, 0.15), (0.03, 0.3), (0.2, 0.3)])
def test_the_size_of_moving_views_follows_the_budget(fixed: float, pixels: float) -> None:
    """Drawing takes `fixed` seconds, and `pixels` more at full size. The divisor converges without oscillation.

    Drawing then takes at most 0.8 of the budget, if a divisor of 4 allows that. Whole views are drawn if they fit into
    half.
    """
    tick, taken, divisor = 0.05, lambda d: fixed + pixels / d**2, 1
    for _ in range(8):
        divisor = divisor_after(divisor, taken(divisor), tick)
    assert divisor == divisor_after(divisor, taken(divisor), tick)
    assert taken(divisor) <= 0.8 * tick or divisor == 4
    assert divisor == 1 or taken(1) > 0.5 * tick
    assert divisor_after(1, taken(1), 0.0) == divisor_after(1, taken(1), -1.0) == 4  # no time is left for the tick


def test_a_moving_view_is_smaller_and_its_records_cover_the_whole_view(ctx: moderngl.Context) -> None:
    """The budget TICK never suffices for a whole picture (each reading of the clock takes longer): both sides are divided by
    4.

    Tiles are shares of the picture, so that a moving view requests the records of a whole one. A whole view of a former
    camera ends with at most a tenth more records than in a renderer without motion.
    """
    size = (160, 120)
    with Renderer(room(), size, ctx=ctx, **FAST) as direct, Renderer(room(), size, ctx=ctx, **FAST) as moved:
        ticks(direct, camera=FRONT)
        moved.frame(FRONT, TICK)
        for i in range(12):
            view, _ = moved.frame(replace(FRONT, fov=60.0 + 1e-3 * i), None, moving=True)
            assert view.image.size == (40, 30)
        few = moved.cache.count
        ticks(moved, camera=FRONT)
        assert moved.frame(FRONT)[0].image.size == size and 10 < few < moved.cache.count <= 1.1 * direct.cache.count


def test_the_spot_check_waits_for_a_still_camera(ctx: moderngl.Context) -> None:
    """The number of checked records stays 0 in smaller views of a moving camera, not in a whole view. 64² rays permit a check."""
    with Renderer(room(), (160, 120), ctx=ctx, **{**FAST, "gather_size": 64}) as renderer:
        renderer.frame(FRONT, TICK)
        for i in range(30):
            renderer.frame(replace(FRONT, fov=60.0 + 1e-3 * (i // 10)), None, moving=True)
        assert not renderer.scheduler.state().checked
        ticks(renderer, camera=FRONT)
        assert renderer.scheduler.state().checked


def test_at_rest_nothing_is_drawn(renderer: Renderer) -> None:
    assert ticks(renderer, 0.05)[-1].done and renderer.cache.column("probe")[:, 3].all()
    before = renderer.frame(seconds=0.05)[0]
    view, progress = renderer.frame(seconds=0.05)
    assert renderer.timers.milliseconds() == {} and view is before and progress.done


def test_hidden_meshes_have_no_sites(ctx: moderngl.Context) -> None:
    """All triangles are degenerate points: no division by their area, and no visible surface."""
    with Renderer(room(), SIZE, ctx=ctx, **{**FAST, "bounces": 3}) as renderer:
        renderer.frame(FRONT, TICK)
        meshes = tuple(hidden(mesh, mesh.positions[0]) for mesh in renderer.scene.meshes)
        renderer.pose(replace(renderer.scene, meshes=meshes))
        assert ticks(renderer)[-1].done


def test_a_frozen_cache_stays_as_it_is(renderer: Renderer) -> None:
    count, away = renderer.cache.count, Camera((0.0, 0.0, 0.95), (0.9, -0.1, 0.4), fov=60.0)
    for _ in range(3):
        _, progress = renderer.frame(away, gather=False)
        assert (renderer.cache.count, progress.new) == (count, 0) and 0.0 < progress.coverage < 1.0
    assert ticks(renderer, camera=away)[-1].coverage == 1.0 and renderer.cache.count > count


def test_a_view_that_cannot_be_covered_ends() -> None:
    """Rounds without gain end, in limited frames as in whole renders, and another camera restarts them."""
    with Renderer(room(), SIZE, **FAST, tolerance=1e6) as renderer:  # Σw never reaches it
        told = ticks(renderer, most=60)
        assert told[-1].new == 0 and told[-1].coverage < 1.0 and len(told) == 60
        quiet = renderer.cache.count
        assert renderer.frame()[1].records == quiet
        assert renderer.frame(replace(FRONT, fov=50.0))[1].new > 0


# ---- settings ---------------------------------------------------------------------------------------------------------

SPLAT = {"splat", "examine", "composite"}
RENEW = SPLAT | {"gather", "reduce"}
# stages that must draw, stages that may draw, and the settings with another value that cause it
CHANGES: list[tuple[set[str], set[str], dict[str, Any]]] = [
    (set(), set(), {"fill_holes": False, "exposure": 2.0, "samples": 4, "budget": 20.0}),
    (set(), set(), {"viewer_samples": 5, "quality": 1.0, "viewer_quality": 1.0}),
    ({"composite"}, set(), {"blend": 0.9, "backdrop": "white"}),
    ({"examine"}, set(), {"tolerance": 0.5, "spread": 0.9, "max_records": 5000}),  # a view may request records again
    (SPLAT, RENEW, {"weights": "paper", "a": 0.8, "adapt": 0.1}),
    (SPLAT, RENEW, {"radius_min": 2.0, "radius_max": 10.0}),
    (SPLAT, RENEW, {"gradients": False}),  # the radii may leave no pixel uncovered
    (RENEW, set(), {"seed": 5, "light_samples": 16, "gather_size": 16, "warmup": 10}),
    (RENEW | {"direct"}, set(), {"gather": "plane"}),  # all other gathers use shadow rays at pixels
    (RENEW | {"shadow", "direct"}, set(), {"shadow_size": 128}),
    (RENEW | {"surface"}, set(), {"bounces": 2}),
]


@pytest.mark.few_sites
def test_a_setting_invalidates_exactly_what_depends_on_it(renderer: Renderer) -> None:
    """The stages that draw after a change are those that read the setting; other stages keep their results.

    A view can be sampled and read after each change.
    """
    for least, besides, values in CHANGES:
        for name, value in values.items():
            ticks(renderer)
            before, old = renderer.frame()[0], getattr(renderer.settings, name)
            renderer.change(replace(renderer.settings, **{name: value}))
            drawn: set[str] = set()
            for _ in range(6):
                view, progress = renderer.frame()
                before.read()
                drawn |= set(renderer.timers.milliseconds()) - {"adapt"}  # every new record leads to it
            assert least <= drawn <= least | besides, name
            assert (view.gbuffer is before.gbuffer) == ("gbuffer" not in drawn), name
            assert not progress.stale, name
            renderer.change(replace(renderer.settings, **{name: old}))
            assert renderer.accumulate(view, 2).read().stats["samples"] == 2


def test_every_setting_is_among_them() -> None:
    """The next tests cover `bounces` = 0 and the placement."""
    assert {"bounces", "placement"}.union(*(values for _, _, values in CHANGES)) == set(SETTINGS)


@pytest.mark.parametrize(("name", "value"), [("shadow_size", 128), ("gather", "plane")])
def test_changed_settings_come_to_the_records_of_a_fresh_renderer(renderer: Renderer, name: str, value: Any) -> None:
    """Existing records are gathered again in place, as in a renderer that started with these settings."""
    count = renderer.cache.count
    before, old = renderer.cache.read(), getattr(renderer.settings, name)
    renderer.change(replace(renderer.settings, **{name: value}))
    ticks(renderer)
    after = renderer.cache.read()
    assert np.array_equal(after["position"][:count], before["position"])
    assert not np.array_equal(after["irradiance"][:count], before["irradiance"])
    renderer.change(replace(renderer.settings, **{name: old}))
    ticks(renderer)
    again = renderer.cache.read()
    assert np.allclose(again["irradiance"][:count], before["irradiance"], rtol=0.02, atol=1e-3 * before["irradiance"].mean())


def test_paper_and_default_by_one_change(ctx: moderngl.Context) -> None:
    """The presets place their records differently: each starts without records, and equals a separate renderer."""
    paper, size = preset("paper", **FAST, warmup=20), (24, 20)
    with (
        Renderer(room(), size, ctx=ctx, **FAST) as renderer,
        Renderer(room(), size, "paper", ctx=ctx, **FAST, warmup=20) as fresh,
    ):
        renderer.render()
        renderer.change(paper, "paper")
        ticks(renderer)
        ticks(fresh)
        one, two = renderer.cache.read(), fresh.cache.read()
        assert np.array_equal(one["position"], two["position"]) and np.array_equal(one["irradiance"], two["irradiance"])
        renderer.change(preset("default", **FAST), "default")
        assert ticks(renderer)[-1].coverage == 1.0 and renderer.render().stats["preset"] == "default"


# ---- lights -----------------------------------------------------------------------------------------------------------


def dimmed(light: Light, by: float) -> Light:
    red, green, blue = light.color
    return replace(light, color=(red * by, green * by, blue * by))


def test_lights_of_another_kind_and_number(renderer: Renderer) -> None:
    """Shaders are compiled for the present kinds: a directional and a point light in place of one point light, then none."""
    sun = Light((0.2, 1.0, 0.4), (1.0, 1.0, 1.0), directional=True)
    for lights in ([sun, *room().lights], []):
        renderer.relight(lights)
        frame = renderer.render()
        with Renderer(replace(room(), lights=tuple(lights)), SIZE, ctx=renderer.ctx, **FAST) as other:
            assert np.allclose(frame.direct, other.render().direct)
    assert frame.irradiance.mean() < 0.1, "what glows is left"
    with pytest.raises(InputError, match="lights"):
        renderer.relight(room().lights * 10_000)
    assert len(renderer.scene.lights) == 0, "and nothing changed"


# ---- size, shaders, freeing -------------------------------------------------------------------------------------------


def test_another_size_keeps_the_records(renderer: Renderer) -> None:
    count = renderer.cache.count
    renderer.resize((96, 80))
    assert renderer.cache.count == count
    frame = renderer.render()
    assert frame.image.shape == (80, 96, 3) and frame.stats["converged"] and frame.stats["records"] < 2 * count
    with Renderer(room(), (96, 80), ctx=renderer.ctx, **FAST) as other:
        assert np.array_equal(frame.position, other.render().position)
    for wrong in ((0, 4), (10**6, 10**6)):
        with pytest.raises(InputError):
            renderer.resize(wrong)
    assert renderer.size == (96, 80)


@pytest.mark.few_sites
def test_nothing_is_left_on_the_gpu(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """All OpenGL objects of a renderer with a given context are freed at its release, after any changes."""
    made: list[Any] = []
    for name in ("texture", "depth_texture", "buffer", "framebuffer", "program", "vertex_array"):
        create = getattr(moderngl.Context, name)

        def watched(self: Any, *args: Any, create: Any = create, **options: Any) -> Any:
            made.append(create(self, *args, **options))
            return made[-1]

        monkeypatch.setattr(moderngl.Context, name, watched)
    with Renderer(room(), SIZE, ctx=ctx, **FAST) as renderer:
        renderer.render()
        renderer.change(replace(renderer.settings, gradients=False, gather_size=12, shadow_size=32))
        renderer.render()
        renderer.relight([Light((0.2, 1.0, 0.4), (1.0, 1.0, 1.0), directional=True)])
        renderer.resize((30, 20))
        renderer.render()
        renderer.change(replace(renderer.settings, bounces=2))
        for x in (0.1, 0.2):
            renderer.move(1, np.array([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0]]))
            renderer.render()
        alive = len(made)
    assert alive > 60
    left = [thing for thing in made if not isinstance(thing.mglo, moderngl.InvalidObject)]
    assert not left, f"{len(left)} of {len(made)}: {left[:5]}"


def test_many_lights_have_smaller_shadow_tiles_and_too_many_are_refused(renderer: Renderer) -> None:
    """300 equal lights illuminate as one of 300 times the intensity does, but for the resolution of their shadows."""
    one, before = point_light((0.3, 0.6, 0.2), 1.0), renderer.settings
    renderer.relight([point_light((0.3, 0.6, 0.2), 300.0)])
    whole = renderer.read_direct_irradiance()
    renderer.relight([one] * 300)
    assert not renderer.notices
    renderer.change(replace(before, shadow_size=4096))
    assert len(renderer.notices) == 1 and "1800 shadow tiles" in renderer.notices[0]
    renderer.change(before)
    assert np.median(np.abs(renderer.read_direct_irradiance() - whole)) < 1e-3 * whole.mean()
    assert renderer.frame()[1].records > 0
    with pytest.raises(InputError, match="lights"):
        renderer.relight([one] * 10000)
    assert len(renderer.scene.lights) == 300
