"""Markers over a buffer: positions and colours of circles, and their occlusion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import moderngl
import numpy as np
import pytest

from irrsplat.app.viewer.buffers.shown_buffer import Canvas, Programs, clear
from irrsplat.app.viewer.show.markers import Markers, radius_range
from irrsplat.gpu.target import Target
from irrsplat.image.tonemap import viridis
from irrsplat.image.view import View
from irrsplat.records.record_cache import RecordCache
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings
from tests.support import worlds

SIZE = (160, 120)
GROUND = (0.2, 0.2, 0.2)
OBLIQUE = Camera((0.0, 1.5, 4.0), (0.0, 0.0, 0.0), fov=40.0)
GRAZING = Camera((0.0, 0.15, 4.0), (0.0, 0.1, 0.0), fov=40.0)
FREE = Settings(radius_min=0.0, radius_max=0.0)  # a·R is what R says


@dataclass(frozen=True)
class Stage:
    """View of a synthetic scene with an empty target."""

    renderer: Renderer
    view: View
    programs: Programs
    markers: Markers
    target: Target

    def discs(self, records: RecordCache, settings: Settings = FREE, most: int = 9) -> tuple[np.ndarray, np.ndarray]:
        """Return the picture and the mask of the discs of records."""
        clear(self.target, GROUND)
        canvas, extent = Canvas(self.target, self.programs), self.renderer.scene.diagonal
        self.markers.discs(canvas, self.view, records, settings, extent, 0, most)
        picture = self.target.read()[..., :3]
        return picture, (picture != np.array(GROUND, "f4")).any(-1)


@pytest.fixture
def stage(ctx: moderngl.Context) -> Iterator[Callable[..., Stage]]:
    """Provide a function that makes stages from meshes and a camera."""
    made: list[Stage] = []

    def stage(*meshes: object, camera: Camera = OBLIQUE) -> Stage:
        renderer = Renderer(worlds.scene(*meshes, camera=camera), SIZE, ctx=ctx, bounces=0)  # type: ignore[arg-type]
        programs = Programs(ctx)
        made.append(Stage(renderer, renderer.frame()[0], programs, Markers(programs), Target(ctx, SIZE, (4,))))
        return made[-1]

    yield stage
    ctx.detect_framebuffer(0).use()
    for one in made:
        one.renderer.release()
        one.markers.release()
        one.programs.release()
        one.target.release()


def records(ctx: moderngl.Context, p: object, R: object = 0.5) -> RecordCache:
    """Return records of the floor at p (N, 3) with radii R and constant unit irradiance."""
    where = worlds.sites(p, (0.0, 1.0, 0.0))
    values = np.concatenate([np.ones((len(where), 3)), np.broadcast_to(R, len(where))[:, None]], axis=1)  # type: ignore[call-overload]
    cache = RecordCache(ctx)
    cache.append(where, values.astype("f4"))
    return cache


def project(camera: Camera, p: np.ndarray) -> np.ndarray:
    """Return (N, 2) pixels, x and y from the upper left corner, of world points (N, 3)."""
    x, y, z = camera.axes @ (np.atleast_2d(p) - camera.eye).T
    half = np.tan(np.radians(camera.fov) / 2.0) * -z
    width, height = SIZE
    return np.stack([(x / half * height / width + 1.0) * width / 2.0, (1.0 - y / half) * height / 2.0], -1)


def distance_to(points: np.ndarray, lit: np.ndarray) -> np.ndarray:
    """Return the distance in pixels from the centre of each lit pixel to the nearest of `points` (N, 2)."""
    y, x = np.nonzero(lit)
    centres = np.stack([x, y], -1) + 0.5
    return np.linalg.norm(centres[:, None] - points[None], axis=-1).min(1)


def test_what_a_surface_hides_is_not_marked(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """A wall at z = 1 hides the first record, the floor hides the second, and the third is behind the eye."""
    world = stage(worlds.floor(3.0), worlds.quad((-2, 0, 1), (4, 0, 0), (0, 1, 0)))
    _, lit = world.discs(records(ctx, [(0.2, 0, 0.5), (0.1, -0.4, 1.5), (0, 1.6, 8)], R=0.3))
    assert not lit.any()
    _, lit = world.discs(records(ctx, [(0.2, 0, 1.5)], R=0.3))
    assert lit.any(), "before the wall it is seen"


def test_discs_appear_in_batches_and_change_together(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """Two calls for one disc each give the picture of one call. After a change, the earlier discs stay until both are drawn."""
    world, p = stage(worlds.floor(3.0)), [(-0.4, 0, 0.3), (0.4, 0, 0.3)]
    both, cache = world.discs(records(ctx, p))[0], records(ctx, p)
    assert (world.discs(cache, most=1)[0] != both).any()
    assert (world.discs(cache, most=1)[0] == both).all()
    cache.revision += 1
    assert all((world.discs(cache, most=1)[0] == both).all() for _ in range(2))


@pytest.mark.parametrize(
    "settings", [FREE, replace(FREE, radius_max=6.0), replace(FREE, radius_min=20.0)], ids=["a·R", "greatest", "least"]
)
@pytest.mark.parametrize("camera", [OBLIQUE, GRAZING], ids=["oblique", "grazing"])
def test_a_disc_is_the_circle_of_its_radius(
    ctx: moderngl.Context, stage: Callable[..., Stage], camera: Camera, settings: Settings
) -> None:
    """Lit pixels are near the circle of radius a·R in the floor, and each point of the circle has a lit pixel next to it.

    a·R is limited to radius_min and radius_max, in percent of the image's height at the record's distance.
    """
    world, p, R = stage(worlds.floor(4.0), camera=camera), np.array([0.2, 0.0, 0.3]), 0.9
    percent = 2.0 * np.tan(np.radians(camera.fov) / 2.0) * np.linalg.norm(p - camera.eye) / 100.0
    r = max(settings.a * R, settings.radius_min * percent)
    r = min(r, settings.radius_max * percent) if settings.radius_max else r
    picture, lit = world.discs(records(ctx, p, R=R), settings)
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    at = project(camera, p + r * np.stack([np.cos(angle), np.zeros(4000), np.sin(angle)], -1))
    assert distance_to(at, lit).max() < 2.3 + 0.5  # half a line's width, half a pixel's diagonal, and straight pieces
    x, y = np.floor(at).astype(int).T
    assert np.any([lit[y + i, x + j] for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=0).all()
    low, high = radius_range(settings, world.renderer.scene.diagonal)
    colour = viridis(np.array(np.log(settings.a * R / low) / np.log(high / low)))
    assert np.abs(picture[lit] - colour).max(-1).min() < 0.02, "the middle of the line has the colour of a·R"
