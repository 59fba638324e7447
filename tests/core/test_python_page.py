"""docs/python.md is right: its blocks run one after the other, and its hosts draw what a render gives."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.core.files import eight_bits
from irrsplat.image.tonemap import tonemap
from tests.support.programs import program

pytestmark = pytest.mark.few_sites
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.S)
QUICK = "gather_size=8, shadow_size=64, bounces=1"
SMALL = (  # the same with less work: this is about the calls, not about their results
    ("size=(200, 200)", f"size=(24, 24), {QUICK}"),
    ('preset="default")', f'preset="default", {QUICK}, light_samples=16)'),
)


def test_the_blocks_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in BLOCKS:
        for long, short in SMALL:
            block = block.replace(long, short)
        exec(compile(block, "python.md", "exec"), names)
    assert {path.name for path in tmp_path.iterdir()} == {"picture.png", "layers.exr"}
    assert names["E"].shape == (2, 3) and (names["E"] > 0.0).all()


def test_the_window_shows_what_a_render_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ticks until nothing changes, in a window in memory; the camera stands at time 0."""
    import moderngl_window

    module = program("in_moderngl_window")
    monkeypatch.setattr(module.Host, "window_size", (48, 48))
    window = moderngl_window.get_local_window_cls("headless")(size=(48, 48), gl_version=(3, 3), backend="egl")
    moderngl_window.activate_context(window=window)
    shown = module.Host(ctx=window.ctx, wnd=window, timer=None)
    try:
        for _ in range(200):
            shown.on_render(0.0, 0.0)
            if shown.renderer.frame(shown.camera, seconds=0.03)[1].still:
                break
        shown.on_render(0.0, 0.0)
        picture = np.frombuffer(window.fbo.read(), np.uint8).reshape(48, 48, 3)[::-1].astype(int)
        frame = shown.renderer.render(shown.camera)
        truth = eight_bits(tonemap(frame.image, frame.exposure)).astype(int)
    finally:
        shown.on_close()
        window.ctx.release()
    assert picture.mean() > 30.0
    assert np.abs(picture - truth).mean() < 1.0  # of 255: the last splats of a render are in another order


def test_another_current_context_is_told() -> None:
    """Without the check, a draw in another context uses things of the same numbers there, or crashes. A context that irrsplat
    made is made current to be left, whoever owns it; that of a host is not irrsplat's to touch."""
    from irrsplat.gpu import context

    scene = irrsplat.load("cornell")
    ctx = context.create()
    try:
        if not any(context.current()):
            pytest.skip("the system does not tell which context is current")
        given = irrsplat.Renderer(scene, (8, 8), ctx=ctx, gather_size=8, shadow_size=64, bounces=1)
        with irrsplat.Renderer(scene, (8, 8), gather_size=8, shadow_size=64, bounces=1):
            for call in (given.frame, given.render):
                with pytest.raises(irrsplat.GLError, match="another OpenGL context is current"):
                    call()
            made_by, ctx.extra = ctx.extra, None  # as of a context that the host made
            with pytest.raises(irrsplat.GLError, match="another OpenGL context is current"):
                given.release()
            ctx.extra = made_by
            given.release()
    finally:
        ctx.release()
