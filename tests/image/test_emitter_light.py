"""Emitters sampled at the pixels: Lambert's formula at every pixel, near or far, textured, cut out or bent; records without."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat import InputError
from irrsplat.gpu.resource import Owner, Resource
from irrsplat.gpu.target import pixels
from irrsplat.gpu.world import World
from irrsplat.image.emitter_light import EmitterLightPass
from irrsplat.image.frame import Frame
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.scene.model import Camera, Image, Material, Mesh, Scene, Texture
from irrsplat.settings import Settings
from tests.support.worlds import box, floor, lamp, material, polygon_vector, quad, scene, sphere

SIZE = (48, 48)
RADIANCE = (1.0, 2.0, 3.0)  # W/(m² sr), different in each channel
SHINING = material(0.0, RADIANCE)
DOWN = Camera((0.0, 4.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 20.0)
GROUND = floor(6.0, 0.0, material(0.7))


def panel(paint: Material = SHINING) -> Mesh:
    """A parallelogram that leans over what DOWN sees of the ground, beside it."""
    return quad((0.95, 0.4, -0.4), (0.0, 0.05, 0.8), (-0.1, 0.6, 0.05), paint)


@dataclass(frozen=True)
class Seen:
    """What a camera sees, (H, W, 3) each: places, normals, and the irradiance that comes straight from emitters."""

    position: np.ndarray
    normal: np.ndarray
    E: np.ndarray

    def lambert(self, corners: np.ndarray) -> np.ndarray:
        """(H, W, 3) the irradiance from an emitter with these corners, all of them above the horizon."""
        vector = polygon_vector(corners.astype(float), self.position.astype(float))
        return np.maximum((vector * self.normal).sum(-1), 0.0)[..., None] * RADIANCE


class Sampler(Owner):
    """Samples emitters in views of SIZE, with programs that are compiled once."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self.ctx, self.gbuffer = ctx, GBufferPass(ctx, SIZE)
        self.passes: dict[str, EmitterLightPass] = {}

    def owned(self) -> tuple[Resource | None, ...]:
        return (self.gbuffer, *self.passes.values())

    def __call__(self, of: Scene, samples: int = 16, camera: Camera = DOWN, times: int = 1) -> Seen:
        """times: of how many samples of a pixel, all at its centre, the irradiance is the mean."""
        with World(self.ctx, of) as world:
            defines, settings = world.material_defines, Settings(pixel_light_samples=samples)
            light = self.passes.setdefault(str(defines), EmitterLightPass(self.ctx, SIZE, defines))
            seen = self.gbuffer(world, camera)
            E = np.mean([pixels(light(seen, world, settings, number))[..., :3] for number in range(times)], axis=0)
            return Seen(pixels(seen.position)[..., :3], pixels(seen.lit_normal)[..., :3], E)


@pytest.fixture(scope="module")
def samplers() -> Iterator[list[Sampler]]:
    """The module's one sampler, once it is made."""
    made: list[Sampler] = []
    yield made
    for sampler in made:
        sampler.release()


@pytest.fixture
def sample(ctx: moderngl.Context, samplers: list[Sampler]) -> Sampler:
    if not samplers:
        samplers.append(Sampler(ctx))
    return samplers[0]


def off(found: np.ndarray, truth: np.ndarray) -> float:
    """√mean(error²) over the mean of the truth."""
    return float(np.sqrt(np.mean((found - truth) ** 2)) / np.mean(truth))


def test_E_is_that_of_lamberts_formula(sample: Sampler) -> None:
    found = sample(scene(GROUND, panel()))
    truth = found.lambert(panel().positions)
    assert off(found.E, truth) < 0.045 and found.E.mean() == pytest.approx(truth.mean(), rel=2e-3)


def test_close_to_an_emitter_there_is_no_more_noise(sample: Sampler) -> None:
    """A panel that stands on the ground: points spread by area would be off by a multiple of E here and there."""
    standing = quad((-1.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 1.0, 0.0), SHINING)
    found = sample(scene(GROUND, standing), camera=Camera((0.0, 1.0, 0.6), (0.0, 0.0, 0.12), (0.0, 1.0, 0.0), 20.0))
    there = np.abs(found.position[..., 1]) < 1e-4
    E, truth = found.E[there], found.lambert(standing.positions)[there]
    assert there.mean() > 0.5 and found.position[there][:, 2].min() < 0.01
    assert np.abs(E / truth - 1.0).max() < 0.5 and off(E, truth) < 0.12 and E.mean() == pytest.approx(truth.mean(), rel=3e-3)


def test_further_samples_have_points_of_their_own(sample: Sampler) -> None:
    """Across a penumbra: the mean of 16 samples with a shadow ray each is that of one with 16, and far better than one alone."""
    world = scene(GROUND, panel(), quad((0.5, 0.25, -1.0), (0.0, 0.4, 0.0), (0.0, 0.0, 2.0)))
    truth = sample(world, 512).E
    one, many, at_once = sample(world, 1).E, sample(world, 1, times=16).E, sample(world, 16).E
    assert np.allclose(many, at_once, rtol=1e-4, atol=1e-6)
    assert off(many, truth) < 0.3 * off(one, truth) and many.mean() == pytest.approx(truth.mean(), rel=0.01)


def half_lit(cut_out: bool) -> tuple[Mesh, np.ndarray]:
    """The panel with an image that shines in one half, or is there in one half only; and the corners of that half."""
    pixels = np.full((64, 64, 4), 255, np.uint8)
    pixels[:, :32, 3 if cut_out else slice(0, 3)] = 0
    texture = Texture(Image(pixels), wrap=("clamp", "clamp"), nearest=True)
    black = (0.0, 0.0, 0.0)
    paint = (
        Material(black, RADIANCE, albedo_texture=texture, alpha_mode="mask")
        if cut_out
        else Material(black, RADIANCE, emission_texture=texture)
    )
    plain = panel(paint)
    uvs = np.array([(0, 0, 0, 0), (1, 0, 0, 0), (1, 1, 0, 0), (0, 1, 0, 0)], "f4")
    a, b, c, d = plain.positions
    return replace(plain, uvs=uvs), np.array([(a + b) / 2, b, c, (c + d) / 2])


@pytest.mark.parametrize("cut_out", [False, True])
def test_a_panel_of_which_half_shines_lights_as_that_half(sample: Sampler, cut_out: bool) -> None:
    mesh, corners = half_lit(cut_out)
    found = sample(scene(GROUND, mesh), 64)
    truth = found.lambert(corners)
    assert off(found.E, truth) < 0.14 and found.E.mean() == pytest.approx(truth.mean(), rel=0.01)


def test_a_bulb_shines_outward_only(sample: Sampler) -> None:
    """E = π·r²·L·cosθ/d² of a sphere: of its triangles those count that face the ground."""
    centre, radius = np.array((0.9, 1.2, 0.1)), 0.05
    found = sample(scene(GROUND, sphere(centre, radius, SHINING, 16, 32)))
    away = centre - found.position
    truth = (np.pi * radius**2 * away[..., 1] / np.linalg.norm(away, axis=-1) ** 3)[..., None] * RADIANCE
    assert off(found.E, truth) < 0.1 and found.E.mean() == pytest.approx(truth.mean(), rel=0.015)


def test_light_comes_by_the_normal_map_from_above_the_surface(sample: Sampler) -> None:
    """Tilted towards a panel: Lambert's formula about the tilted normal, which looks below the ground as well; what shines there
    brings nothing."""
    stored = np.round(255.0 * (0.5 * np.array((np.sin(0.7), 0.0, np.cos(0.7), 1.0)) + 0.5)).astype(np.uint8)
    bent = Texture(Image(np.tile(stored, (2, 2, 1))))
    uvs = np.array([(0, 1, 0, 0), (1, 1, 0, 0), (1, 0, 0, 0), (0, 0, 0, 0)], "f4")
    ground = replace(floor(6.0, 0.0, Material((0.7, 0.7, 0.7), normal_texture=bent)), uvs=uvs)
    below = quad((1.1, -0.9, -1.0), (0.0, 0.8, 0.0), (0.0, 0.0, 2.0), SHINING)
    found = sample(scene(ground, panel(), below), 32)
    assert found.normal[..., 0].mean() == pytest.approx(np.sin(0.7), abs=0.01)
    assert off(found.E, found.lambert(panel().positions)) < 0.04


# ---- whole renders -----------------------------------------------------------------------------------------------------


def room() -> Scene:
    """A room with a panel, a table below it and a lamp: light of all kinds."""
    walls = box((-2, 0, -2), (2, 3, 2), material((0.6, 0.5, 0.4)), outward=False)
    shining = quad((-0.4, 2.9, -0.4), (0.8, 0.0, 0.0), (0.0, 0.0, 0.8), material(0.0, 20.0))
    table = box((-0.6, 0.7, -0.4), (0.6, 0.75, 0.4), material(0.5))
    return scene(walls, shining, table, lights=(lamp((1.5, 1.0, 1.0), 2.0),))


ACROSS = Camera((0.0, 1.6, 1.9), (0.0, 0.7, 0.0), (0.0, 1.0, 0.0), 70.0)


@pytest.mark.parametrize("gather", ["trace", "raster", "plane"])
def test_records_of_a_dark_room_know_nothing_of_its_panel(gather: str) -> None:
    """Not even by chance; in all buffers but `direct` its light is there."""
    settings: Any = {"bounces": 1, "gather": gather, "gather_size": 16, "pixel_light_samples": 4}
    frame = irrsplat.render(scene(floor(2.0, 0.0, material(0.0)), panel()), (32, 32), DOWN, **settings)
    assert len(frame.records_irradiance) and not frame.records_irradiance.any()
    assert frame.irradiance.all() and not frame.direct.any()


def test_a_change_renews_the_records_and_files_do_not_mix(tmp_path: Path) -> None:
    """From records that hold all light to pixels and back, with as much light; of files it only matters whether the pixels are
    sampled."""
    file, settings = (
        tmp_path / "cache",
        {"bounces": 2, "gather": "trace", "gather_size": 8, "a": 0.9, "radius_max": 20.0, "shadow_size": 64},
    )
    with irrsplat.Renderer(room(), (32, 32), **settings) as renderer:  # type: ignore[arg-type]

        def render(samples: int) -> Frame:
            renderer.change(replace(renderer.settings, pixel_light_samples=samples))
            return renderer.render(ACROSS)

        before = render(0)
        count, mean = len(before.records_irradiance), before.records_irradiance.mean()
        assert renderer.composite_pass.added_target is None
        renderer.save_cache(file)
        apart = render(8)
        assert apart.records_irradiance[:count].mean() < 0.7 * mean
        assert apart.irradiance.mean() == pytest.approx(before.irradiance.mean(), rel=0.02)
        assert np.array_equal(apart.direct, before.direct)
        with pytest.raises(InputError, match="--pixel-light-samples 0, not --pixel-light-samples 1"):
            renderer.load_cache(file)
        renderer.save_cache(file)
        renderer.change(replace(renderer.settings, pixel_light_samples=16))
        renderer.load_cache(file)
        again = render(0).records_irradiance[:count]
        assert np.allclose(again, before.records_irradiance, rtol=0.02, atol=1e-3 * mean)
