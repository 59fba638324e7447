"""Markers over a buffer: the places of dots, circles and edges, and what hides them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import moderngl
import numpy as np
import pytest

from irrsplat.app.viewer.show.markers import Markers, radius_range
from irrsplat.app.viewer.show.screen import Programs, clear
from irrsplat.core.buffers import Records
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
    """A view of a made-up scene, with nothing on its target yet."""

    renderer: Renderer
    view: View
    programs: Programs
    markers: Markers
    target: Target

    def drawn(self, draw: Callable[[Target], object]) -> tuple[np.ndarray, np.ndarray]:
        """Return the picture (H, W, 3), top row first, and where it is no longer the ground."""
        clear(self.target, GROUND)
        draw(self.target)
        picture = self.target.read()[..., :3]
        return picture, (picture != np.array(GROUND, "f4")).any(-1)

    def marks(self, kind: str, records: Records, settings: Settings = FREE) -> tuple[np.ndarray, np.ndarray]:
        """Return those of one of the markers of records."""
        scene, draw = self.renderer.scene, self.markers.records
        return self.drawn(lambda target: draw(kind, target, self.view, records, settings, scene, None))


@pytest.fixture
def stage(ctx: moderngl.Context) -> Iterator[Callable[..., Stage]]:
    """Makes stages of meshes and a camera."""
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


def records(ctx: moderngl.Context, p: object, R: object = 0.5) -> Records:
    """Return records of the floor at p (N, 3) with radii R, of unit irradiance that changes nowhere."""
    where = worlds.sites(p, (0.0, 1.0, 0.0))
    values = np.concatenate([np.ones((len(where), 3)), np.broadcast_to(R, len(where))[:, None]], axis=1)  # type: ignore[call-overload]
    cache = RecordCache(ctx)
    cache.append(where, values.astype("f4"))
    return cache.records


def project(camera: Camera, p: np.ndarray) -> np.ndarray:
    """Return (N, 2) pixels, x and y from the upper left corner, of world points (N, 3)."""
    x, y, z = camera.axes @ (np.atleast_2d(p) - camera.eye).T
    half = np.tan(np.radians(camera.fov) / 2.0) * -z
    width, height = SIZE
    return np.stack([(x / half * height / width + 1.0) * width / 2.0, (1.0 - y / half) * height / 2.0], -1)


def texels(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of the pixels that points (N, 2) lie in."""
    x, y = np.floor(points).astype(int).T
    return y, x


def distance_to(points: np.ndarray, lit: np.ndarray) -> np.ndarray:
    """Return for every lit pixel the distance in pixels from its centre to the nearest of `points` (N, 2)."""
    y, x = np.nonzero(lit)
    centres = np.stack([x, y], -1) + 0.5
    return np.linalg.norm(centres[:, None] - points[None], axis=-1).min(1)


def grown(lit: np.ndarray) -> np.ndarray:
    """Return where a pixel or one of its eight neighbours is lit."""
    return np.any([np.roll(lit, (dy, dx), (0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)], axis=0)


def test_a_dot_marks_its_record_s_pixel(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """In the colour of its radius: of a·R on a logarithmic scale; nothing lies farther from it than a dot's few pixels."""
    world = stage(worlds.floor())
    p, R = np.array([(-0.8, 0, 0.4), (0.3, 0, -0.5), (0.9, 0, 0.9)]), np.array([0.05, 0.4, 1.2])
    picture, lit = world.marks("points", records(ctx, p, R=R))
    low, high = radius_range(FREE, world.renderer.scene)
    expected = viridis(np.log(FREE.a * R / low) / np.log(high / low))
    at = project(OBLIQUE, p)
    assert np.abs(picture[texels(at)] - expected).max() < 0.02
    assert distance_to(at, lit).max() < 6.0 and 3 * 20 < lit.sum() < 3 * 100


@pytest.mark.parametrize("kind", ["points", "discs"])
def test_what_a_surface_hides_is_not_marked(ctx: moderngl.Context, stage: Callable[..., Stage], kind: str) -> None:
    """A wall stands at z = 1 between the eye and the first record; the second lies under the floor, the third behind the eye."""
    world = stage(worlds.floor(3.0), worlds.quad((-2, 0, 1), (4, 0, 0), (0, 1, 0)))
    _, lit = world.marks(kind, records(ctx, [(0.2, 0, 0.5), (0.1, -0.4, 1.5), (0, 1.6, 8)], R=0.3))
    assert not lit.any()
    _, lit = world.marks(kind, records(ctx, [(0.2, 0, 1.5)], R=0.3))
    assert lit.any(), "before the wall it is seen"


@pytest.mark.parametrize(
    "settings", [FREE, replace(FREE, radius_max=6.0), replace(FREE, radius_min=20.0)], ids=["a·R", "greatest", "least"]
)
@pytest.mark.parametrize("camera", [OBLIQUE, GRAZING], ids=["oblique", "grazing"])
def test_a_disc_is_the_circle_of_its_radius(
    ctx: moderngl.Context, stage: Callable[..., Stage], camera: Camera, settings: Settings
) -> None:
    """Every lit pixel lies within three pixels of the circle of radius a·R in the floor, and all of it is lit within one.

    a·R lies between radius_min and radius_max percent of the image's height at the record's distance.
    """
    world, p, R = stage(worlds.floor(4.0), camera=camera), np.array([0.2, 0.0, 0.3]), 0.9
    percent = 2.0 * np.tan(np.radians(camera.fov) / 2.0) * np.linalg.norm(p - camera.eye) / 100.0
    r = max(settings.a * R, settings.radius_min * percent)
    r = min(r, settings.radius_max * percent) if settings.radius_max else r
    _, lit = world.marks("discs", records(ctx, p, R=R), settings)
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    at = project(camera, p + r * np.stack([np.cos(angle), np.zeros(4000), np.sin(angle)], -1))
    assert distance_to(at, lit).max() < 2.3 + 0.5  # half a line's width, half a pixel's diagonal, and straight pieces
    assert grown(lit)[texels(at)].all()
