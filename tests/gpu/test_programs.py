"""Programs are linked when they are first drawn with; so that none hides a mistake, all of them are linked here, as used."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer
from irrsplat.core import paths
from irrsplat.gather.gaps import GapPass
from irrsplat.gather.raster import MeshletDraw, SingleDraw
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.spot_check import SpotPass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu import program, shader_source
from irrsplat.gpu.program import Program, programs_of
from irrsplat.gpu.resource import Owner
from irrsplat.gpu.target import Target
from irrsplat.gpu.world import World
from irrsplat.image.antialias import MeanPass
from irrsplat.image.composite import CompositePass, MeterPass
from irrsplat.image.emitter_light import EmitterLightPass
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.indirect.examine import ExaminePass
from irrsplat.indirect.splat import SplatPass
from irrsplat.indirect.temporal_filter import TemporalFilter
from irrsplat.indirect.upsample import UpsamplePass
from irrsplat.lighting.direct import DirectPass
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.lighting.site_light import SiteLightPass
from irrsplat.lighting.virtual_lights import VirtualLightPasses
from irrsplat.records.coverage_pass import CoveragePass
from irrsplat.records.radius_limit_pass import RadiusLimitPass
from irrsplat.scene.model import Image, Light, Material, Texture
from irrsplat.surface_cache.view import SurfaceViewPass
from irrsplat.surface_cache.visibility import VisibilityPass
from tests.gather.test_analytic import LIGHTS
from tests.renderer.test_renderer import FAST, SIZE, room
from tests.support.worlds import Lit, floor, scene

KINDS: dict[str, tuple[Light, ...]] = {
    "none": (),
    **{name: (one,) for name, one in LIGHTS.items()},
    "all": tuple(LIGHTS.values()),
}

LIT = {
    "lighting/direct",
    "gather/raster/draw",
    "gather/raster/triangle",
    "gather/raster/shade",
    "gather/trace",
    "lighting/site_light",
    "lighting/virtual_lights/find",
    "lighting/virtual_lights/shine",
}  # stages whose shaders go by the lights


def lit(ctx: moderngl.Context, lights: tuple[Light, ...]) -> Iterator[Owner]:
    """Every pass whose shaders are made for the lights that there are."""
    world = Lit(ctx, scene(floor(), lights=lights), 16).world
    defines = light_defines(world.scene)
    yield DirectPass(ctx, SIZE, defines)
    for surface, samples in product((False, True), (0, 16)):
        for gather in (SingleDraw, MeshletDraw):
            yield gather(ctx, SIZE, {**defines, "SURFACE": int(surface), "VIRTUAL_LIGHTS": int(samples > 0)})
        yield TraceGather(world, 8, 1, surface=surface, light_samples=samples)
        yield TraceGather(world, 8, 1, surface=True, hits=True, light_samples=samples)
    yield SiteLightPass(ctx, defines, 8)
    yield VirtualLightPasses(world)


def unlit(ctx: moderngl.Context) -> Iterator[Owner]:
    """Every other pass of the core, as settings may have it."""
    for gradients in (False, True):
        yield SplatPass(ctx, SIZE, gradients)
        yield ReducePass(ctx, gradients)
        yield CoveragePass(ctx, gradients)
        for neighbours in (False, True):
            yield RadiusLimitPass(ctx, gradients, neighbours)
    for simple in (ShadowPass, VisibilityPass, SurfaceViewPass):
        yield simple(ctx)
    yield textured(ctx)
    yield ExaminePass(ctx)
    yield MeterPass(ctx)
    for sized in (GBufferPass, CompositePass, MeanPass, UpsamplePass, SpotPass):
        yield sized(ctx, SIZE)
    yield EmitterLightPass(ctx, SIZE, {})
    yield GapPass(Lit(ctx, scene(floor()), 16).world, SIZE)
    yield TemporalFilter(ctx, SIZE)


def textured(ctx: moderngl.Context) -> GBufferPass:
    """A g-buffer that has drawn surfaces with all maps, and with none, of every way in which they may be opaque."""
    worn = Texture(Image(np.full((1, 1, 4), 255, "u1")))
    maps = {"albedo_texture": worn, "emission_texture": worn, "normal_texture": worn, "emission": (1.0, 1.0, 1.0)}
    modes = Material(alpha_mode="mask"), Material(alpha_mode="blend"), Material(transmission=1.0)
    paints = (replace(mode, **some) for mode in modes for some in (maps, {}))  # type: ignore[arg-type]
    world, drawn = scene(*(floor(paint=paint) for paint in paints)), GBufferPass(ctx, SIZE)
    with World(ctx, world) as placed:
        drawn(placed, world.camera())
    return drawn


def linked(ctx: moderngl.Context, passes: Iterator[Owner]) -> set[str]:
    """The names of all their programs, each linked and freed again."""
    names = set()
    for one in passes:
        names |= {each.name for each in programs_of(one) if each.gl}
        one.release()
    ctx.detect_framebuffer(0).use()
    return names


@pytest.mark.parametrize("kind", KINDS)
def test_shaders_for_all_kinds_of_lights_compile(ctx: moderngl.Context, kind: str) -> None:
    assert linked(ctx, lit(ctx, KINDS[kind])) == LIT


def test_all_other_shaders_of_the_core_compile(ctx: moderngl.Context) -> None:
    """Those of the viewer and of bakes are all drawn with in their tests."""
    folder = paths.folder("shaders")
    stages = {path.relative_to(folder).with_suffix("").as_posix() for path in folder.rglob("*.frag")}
    core = {name for name in stages if not name.startswith(("viewer/", "bake/"))}
    assert linked(ctx, unlit(ctx)) == core - LIT


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Program]:
    """The programs that are linked from now on."""
    found: list[Program] = []
    plain = Program._linked

    def link(self: Program, sources: Any) -> Any:
        found.append(self)
        return plain(self, sources)

    monkeypatch.setattr(Program, "_linked", link)
    return found


def test_a_render_links_what_it_draws_with_and_nothing_else(made: list[Program]) -> None:
    """And each once, however many frames there are."""
    with Renderer(room(), SIZE, **FAST, exposure=0.0) as renderer:
        assert made == []
        renderer.render()
        renderer.render()
        names = [one.name for one in made]
        assert sorted(names) == sorted(set(names))
        assert "image/gbuffer" in names
        assert not {f"image/{name}" for name in ("composite_smooth", "composite_meter", "composite_display", "accumulate")} & set(
            names
        )


def test_shaders_that_were_not_drawn_with_are_read_again_too(
    ctx: moderngl.Context, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """F5: what is wrong in one is told with its place, drawn with before or not, and all go on as they were."""
    monkeypatch.setattr(shader_source, "folder", lambda name: tmp_path)
    (tmp_path / "v.vert").write_text(
        "void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0, 1); }\n"
    )
    text = "out vec4 color;\nvoid main() { color = vec4(VALUE); }\n"
    for name in ("drawn", "waiting"):
        (tmp_path / f"{name}.frag").write_text(text.replace("VALUE", "1.0"))
    drawn, waiting = (Program(ctx, name, "v") for name in ("drawn", "waiting"))
    target = Target(ctx, (1, 1), (4,))
    drawn(target)
    (tmp_path / "drawn.frag").write_text(text.replace("VALUE", "2.0"))
    (tmp_path / "waiting.frag").write_text(text.replace("VALUE", "nowhere"))
    with pytest.raises(shader_source.ShaderError, match=r"^waiting\.frag:2: .*nowhere"):
        program.reload([drawn, waiting])
    ctx.clear_errors()
    for one in (drawn, waiting):
        one(target)
        assert target.read()[0, 0, 0] == 1.0, "the last good one, though its file is broken by now"
    (tmp_path / "waiting.frag").write_text(text.replace("VALUE", "3.0"))
    program.reload([drawn, waiting])
    for one, value in ((drawn, 2.0), (waiting, 3.0)):
        one(target)
        assert target.read()[0, 0, 0] == value
