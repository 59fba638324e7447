"""The record under the cursor: the weights on the CPU against the GPU's, what is said of it, and what it sees."""

from __future__ import annotations

import re
from dataclasses import replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.show.record_inspector import RecordInspector
from irrsplat.app.viewer.show.record_table import RecordTable, read
from irrsplat.app.viewer.show.screen import Texels
from irrsplat.gather.raster import RasterGather
from irrsplat.gpu import context
from irrsplat.image.tonemap import tonemap
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Scene
from tests.support import worlds
from tests.support.viewing import ShownView, shown_view

SIZE = (97, 61)
INSIDE = Camera((0.0, 0.3, 0.8), (0.0, -0.5, -0.5))


@pytest.fixture(scope="module")
def table(shared_cornell: ShownView) -> RecordTable:
    """The records of the Cornell box; all but those of the last round are splatted."""
    with context.shared():
        return read(shared_cornell.renderer.cache.records)


def test_the_table_is_the_cache(cornell: ShownView, table: RecordTable) -> None:
    renderer, frame = cornell.renderer, cornell.frame
    assert len(table) == renderer.cache.count == len(frame.records_radius)
    assert np.array_equal(table.position, frame.records_position) and np.array_equal(table.normal, frame.records_normal)
    assert np.array_equal(table.irradiance, frame.records_irradiance) and np.array_equal(table.radius, frame.records_radius)
    assert (table.slope() > 0.0).any() and np.isfinite(table.slope()).all()


def test_the_weights_add_up_to_what_was_splatted(cornell: ShownView, table: RecordTable) -> None:
    """Σw at a pixel is the sum over all records of what each weighs there: the splat buffer's, but for pixels at a rim."""
    renderer, view, frame = cornell.renderer, cornell.source.view, cornell.frame
    seen = np.argwhere(np.isfinite(frame.depth))
    sums, found = [], []
    for y, x in np.random.default_rng(6).permutation(seen)[:200]:
        sums.append(table.weights(frame.position[y, x], frame.normal[y, x], view.camera, renderer.size, renderer.settings).sum())
        found.append(frame.weight[y, x])
    same = np.isclose(sums, found, rtol=2e-3)
    assert same.mean() > 0.95
    assert np.mean(np.array(found) > 0.0) > 0.4 and not np.all(np.array(found) > 0.0)


def test_the_record_that_weighs_most_is_picked(cornell: ShownView, table: RecordTable) -> None:
    """None where nothing is seen, where no record speaks, and outside of the picture."""
    view, frame, texels = cornell.source.view, cornell.frame, cornell.buffer_view.texels
    settings, rng = cornell.source.settings, np.random.default_rng(7)
    served, lacking = (np.argwhere(np.isfinite(frame.depth) & m) for m in (frame.weight > 0.0, frame.weight == 0.0))
    for y, x in rng.permutation(served)[:40]:
        w = table.weights(frame.position[y, x], frame.normal[y, x], view.camera, cornell.renderer.size, settings)
        number = table.pick(texels, view, settings, int(x), int(y))
        assert number == int(np.argmax(w))
        apart, axis = frame.position[y, x] - table.position[number], table.axis[number]
        along, across = table.reach(view.camera, cornell.renderer.size, settings)[number]
        aside = apart - (apart @ axis) * axis
        assert (apart @ axis / along) ** 2 + (aside @ aside) / across**2 <= 1.0, "and the pixel lies within its ellipse"
    for y, x in [*rng.permutation(lacking)[:10], *np.argwhere(~np.isfinite(frame.depth))[:3]]:
        assert table.pick(texels, view, settings, int(x), int(y)) is None
    assert table.pick(texels, view, settings, -1, 0) is None and table.pick(texels, view, settings, 0, SIZE[1]) is None


def test_without_records_none_is_picked(ctx: moderngl.Context) -> None:
    with Renderer(worlds.scene(worlds.floor()), SIZE, ctx=ctx, bounces=0) as renderer:
        view, _ = renderer.frame()
        table = read(renderer.cache.records)
        with Texels(ctx) as texels:
            assert len(table) == 0 and table.pick(texels, view, renderer.settings, 48, 30) is None


def test_a_record_is_described_with_its_numbers_and_units(cornell: ShownView, table: RecordTable) -> None:
    renderer, view = cornell.renderer, cornell.source.view
    said = dict(table.describe(17, view, renderer.settings))
    assert said["record"] == f"17 of {len(table)}"
    assert [float(v) for v in said["position"].split()[:3]] == pytest.approx(table.position[17], abs=1e-3)
    assert [float(v) for v in said["irradiance"].split()[:3]] == pytest.approx(table.irradiance[17], rel=0.01)
    assert float(said["R"].split()[0]) == pytest.approx(table.radius[17], rel=0.01)
    assert "W/m³" in said["|grad E|"] and "W/m²" in said["irradiance"]
    curvature = [float(v) for v in re.findall(r"-?[\d.]+(?:e[+-]\d+)?", said["curvature"])[:2]]
    assert curvature == pytest.approx(table.curvature[17], rel=0.01)
    along, across = table.reach(view.camera, renderer.size, renderer.settings)[17]
    assert said["a·R"].endswith(f"here {along:.3g} by {across:.3g} m") and along >= across > 0.0
    flat = renderer.settings.with_values({"gradients": False})
    assert "|grad E|" not in dict(table.describe(17, view, flat))


# ---- the hemisphere ---------------------------------------------------------------------------------------------------


def picture(texture: moderngl.Texture) -> np.ndarray:
    return np.frombuffer(texture.read(), "u1").reshape(texture.height, texture.width, 4)[..., :3] / 255.0


@pytest.mark.parametrize("kind", ["raster", "plane"])
def test_a_record_in_a_furnace_sees_one_radiance(ctx: moderngl.Context, kind: str) -> None:
    """The walls of a box emit L in all directions: every texel of every hemisphere is L, exposed and tone-mapped."""
    L = (0.9, 0.3, 0.1)
    room = worlds.scene(worlds.box((-1, -1, -1), (1, 1, 1), worlds.material(0.0, L), outward=False), camera=INSIDE)
    made = hemispheres(ctx, room, kind)
    assert np.abs(made - tonemap(np.array(L), -1.0)).max() <= 0.51 / 255.0


def test_where_nothing_is_hit_there_is_the_sky(ctx: moderngl.Context) -> None:
    made = hemispheres(ctx, worlds.scene(worlds.floor(), sky=(0.1, 0.5, 0.9)), "raster")
    assert np.abs(made - tonemap(np.array([0.1, 0.5, 0.9]), -1.0)).max() <= 0.51 / 255.0


def hemispheres(ctx: moderngl.Context, world: Scene, kind: str) -> np.ndarray:
    """What a record on the floor of `world` sees, exposed by -1 stops."""
    with shown_view(world, rounds=1, gather=kind, placement="tiles") as made, RecordInspector(ctx, made.buffer_view) as inspector:
        texture = inspector.hemisphere(3, replace(made.source, exposure=-1.0))
        assert texture is not None
        return picture(texture)


def test_a_record_that_is_gathered_again_is_the_same(ctx: moderngl.Context) -> None:
    """E = Σ L·cosθ·dω over the texels of its cell is what the cache has, where no light samples take a share of that; and the
    picture is their radiance."""
    made = shown_view(irrsplat.load("cornell"), gather="raster", light_samples=0)
    with made, RecordInspector(ctx, made.buffer_view) as inspector:
        table, source = read(made.renderer.cache.records), replace(made.source, exposure=1.0)
        for number in (0, 33, len(table) - 1):
            texture = inspector.hemisphere(number, source)
            gather = inspector.gather_pass
            assert texture is not None and isinstance(gather, RasterGather) and gather.target is not None
            seen = gather.target.read()[::-1, :, :3]
            assert np.einsum("ij,ijc->c", gather.share, seen) == pytest.approx(table.irradiance[number], rel=1e-3)
            assert np.abs(picture(texture) - tonemap(seen, 1.0)).max() <= 0.6 / 255.0
            assert picture(texture).std() > 0.05


def test_another_gather_size_shows_another_hemisphere(ctx: moderngl.Context) -> None:
    with shown_view(worlds.scene(worlds.floor(), sky=1.0), rounds=1) as made:
        inspector, sizes = RecordInspector(ctx, made.buffer_view), []
        for side in (16, 8):
            made.renderer.change(made.source.settings.with_values({"gather_size": side}))
            made.renderer.frame()
            texture = inspector.hemisphere(0, made.source)
            assert texture is not None
            sizes.append(texture.size)
        assert sizes == [(32, 24), (16, 12)]
        inspector.release()
