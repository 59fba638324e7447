"""The self-test: a driver passes, or is refused by name; and triangles numbered by a geometry shader."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core.errors import GLError
from irrsplat.gpu import context, self_test
from irrsplat.gpu.self_test import Abilities
from irrsplat.gpu.target import Target
from tests.renderer.test_renderer import room


@pytest.fixture(autouse=True)
def anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget the drivers that were tested before."""
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path))
    monkeypatch.setattr(self_test, "_abilities", {})


def test_this_opengl_passes_and_is_left_as_it_was(ctx: moderngl.Context) -> None:
    target = Target(ctx, (3, 2), (4,))
    target.clear(7.0)
    found = self_test.tried(ctx)
    assert found.missing == ()
    assert ctx.fbo is target.gl and (target.read() == 7.0).all()
    target.release()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Mesa's environment variables")
def test_a_command_names_what_a_real_driver_lacks(ctx: moderngl.Context, tmp_path: Path) -> None:
    if not context.describe(ctx)["software"]:
        pytest.skip("only Mesa hides features on demand")
    without = {"MESA_GL_VERSION_OVERRIDE": "3.3", "MESA_EXTENSION_OVERRIDE": "-GL_ARB_depth_clamp"}
    done = subprocess.run(
        [sys.executable, "-m", "irrsplat", "render", "-o", "x.png"],
        env={**os.environ, **without},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 1 and "fails the self-test of GL_DEPTH_CLAMP;" in done.stderr
    assert done.stderr.count("\n") == 1 and not (tmp_path / "x.png").exists()


def test_triangles_numbered_by_a_geometry_shader_are_the_same(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """For drivers that give fragment shaders no gl_PrimitiveID otherwise (softpipe), or confuse varyings next to it (llvmpipe of
    Mesa 26.0): all buffers."""
    if not self_test.tried(ctx).numbers_triangles:
        pytest.skip("this driver has no other way to compare with")
    pictures = []
    for plain in (True, False):
        monkeypatch.setattr(self_test, "abilities", lambda ctx, plain=plain: Abilities((), plain))
        with Renderer(room(), (24, 16), ctx=ctx, gather="plane", bounces=1, gather_size=16, shadow_size=64) as renderer:
            pictures.append(renderer.render())
    for name, tolerance in (("position", 1e-5), ("normal", 1e-5), ("albedo", 1e-6), ("emission", 1e-6), ("irradiance", 2e-2)):
        one, other = (getattr(picture, name) for picture in pictures)  # a driver may begin a triangle at another corner
        assert one.any() and np.abs(one - other).max() <= tolerance * np.abs(one).max(), name


def test_what_passed_is_kept_and_a_failure_is_not(ctx: moderngl.Context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver is refused by what it lacks. A later process takes a success from the file, unless that is damaged."""
    calls: list[object] = []
    features = (("unheard of", lambda ctx: False), ("wrong numbers", lambda ctx: False))
    with (
        monkeypatch.context() as patch,
        pytest.raises(GLError, match="fails the self-test of unheard of, wrong numbers; update it"),
    ):
        patch.setattr(self_test, "FEATURES", features)
        self_test.check(ctx)

    def tried(ctx: moderngl.Context) -> Abilities:
        calls.append(ctx)
        return Abilities((), True)

    monkeypatch.setattr(self_test, "tried", tried)
    for content, count in ((None, 1), (None, 1), ("{}", 2), ('{"version": 0}', 3), ("\x00", 4)):
        for file in tmp_path.iterdir() if content else ():
            file.write_text(content or "")
        monkeypatch.setattr(self_test, "_abilities", {})
        self_test.check(ctx)
        assert len(calls) == count, content
