"""Each buffer in the viewer, compared with its picture by numpy; values and records under the cursor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.buffers.shown_buffer import clear
from irrsplat.app.viewer.buffers.table import BUFFERS, weight_range
from irrsplat.app.viewer.show.record_inspector import RecordInspector
from irrsplat.core.buffers import CHANNELS
from irrsplat.core.color import photometric
from irrsplat.gpu.target import Target
from irrsplat.image.tonemap import show, tonemap, viridis
from irrsplat.meter.light_scale import LightScale, false_colours
from irrsplat.records.weight import reach, weights
from irrsplat.scene.model import Light
from irrsplat.sky.environment import Environment
from tests.support import worlds
from tests.support.viewing import ShownView, shown_view
from tests.support.worlds import shared

SIZE = (97, 61)
UNTOUCHED = (0.25, 0.5, 0.75)


@pytest.fixture(scope="module")
def shared_cornell() -> Iterator[ShownView]:
    """Provide the Cornell box after two rounds of gathering; some pixels still lack records."""
    with shared():
        made = shown_view(irrsplat.load("cornell"))
    yield made
    with shared():
        made.release()


@pytest.fixture
def cornell(shared_cornell: ShownView) -> Iterator[ShownView]:
    """Provide the shared view with its context current; tests must not change the view."""
    with shared():
        yield shared_cornell


@pytest.fixture
def target(ctx: moderngl.Context) -> Iterator[Target]:
    """Provide a float target, without rounding, filled with a colour that no picture has."""
    target = Target(ctx, SIZE, (4,))
    clear(target, UNTOUCHED)
    yield target
    target.release()


@pytest.mark.parametrize("name", ["image", "direct", "indirect", "irradiance", "normal", "albedo"])
def test_buffers_are_shown_as_in_files(cornell: ShownView, target: Target, name: str) -> None:
    expected = show(name, getattr(cornell.frame, name), cornell.source.exposure, cornell.seen)
    assert expected.std() > 0.1, "there is something to see"
    assert np.abs(cornell.draw(target, name) - expected).max() < 1.0 / 255.0


def test_a_map_of_the_sky_is_in_the_image_and_in_the_emission_alone(ctx: moderngl.Context, target: Target) -> None:
    bright = np.full((16, 32, 3), (0.1, 0.5, 0.9), np.float32)
    with shown_view(replace(worlds.scene(worlds.floor(0.5)), environment=Environment(bright, bright), own_sky=True)) as made:
        assert 0.2 < (~made.seen).mean() < 0.95
        for name in set(BUFFERS) - {"reference", "error"}:
            picture = made.draw(target, name)[~made.seen]
            sky = tonemap(bright[0, 0], made.source.exposure) if name in ("image", "emission") else 0.0
            assert name not in CHANNELS or np.abs(picture - sky).max() < 1.0 / 255.0, name


def test_positions_and_depths_run_through_the_scene_s_bounds(cornell: ShownView, target: Target) -> None:
    """Colours of positions are linear within the bounds; the scale of depth spans the corners of the bounds."""
    (low, high), seen, camera = cornell.source.renderer.scene.bounds, cornell.seen, cornell.source.view.camera
    expected = (cornell.frame.position[seen] - low) / (high - low)
    assert np.abs(cornell.draw(target, "position")[seen] - expected).max() < 1e-3
    axis = np.subtract(camera.target, camera.eye) / np.linalg.norm(np.subtract(camera.target, camera.eye))
    along = (cornell.source.renderer.scene.corners - camera.eye) @ axis
    expected = viridis((cornell.frame.depth[seen] - along.min()) / (along.max() - along.min()))
    assert np.abs(cornell.draw(target, "depth")[seen] - expected).max() < 1.0 / 255.0


def test_the_contour_runs_between_pixels_on_different_sides(cornell: ShownView, target: Target) -> None:
    """The contour is white above the threshold and black below it, at pixels with a neighbour on the other side."""
    weight, threshold, seen = cornell.frame.weight, cornell.source.renderer.settings.threshold, cornell.seen
    below, line = weight < threshold, np.zeros(weight.shape, bool)
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
    low, high = weight_range(cornell.source.renderer.settings)
    scale = viridis(np.log(np.maximum(weight, low) / low) / np.log(high / low))
    rest = seen & ~line
    assert np.abs(picture[rest] - scale[rest]).max() < 1.0 / 255.0
    mark = BUFFERS["weight"].legend(cornell.source).mark
    assert mark is not None and low * (high / low) ** mark == pytest.approx(threshold), "the legend's mark is at the threshold"


def test_values_are_those_of_the_pixel_under_the_cursor(cornell: ShownView) -> None:
    """(0, 0) is the upper left pixel; without a surface only depth, image and alpha have values."""
    rng, seen = np.random.default_rng(3), cornell.seen
    places = [*rng.permutation(np.argwhere(seen))[:6], *rng.permutation(np.argwhere(~seen))[:2]]
    for name in CHANNELS.keys() & BUFFERS.keys():
        array = getattr(cornell.frame, name)
        for y, x in places:
            value = cornell.value(name, int(x), int(y))
            if not seen[y, x] and name not in ("image", "depth", "alpha"):
                assert value is None
            else:
                assert value is not None and value.shape == np.atleast_1d(array[y, x]).shape
                assert np.allclose(value, array[y, x], rtol=1e-6)
        assert cornell.value(name, SIZE[0], 0) is None and cornell.value(name, 0, -1) is None


def test_a_region_bounds_what_is_drawn_and_every_buffer_has_a_legend(cornell: ShownView, target: Target) -> None:
    """The pixels in the region are those of the whole picture; other pixels are unchanged."""
    x, y, width, height = region = (31, 7, 40, 33)
    inside = np.zeros((SIZE[1], SIZE[0]), bool)
    inside[SIZE[1] - y - height : SIZE[1] - y, x : x + width] = True
    for name, buffer in BUFFERS.items():
        clear(target, UNTOUCHED)
        part = cornell.draw(target, name, region=region).copy()
        whole = cornell.draw(target, name)
        assert (part[~inside] == np.array(UNTOUCHED, "f4")).all(), name
        assert np.array_equal(part[inside], whole[inside]), name
        assert not (whole == np.array(UNTOUCHED, "f4")).all(-1).any(), "without a region all of it is drawn"
        legend = buffer.legend(replace(cornell.source, exposure=2.34))
        assert legend.text and buffer.title and buffer.help
        assert ("+2.3 stops" in legend.text) == (name in ("image", "direct", "indirect", "irradiance", "emission", "atlas")), name


# ---- shadow maps -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["spot", "sun"])
def test_a_shadow_map_shows_distances_from_the_light(ctx: moderngl.Context, target: Target, kind: str) -> None:
    """A light straight above a floor has one distance to the floor, and a distance shorter by 1 to a box of height 1.

    The sun's tile covers all bodies except the floor; two posts make it wider. A spot at height 3 stores near/z, the sun
    stores z in a depth of 1.001 diagonals around the centre of the bounds.
    """
    posts = (worlds.box((x - 0.1, 0.0, x - 0.1), (x + 0.1, 1.0, x + 0.1)) for x in (-1.9, 1.9))
    bodies = worlds.floor(2.0), worlds.box((-0.3, 0.0, -0.3), (0.3, 1.0, 0.3)), *posts
    spot = worlds.point_light((0, 3, 0), spot_target=(0, 0, 0), spot_cutoff=40.0, spot_inner=40.0)
    light = spot if kind == "spot" else Light((0, 1, 0), (1, 1, 1), directional=True)
    with shown_view(worlds.scene(*bodies, lights=(light,)), rounds=1) as made:
        scene, shadows = made.source.renderer.scene, made.renderer.shadows
        assert shadows is not None
        thick = 1.001 * scene.diagonal if kind == "sun" else shadows.layout[2]
        top = 2.0 if kind == "spot" else thick / 2 - 0.5  # the middle of the bounds is at height ½
        picture = made.draw(target, "shadow")
        centre = picture[SIZE[1] // 2, SIZE[0] // 2]
        beside = picture[SIZE[1] // 2, SIZE[0] // 2 + 12]  # the floor, inside the tile and outside the box
        assert np.abs(centre - viridis(np.array(top / thick))).max() < 0.02
        assert np.abs(beside - viridis(np.array((top + 1.0) / thick))).max() < 0.02


# ---- light in false colours --------------------------------------------------------------------------------------------


def lux_of(shown: ShownView) -> np.ndarray:
    """Return lux (H, W) from the frame: indirect irradiance, and π/ρ times the direct radiance; no surface has ρ = 0."""
    albedo = np.where(shown.seen[..., None], shown.frame.albedo, 1.0)
    return photometric((shown.frame.irradiance + np.pi / albedo * shown.frame.direct).astype(float))


def scaled(shown: ShownView, **scale: object) -> ShownView:
    """Return the view with another scale of light, by default up to 1000 lux without lines."""
    light_scale = LightScale(**{"highest": 1000.0, "lines": False, **scale})  # type: ignore[arg-type]
    return replace(shown, source=replace(shown.source, light_scale=light_scale))


def test_light_in_false_colours(cornell: ShownView, target: Target) -> None:
    """A pixel's colour is that of its direct and indirect light on a scale up to 1000 lux."""
    light, seen = lux_of(cornell), cornell.seen
    colours = false_colours()
    at = np.clip(light / 1000.0, 0.0, 1.0) * (len(colours) - 1)
    expected = np.stack([np.interp(at, np.arange(len(colours)), channel) for channel in colours.T], -1)
    picture = scaled(cornell).draw(target, "light")
    assert expected[seen].std() > 0.1, "there is something to see"
    assert np.abs(picture - expected)[seen].max() < 0.02


def test_the_light_under_the_cursor_is_in_lux(cornell: ShownView) -> None:
    for y, x in ((30, 48), (45, 30), (20, 60)):
        assert scaled(cornell).value("light", x, y) == pytest.approx([lux_of(cornell)[y, x]], rel=1e-3)
    legend = BUFFERS["light"].legend(scaled(cornell, highest=5.0, lines=True).source)
    assert (legend.low, legend.high, legend.unit) == ("0", "5", "lux") and legend.text == "a line every 0.5 lux"


# ---- the record under the cursor ---------------------------------------------------------------------------------------


def test_weights_of_records_add_up_and_the_greatest_is_picked(cornell: ShownView) -> None:
    """The weights of all records at a pixel add up to Σw of the splat buffer, except for rounding at the rims of records."""
    renderer, view, frame = cornell.renderer, cornell.source.view, cornell.frame
    inspector, sums, found = RecordInspector(cornell.programs), [], []
    columns, floor = inspector.columns(cornell.source), renderer.cache.records.luminance_floor
    radii = reach(columns, floor, view.camera, renderer.size, renderer.settings)
    for y, x in np.random.default_rng(6).permutation(np.argwhere(np.isfinite(frame.depth)))[:120]:
        w = weights(columns, radii, frame.position[y, x], frame.normal[y, x], renderer.settings)
        sums.append(w.sum())
        found.append(frame.weight[y, x])
        picked = inspector.pick(cornell.source, int(x), int(y))
        assert picked == (int(np.argmax(w)) if w.any() else None)
    assert np.isclose(sums, found, rtol=2e-3).mean() > 0.95
    assert 0.4 < np.mean(np.array(found) > 0.0) < 1.0


def test_a_record_under_a_sky_sees_one_radiance(ctx: moderngl.Context) -> None:
    """The sky over a floor emits L in all directions: each texel of a record's hemisphere is the tone-mapped L."""
    L = (0.9, 0.3, 0.1)
    with (
        shown_view(worlds.scene(worlds.floor(), sky=L), rounds=1, placement="tiles") as made,
        RecordInspector(made.programs) as inspector,
    ):
        texture = inspector.hemisphere(3, replace(made.source, exposure=-1.0))
        assert texture is not None
        picture = np.frombuffer(texture.read(), "u1").reshape(texture.height, texture.width, 4)[..., :3] / 255.0
        assert np.abs(picture - tonemap(np.array(L), -1.0)).max() <= 0.51 / 255.0
