"""A renderer in use: ticks of limited time, settings and lights that change, other sizes, shaders read again."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat import InputError, Renderer
from irrsplat.core import paths
from irrsplat.gpu import shader_source
from irrsplat.gpu.target import pixels
from irrsplat.image.view import Progress, View
from irrsplat.renderer import frames
from irrsplat.scene.model import Camera, Light
from irrsplat.settings import SETTINGS
from tests.renderer.test_renderer import FAST, FRONT, SIZE, room
from tests.support.worlds import lamp

TICK = 1e-4  # seconds: no tick gathers more than it must


@pytest.fixture
def renderer() -> Iterator[Renderer]:
    """A renderer of `room` that has served FRONT whole."""
    with Renderer(room(), SIZE, **FAST) as made:
        made.render()
        yield made


def ticks(renderer: Renderer, seconds: float | None = None, camera: Camera | None = None, most: int = 3000) -> list[Progress]:
    """Ticks until nothing is left to do."""
    told: list[Progress] = []
    while len(told) < most and not (told and told[-1].done):
        told.append(renderer.frame(camera, seconds)[1])
    return told


# ---- a tick's time ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("preset", [{"spread": 0.3}, {"preset": "paper", "warmup": 60, "a": 0.3}])
def test_small_ticks_come_to_what_whole_rounds_come_to(preset: dict[str, Any]) -> None:
    """The sites of a round are chosen at its begin: in however many ticks they are gathered, the records lie at the same places.

    (The paper's traversal looks at the weights again each time, CPU's and GPU's differ by rounding: there nearly all do.)
    """
    with Renderer(room(), SIZE, **{**FAST, **preset}) as small, Renderer(room(), SIZE, **{**FAST, **preset}) as whole:
        told, other = ticks(small, TICK), ticks(whole)
        assert len(told) > 3 * len(other), "the ticks were small"
        assert told[-1].coverage == 1.0 and all(p.new >= 1 for p in told[:5])
        one, two = small.cache.read(), whole.cache.read()
    if "preset" not in preset:
        ended = [{p.round for p in some if p.new == 0 and p.complete} for some in (told, other)]
        assert ended[0] == ended[1] != set(), "a round is whole when all is gathered"
        # batches of other sizes round otherwise, by which in the last rounds a pixel may ask that else would not
        count = int(0.9 * len(two["position"]))
        assert abs(len(one["position"]) - len(two["position"])) <= 2
        assert np.array_equal(one["position"][:count], two["position"][:count])
        light, other_light = (records["irradiance"][:count] for records in (one, two))
        assert np.allclose(light, other_light, rtol=0.02, atol=1e-3 * other_light.mean())
    else:
        assert abs(len(one["radius"]) - len(two["radius"])) <= 0.02 * len(two["radius"])
        assert np.array_equal(one["position"][:60], two["position"][:60]), "the warm-up goes on where it stopped"


def test_at_rest_nothing_is_drawn(renderer: Renderer) -> None:
    ticks(renderer)
    before = renderer.frame(seconds=0.05)[0]
    view, progress = renderer.frame(seconds=0.05)
    assert renderer.timers.milliseconds() == {} and view is before and progress.done


def test_a_frozen_cache_stays_as_it_is(renderer: Renderer) -> None:
    count, away = renderer.cache.count, Camera((0.0, 0.0, 0.95), (0.9, -0.1, 0.4), fov=60.0)
    for _ in range(3):
        _, progress = renderer.frame(away, gather=False)
        assert (renderer.cache.count, progress.new) == (count, 0) and 0.0 < progress.coverage < 1.0
    assert ticks(renderer, camera=away)[-1].coverage == 1.0 and renderer.cache.count > count


def test_a_view_that_cannot_be_served_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds that gain nothing are given up, in ticks as in whole renders, and another camera starts anew."""
    with Renderer(room(), SIZE, **FAST, tolerance=1e6) as renderer:  # Σw never comes to that
        told = ticks(renderer, most=60)
        assert told[-1].new == 0 and told[-1].coverage < 1.0 and len(told) == 60
        quiet = renderer.cache.count
        assert renderer.frame()[1].records == quiet
        assert renderer.frame(replace(FRONT, fov=50.0))[1].new > 0


def test_pictures_that_take_long_come_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """While only records change, ticks gather and keep the last picture; a new one comes at once for other lights, and when
    nothing is left to gather."""
    monkeypatch.setattr(frames, "_OLDEST_PICTURE", 1e9)  # seconds

    def tick(made: Renderer) -> tuple[View, Progress]:
        made._frames.state = replace(made._state, costs=replace(made._state.costs, picture=1e3))  # seconds that a picture takes
        return made.frame(seconds=TICK)

    with Renderer(room(), SIZE, **FAST) as made:
        first, _ = made.frame(seconds=TICK)
        second, progress = tick(made)
        assert second is first and progress.new > 0 and not made.timers.milliseconds().keys() & {"composite", "direct"}
        made.relight([lamp((-0.5, 0.2, 0.5), 5.0)])
        relit, _ = tick(made)
        assert relit is not first
        while not progress.still:
            last, progress = tick(made)
            assert last is relit or progress.still or progress.fading
        shown = pixels(last.image).copy()
        made.forget(records=False)
        assert np.array_equal(shown, pixels(made.frame(gather=False)[0].image)) and progress.done


# ---- settings ---------------------------------------------------------------------------------------------------------

ALL = {"shadow", "gbuffer", "splat", "examine", "gather", "reduce", "direct", "composite"}
SPLAT = {"splat", "examine", "composite"}
RENEW = SPLAT | {"gather", "reduce"}
# a setting, another value of it, and the stages that then draw again (gathering anew: the records that the change asks for)
CHANGES: list[tuple[str, Any, set[str]]] = [
    ("shadow_size", 128, RENEW | {"shadow", "direct"}),
    ("seed", 5, RENEW),
    ("ray_noise", 2.0, RENEW),
    ("light_samples", 16, RENEW),
    ("bounces", 0, {"splat", "composite"}),
    ("bounces", 2, RENEW | {"surface"}),
    ("gather", "plane", RENEW),
    ("gather_size", 16, RENEW),
    ("gradients", False, RENEW),  # without R <= E/|∇E| other radii: not SPLAT alone where pixels then ask
    ("second_order", False, SPLAT),
    ("radius", "harmonic", SPLAT),
    ("a", 0.8, SPLAT),
    ("adapt", 0.1, SPLAT),
    ("kernel", "cut", SPLAT),
    ("in_front", False, SPLAT),
    ("walls", False, SPLAT),
    ("neighbours", True, SPLAT),
    ("radius_min", 2.0, SPLAT),
    ("radius_max", 10.0, SPLAT),
    ("coarse", False, SPLAT),
    ("tolerance", 0.5, {"examine"}),
    ("spread", 0.9, {"examine"}),
    ("borrow", 8, {"examine", "splat", "composite"}),  # records are held against each other again where fewer are wanted
    ("placement", "scan", SPLAT | {"gather", "gbuffer"}),  # the paper reads the g-buffer back
    ("warmup", 10, RENEW),
    ("max_rounds", 5, set()),
    ("max_records", 5000, {"examine"}),  # a view that needed more may ask again
    ("blend", 0.9, {"composite"}),
    ("pixel_light_samples", 4, RENEW),
    ("smooth", True, {"composite"}),
    ("fill_holes", False, set()),  # the view is whole
    ("fade", False, set()),  # frames without limit never do
    ("backdrop", "white", {"composite"}),
    ("texture_memory", 64, SPLAT | {"gbuffer", "direct"}),
    ("exposure", 2.0, set()),
    ("samples", 4, set()),
    ("budget", 20.0, set()),
    ("viewer_samples", 5, set()),
    ("quality", 1.0, set()),
    ("viewer_quality", 1.0, set()),
]


def test_every_setting_has_its_line_below() -> None:
    assert {name for name, *_ in CHANGES} == set(SETTINGS)


@pytest.mark.parametrize(("name", "value", "stages"), CHANGES)
def test_a_setting_invalidates_exactly_what_depends_on_it(renderer: Renderer, name: str, value: Any, stages: set[str]) -> None:
    ticks(renderer)
    before = renderer.frame()[0]
    renderer.change(replace(renderer.settings, **{name: value}))
    drawn: set[str] = set()
    for _ in range(6):
        view, progress = renderer.frame()
        drawn |= set(renderer.timers.milliseconds()) - {"adapt"}  # which comes with every new record
    assert drawn >= stages - {"gather", "reduce"} and drawn <= (stages if stages != SPLAT else RENEW)
    assert (view.gbuffer is before.gbuffer) == ("gbuffer" not in stages or name == "placement")
    if name != "gradients":
        assert drawn >= stages & {"gather", "reduce"}
    assert not progress.stale


@pytest.mark.parametrize(("name", "value"), [("gather_size", 16), ("shadow_size", 128), ("gather", "plane"), ("gather", "trace")])
def test_changed_settings_come_to_the_records_of_a_fresh_renderer(renderer: Renderer, name: str, value: Any) -> None:
    """Records that were there are gathered again where they are, as a renderer that began with these settings would."""
    count = renderer.cache.count
    before, old = renderer.cache.read(), getattr(renderer.settings, name)
    renderer.change(replace(renderer.settings, **{name: value}))
    ticks(renderer)
    after = renderer.cache.read()
    assert np.array_equal(after["position"][:count], before["position"])
    assert not np.array_equal(after["irradiance"][:count], before["irradiance"])
    renderer.change(replace(renderer.settings, **{name: old}))
    ticks(renderer)
    again = renderer.cache.read()
    assert np.allclose(again["irradiance"][:count], before["irradiance"], rtol=0.02, atol=1e-3 * before["irradiance"].mean())


def test_paper_and_default_by_one_change(renderer: Renderer) -> None:
    """The presets place their records differently: each begins with none, and comes to what it comes to alone."""
    from irrsplat.settings import preset

    paper = preset("paper", **FAST, warmup=50)
    renderer.change(paper, "paper")
    ticks(renderer)
    with Renderer(room(), SIZE, "paper", **FAST, warmup=50) as fresh:
        ticks(fresh)
        one, two = renderer.cache.read(), fresh.cache.read()
    assert np.array_equal(one["position"], two["position"]) and np.array_equal(one["irradiance"], two["irradiance"])
    renderer.change(preset("default", **FAST), "default")
    assert ticks(renderer)[-1].coverage == 1.0 and renderer.render().stats["preset"] == "default"


# ---- lights -----------------------------------------------------------------------------------------------------------


def dimmed(light: Light, by: float) -> Light:
    red, green, blue = light.color
    return replace(light, color=(red * by, green * by, blue * by))


def test_a_dimmed_light_is_the_same_picture_darker(renderer: Renderer) -> None:
    """Light is linear: half the lamp, half of E in every record and of the image, but for what emits by itself."""
    world = room()
    plain = replace(world, meshes=tuple(replace(m, material=replace(m.material, emission=(0, 0, 0))) for m in world.meshes))
    with Renderer(plain, SIZE, **FAST) as renderer:
        frame = renderer.render()
        renderer.relight([dimmed(plain.lights[0], 0.5)])
        told = ticks(renderer, TICK)
        assert not told[0].stale and told[-1].records == frame.stats["records"]
        half = renderer.render()
    assert half.stats["records"] == frame.stats["records"]
    assert np.allclose(half.records_irradiance, 0.5 * frame.records_irradiance, rtol=0.01, atol=1e-4 * frame.irradiance.mean())
    assert np.allclose(half.image, 0.5 * frame.image, rtol=0.02, atol=1e-3 * frame.image.mean())


def test_a_moved_light_is_a_fresh_render_s(renderer: Renderer) -> None:
    moved = [lamp((-0.5, 0.2, 0.5), 5.0)]
    renderer.relight(moved)
    frame = renderer.render()
    with Renderer(replace(room(), lights=tuple(moved)), SIZE, **FAST) as other:
        fresh = other.render()
    assert np.allclose(frame.direct, fresh.direct)
    assert np.sqrt(np.mean((frame.irradiance - fresh.irradiance) ** 2)) < 0.1 * fresh.irradiance.mean()
    assert frame.irradiance.mean() == pytest.approx(fresh.irradiance.mean(), rel=0.03)


def test_lights_of_another_kind_and_number(renderer: Renderer) -> None:
    """Their shaders are compiled for the kinds that there are: a directional light and a lamp in place of one lamp, then none."""
    sun = Light((0.2, 1.0, 0.4), (1.0, 1.0, 1.0), directional=True)
    for lights in ([sun, *room().lights], []):
        renderer.relight(lights)
        frame = renderer.render()
        with Renderer(replace(room(), lights=tuple(lights)), SIZE, **FAST) as other:
            assert np.allclose(frame.direct, other.render().direct)
    assert frame.irradiance.mean() < 0.1, "what glows is left"
    with pytest.raises(InputError, match="lights"):
        renderer.relight(room().lights * 10_000)
    assert len(renderer.scene.lights) == 0, "and nothing changed"


# ---- size, shaders, freeing -------------------------------------------------------------------------------------------


def test_another_size_keeps_the_records(renderer: Renderer) -> None:
    count = renderer.cache.count
    renderer.resize((96, 80))
    assert renderer.cache.count == count
    frame = renderer.render()
    assert frame.image.shape == (80, 96, 3) and frame.stats["converged"] and frame.stats["records"] < 2 * count
    with Renderer(room(), (96, 80), **FAST) as other:
        assert np.array_equal(frame.position, other.render().position)
    for wrong in ((0, 4), (10**6, 10**6)):
        with pytest.raises(InputError):
            renderer.resize(wrong)
    assert renderer.size == (96, 80)


def test_shaders_are_read_again(renderer: Renderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A changed shader changes the picture; one that is wrong is told by file and line, and the last good one goes on."""
    copy = tmp_path / "shaders"
    shutil.copytree(paths.folder("shaders"), copy)
    monkeypatch.setattr(shader_source, "folder", lambda name: copy)
    before = renderer.render().image
    file = copy / "image/composite.frag"
    good = file.read_text(encoding="utf-8")
    file.write_text(good.replace("out_image = vec4(", "out_image = 2.0 * vec4("), encoding="utf-8")
    renderer.reload()
    assert np.allclose(renderer.render().image, 2.0 * before, rtol=0.01)
    file.write_text(good.replace("out_image = vec4(", "out_image = wrong + vec4("), encoding="utf-8")
    with pytest.raises(shader_source.ShaderError, match=r"composite\.frag:\d+: .*wrong"):
        renderer.reload()
    assert np.allclose(renderer.render().image, 2.0 * before, rtol=0.01)
    file.write_text(good.replace("uniform vec2 blend;", "uniform vec2 mixture;").replace("blend.", "mixture."), encoding="utf-8")
    with pytest.raises(shader_source.ShaderError, match=r"blend, mixture"):
        renderer.reload()
    file.write_text(good, encoding="utf-8")
    renderer.reload()
    assert np.allclose(renderer.render().image, before, rtol=0.01)


def test_nothing_is_left_on_the_gpu(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every object that a renderer with a given context made is gone after its release, whatever changed meanwhile."""
    made: list[Any] = []
    for name in ("texture", "depth_texture", "buffer", "framebuffer", "program", "vertex_array"):
        create = getattr(moderngl.Context, name)

        def watched(self: Any, *args: Any, create: Any = create, **options: Any) -> Any:
            made.append(create(self, *args, **options))
            return made[-1]

        monkeypatch.setattr(moderngl.Context, name, watched)
    with Renderer(room(), SIZE, ctx=ctx, **FAST) as renderer:
        renderer.render()
        renderer.change(replace(renderer.settings, gradients=False, gather_size=12, smooth=True, shadow_size=32))
        renderer.render()
        renderer.relight([Light((0.2, 1.0, 0.4), (1.0, 1.0, 1.0), directional=True)])
        renderer.resize((30, 20))
        renderer.render()
        renderer.change(replace(renderer.settings, bounces=2))
        for x in (0.1, 0.2):
            renderer.move(1, np.array([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0]]))
            renderer.render()
        renderer.reload()
        renderer.render()
        alive = len(made)
    assert alive > 60
    left = [thing for thing in made if not isinstance(thing.mglo, moderngl.InvalidObject)]
    assert not left, f"{len(left)} of {len(made)}: {left[:5]}"


def test_too_many_shadow_tiles_are_refused_before_anything_changes(renderer: Renderer) -> None:
    room_for = (int(renderer.ctx.info["GL_MAX_TEXTURE_SIZE"]) // 4096) ** 2  # tiles; a lamp takes six
    many = tuple(lamp((0.05 * i, 0.6, 0.2)) for i in range(room_for // 6 + 1))
    before = renderer.settings
    renderer.relight(many)
    with pytest.raises(InputError, match=rf"{6 * len(many)} shadow tiles of 4096 .*--shadow-size"):
        renderer.change(replace(before, shadow_size=4096))
    assert renderer.settings == before and renderer.frame()[1].records > 0
    renderer.change(replace(before, shadow_size=16))
    with pytest.raises(InputError, match="lights"):
        renderer.relight(many * 1000)
    assert len(renderer.scene.lights) == len(many)


def test_a_frozen_view_is_looked_at_once(renderer: Renderer) -> None:
    away = Camera((0.0, 0.0, 0.95), (0.9, -0.1, 0.4), fov=60.0)
    first = renderer.frame(away, gather=False)[1]
    assert "examine" in renderer.timers.milliseconds()
    again = renderer.frame(away, gather=False)[1]
    assert renderer.timers.milliseconds() == {} and again == first
