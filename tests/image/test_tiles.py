"""Pictures in tiles, and strips: the same records and bytes as in one piece, and the checks of their arguments."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat import Frame, Renderer
from irrsplat.core.buffers import CHANNELS
from irrsplat.core.errors import InputError
from irrsplat.image import gbuffer
from irrsplat.image.frame import RECORDS
from irrsplat.lighting import gl_limits
from irrsplat.renderer import whole_renders
from irrsplat.renderer.stages import Stages
from irrsplat.scene.model import Camera, Material
from tests.image.test_normal_maps import bumpy, tilted
from tests.image.test_textures import square
from tests.renderer.test_renderer import FAST, room
from tests.support.worlds import scene

SIZE = (168, 402)  # high enough for views that begin with every other pixel
CHEAP: dict[str, Any] = {**FAST, "a": 0.8}
TIMES = ("seconds", "stages_ms", "clock")


def same(whole: Frame, tiled: Frame, but: tuple[str, ...] = ()) -> None:
    """All buffers, records and statistics but times are the same, to the bit."""
    for name in (*CHANNELS, *RECORDS):
        assert name in but or getattr(whole, name).tobytes() == getattr(tiled, name).tobytes(), name
    told = [{name: value for name, value in frame.stats.items() if name not in TIMES} for frame in (whole, tiled)]
    assert told[0] == told[1]


@pytest.fixture
def cells(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of this size are drawn by many cells, in one piece too."""
    monkeypatch.setattr(gbuffer, "CELL_PIXELS", 1000)
    monkeypatch.setattr(gbuffer, "CELL", 96)


@pytest.mark.few_sites
@pytest.mark.parametrize(
    ("settings", "tile", "rounds"),
    [({"bounces": "all"}, 128, 1), ({"bounces": 0}, 160, 1), ({"samples": 2, "backdrop": "sky"}, 100, 50)],
    ids=str,
)
def test_tiles_make_the_same_picture(monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], tile: int, rounds: int) -> None:
    monkeypatch.setattr(whole_renders, "MOST_ROUNDS", rounds)
    world = room(sky=0.5)
    whole = irrsplat.render(world, SIZE, **{**CHEAP, **settings})
    with Renderer(world, SIZE, tile_size=tile, **{**CHEAP, **settings}) as renderer:
        same(whole, renderer.render())
        if rounds > 1:
            assert renderer.render().stats["records"] == whole.stats["records"], "nothing is missing any more"


@pytest.mark.usefixtures("cells")
def test_large_pictures_are_the_same_by_cells() -> None:
    """Surfaces with normal maps behind an emitting filter: tiles equal the whole picture to the bit."""
    pane = square(Material(albedo=(0.9, 0.2, 0.1), opacity=0.3, alpha_mode="blend", emission=(0.1, 0.0, 0.0)), z=0.2, half=0.3)
    camera = Camera((0.4, 0.3, 2.0), (0.0, 0.0, 0.0), (0.1, 1.0, 0.0))
    world = scene(square(bumpy(tilted(20.0)), z=-0.5, half=0.8), pane, sky=0.5, camera=camera)
    whole = irrsplat.render(world, (130, 110), **CHEAP)
    with Renderer(world, (130, 110), tile_size=50, **CHEAP) as renderer:
        same(whole, renderer.render())


def test_tiles_are_taken_beyond_the_largest_texture(monkeypatch: pytest.MonkeyPatch) -> None:
    world, size = room(), (300, 2)
    whole = irrsplat.render(world, size, **CHEAP)
    monkeypatch.setattr(gl_limits, "largest", lambda ctx: 299)
    monkeypatch.setattr("irrsplat.renderer.tiles.TILE", 64)
    with Renderer(world, size, **CHEAP) as renderer:
        assert renderer.notices == ("size 300x2 is more than fits here at once; it is drawn in tiles of 64x64",)
        same(whole, renderer.render())
        renderer.resize((20, 2))
        assert not renderer.notices and renderer.frame()[0].image.size == (20, 2)
    with pytest.raises(InputError, match="300x2 is beyond the limit here, 299 pixels a side"):
        Renderer(world, size, tile_size=0, **CHEAP)


def test_what_needs_the_whole_view_is_refused() -> None:
    with Renderer(room(), (40, 30), tile_size=16, **CHEAP) as renderer:
        for ask in (renderer.frame, renderer.converge, renderer.coverage, renderer.read_direct_irradiance):
            with pytest.raises(InputError, match="size 40x30 is drawn in tiles here, which only rendering does"):
                ask()
        with pytest.raises(InputError, match="40x30 is drawn in tiles here, without a folder's figures: take a smaller size"):
            renderer.render(figures=True)
        renderer.change(replace(renderer.settings, placement="scan", quality=1.0))
        with pytest.raises(InputError, match="without --quality and --placement scan"):
            renderer.render()
    for wrong in (15, 4097, -1, 1.5):
        with pytest.raises(InputError, match="tile_size"):
            Renderer(room(), (40, 30), tile_size=wrong, **CHEAP)  # type: ignore[arg-type]


# ---- strips ------------------------------------------------------------------------------------------------------------


def test_a_frozen_cache_shows_the_same_in_tiles() -> None:
    """Uncovered pixels are counted over all tiles, and no record is added."""
    other, found = replace(room().cameras[0], eye=(0.3, 0.1, 0.9)), []
    told: list[Any] = []
    for tile in (0, 32):
        with Renderer(room(), (48, 40), tile_size=tile, **CHEAP, fill_holes=False) as renderer:
            renderer.render()
            found.append(renderer.render(other, gather=False, progress=told.append))
            renderer.change(replace(renderer.settings, bounces=0))
            assert renderer.render(other, gather=False).stats["uncovered"] == 0, "without bounces no record is missing"
    same(found[0], found[1])
    assert found[0].stats["uncovered"] > 0 and told[0].coverage == found[0].stats["coverage"] < 1.0


def test_ctrl_c_leaves_the_other_tiles_one_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """It comes between tiles or in one; a second one leaves no picture. The records are kept."""
    drawn, calls, stops, rest = Stages.draw_picture, [], {3}, (slice(0, 30 - 16), slice(32, 40))  # the last tile
    with Renderer(room(), (40, 30), tile_size=16, **CHEAP, samples=2) as renderer, Renderer(room(), (40, 30), **CHEAP) as plain:

        def interrupted(now: Any, *given: Any) -> Any:
            calls.append(now)
            if len(calls) in stops if isinstance(now, Stages) else getattr(now, "sampled", 0.0) > 0.5:
                raise KeyboardInterrupt
            return drawn(now, *given) if given else None

        one, frames = plain.render(), [renderer.render(progress=interrupted)]
        calls.clear()
        monkeypatch.setattr(Stages, "draw_picture", interrupted)
        frames.append(renderer.render())
        for frame in frames:
            assert frame.stats["interrupted"] and not frame.stats["converged"] and frame.stats["samples"] == 1
            assert np.array_equal(frame.image[rest], one.image[rest]) and not np.array_equal(frame.image, one.image)
        calls, stops = [], {3, 4}
        with pytest.raises(KeyboardInterrupt):
            renderer.render()
        assert renderer.cache.count == frames[0].stats["records"] > 0
