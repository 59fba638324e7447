"""Ctrl-C at any line of a frame, or of a change: nothing counts as current that is not, and the renderer goes on.

IRRSPLAT_INTERRUPTS: at how many lines, evenly over all that each run executes, it is interrupted (3).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import Renderer
from irrsplat.gpu.target import pixels
from irrsplat.image.view import Progress
from irrsplat.indirect.gathering import record_gatherer
from irrsplat.surface_cache import site_layout
from tests.renderer.test_move import BOX, shift
from tests.renderer.test_refinement import COARSE
from tests.renderer.test_renderer import FAST, room
from tests.support.interrupts import run
from tests.support.viewing import write_room
from tests.support.worlds import lamp

SIZE = 32, 24
PLACES = int(os.environ.get("IRRSPLAT_INTERRUPTS", "3"))


def at_rest(renderer: Renderer) -> dict[str, np.ndarray]:
    """The buffers of the view once frames find nothing to do, and the records."""
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
    renderer.relight([lamp((-0.5, 0.2, 0.5), 5.0)])
    renderer.frame()


def act_move(renderer: Renderer) -> None:
    renderer.move(BOX, shift(0.3, 0.0, 0.2))
    renderer.frame()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("act", "settings"),
    [
        (act_from_empty, {"gather": "trace", "bounces": 2}),
        (act_relight, {"gather": "trace", "bounces": 1}),
        (act_move, {"gather": "raster", "bounces": 1}),
        (act_move, {"gather": "trace", "bounces": 2}),
    ],
)
def test_what_counts_as_current_is(ctx: moderngl.Context, act: Callable[[Renderer], None], settings: dict[str, Any]) -> None:
    """The frames after an interruption come to a view whose g-buffer and direct light are those of a renderer that was not
    interrupted, which stays what it is when all of it is drawn again, and whose records stay when they are gathered again."""

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
    for number in np.linspace(0, lines - 1, PLACES).astype(int).tolist():
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
            renderer.renew()
            gathered_again = at_rest(renderer)["records"][:count]
            off = np.abs(found["records"] - gathered_again).max() / gathered_again.mean()
            assert off < (0.15 if act is act_move else 0.005), f"line {number}: records"  # a move renews what it changes enough


@pytest.mark.slow
def test_a_refinement_that_was_interrupted_begins_anew(
    ctx: moderngl.Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next call comes to the error aimed at, as if nothing had been, and to the same picture within twice that."""
    monkeypatch.setattr(site_layout, "POINTS", (100, 100))
    scene, target, pictures = irrsplat.load(write_room(tmp_path)), 0.03, []

    def refined(renderer: Renderer) -> Progress:
        progress = None
        while progress is None or not progress.refined:
            progress = renderer.refine(None, target, 0.05)[1]
        return progress

    lines = 0
    for share in (None, *np.linspace(0.0, 1.0, PLACES + 1, endpoint=False)[1:].tolist()):
        with Renderer(scene, (64, 48), ctx=ctx, **(COARSE | {"bounces": 3})) as renderer:
            renderer.converge()
            if share is None:
                lines, _ = run(lambda: refined(renderer))
            else:
                run(lambda: refined(renderer), int(share * lines))
            progress = refined(renderer)
            assert progress.error is not None and progress.error <= target, f"{share} of {lines} lines"
            pictures.append(pixels(renderer.refine(None, target)[0].image).copy())
    for picture in pictures[1:]:
        assert np.sqrt(((picture - pictures[0]) ** 2).mean()) < 2.0 * target * pictures[0].mean()


def test_a_gather_that_fails_leaves_no_record_without_values(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise MemoryError

    with Renderer(room(), SIZE, ctx=ctx, **{**FAST, "gather": "trace", "bounces": 1}) as renderer:
        with monkeypatch.context() as patch, pytest.raises(MemoryError):
            patch.setattr(record_gatherer, "gather_records", fail)
            renderer.frame()
        assert renderer.cache.count == 0
        renderer.frame()
        assert renderer.cache.count > 0
