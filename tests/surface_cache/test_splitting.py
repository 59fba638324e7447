"""Further sites where light changes: lookups there come nearer to gathers, values elsewhere stay, and areas still add up."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import TypeVar

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.core.buffers import HitLight, Sites
from irrsplat.core.vertex_layout import PARTS, WIDTH
from irrsplat.gather.look import gather_records
from irrsplat.gather.reduce import ReducePass
from irrsplat.gather.trace import TraceGather
from irrsplat.gpu.time_budget import Budget
from irrsplat.indirect.paper_scan import read_back
from irrsplat.records.record_cache import RecordCache
from irrsplat.renderer import Renderer
from irrsplat.surface_cache import site_layout, tessellation
from irrsplat.surface_cache.cache import SurfaceCache
from irrsplat.surface_cache.lookup_table import LookupTable
from irrsplat.surface_cache.site_layout import FIRST_SITE, SiteChooser
from irrsplat.surface_cache.site_splitting import SiteSplitter, SplitLayout, leaves_of, unevenness
from tests.support.viewing import write_room

Result = TypeVar("Result")


def finished(work: Generator[float, None, Result]) -> Result:
    """What a step returns in the end."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            result: Result = end.value
            return result


def made(renderer: Renderer) -> SurfaceCache:
    """The surface cache of a renderer, complete."""
    renderer.frame()
    surface = renderer.scheduler.gatherer.surface_now
    assert surface is not None and surface.complete
    return surface


def area_of(surface: SurfaceCache) -> np.ndarray:
    """(S,) square metres, that the sites stand for which lookups find."""
    assert surface._now.laid_out is not None
    return surface._now.laid_out.layout.area


def test_a_further_refinement_brings_lookups_nearer_to_gathers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On what the view shows of a room, with two bounces: E_1 by lookup against E_1 by 64² rays. Sites that there were stay,
    and so does the light at those that speak for as much as before."""
    monkeypatch.setattr(site_layout, "POINTS", (150, 150))
    with Renderer(irrsplat.load(write_room(tmp_path)), (48, 36), bounces=2, gather="trace", shadow_size=256) as renderer:
        surface, shadows = made(renderer), renderer.draw_shadows()
        seen = read_back(renderer.draw_gbuffer(renderer.scene.camera()))
        sites: Sites = seen.sites(np.nonzero(seen.mask))[::5]
        with (
            TraceGather(renderer.world, 64) as fine,
            ReducePass(renderer.ctx, False) as reduce,
            RecordCache(renderer.ctx) as cache,
        ):
            cache.append(sites)
            gather_records(fine, reduce, HitLight(shadows), cache, np.arange(cache.count), seed=0)
            true = cache.read()["irradiance"]

        def off() -> float:
            return float(np.sqrt(np.mean((surface.at(sites) - true) ** 2)) / true.mean())

        errors, counts, lights, areas = [], [], [], []
        for _ in range(3):
            while not surface.refine(shadows, Budget(1e-3)):
                pass
            assert surface.result is not None and surface.records is not None
            errors.append(off())
            counts.append(len(surface.sites))
            lights.append(surface.result.irradiance)
            areas.append(area_of(surface))
        assert counts[0] < 0.9 * counts[1] and counts[1] < 0.9 * counts[2]
        assert errors[1] < 0.9 * errors[0] and errors[2] < 0.75 * errors[0], errors
        same = np.isclose(areas[1][: len(areas[0])], areas[0], rtol=1e-6, atol=0.0)
        assert np.array_equal(lights[0][same], lights[1][: len(same)][same]) and 0.2 < same.mean() < 0.95
        assert surface.refinements == 3 and surface.before is not surface.lookup
        renderer.relight([])
        assert surface.refinements == 0 and len(surface.sites) == counts[0]


def test_cells_that_are_cut_cover_what_they_did(tmp_path: Path) -> None:
    """The leaves of a layout have its area before and after, sites are not lost, and every leaf names values that there are."""
    with Renderer(irrsplat.load(write_room(tmp_path)), (16, 12), bounces=2, gather="trace", shadow_size=64) as renderer:
        surface = made(renderer)
        assert surface.layout is not None and surface.result is not None
        chooser = SiteChooser(renderer.scene, surface._basis.unlit, 1e-4 * renderer.scene.diagonal, surface._rays.see)
        layout, E = surface.layout, surface.result.irradiance.astype(float)
        given = SplitLayout(layout, leaves_of(layout.tessellation))
        corners = tessellation.cell_corners(layout.tessellation)
        assert np.allclose(corners.mean(1), layout.tessellation.position[layout.tessellation.corners].mean(1), atol=1e-3)
        cut = finished(SiteSplitter(chooser, E, len(E) // 2).split(given))
        again = finished(SiteSplitter(chooser, np.concatenate([E, E[: len(cut.layout.sites) - len(E)]]), len(E)).split(cut))
        assert np.isclose(cut.layout.area.sum(), layout.area.sum(), rtol=1e-3)
        assert np.isclose(again.layout.area.sum(), layout.area.sum(), rtol=1e-3)
        assert len(layout.sites) < len(cut.layout.sites) < 2 * len(layout.sites) and again.leaves.level.max() >= 2
        assert np.array_equal(cut.layout.sites.position[: len(E)], layout.sites.position)
        rows = again.layout.cells[again.leaves.row, again.leaves.side]
        assert (rows[:, :3] < len(again.layout.sites)).all() and (rows[:, :3] >= -1.0).all() and (rows[:, 3] >= 0.0).all()
        pairs = np.column_stack([again.leaves.row, again.leaves.side])
        assert len(np.unique(pairs, axis=0)) == len(pairs)


def test_unevenness_is_the_greatest_difference_around() -> None:
    """Two cells that share a site; what is known without a gather does not count."""
    E = np.zeros((FIRST_SITE + 4, 3))
    E[FIRST_SITE:] = np.array([1.0, 1.5, 4.0, 4.0])[:, None]
    values = np.array([[2, 2, 3], [3, 4, 4], [5, 5, 5], [0, 1, 5]])
    assert unevenness(values, E).tolist() == [2.5, 2.5, 0.0, 0.0]


def test_cells_are_cut_in_halves_however_long_they_are() -> None:
    """Of a sliver whose steps are longer than was asked for, too: lookups go by four cells."""
    sliver = np.zeros((3, WIDTH), np.float32)
    sliver[:, PARTS["position"]], sliver[:, PARTS["normal"]] = [(0, 0, 0), (10, 0, 0), (0, 0, 0.1)], (0, 1, 0)
    faces = np.array([[0, 1, 2]])
    assert tessellation.tessellate(sliver, faces, 0.5, 0.0).table[0, 0, 3] > 2
    long = np.full(40_000, 100.0)  # many slivers are cut as one is, and leave others as fine as they were
    assert set(tessellation.steps(np.append(long, 1.0), 0.5, most=2)) == {2}
    cut = tessellation.tessellate(sliver, faces, 0.5, 0.0, most=2)
    assert cut.table[0, 0, 3] == 2 and len(np.unique(cut.corners)) == 12 and cut.area.sum() == pytest.approx(0.5)


def test_tables_of_the_same_arrays_are_borrowed(ctx: moderngl.Context) -> None:
    """A refinement of the same cells needs none of its own but for the values; one that cuts cells keeps the triangles'."""
    rows, cells = np.ones((5, 3, 4)), np.ones((7, 2, 4))
    base = LookupTable(ctx, rows, cells, 3)
    same, cut = (LookupTable(ctx, rows, one, 3, like=base) for one in (cells, np.ones((9, 2, 4))))
    tables = [(one.triangles, one.cells) for one in (base, same, cut)]
    assert tables[1] == tables[0] and tables[2][0] == tables[0][0] and cut.cells is not base.cells
    assert set(same.owned()) == {same.values} and set(cut.owned()) == {cut.values, cut.cells}
    assert len(set(base.owned())) == 3 and len({one.values for one in (base, same, cut)}) == 3
    for one in (same, cut, base):
        one.release()
