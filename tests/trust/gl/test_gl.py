"""The short form of machines.py, and contexts that are lost, shared and taken turns with."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import LightMeter, Renderer
from irrsplat.core.errors import GLError
from irrsplat.gpu import context
from tests.renderer.test_renderer import FAST, room
from tests.trust.gl import machines

SIZE, SIDE = (24, 20), 32
MESA = "Mesa" in context.describe(context.shared())["version"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the plain machine's pictures are, with the shaders that it has kept."""
    found = tmp_path_factory.mktemp("machines")
    machines.draw_plain(found, ("cornell",), SIDE)
    return found


@pytest.mark.skipif(not MESA, reason="Mesa's environment variables")
@pytest.mark.parametrize("name", ["OpenGL 3.3", "128-bit vectors"])
def test_pictures_do_not_depend_on_the_machine(name: str, folder: Path) -> None:
    case = next(case for case in machines.CASES if case.name == name)
    verdict = machines.judge(case, folder, folder / "plain.npz", ("cornell",), SIDE)
    assert verdict.held is not False, verdict.words


@pytest.mark.skipif(not MESA, reason="MESA_DEBUG")
def test_khr_debug_tells_of_no_fault(tmp_path: Path) -> None:
    verdict = machines.judge_messages(tmp_path, ("cornell",), 16)
    assert verdict.held is not False, verdict.words


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("glslangValidator") is None, reason="glslangValidator is not here (glslang-tools)")
def test_glslang_takes_all_programs(tmp_path: Path) -> None:
    verdict = machines.judge_shaders(tmp_path)
    assert verdict.held, verdict.words


def test_another_picture_is_told_apart(tmp_path: Path) -> None:
    """What the cases above hold against: 2 % more light, or one bit, is found."""
    case, rounded = machines.Case("a"), machines.Case("b", same=False)
    values = np.linspace(1.0, 2.0, 48, dtype="f4").reshape(4, 4, 3)
    for name, more in (("plain", 1.0), ("bit", 1.0 + 1e-7), ("light", 1.02)):
        arrays: dict[str, Any] = {"driver": np.array("any"), "cornell raster image": (values * more).astype("f4")}
        arrays["cornell raster albedo"] = values
        np.savez(tmp_path / f"{name}.npz", **arrays)
    plain, bit, light = (tmp_path / f"{name}.npz" for name in ("plain", "bit", "light"))
    assert machines.compare(case, plain, plain).held and machines.compare(rounded, plain, bit).held
    assert machines.compare(case, plain, bit).held is False
    assert machines.compare(rounded, plain, light).held is False
    assert machines.compare(machines.Case("c", driver="softpipe"), plain, plain).held is None


@pytest.mark.parametrize("given", [False, True], ids=("own context", "a host's"))
def test_a_lost_context_is_one_line_and_can_be_left(given: bool) -> None:
    ctx = context.create()
    renderer = Renderer(room(), SIZE, ctx=ctx if given else None, **FAST)
    renderer.render()
    meter = LightMeter(room(), ctx=renderer.ctx, bounces=1, gather_size=8, shadow_size=64)
    renderer.ctx.release()
    for use in (renderer.render, renderer.frame, lambda: renderer.resize((8, 8)), lambda: renderer.relight(())):
        with pytest.raises(GLError, match="context has been released"):
            use()
    meter.release()
    renderer.release()
    renderer.release()
    ctx.release()


def test_two_renderers_by_turns_one_in_a_host_s_context() -> None:
    """Round by round, with the host drawing in between by a state of its own: each has the records and pictures of one alone."""
    scenes = room(), room(sky=0.7)
    alone = [irrsplat.render(scene, SIZE, **FAST) for scene in scenes]
    host = context.create()
    try:
        picture = host.simple_framebuffer(SIZE)
        with Renderer(scenes[1], SIZE, ctx=host, **FAST) as lent, Renderer(scenes[0], SIZE, **FAST) as own:
            for _ in range(3):
                own.frame()
                context.make_current(host)
                picture.use()
                picture.color_mask = False, True, False, True
                host.enable_only(moderngl.BLEND | moderngl.CULL_FACE | moderngl.DEPTH_TEST)
                host.front_face, host.blend_func, host.depth_func = "cw", (moderngl.ZERO, moderngl.ONE), ">"
                host.wireframe, picture.scissor = True, (1, 1, 2, 2)
                picture.clear(1.0, 0.5, 0.25)
                lent.frame()
            own_frame = own.render()
            context.make_current(host)
            lent_frame = lent.render()
            assert host.error == "GL_NO_ERROR"
        for found, one in zip((own_frame, lent_frame), alone, strict=True):
            for name in ("image", "irradiance", "records_position", "records_irradiance"):
                assert getattr(found, name).tobytes() == getattr(one, name).tobytes(), name
    finally:
        host.release()
