"""docs/python.md is right: its blocks run one after the other, and its hosts draw what a render gives."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import irrsplat
from irrsplat.core.files import eight_bits
from irrsplat.image.tonemap import tonemap
from tests.support.programs import program

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
        if "import mitsuba" in block and importlib.util.find_spec("mitsuba") is None:
            continue  # tests/scene/test_objects.py has it where the extra is there
        for long, short in SMALL:
            block = block.replace(long, short)
        exec(compile(block, "python.md", "exec"), names)
    assert {path.name for path in tmp_path.iterdir()} == {"picture.png", "layers.exr", "blender.exr", "sheet.png"}
    assert names["E"].shape == (2, 3) and (names["E"] > 0.0).all()
    assert names["lit"].notices == ("scene: no camera; one that sees the whole scene stands in",)


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
    assert (
        np.abs(picture - truth).mean() < 1.0
    )  # the last splats of a render are in another order; a tick's picture is as complete


IN_QT = """
import sys
sys.path.insert(0, sys.argv[1])
import functools, in_qt, irrsplat
irrsplat.Renderer = functools.partial(irrsplat.Renderer, gather_size=8, shadow_size=64, bounces=1)
application = in_qt.QApplication([])
main, lit = in_qt.window()
lit.setFixedSize(48, 48)
main.show()
while not lit.still:
    application.processEvents()
before = lit.grabFramebuffer()
lit.doneCurrent()
try:
    lit.renderer.frame()
    sys.exit("no error without a current context")
except irrsplat.GLError:
    pass
lit.dim(25)
lit.still = False
while not lit.still:
    application.processEvents()
before.save(sys.argv[2])
lit.grabFramebuffer().save(sys.argv[3])
main.close()
"""


def test_the_widget_of_qt_is_lit_and_dimmed(tmp_path: Path) -> None:
    pytest.importorskip("PySide6")
    if shutil.which("xvfb-run") is None:
        pytest.skip("needs xvfb-run")
    files = [str(tmp_path / name) for name in ("before.png", "after.png")]
    command = ["xvfb-run", "-a", sys.executable, "-c", IN_QT, str(ROOT / "docs/programs"), *files]
    xcb = {**os.environ, "QT_QPA_PLATFORM": "xcb"}
    done = subprocess.run(command, env=xcb, capture_output=True, text=True, timeout=120, check=False)
    if "platform plugin" in done.stderr:
        pytest.skip("Qt has no xcb here")
    assert done.returncode == 0, done.stderr
    before, after = (np.asarray(Image.open(file).convert("RGB"), float) for file in files)
    assert before.shape == (48, 48, 3) and before.mean() > 30.0
    assert after.mean() < 0.75 * before.mean()


def test_another_current_context_is_told() -> None:
    """Without the check, a draw in another context uses things of the same numbers there, or crashes. A context that irrsplat
    made is made current to be left, whoever owns it; that of a host is not irrsplat's to touch."""
    from irrsplat.gpu import context

    scene = irrsplat.load("cornell")
    ctx = context.create()
    try:
        if not any(context.current()):
            pytest.skip("the system does not tell which context is current")
        given = irrsplat.Renderer(scene, (8, 8), ctx=ctx, gather_size=8, shadow_size=64)
        with irrsplat.Renderer(scene, (8, 8), gather_size=8, shadow_size=64):
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
