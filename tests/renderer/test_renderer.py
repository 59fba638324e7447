"""Whole frames: contracts of every buffer, of convergence and of repetition, on small pictures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import Frame, Renderer
from irrsplat.core.buffers import CHANNELS
from irrsplat.core.errors import InputError
from irrsplat.gpu.target import Target
from irrsplat.image.frame import check_names
from irrsplat.renderer import whole_renders
from irrsplat.scene.model import Camera, Scene
from tests.support.worlds import box, floor, material, point_light, quad, scene, shared

FAST: dict[str, Any] = {"bounces": 1, "gather_size": 8, "shadow_size": 64}
SIZE = (48, 40)
FRONT = Camera((0.0, 0.0, 0.95), (0.0, -0.1, -1.0), fov=60.0)


def room(sky: float = 0.0) -> Scene:
    """Return a room of 2 m in three colours, open in front, with a box and a light in it."""
    walls = box((-1, -1, -1), (1, 1, 1), material((0.8, 0.7, 0.6)), outward=False)
    things = box((-0.4, -1, -0.6), (0.2, -0.3, 0.0), material((0.2, 0.6, 0.8)))
    left = quad((-0.99, -1, -1), (0, 0, 2), (0, 2, 0), material((0.7, 0.1, 0.1), (0.05, 0.0, 0.0)))
    return scene(walls, things, left, lights=(point_light((0.3, 0.6, 0.2), 3.0),), sky=sky, camera=FRONT)


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    """A renderer of `room` after one render of FRONT."""
    with Renderer(room(), SIZE, **FAST) as made:
        made.render()
        yield made


def rendered(world: Scene, size: tuple[int, int] = SIZE, camera: Camera | None = None, **settings: Any) -> Frame:
    """Return the view of a new renderer with FAST settings, in the shared context."""
    ctx = shared()
    with ctx, Renderer(world, size, ctx=ctx, **{**FAST, **settings}) as one:
        return one.render(camera)


# ---- the contract of the buffers --------------------------------------------------------------------------------------


def check(frame: Frame, size: tuple[int, int], sky: tuple[float, float, float]) -> None:
    """Assert names, shapes and types; finite values except in depth; zeros in the background; the sum of indirect and image."""
    count = frame.stats["records"]
    for name, channel in CHANNELS.items():
        array = getattr(frame, name)
        assert array.shape == ((size[1], size[0], 3) if channel.components == 3 else (size[1], size[0])), name
        assert array.dtype == np.float32 and array.flags["C_CONTIGUOUS"] and array.flags["WRITEABLE"], name
        assert np.isfinite(array).all() or name == "depth", name
    for name in ("position", "normal", "irradiance", "radius"):
        array = getattr(frame, f"records_{name}")
        assert array.shape == ((count,) if name == "radius" else (count, 3)), name
        assert array.dtype == np.float32 and np.isfinite(array).all(), name
    assert (frame.records_radius > 0.0).all() and (frame.records_irradiance >= 0.0).all()
    unseen = np.isinf(frame.depth)
    assert not np.isnan(frame.depth).any() and (frame.depth > 0.0).all()
    for name in set(CHANNELS) - {"depth", "emission", "image"}:
        assert not getattr(frame, name)[unseen].any(), f"{name} where nothing is seen"
    assert (frame.emission[unseen] == np.asarray(sky, "f4")).all() and (frame.image[unseen] == np.asarray(sky, "f4")).all()
    assert np.allclose(np.linalg.norm(frame.normal[~unseen], axis=1), 1.0, atol=1e-5)
    assert np.allclose(frame.indirect, frame.albedo / np.pi * frame.irradiance, rtol=1e-5, atol=1e-7)
    for name in ("image", "direct", "irradiance", "weight", "albedo", "emission"):
        assert (getattr(frame, name) >= 0.0).all(), name


@pytest.mark.parametrize(("size", "preset"), [((1, 1), "paper"), ((3, 200), "default"), (SIZE, "paper")])
def test_every_buffer_is_as_promised(size: tuple[int, int], preset: str) -> None:
    world = scene(floor(0.5), box((-0.2, 0, -0.2), (0.1, 0.3, 0.1)), lights=(point_light((1, 2, 1)),), sky=(0.1, 0.2, 0.3))
    frame = rendered(world, size, preset=preset, warmup=20)
    check(frame, size, world.sky)
    assert frame.stats["converged"] and frame.stats["coverage"] == 1.0
    assert frame.stats["size"] == list(size)
    assert np.allclose(
        frame.image, np.where(np.isinf(frame.depth)[..., None], world.sky, frame.direct + frame.indirect), atol=1e-5
    )


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_no_geometry_is_the_sky(preset: str) -> None:
    frame = rendered(scene(sky=(0.1, 0.2, 0.3), lights=(point_light((1, 2, 1)),)), preset=preset)
    check(frame, SIZE, (0.1, 0.2, 0.3))
    assert np.isinf(frame.depth).all() and frame.stats["records"] == 0 and frame.stats["converged"]


def test_black_and_white_surfaces() -> None:
    """Black reflects no light but has an irradiance; white reflects all. A quad of each under a uniform sky: E = π·L."""
    black = quad((-2, 0, -2), (2, 0, 0), (0, 0, 4), material(0.0))
    white = quad((0, 0, -2), (2, 0, 0), (0, 0, 4), material(1.0))
    frame = rendered(scene(black, white, sky=2.0), gather_size=16)
    check(frame, SIZE, (2.0, 2.0, 2.0))
    seen = np.isfinite(frame.depth)
    assert np.allclose(frame.irradiance[seen], 2.0 * np.pi, rtol=0.01)
    assert not frame.image[seen & (frame.albedo[..., 0] == 0.0)].any()
    assert np.allclose(frame.image[seen & (frame.albedo[..., 0] == 1.0)], 2.0, rtol=0.01)


def test_a_camera_inside_a_wall_sees_black() -> None:
    """Inside a solid the picture is black, and all buffers are valid."""
    solid = box((-1, -1, -1), (1, 1, 1), material(0.9))
    world = scene(solid, lights=(point_light((0, 5, 0)),), sky=1.0)
    frame = rendered(world, camera=Camera((0, 0, 0.2), (0, 0, -1)), shadow_size=1024)  # finer: a wall is steep towards the light
    check(frame, SIZE, (1.0, 1.0, 1.0))
    assert not frame.direct.any() and np.isfinite(frame.depth).all()
    assert frame.image.max() < 1e-3, "of a sky of 1 outside; at the edges the records' own shadow samples see a little"


@pytest.mark.parametrize("offset", [0.0, 1e-7])
def test_a_camera_in_a_surface_is_no_trouble(offset: float) -> None:
    camera = Camera((0.0, offset, 0.5), (0.0, offset, 0.0), fov=60.0)
    world = scene(floor(2.0), box((-0.5, -0.5, -1), (0.5, 0.5, -0.5)), sky=1.0)
    check(rendered(world, camera=camera), SIZE, (1.0, 1.0, 1.0))


def test_zero_bounces_is_direct_light_alone() -> None:
    frame = rendered(room(), bounces=0)
    check(frame, SIZE, (0.0, 0.0, 0.0))
    assert not frame.irradiance.any() and not frame.indirect.any() and frame.stats["records"] == 0 and frame.stats["converged"]
    assert np.allclose(frame.image, frame.direct + frame.emission, rtol=1e-6)


@pytest.mark.parametrize(("blend", "weights"), [(0.0, (1.0, 0.0)), (0.8, (0.4, 1.0))])
def test_blend_weighs_direct_against_indirect(blend: float, weights: tuple[float, float]) -> None:
    """The weights are min(1, 2(1-b)) and min(1, 2b); irradiance, indirect and direct do not change."""
    frame = rendered(room(), blend=blend)
    truth = weights[0] * frame.direct + weights[1] * frame.indirect + frame.emission
    assert np.allclose(frame.image, truth, rtol=1e-4, atol=1e-6)


def test_exposure_is_a_number_or_found() -> None:
    """Walls of ρ = 0.8 have values between 176 and 201 of 255, as white rooms in Mitsuba's pictures; black ones are dark."""
    for rho, least, most in ((0.8, 176, 201), (0.03, 30, 60)):
        walls = box((-1, -1, -1), (1, 1, 1), material(rho), outward=False)
        picture = rendered(scene(walls, lights=(point_light((0.2, 0.3, 0.9)),), camera=FRONT)).picture
        assert least < 255.0 * np.median(picture) < most
    assert rendered(room(), exposure=-2.5).stats["exposure"] == -2.5
    assert rendered(scene(floor(), lights=(point_light((0, -1, 0)),))).stats["exposure"] == 0.0, "a black picture has none"


@pytest.mark.parametrize("side", [4, 128])
def test_every_gather_size_in_range_gathers(side: int) -> None:
    """In a furnace E = π·L_e at any resolution; odd sizes are rounded."""
    world = scene(box((-1, -1, -1), (1, 1, 1), material(0.5, 2.0), outward=False), camera=FRONT)
    frame = rendered(world, (12, 10), gather_size=side)
    assert np.allclose(frame.irradiance, 2.0 * np.pi, rtol=0.02)


# ---- convergence ------------------------------------------------------------------------------------------------------


def unserved(frame: Frame) -> int:
    """Return the number of surface pixels with Σw below the threshold 1/a, or below the given tolerance."""
    settings: Any = frame.stats["settings"]
    least = 1.0 / settings["a"] if settings["tolerance"] == "auto" else settings["tolerance"]
    return int((np.isfinite(frame.depth) & (frame.weight < least * (1 - 1e-5))).sum())


@pytest.mark.parametrize("settings", [{"a": 0.2}, {"tolerance": 9.0}, {"preset": "paper"}])
def test_converged_means_that_records_cover_every_pixel(settings: dict[str, Any]) -> None:
    frame = rendered(room(), warmup=50, **settings)
    assert frame.stats["converged"] and frame.stats["coverage"] == 1.0
    assert unserved(frame) == 0


@pytest.mark.parametrize(("size", "at"), [((400, 400), (-0.6, 0.5)), ((40, 40), (0.45, -0.6))])
def test_a_small_object_is_covered_in_every_view(size: tuple[int, int], at: tuple[float, float]) -> None:
    """Rounds alternate between the colours of a chess board: one round without a request does not end the render."""
    thing = quad((at[0], at[1], 0), (0.16, 0, 0), (0, 0.16, 0), material(0.5, 0.1))
    frame = rendered(scene(thing, sky=1.0), size, Camera((0, 0, 2), (0, 0, 0)))
    assert frame.stats["converged"] and frame.stats["records"] > 0
    assert unserved(frame) == 0


def test_the_last_round_stops_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_renders, "MOST_ROUNDS", 1)
    frame = rendered(room())
    assert frame.stats["rounds"] == 1 and not frame.stats["converged"]
    assert frame.stats["records"] == len(frame.records_radius) > 0
    assert (frame.weight > 0.0).any(), "what the last round gathered is in the picture"


def test_progress_tells_each_round() -> None:
    with Renderer(room(), SIZE, **FAST) as fresh:
        told: list[Any] = []
        frame = fresh.render(progress=told.append)
    assert [p.round for p in told] == list(range(1, frame.stats["rounds"] + 1))
    assert [p.records for p in told] == list(np.cumsum([p.new for p in told]))
    assert told[0].coverage == 0.0 and told[-1].coverage == 1.0 and told[-1].new == 0
    assert told[-1].records == frame.stats["records"]


def test_ctrl_c_yields_the_last_whole_round() -> None:
    """An interruption in the second round yields the picture of the previous rounds; the renderer then continues normally."""

    def interrupt(progress: Any) -> None:
        if progress.round == 2:
            raise KeyboardInterrupt

    with Renderer(room(), SIZE, **FAST) as one:
        broken = one.render(progress=interrupt)
        whole = one.render()
    assert not broken.stats["converged"] and 0 < broken.stats["records"] <= whole.stats["records"]
    check(broken, SIZE, (0.0, 0.0, 0.0))
    assert whole.stats["converged"] and unserved(whole) == 0


def test_a_wrong_size_or_setting_is_an_input_error() -> None:
    for size in ((0, 5), (5, -1), (10**6, 5), "small"):
        with pytest.raises(irrsplat.InputError):
            Renderer(room(), size, tile_size=0, **FAST).release()  # type: ignore[arg-type]
    with pytest.raises(irrsplat.InputError):
        Renderer(room(), SIZE, softness=1.0)  # type: ignore[call-arg]
    for names in ("image", 5):
        with pytest.raises(irrsplat.InputError, match="a sequence of names"):
            check_names(names)  # type: ignore[arg-type]
    with Renderer(room(), SIZE, **FAST) as renderer:
        for call in ("stops", "direct_irradiance", "draw_gbuffer"):
            with pytest.raises(irrsplat.InputError, match="not NoneType"):
                getattr(renderer, call)(None)
        with pytest.raises(irrsplat.InputError, match="progress is a function"):
            renderer.render(progress=5)  # type: ignore[arg-type]


def test_a_view_is_shown_in_a_framebuffer_of_its_size_alone(ctx: moderngl.Context) -> None:
    """A higher exposure is brighter; a framebuffer of another size is refused."""
    with Renderer(room(), (32, 24), ctx=ctx, **FAST) as renderer, Target(ctx, (32, 24), (4,)) as target:
        view, shown = renderer.frame()[0], []
        for stops in (None, renderer.stops(view) + 1.0):
            renderer.show(view, target.gl, stops)
            shown.append(target.read()[..., :3].mean())
        assert shown[1] > 1.1 * shown[0] > 0.0
        renderer.resize((16, 24))
        with pytest.raises(InputError, match="resize the renderer"):
            renderer.show(renderer.frame()[0], target.gl)
