"""Ctrl-C at any line of a frame or a change: the renderer continues and converges to current values.

IRRSPLAT_INTERRUPTS: the number of evenly spaced lines of a run at which a long test interrupts it (5).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.gpu.target import pixels
from irrsplat.indirect.gathering import record_gatherer
from irrsplat.surface_cache.site_rays import SiteRays
from irrsplat.surface_cache.surface_sites import SurfaceSites
from tests.renderer.test_move import BOX, shift
from tests.renderer.test_renderer import FAST, room
from tests.support.interrupts import run
from tests.support.worlds import point_light

SIZE = 32, 24
LONG = int(os.environ.get("IRRSPLAT_INTERRUPTS", "5"))  # lines


def at_rest(renderer: Renderer) -> dict[str, np.ndarray]:
    """Return the buffers of the converged view, and the records."""
    for _ in range(400):
        view, progress = renderer.frame()
        if progress.still:
            break
    assert progress.still
    g = view.gbuffer
    textures = {"position": g.position, "direct": view.direct, "sums": view.splats.sums, "image": view.image}
    return {name: pixels(texture).copy() for name, texture in textures.items()} | {"records": renderer.cache.read()["irradiance"]}


def act_from_empty(renderer: Renderer) -> None:
    renderer.frame()
    renderer.frame()


def act_relight(renderer: Renderer) -> None:
    renderer.relight([point_light((-0.5, 0.2, 0.5), 5.0)])
    renderer.frame()


def act_move(renderer: Renderer) -> None:
    renderer.move(BOX, shift(0.3, 0.0, 0.2))
    renderer.frame()


@pytest.mark.few_sites
@pytest.mark.parametrize(
    ("act", "settings", "places"),
    [
        (act_move, {"gather": "trace", "bounces": 1}, 2),
        *(
            pytest.param(act, settings, LONG, marks=pytest.mark.long)
            for act, settings in (
                (act_from_empty, {"gather": "trace", "bounces": 2}),
                (act_relight, {"gather": "trace", "bounces": 1}),
                (act_move, {"gather": "trace", "bounces": 2}),
            )
        ),
    ],
)
def test_what_counts_as_current_is(
    ctx: moderngl.Context, act: Callable[[Renderer], None], settings: dict[str, Any], places: int
) -> None:
    """After an interruption, g-buffer and direct light converge to those of a renderer without interruption.

    A complete redraw does not change the view, and a complete gather does not change the records.
    """

    def begun() -> Renderer:
        renderer = Renderer(room(), SIZE, ctx=ctx, **{**FAST, **settings})
        if act is not act_from_empty:
            at_rest(renderer)
        return renderer

    with begun() as renderer:
        lines, interrupted = run(lambda: act(renderer))
        assert not interrupted
        act(renderer)
        expected = at_rest(renderer)
    for number in np.linspace(0, lines - 1, places + 2)[1:-1].astype(int).tolist():
        with begun() as renderer:
            run(lambda renderer=renderer: act(renderer), number)  # type: ignore[misc]
            act(renderer)
            found = at_rest(renderer)
            for name in ("position", "direct"):
                assert np.array_equal(found[name], expected[name]), f"line {number}: {name} of another scene"
            renderer.forget(records=False)
            drawn_again = at_rest(renderer)
            count = len(found["records"])
            assert len(drawn_again["records"]) == count, f"line {number}: records were missing"
            for name in ("position", "direct", "sums", "image"):
                assert np.allclose(found[name], drawn_again[name], rtol=1e-4, atol=1e-5), f"line {number}: {name}"
            renderer.forget(records=False)
            renderer.scheduler.expire()
            gathered_again = at_rest(renderer)["records"][:count]
            off = np.abs(found["records"] - gathered_again).max() / gathered_again.mean()
            assert off < (0.15 if act is act_move else 0.005), f"line {number}: records"  # a move renews what it changes enough


def test_a_gather_that_fails_leaves_no_record_without_values(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise MemoryError

    with Renderer(room(), SIZE, ctx=ctx, **{**FAST, "gather": "trace", "bounces": 1}) as renderer:
        with monkeypatch.context() as patch, pytest.raises(MemoryError):
            patch.setattr(record_gatherer, "gather_records", fail)
            renderer.frame()
        assert renderer.cache.count == 0
        renderer.frame()
        assert renderer.cache.count > 0


@pytest.mark.few_sites
@pytest.mark.parametrize(("owner", "name"), [(SurfaceSites, "show"), (SiteRays, "direct_light")])
def test_an_interrupted_level_is_remade(owner: type, name: str, ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bounces are summed by then: a level whose values are not in use must not count as complete."""
    original, calls = getattr(owner, name), list[Any]()

    def interrupted(*args: Any) -> Any:
        calls.append(args)
        if len(calls) in (1, 3):  # of the coarse level, and of the full level
            raise KeyboardInterrupt
        return original(*args)

    monkeypatch.setattr(owner, name, interrupted)
    with Renderer(room(), SIZE, ctx=ctx, **{**FAST, "bounces": "all"}) as renderer:
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                while not renderer.frame(seconds=100.0)[1].done:
                    pass
        assert any(renderer.frame(seconds=100.0)[1].done for _ in range(200))
        assert not renderer.scheduler.gatherer.provisional
