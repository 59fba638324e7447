"""Programs are linked when they are first drawn with; so that none hides a mistake, all of them are linked here, as used."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core import paths
from irrsplat.gather.plane import PlaneGather
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.spot_check import SpotPass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu import shader_source
from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.timers import Timers
from irrsplat.gpu.world import World
from irrsplat.image.antialias import MeanPass
from irrsplat.image.composite import CompositePass
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.indirect.examine import ExaminePass
from irrsplat.indirect.hole_filling import HoleFilling
from irrsplat.indirect.splat import SplatPass, UpsamplePass
from irrsplat.indirect.temporal_filter import TemporalFilter
from irrsplat.lighting.direct import DirectPass
from irrsplat.lighting.light_table import light_defines
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.lighting.site_light import SiteLightPass
from irrsplat.lighting.virtual_lights import VirtualLightPasses
from irrsplat.records.adaptive_radius import AdaptiveRadius
from irrsplat.records.record_cache import RecordCache
from irrsplat.records.refresh_order import RefreshOrder
from irrsplat.scene.model import Image, Light, Material, Texture
from irrsplat.surface_cache.cache import SurfaceViewPass
from irrsplat.surface_cache.site_rays import VisibilityPass
from tests.gather.test_analytic import LIGHTS
from tests.renderer.test_renderer import SIZE
from tests.support.worlds import Lit, floor, scene

LIT = {
    "lighting/direct",
    "gather/plane",
    "gather/trace",
    "gather/sky_share",
    "lighting/site_light",
    "lighting/virtual_lights/find",
    "lighting/virtual_lights/emit",
}  # stages whose shaders go by the lights, and the sky's share of a gather that has one of these


def lit(ctx: moderngl.Context, lights: tuple[Light, ...]) -> Iterator[Owner]:
    """Every pass whose shaders are made for the lights that there are."""
    world = Lit(ctx, scene(floor(), lights=lights), 16).world
    defines = light_defines(world.scene)
    yield DirectPass(ctx, SIZE, defines)
    for surface, samples in product((False, True), (0, 16)):
        yield PlaneGather(world, 8, 1, surface=surface)
        yield TraceGather(world, 8, 1, surface=surface, light_samples=samples)
        yield TraceGather(world, 8, 1, hits=True, light_samples=samples)
    yield SiteLightPass(ctx, defines, 8)
    yield VirtualLightPasses(world)


def unlit(ctx: moderngl.Context) -> Iterator[Owner]:
    """Every other pass of the core, as settings may have it."""
    for gradients in (False, True):
        yield ReducePass(ctx, gradients)
    for simple in (ShadowPass, VisibilityPass, SurfaceViewPass, RefreshOrder, ExaminePass, SpotPass):
        yield simple(ctx)
    yield AdaptiveRadius(ctx, RecordCache(ctx), Timers(ctx, software=True))
    yield textured(ctx)
    for sized in (GBufferPass, CompositePass, MeanPass, SplatPass, UpsamplePass):
        yield sized(ctx, SIZE)
    yield TemporalFilter(ctx, SIZE)
    yield HoleFilling(ctx, SIZE)


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


def resources(owner: Owner) -> Iterator[Resource]:
    """All resources of an owner, including those of owned owners, without the owners themselves."""
    for thing in owner.owned():
        if isinstance(thing, Owner):
            yield from resources(thing)
        elif thing is not None:
            yield thing


def linked(ctx: moderngl.Context, passes: Iterator[Owner]) -> set[str]:
    """The names of all their programs, each linked and freed again."""
    names = set()
    for one in passes:
        names |= {each.name for each in resources(one) if isinstance(each, Program) and each.gl}
        one.release()
    ctx.detect_framebuffer(0).use()
    return names


@pytest.mark.parametrize("kinds", [(), ("directional",), ("opengl",), ("luminaire",), tuple(LIGHTS)], ids=",".join)
def test_shaders_for_all_kinds_of_lights_compile(ctx: moderngl.Context, kinds: tuple[str, ...]) -> None:
    assert linked(ctx, lit(ctx, tuple(LIGHTS[kind] for kind in kinds))) == LIT


def test_all_other_shaders_of_the_core_compile(ctx: moderngl.Context) -> None:
    """The viewer's and the bakes' programs are drawn with in their own tests."""
    folder = paths.folder("shaders")
    stages = {path.relative_to(folder).with_suffix("").as_posix() for path in folder.rglob("*.frag")}
    core = {name for name in stages if not name.startswith(("viewer/", "bake/"))}
    assert linked(ctx, unlit(ctx)) == core - LIT


def test_each_input_of_a_fragment_shader_is_an_output_of_its_vertex_shader() -> None:
    """Otherwise its value is undefined by OpenGL, and drivers other than Mesa refuse the program.

    A program of one name has both shaders in one folder; the code names the vertex shader of others.
    """
    shaders, code = paths.folder("shaders"), Path(irrsplat.__file__).parents[1]
    names = (path.relative_to(shaders).with_suffix("").as_posix() for path in shaders.rglob("*.frag"))
    pairs = {(name, name) for name in names}
    for module in [*(code / "irrsplat").rglob("*.py"), *(code / "app").rglob("*.py")]:
        pairs |= set(re.findall(r'"([\w/]+)",\s*"([\w/]+)"', module.read_text()))
    files = [(f"{fragment}.frag", f"{vertex}.vert") for fragment, vertex in sorted(pairs)]
    files = [pair for pair in files if all((shaders / name).exists() for name in pair)]
    assert len(files) > 30
    for fragment, vertex in files:
        taken, given = (
            set(re.findall(rf"^(?:flat )?{word} (\w+ \w+);", shader_source.load(name).text, re.MULTILINE))
            for word, name in (("in", fragment), ("out", vertex))
        )
        assert taken <= given, f"{fragment} with {vertex}"


def test_programs_of_one_text_are_linked_once(ctx: moderngl.Context) -> None:
    """Each draw sets all uniforms, so that two users of a linked program do not disturb each other; the last one frees it."""
    one, two = (Program(ctx, "lib/nothing", "lib/fullscreen", {"DEPTH": 0.5}) for _ in range(2))
    other = Program(ctx, "lib/nothing", "lib/fullscreen", {"DEPTH": 0.25})
    assert one.gl is two.gl and one.gl is not other.gl
    shared = one.gl
    one.release()
    assert two.gl is shared
    two.release()
    assert isinstance(shared.mglo, moderngl.InvalidObject)
    assert not isinstance(other.gl.mglo, moderngl.InvalidObject)
    other.release()
