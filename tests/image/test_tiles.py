"""Pictures in tiles, and strips: the same records and bytes as in one piece, and what may be asked of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import Frame, Renderer
from irrsplat.app import cli
from irrsplat.core.buffers import CHANNELS
from irrsplat.core.errors import InputError
from irrsplat.gpu.target import pixels
from irrsplat.gpu.world import World
from irrsplat.image import gbuffer
from irrsplat.image.frame import RECORDS
from irrsplat.image.gbuffer import GBufferPass, GBufferTarget
from irrsplat.image.view import View
from irrsplat.lighting import gl_limits, memory
from irrsplat.renderer.tiles import Tiles
from irrsplat.scene.model import Camera, Material, Part, measure, part_of
from tests.image.test_normal_maps import bumpy, tilted
from tests.image.test_textures import square
from tests.renderer.test_renderer import FAST, room
from tests.support.worlds import floor, scene

SIZE = (180, 410)  # high enough for views that begin with every other pixel
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


@pytest.mark.parametrize(
    ("settings", "tile"),
    [
        ({"borrow": 6, "smooth": True}, 100),
        ({"bounces": "all", "max_rounds": 1}, 128),
        ({"samples": 2, "pixel_light_samples": 1}, 150),
        ({"bounces": 0, "backdrop": "sky"}, 33),
    ],
    ids=str,
)
def test_tiles_make_the_same_picture(settings: dict[str, Any], tile: int) -> None:
    world = room(sky=0.5)
    whole = irrsplat.render(world, SIZE, **{**CHEAP, **settings})
    with Renderer(world, SIZE, tile_size=tile, **{**CHEAP, **settings}) as renderer:
        same(whole, renderer.render())
        if "max_rounds" not in settings:
            assert renderer.render().stats["records"] == whole.stats["records"], "nothing is missing any more"


def test_large_pictures_are_the_same_by_cells(cells: None) -> None:
    world = room()
    whole = irrsplat.render(world, SIZE, **CHEAP)
    with Renderer(world, SIZE, tile_size=80, **CHEAP) as renderer:
        same(whole, renderer.render())
        alone = renderer.render(buffers=("alpha",))
        assert alone.alpha.tobytes() == whole.alpha.tobytes() and alone.depth.shape == (0, 0)


def test_a_frozen_cache_shows_the_same(tmp_path: Path) -> None:
    """What records do not reach is counted over all tiles, and no record is added."""
    world, other = room(), replace(room().cameras[0], eye=(0.3, 0.1, 0.9))
    found = []
    for tile in (0, 64):
        with Renderer(world, (90, 70), tile_size=tile, **CHEAP, fill_holes=False) as renderer:
            renderer.render()
            found.append(renderer.render(other, gather=False))
    same(found[0], found[1])
    assert found[0].stats["uncovered"] > 0 and found[0].stats["coverage"] < 1.0


def parts_of(whole: np.ndarray, part: Part) -> np.ndarray:
    """What of a picture (H, W, …), bottom row first, lies in a part that lies within it."""
    (x, y), (width, height) = part.corner, part.size
    return whole[y : y + height, x : x + width]


@pytest.mark.parametrize("by_cells", [False, True])
def test_parts_of_a_g_buffer_are_those_of_the_whole(
    ctx: moderngl.Context, request: pytest.FixtureRequest, by_cells: bool
) -> None:
    """Of surfaces with normal maps behind filters that shine, at any place, to the bit."""
    if by_cells:
        request.getfixturevalue("cells")
    pane = square(Material(albedo=(0.9, 0.2, 0.1), opacity=0.3, alpha_mode="blend", emission=(0.1, 0.0, 0.0)), z=0.2, half=0.3)
    wall = square(bumpy(tilted(20.0)), z=-0.5, half=0.8)
    camera, size = Camera((0.4, 0.3, 2.0), (0.0, 0.0, 0.0), (0.1, 1.0, 0.0)), (130, 110)
    world = World(ctx, scene(wall, pane, camera=camera))

    def drawn(camera: Camera, size: tuple[int, int]) -> dict[str, np.ndarray]:
        made = GBufferPass(ctx, size)
        found = made(world, camera)
        assert found.mapped_normal is not None and found.filters is not None and found.filters.glow is not None
        textures = {name: getattr(found, name) for name in ("position", "normal", "albedo", "emission", "mapped_normal")}
        textures |= {name: getattr(found.filters, name) for name in ("tint", "opacity", "glow")}
        read = {name: pixels(texture)[::-1].copy() for name, texture in textures.items()}
        made.release()
        return read

    whole = drawn(camera, size)
    assert (whole["tint"] < 1.0).any() and (whole["glow"] > 0.0).any()
    for part in (Part(size, (0, 0), (50, 40)), Part(size, (33, 21), (97, 70)), Part(size, (129, 109), (1, 1))):
        here = drawn(part_of(camera, part), part.size)
        seen = here["position"][..., 3:] > 0.0
        for name, values in whole.items():
            everywhere = name in ("tint", "opacity", "glow")
            mine, there = (np.where(seen | everywhere, one, 0.0) for one in (here[name], parts_of(values, part)))
            assert np.array_equal(mine, there), (name, part)
    world.release()


def test_tiles_are_taken_where_memory_is_short(
    software: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a notice; --tile-size 0 refuses it instead, as too little memory for tiles does."""
    if not software:
        pytest.skip("hardware has memory of its own, of which OpenGL does not tell")
    size, whole, tiled = ("60", "50"), tmp_path / "whole.png", tmp_path / "tiled.png"
    words = ["render", "cornell", "--size", *size, "--gather-size", "8", "--shadow-size", "64", "--bounces", "1", "-o"]
    assert cli.main([*words, str(whole)]) == 0
    capsys.readouterr()
    monkeypatch.setattr(gl_limits, "LARGE", 0)
    monkeypatch.setattr(gl_limits, "_BESIDE", 0)
    monkeypatch.setattr("irrsplat.renderer.tiling.TILE", 16)
    monkeypatch.setattr(memory, "available", lambda: 300_000)
    assert cli.main([*words, str(tiled)]) == 0
    assert "size 60x50 is more than fits here at once; it is drawn in tiles of 16x16" in capsys.readouterr().err
    assert tiled.read_bytes() == whole.read_bytes()
    assert cli.main([*words, str(tiled), "--tile-size", "0"]) == 2
    assert "size 60x50 needs 0.0 GB of memory" in capsys.readouterr().err
    monkeypatch.setattr(memory, "available", lambda: 10_000)
    assert cli.main([*words, str(tiled)]) == 2
    assert "take a smaller size" in capsys.readouterr().err


def test_tiles_are_taken_beyond_the_largest_texture(monkeypatch: pytest.MonkeyPatch) -> None:
    world, size = room(), (1100, 2)
    whole = irrsplat.render(world, size, **CHEAP)
    monkeypatch.setattr(gl_limits, "largest", lambda ctx: 1099)
    monkeypatch.setattr("irrsplat.renderer.tiling.TILE", 256)
    with Renderer(world, size, **CHEAP) as renderer:
        assert renderer.notices == ("size 1100x2 is more than fits here at once; it is drawn in tiles of 256x256",)
        same(whole, renderer.render())
        renderer.resize((20, 2))
        assert not renderer.notices and renderer.frame()[0].image.size == (20, 2)
    with pytest.raises(InputError, match="1100x2 is beyond the limit here, 1099 pixels a side"):
        Renderer(world, size, tile_size=0, **CHEAP)


def test_what_needs_the_whole_view_is_refused() -> None:
    with Renderer(room(), (40, 30), tile_size=16, **CHEAP) as renderer:
        for ask in (renderer.frame, renderer.converge, renderer.coverage, renderer.lamp_irradiance):
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


def test_an_interruption_leaves_the_other_tiles_one_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between tiles or in one; a second one leaves no picture. The records are kept."""
    with Renderer(room(), (40, 30), tile_size=16, **CHEAP, samples=2) as renderer, Renderer(room(), (40, 30), **CHEAP) as plain:

        def stop(progress: Any) -> None:
            if progress.sampled > 0.5:
                raise KeyboardInterrupt

        frame, one = renderer.render(progress=stop), plain.render()
        assert frame.stats["interrupted"] and not frame.stats["converged"] and frame.stats["samples"] == 1
        rest = slice(0, 30 - 16), slice(32, 40)  # the last tile
        assert np.array_equal(frame.image[rest], one.image[rest]) and not np.array_equal(frame.image, one.image)
        assert np.array_equal(frame.irradiance, one.irradiance)
        count = renderer.cache.count
        drawn, times = Tiles._drawn, 0

        def stopped(*given: Any) -> View:
            nonlocal times
            times += 1
            if times in stops:
                raise KeyboardInterrupt
            return drawn(*given)

        monkeypatch.setattr(Tiles, "_drawn", stopped)
        stops = {3}
        frame = renderer.render()
        assert frame.stats["interrupted"] and np.array_equal(frame.image[rest], one.image[rest])
        times, stops = 0, {3, 4}
        with pytest.raises(KeyboardInterrupt):
            renderer.render()
        monkeypatch.undo()
        assert renderer.render().stats["records"] == count > 0


# ---- strips ------------------------------------------------------------------------------------------------------------


def test_the_measure_of_a_picture() -> None:
    """Its height, while its sides differ by no more than a factor of 2.4; from 5.76 on that of a square of as many pixels."""
    for size in ((240, 100), (100, 100), (100, 240), (1920, 1080), (1080, 1920), (1, 1)):
        assert measure(size) == size[1]
    assert measure((4000, 10)) == measure((10, 4000)) == 200.0
    assert measure((3600, 1000)) == 1500.0 and measure((1000, 3600)) == 2400.0
    for factor in (2.4, 5.76):  # without a jump
        sides = (round(1000 * factor) - 1, round(1000 * factor) + 1)
        for below, above in (((sides[0], 1000), (sides[1], 1000)), ((1000, sides[0]), (1000, sides[1]))):
            assert np.isclose(measure(below), measure(above), rtol=2e-3)


@pytest.mark.parametrize("size", [(640, 10), (10, 640)])
def test_a_strip_takes_about_as_many_records_as_a_square(size: tuple[int, int]) -> None:
    """Of a floor under a sky, where only the greatest radius on screen bounds records; pixels are as wide in both."""

    def records(size: tuple[int, int]) -> int:
        fov = 2.0 * np.degrees(np.arctan(0.2 * np.sqrt(size[1] / size[0])))
        above = Camera((0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov=float(fov))
        frame = irrsplat.render(scene(floor(), sky=1.0, camera=above), size, **FAST)
        assert frame.stats["converged"] and np.isfinite(frame.depth).all()
        return int(frame.stats["records"])

    assert 0.5 < records(size) / records((80, 80)) < 1.5


def test_no_target_is_longer_than_a_texture_can_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """A long strip of few pixels is drawn by cells as well."""
    made: list[tuple[int, int]] = []
    create = GBufferTarget.__init__

    def noted(self: GBufferTarget, ctx: moderngl.Context, size: tuple[int, int]) -> None:
        made.append(size)
        create(self, ctx, size)

    monkeypatch.setattr(GBufferTarget, "__init__", noted)
    with Renderer(room(), (9000, 2), tile_size=512, **CHEAP) as renderer:
        frame = renderer.render(buffers=("image",))
    assert frame.image.shape == (2, 9000, 3) and frame.stats["converged"]
    assert made and max(max(size) for size in made) <= 1024
