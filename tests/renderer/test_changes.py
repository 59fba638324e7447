"""Successive changes, and changes that fail or are interrupted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.gather import kinds
from irrsplat.gpu.target import pixels
from irrsplat.indirect.gathering.record_gatherer import RecordGatherer
from irrsplat.records.record_cache import RecordCache
from irrsplat.scene.appearance import flatten
from tests.renderer.test_move import BOX, shift
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.worlds import point_light

TWO = (point_light((-0.5, 0.2, 0.5), 5.0), *room().lights)
WAY = shift(0.3, 0.0, 0.2)


def agrees(renderer: Renderer) -> None:
    """Assert that the picture is close to a fresh renderer's, and that buffers without records are equal."""
    frame = renderer.render()
    same = {"gather_size": renderer.settings.gather_size, "gather": renderer.settings.gather}  # 8² texels are 4 % off, rays 2 %
    with Renderer(renderer.scene, SIZE, ctx=renderer.ctx, **{**FAST, **same}) as fresh:
        other = fresh.render()
    assert np.array_equal(frame.position, other.position) and np.array_equal(frame.direct, other.direct)
    assert frame.irradiance.mean() == pytest.approx(other.irradiance.mean(), rel=0.05)
    assert frame.stats["converged"]


@pytest.mark.parametrize("lights", [TWO, pytest.param((), marks=pytest.mark.long)])
def test_lights_change_and_a_mesh_moves_before_a_frame(ctx: moderngl.Context, lights: Any) -> None:
    """Change to more or fewer lights than the shadow maps have."""
    with Renderer(room(), SIZE, ctx=ctx, **FAST) as renderer:
        renderer.render()
        renderer.relight(lights)
        renderer.move(BOX, WAY)
        renderer.relight(tuple(reversed(lights)))
        renderer.move(BOX, WAY)
        renderer.change(replace(renderer.settings, shadow_size=32))
        renderer.move(BOX, shift(0.2))
        renderer.change(replace(renderer.settings, shadow_size=64))
        agrees(renderer)


def state(renderer: Renderer) -> list[Any]:
    """Return all state that a change may affect, by value."""
    gatherer, cache = renderer.scheduler.gatherer, renderer.cache.read()
    known = (
        renderer.scene.lights,
        renderer.settings,
        gatherer.settings,
        renderer.world.shows(renderer.scene),
        gatherer.has_pending_changes,
    )
    return [*known, *(a.tobytes() for a in (*cache.values(), *flatten(renderer.scene), renderer.cache.stale))]


def fails(*_: Any, **__: Any) -> Any:
    raise RuntimeError("no memory")


def interrupted(*_: Any, **__: Any) -> Any:
    raise KeyboardInterrupt


CHANGES: dict[str, tuple[Any, str, Callable[[Renderer], None]]] = {
    "probes": (RecordGatherer, "_probed", lambda r: r.move(BOX, WAY)),
    "lights": (kinds, "gather_pass", lambda r: r.relight(TWO)),
}


@pytest.mark.parametrize("case", CHANGES)
def test_a_change_that_fails_changes_nothing(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    """The renderer continues as before, and the change succeeds later."""
    owner, name, act = CHANGES[case]
    with Renderer(room(), SIZE, ctx=ctx, **FAST, gather="trace") as renderer:
        renderer.render()
        before, image = state(renderer), pixels(renderer.frame()[0].image).copy()
        with monkeypatch.context() as patch, pytest.raises(RuntimeError, match="no memory"):
            patch.setattr(owner, name, fails)
            act(renderer)
        assert state(renderer) == before, "all is as it was"
        assert np.array_equal(pixels(renderer.frame()[0].image), image)
        act(renderer)
        renderer.change(replace(renderer.settings, **{**FAST, "gather": "auto", "gradients": True}))
        agrees(renderer)


def test_an_interrupted_change_forgets_the_records(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """Partial changes discard the records; the renderer continues with the old scene, and the change succeeds later."""
    with Renderer(room(), SIZE, ctx=ctx, **FAST, gather="trace") as renderer:
        renderer.render()
        scene = renderer.scene
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            for name in ("keep_only", "invalidate"):
                patch.setattr(RecordCache, name, interrupted)
            renderer.move(BOX, WAY)
        assert renderer.cache.count == 0 and renderer.scene is scene
        assert renderer.scheduler.gatherer.atlas is None, "the gather with its textures may be gone"
        renderer.move(BOX, WAY)
        agrees(renderer)
