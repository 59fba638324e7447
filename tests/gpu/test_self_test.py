"""The self-test: what it finds, what it says, what is kept, and triangles numbered by a geometry shader."""

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
def anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Nothing is known of any driver; the file for what is kept."""
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path))
    monkeypatch.setattr(self_test, "_known", {})
    return tmp_path / "self-test.json"


def test_this_opengl_passes_and_is_left_as_it_was(ctx: moderngl.Context) -> None:
    target = Target(ctx, (3, 2), (4,))
    target.clear(7.0)
    found = self_test.tried(ctx)
    assert found.missing == ()
    assert ctx.fbo is target.gl and (target.read() == 7.0).all()
    target.release()


def test_a_driver_without_a_feature_is_refused_by_its_name(
    ctx: moderngl.Context, anew: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: moderngl.Context) -> bool:
        raise moderngl.Error("no such thing")

    broken = (*self_test.FEATURES, ("unheard of", fails), ("wrong numbers", lambda ctx: False))
    monkeypatch.setattr(self_test, "FEATURES", broken)
    with pytest.raises(GLError, match="fails the self-test of unheard of, wrong numbers; update"):
        Renderer(room(), (8, 8), ctx=ctx)
    assert not anew.exists(), "a failure is not kept: a driver may be mended under the same name"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Mesa's environment variables")
@pytest.mark.parametrize("command", [("doctor",), ("render", "-o", "x.png")])
def test_commands_name_what_a_real_driver_lacks(command: tuple[str, ...], tmp_path: Path) -> None:
    if not context.describe(context.shared())["software"]:
        pytest.skip("only Mesa hides features on demand")
    without = {"MESA_GL_VERSION_OVERRIDE": "3.3", "MESA_EXTENSION_OVERRIDE": "-GL_ARB_depth_clamp"}
    done = subprocess.run(
        [sys.executable, "-m", "irrsplat", *command],
        env={**os.environ, **without},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1 and "fails the self-test of GL_DEPTH_CLAMP;" in done.stderr
    assert done.stderr.count("\n") == 1 and not (tmp_path / "x.png").exists()


def test_what_passed_is_not_tried_again_by_later_processes(
    ctx: moderngl.Context, anew: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[object] = []

    def tried(ctx: moderngl.Context) -> Abilities:
        calls.append(ctx)
        return Abilities((), True)

    monkeypatch.setattr(self_test, "tried", tried)
    for _ in range(3):
        monkeypatch.setattr(self_test, "_known", {})
        self_test.check(ctx)
        self_test.check(ctx)
    assert len(calls) == 1
    for damaged in ("", "{}", '{"version": 2, "numbers_triangles": [3]}', "\x00\xff"):
        anew.write_text(damaged)
        monkeypatch.setattr(self_test, "_known", {})
        self_test.check(ctx)
    assert len(calls) == 5, "a damaged file counts as none"


def test_triangles_numbered_by_a_geometry_shader_are_the_same(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """For drivers that give fragment shaders no gl_PrimitiveID otherwise (softpipe), or confuse varyings beside it (llvmpipe of
    Mesa 26.0): all buffers, either gather."""
    if not self_test.tried(ctx).numbers_triangles:
        pytest.skip("this driver has no other way to compare with")
    for gather in ("raster", "trace"):
        pictures = []
        for plain in (True, False):
            monkeypatch.setattr(self_test, "abilities", lambda ctx, plain=plain: Abilities((), plain))
            with Renderer(room(), (24, 16), ctx=ctx, gather=gather, bounces=1, gather_size=16, shadow_size=64) as renderer:
                pictures.append(renderer.render())
        for name, tolerance in (("position", 1e-5), ("normal", 1e-5), ("albedo", 1e-6), ("emission", 1e-6), ("irradiance", 2e-2)):
            one, other = (getattr(picture, name) for picture in pictures)  # a driver may begin a triangle at another corner
            assert one.any() and np.abs(one - other).max() <= tolerance * np.abs(one).max(), (gather, name)


def test_a_given_vector_width_has_no_shaders_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mesa's llvmpipe finds kept shaders whatever width they are for; what the user says of the cache holds."""
    for name in ("MESA_SHADER_CACHE_DISABLE", "LP_NATIVE_VECTOR_WIDTH"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    context.prepare()
    assert "MESA_SHADER_CACHE_DISABLE" not in os.environ
    monkeypatch.setenv("LP_NATIVE_VECTOR_WIDTH", "128")
    context.prepare()
    assert os.environ["MESA_SHADER_CACHE_DISABLE"] == "true"
    monkeypatch.setenv("MESA_SHADER_CACHE_DISABLE", "false")
    context.prepare()
    assert os.environ["MESA_SHADER_CACHE_DISABLE"] == "false"
