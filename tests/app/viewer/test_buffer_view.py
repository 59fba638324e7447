"""Every buffer on the screen, against what display.py makes of the same numbers, and the numbers under the cursor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat.app.viewer.buffers.gather_atlas import draw_atlas
from irrsplat.app.viewer.buffers.shadow_maps import shadow_range
from irrsplat.app.viewer.buffers.table import BUFFERS
from irrsplat.app.viewer.buffers.texture_buffers import depth_range
from irrsplat.app.viewer.buffers.weight import weight_range
from irrsplat.app.viewer.show.light.brightest import BrightestLight
from irrsplat.app.viewer.show.screen import Screen, clear
from irrsplat.core.buffers import CHANNELS, Atlas
from irrsplat.core.color import photometric
from irrsplat.gpu.target import Target, pixels, table_texture
from irrsplat.image.output.false_colours import coloured
from irrsplat.image.tonemap import show, tonemap, viridis
from irrsplat.meter.light_scale import STEPS, LightScale, false_colours, round_above
from irrsplat.scene.model import Light
from irrsplat.sky.environment import Environment
from tests.support import worlds
from tests.support.viewing import ShownView, shown_view

SIZE = (97, 61)
UNTOUCHED = (0.25, 0.5, 0.75)


TRUTHS = [name for name, buffer in BUFFERS.items() if buffer.needs_truth]


@pytest.fixture
def target(ctx: moderngl.Context) -> Iterator[Target]:
    """A float target, so that nothing is rounded; no picture has its colour."""
    target = Target(ctx, SIZE, (4,))
    clear(target, UNTOUCHED)
    yield target
    target.release()


def test_the_table_is_the_channels_and_seven_more() -> None:
    assert set(BUFFERS) == {*CHANNELS, "asking", "shadow", "atlas", "light", "surface", *TRUTHS}
    first = ["image", "direct", "indirect", "irradiance", "weight", "position", "normal", "albedo", "depth"]
    assert list(BUFFERS)[:9] == first, "the keys 1 to 9"
    assert all(s.title and s.help for s in BUFFERS.values())


@pytest.mark.parametrize("name", ["image", "direct", "indirect", "irradiance", "emission", "normal", "albedo"])
def test_buffers_are_shown_as_in_files(cornell: ShownView, target: Target, name: str) -> None:
    picture = cornell.draw(target, name)
    expected = show(name, getattr(cornell.frame, name), cornell.source.exposure, cornell.seen)
    if name != "emission":  # this box emits nothing
        assert expected.std() > 0.1, "there is something to see"
    assert np.abs(picture - expected).max() < 1.0 / 255.0


def test_the_sky_is_in_the_image_and_in_the_emission_alone(ctx: moderngl.Context, target: Target) -> None:
    with shown_view(worlds.scene(worlds.floor(0.5), lights=(worlds.lamp((0, 2, 0)),), sky=(0.2, 0.5, 0.8))) as made:
        unseen = ~made.seen
        assert 0.2 < unseen.mean() < 0.95
        for name in CHANNELS:
            sky = tonemap(np.array([0.2, 0.5, 0.8]), made.source.exposure)
            expected = sky if name in ("image", "emission") else 0.0
            assert np.abs(made.draw(target, name)[unseen] - expected).max() < 1.0 / 255.0, name


def test_every_buffer_is_shown_under_a_map_of_the_sky(ctx: moderngl.Context, target: Target) -> None:
    """Where nothing stands the emission is the map's; the same programs go on where there is none."""
    bright = np.full((16, 32, 3), (0.1, 0.5, 0.9), np.float32)
    world = replace(worlds.scene(worlds.floor()), environment=Environment(bright, bright), own_sky=True)
    with shown_view(world) as made:
        for name in set(BUFFERS) - set(TRUTHS):
            made.draw(target, name)
        sky = made.draw(target, "emission")[~made.seen]
        assert len(sky) and np.abs(sky - tonemap(bright[0, 0], made.source.exposure)).max() < 1.0 / 255.0


def test_positions_run_through_the_scene_s_bounds(cornell: ShownView, target: Target) -> None:
    low, high = cornell.source.scene.bounds
    seen = cornell.seen
    expected = (cornell.frame.position[seen] - low) / (high - low)
    assert np.abs(cornell.draw(target, "position")[seen] - expected).max() < 1e-3


def test_depth_runs_through_what_the_camera_can_see(cornell: ShownView, target: Target) -> None:
    """The legend's ends are the nearest and farthest corner of the bounds, along the axis from eye to target."""
    camera, depth = cornell.source.view.camera, cornell.frame.depth
    axis = np.subtract(camera.target, camera.eye) / np.linalg.norm(np.subtract(camera.target, camera.eye))
    along = (cornell.source.scene.corners - camera.eye) @ axis
    assert depth_range(cornell.source.scene, camera) == pytest.approx((along.min(), along.max()))
    seen = np.isfinite(depth)
    expected = viridis((depth[seen] - along.min()) / (along.max() - along.min()))
    assert np.abs(cornell.draw(target, "depth")[seen] - expected).max() < 1.0 / 255.0


def test_the_contour_runs_between_pixels_on_different_sides(cornell: ShownView, target: Target) -> None:
    """White where a pixel has enough and one of its four neighbours has not, black on that other side, the scale elsewhere."""
    weight, threshold = cornell.frame.weight, cornell.source.settings.threshold
    seen = cornell.seen
    below = weight < threshold
    line = np.zeros(weight.shape, bool)
    for axis in (0, 1):
        one, other = slice(None, -1), slice(1, None)
        a, b = ((..., one), (..., other)) if axis else ((one,), (other,))
        pad = [(0, 0), (0, 0)]
        pad[axis] = (0, 1)
        differ = (below[a] != below[b]) & seen[a] & seen[b]
        line |= np.pad(differ, pad) | np.pad(differ, [p[::-1] for p in pad])
    assert line.sum() > 50
    picture = cornell.draw(target, "weight")
    assert (picture[line] == np.where(below[line], 0.0, 1.0)[:, None]).all()
    low, high = weight_range(cornell.source.settings)
    scale = viridis(np.log(np.maximum(weight, low) / low) / np.log(high / low))
    rest = seen & ~line
    assert np.abs(picture[rest] - scale[rest]).max() < 1.0 / 255.0
    assert not ((picture == 1.0).all(-1) | (picture == 0.0).all(-1))[rest].any(), "no line anywhere else"


def test_a_silhouette_is_no_contour(ctx: moderngl.Context, target: Target) -> None:
    """Before anything is splatted every pixel of the surface is below the threshold, and there is no other side to it."""
    with shown_view(worlds.scene(worlds.floor(1.0)), bounces=0) as made:
        picture, seen = made.draw(target, "weight"), made.seen
    expected = np.where(seen[..., None], viridis(np.zeros(seen.shape)), 0.0)
    assert 0.1 < seen.mean() < 0.9 and np.abs(picture - expected).max() < 1.0 / 255.0


def test_asking_marks_exactly_the_pixels_that_ask(cornell: ShownView, target: Target) -> None:
    """The rest is grey: only what asks has a colour, of too little weight or of records that contradict each other."""
    settings, splats = cornell.source.settings, cornell.source.view.splats
    weight, squares = np.moveaxis(pixels(splats.weight)[..., :2].astype(float), -1, 0)
    sums = pixels(splats.sums).astype(float)
    k = np.maximum(sums[..., 3], 1e-20)
    mean = sums[..., :3] @ (0.2126, 0.7152, 0.0722) / k
    floor = splats.luminance_floor
    contradict = np.sqrt(np.maximum(squares / k - mean**2, 0.0)) > settings.spread * worlds.error_scale(mean, floor)
    few = weight < settings.threshold
    asks = (few | (contradict & (weight < 3.0 * settings.threshold))) & cornell.seen
    assert (asks & ~few).any() and (asks & few).any()
    picture = cornell.draw(target, "asking")
    coloured = np.ptp(picture, axis=-1) > 0.1
    assert np.array_equal(coloured, asks)
    assert picture[~asks].max() < 0.5, "the picture behind is dim"


@pytest.mark.parametrize("name", [*CHANNELS, "asking"])
def test_values_are_those_of_the_pixel_under_the_cursor(cornell: ShownView, ctx: moderngl.Context, name: str) -> None:
    """(0, 0) is the upper left pixel; nothing is a number where nothing is seen, but depth, image, alpha and opacity."""
    frame = cornell.frame
    array = frame.weight if name == "asking" else getattr(frame, name)
    seen = cornell.seen
    rng = np.random.default_rng(3)
    for y, x in [*rng.permutation(np.argwhere(seen))[:12], *rng.permutation(np.argwhere(~seen))[:3]]:
        value = cornell.value(name, int(x), int(y))
        if not seen[y, x] and name not in ("image", "depth", "alpha", "opacity"):
            assert value is None
        else:
            assert value is not None and value.shape == np.atleast_1d(array[y, x]).shape
            assert np.allclose(value, array[y, x], rtol=1e-6)
    assert cornell.value(name, SIZE[0], 0) is None and cornell.value(name, 0, -1) is None


@pytest.mark.parametrize("name", BUFFERS)
def test_a_region_bounds_what_is_drawn(cornell: ShownView, target: Target, name: str) -> None:
    """And inside of it lies what lies there without it."""
    x, y, width, height = region = (31, 7, 40, 33)
    part = cornell.draw(target, name, region=region).copy()
    whole = cornell.draw(target, name)
    inside = np.zeros((SIZE[1], SIZE[0]), bool)
    inside[SIZE[1] - y - height : SIZE[1] - y, x : x + width] = True
    assert (part[~inside] == np.array(UNTOUCHED, "f4")).all()
    assert np.array_equal(part[inside], whole[inside])
    assert not (whole == np.array(UNTOUCHED, "f4")).all(-1).any(), "without a region all of it is drawn"


def test_a_window_s_framebuffer_is_a_target(cornell: ShownView, ctx: moderngl.Context, target: Target) -> None:
    texture = ctx.texture(SIZE, 4)
    framebuffer = ctx.framebuffer([texture])
    screen = Screen(framebuffer)
    assert screen.size == SIZE
    clear(screen, (0.0, 0.0, 0.0))
    cornell.buffer_view.draw(screen, "normal", cornell.source)
    found = np.frombuffer(texture.read(), "u1").reshape(SIZE[1], SIZE[0], 4)[::-1, :, :3] / 255.0
    assert np.abs(found - cornell.draw(target, "normal")).max() <= 0.51 / 255.0
    screen.release()
    assert framebuffer.read(viewport=(0, 0, 1, 1)), "it is not the screen's to free"
    ctx.detect_framebuffer(0).use()
    framebuffer.release()


def test_a_larger_target_shows_each_pixel_larger(cornell: ShownView, ctx: moderngl.Context, target: Target) -> None:
    large = Target(ctx, (2 * SIZE[0], 2 * SIZE[1]), (4,))
    for name in ("image", "weight"):
        twice = cornell.draw(large, name)
        assert np.array_equal(twice, cornell.draw(target, name).repeat(2, 0).repeat(2, 1))
    large.release()


# ---- shadow maps and the atlas ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["spot", "sun"])
def test_a_shadow_map_shows_distances_from_the_light(ctx: moderngl.Context, target: Target, kind: str) -> None:
    """Straight above a floor: its tile sees the floor at one distance, a box's top of height 1 nearer by 1.

    A spot at height 3 stores near/z, the sun z in a depth of 1.001 diagonals about the middle of the bounds.
    """
    bodies = worlds.floor(2.0), worlds.box((-0.3, 0.0, -0.3), (0.3, 1.0, 0.3))
    spot = worlds.lamp((0, 3, 0), spot_target=(0, 0, 0), spot_cutoff=40.0, spot_inner=40.0)
    light = spot if kind == "spot" else Light((0, 1, 0), (1, 1, 1), directional=True)
    made = shown_view(worlds.scene(*bodies, lights=(light,)), rounds=1)
    scene, shadows = made.source.scene, made.renderer.shadows
    assert shadows is not None
    low, high = shadow_range(scene, shadows)
    thick = 1.001 * scene.diagonal
    top = 2.0 if kind == "spot" else thick / 2 - 0.5  # the middle of the bounds is at height ½
    expected = [(low, high), (2.0, 3.0) if kind == "spot" else (0.0, thick)]
    assert expected[0] == pytest.approx(expected[1])
    picture = made.draw(target, "shadow")
    centre = picture[SIZE[1] // 2, SIZE[0] // 2]
    beside = picture[SIZE[1] // 2, SIZE[0] // 2 + 12]  # the floor, inside the tile and outside the box
    assert np.abs(centre - viridis(np.array((top - low) / (high - low)))).max() < 0.02
    assert np.abs(beside - viridis(np.array((top + 1.0 - low) / (high - low)))).max() < 0.02
    text = BUFFERS["shadow"].legend(made.source)
    assert (float(text.low), float(text.high)) == pytest.approx((low, high), rel=0.01) and text.unit == "m"
    made.release()


def test_without_lights_batches_and_bounces_there_is_only_ground(ctx: moderngl.Context, target: Target) -> None:
    with shown_view(worlds.scene(worlds.floor(), sky=1.0), rounds=1, bounces=0) as made:
        for name in ("shadow", "atlas", "surface"):
            clear(target, UNTOUCHED)
            picture = made.draw(target, name)
            assert (picture == picture[0, 0]).all() and picture[0, 0, 0] != UNTOUCHED[0], name
        assert "no light" in BUFFERS["shadow"].legend(made.source).text


def test_the_atlas_shows_its_cells_from_the_upper_left(cornell: ShownView, ctx: moderngl.Context) -> None:
    """Three cells of 4x3 texels, two in an atlas row, in a target with room for just 3x1 of ten times that, 2 pixels apart."""
    radiance = np.zeros((6, 8, 4))
    for i, (x, y) in enumerate([(0, 0), (4, 0), (0, 3)]):
        radiance[y : y + 3, x : x + 4] = [*np.eye(3)[i], 1.0]
        radiance[y + 2, x : x + 4] = 0.5  # its upper row
        radiance[y, x] = 0.0  # one texel hits nothing
    sky = (0.25, 0.5, 1.0)
    table = table_texture(ctx, radiance)
    frames = table_texture(ctx, np.tile(np.eye(4, 4)[:, None], (1, 3, 1)))
    directions = table_texture(ctx, np.tile([0.6, 0.0, 0.8, 1.0], (3, 4, 1)))
    atlas = Atlas(table, None, directions, None, frames, 3, 2, (4, 3), (1, 1))  # type: ignore[arg-type]  # planes and edges
    target = Target(ctx, (124, 30), (4,))
    above = {"sky": (0.25, 0.5, 0.6), "sky_gradient": (0.0, 0.0, 0.5), "sky_up": (0.0, 0.0, 1.0)}  # 0.8 of it adds 0.4
    draw_atlas(cornell.buffer_view.canvas(target), atlas, 2.0, above)
    picture = target.read()[..., :3]
    for i in range(3):
        x = i * 42
        assert np.allclose(picture[14, x + 15], tonemap(np.eye(3)[i], 1.0), atol=1 / 255)
        assert np.allclose(picture[:10, x : x + 40], tonemap(np.full(3, 0.5), 1.0), atol=1 / 255), "upper row up"
        assert np.allclose(picture[-10:, x : x + 10], tonemap(np.array(sky), 1.0), atol=1 / 255), "the sky where nothing is hit"
        assert np.allclose(picture[10:20, x : x + 40], picture[14, x + 15], atol=1 / 255), "the whole row is the cell's"
    assert (picture[:, 40:42] == picture[0, 40]).all() and picture[0, 40, 0] < 0.2, "ground between the cells"
    target.release()
    for texture in (table, frames, directions):
        texture.release()


# ---- legends ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BUFFERS)
def test_every_buffer_has_a_legend(cornell: ShownView, name: str) -> None:
    made = BUFFERS[name].legend(replace(cornell.source, exposure=2.34))
    assert made.text
    assert (made.colours is None) or made.colours.shape[1:] == (3,)
    if name in ("image", "direct", "indirect", "irradiance", "emission", "atlas"):
        assert "+2.3 stops" in made.text and made.unit in made.text


@pytest.mark.parametrize("tolerance", ["auto", 0.01, 3.0, 1e5, 0.0])
def test_the_threshold_has_its_place_on_the_scale_of_weights(cornell: ShownView, tolerance: object) -> None:
    """On a logarithmic scale from low to high the mark is at threshold = low·(high/low)^mark; a threshold of 0 has no place."""
    renderer, before = cornell.renderer, cornell.renderer.settings
    renderer.change(before.with_values({"tolerance": tolerance}))
    settings, made = renderer.settings, BUFFERS["weight"].legend(cornell.source)
    renderer.change(before)
    low, high = weight_range(settings)
    assert low < high and (float(made.low), float(made.high)) == pytest.approx((low, high), rel=0.01)
    if tolerance == 0.0:
        assert made.mark is None
    else:
        assert made.mark is not None and 0.0 < made.mark < 1.0
        assert low * (high / low) ** made.mark == pytest.approx(settings.threshold)


# ---- light in false colours --------------------------------------------------------------------------------------------


def lux_of(shown: ShownView) -> np.ndarray:
    """(H, W) lux by the frame's buffers: irradiance, and π/ρ times the direct radiance. No surface of the box is black."""
    albedo = np.where(shown.seen[..., None], shown.frame.albedo, 1.0)
    return photometric((shown.frame.irradiance + np.pi / albedo * shown.frame.direct).astype(float))


def scaled(shown: ShownView, **scale: object) -> ShownView:
    """The same with another scale of light, up to 1000 lux without lines."""
    light_scale = LightScale(**{"highest": 1000.0, "lines": False, **scale})  # type: ignore[arg-type]
    return replace(shown, source=replace(shown.source, light_scale=light_scale))


@pytest.mark.parametrize("logarithmic", [False, True])
def test_light_in_false_colours(cornell: ShownView, target: Target, logarithmic: bool) -> None:
    """The colour at light/1000 lux, or at 1 + log₁₀(light/1000)/2 on two decades; a pixel's light is that of both kinds."""
    light, seen = lux_of(cornell), cornell.seen
    t = 1.0 + np.log10(np.maximum(light, 1e-9) / 1000.0) / 2.0 if logarithmic else light / 1000.0
    colours = false_colours()
    at = np.clip(t, 0.0, 1.0) * (len(colours) - 1)
    expected = np.stack([np.interp(at, np.arange(len(colours)), channel) for channel in colours.T], -1)
    picture = scaled(cornell, logarithmic=logarithmic).draw(target, "light")
    assert expected[seen].std() > 0.1, "there is something to see"
    assert np.abs(picture - expected)[seen].max() < 0.02


def test_isolines_run_between_the_steps(cornell: ShownView, target: Target) -> None:
    """A pixel is dark where the one to its right or the one above it lies in another step, on the same surface."""
    plain, lined = scaled(cornell).draw(target, "light"), scaled(cornell, lines=True).draw(target, "light")
    step = np.minimum(np.floor(lux_of(cornell) / 1000.0 * STEPS), STEPS - 1)
    depth = np.where(cornell.seen, cornell.frame.depth, -1e9)
    line = np.zeros(step.shape, bool)
    for axis, shift in ((1, -1), (0, 1)):
        other, there = np.roll(step, shift, axis), np.abs(np.roll(depth, shift, axis) - depth) < 0.02 * depth
        line |= there & (other != step)
    inner = np.zeros(step.shape, bool)
    inner[1:, :-1] = cornell.seen[1:, :-1]
    dark = (lined < 0.99 * plain).any(-1)
    assert 0.01 < line[inner].mean() < 0.5
    assert (dark != line)[inner].mean() < 2e-3, "but for light that rounding puts into the other step"
    alone = coloured(lux_of(cornell), np.where(cornell.seen, cornell.frame.depth, np.inf), LightScale(highest=1000.0))
    same = np.abs(alone - lined).max(-1) < 0.02
    assert same[inner | ~cornell.seen].mean() > 0.998, "as the command line has it"


def test_the_light_under_the_cursor_is_in_the_unit_of_the_scale(cornell: ShownView) -> None:
    light = lux_of(cornell)
    for y, x in ((30, 48), (45, 30), (20, 60)):
        found = [scaled(cornell, unit=unit).value("light", x, y) for unit in ("lux", "W/m2")]
        assert found[0] == pytest.approx([light[y, x]], rel=1e-3)
        assert found[1] == pytest.approx([light[y, x] / 179.0], rel=1e-3)
    legend = BUFFERS["light"].legend(scaled(cornell, unit="W/m2", highest=5.0, logarithmic=True, lines=True).source)
    assert (legend.low, legend.high, legend.unit) == ("0.05", "5", "W/m²") and "5 lines a decade" in legend.text
    legend = BUFFERS["light"].legend(scaled(cornell, lines=True).source)
    assert (legend.low, legend.high, legend.unit) == ("0", "1000", "lux") and "a line every 100 lux" in legend.text


def test_the_scale_ends_by_itself_above_nearly_all_that_is_seen(cornell: ShownView) -> None:
    assert [round_above(x) for x in (0.0, 0.3, 1.0, 1.1, 4.99, 5.0, 700.0)] == pytest.approx(
        [1.0, 0.5, 1.0, 2.0, 5.0, 5.0, 1000.0]
    )
    assert LightScale().up_to(3.0).ends == (0.0, 1000.0), "537 lux"
    assert LightScale("W/m2", logarithmic=True, decades=3).up_to(3.0).ends == pytest.approx((0.005, 5.0))
    assert LightScale(highest=300.0).up_to(3.0).ends == (0.0, 300.0)
    with BrightestLight(cornell.renderer.ctx) as meter:
        meter.look(cornell.renderer, cornell.source.view)
        found = 179.0 * meter.found
    assert found == pytest.approx(np.percentile(lux_of(cornell)[cornell.seen], 99.0), rel=0.05)


def test_light_is_there_where_nothing_is_reflected(ctx: moderngl.Context) -> None:
    """I·cosθ/d² below a lamp on a black floor, which the buffer `direct` shows nothing of; the headlamp is none of it."""
    lit = worlds.scene(worlds.floor(2.0, paint=worlds.material(0.0)), lights=(worlds.lamp((0, 2, 0), 10.0),))
    with shown_view(lit) as made:
        made.renderer.carry_headlamp(50.0)
        x, y = 48, 30
        place = made.frame.position[y, x]
        way = np.array([0.0, 2.0, 0.0]) - place
        expected = 179.0 * 10.0 * way[1] / np.linalg.norm(way) ** 3
        assert scaled(made).value("light", x, y) == pytest.approx([expected], rel=1e-3)
        assert not made.frame.direct[y, x].any()
