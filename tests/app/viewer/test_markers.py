"""What is drawn over a buffer: where dots, circles, normals and edges lie, what hides them, and what one record serves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import moderngl
import numpy as np
import pytest

import irrsplat
from irrsplat.app.viewer.show.markers import Markers, radius_legend, radius_range
from irrsplat.app.viewer.show.screen import clear
from irrsplat.core.buffers import Records
from irrsplat.gpu.target import Target
from irrsplat.image.tonemap import viridis
from irrsplat.image.view import View, read
from irrsplat.records.record_cache import RecordCache
from irrsplat.renderer import Renderer
from irrsplat.scene.model import Camera, Scene
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
    markers: Markers
    target: Target

    @property
    def scene(self) -> Scene:
        return self.renderer.scene

    def drawn(self, draw: Callable[[Target], object]) -> tuple[np.ndarray, np.ndarray]:
        """The picture (H, W, 3), top row first, and where it is no longer the ground."""
        clear(self.target, GROUND)
        draw(self.target)
        picture = self.target.read()[..., :3]
        return picture, (picture != np.array(GROUND, "f4")).any(-1)

    def marks(self, kind: str, records: Records, settings: Settings = FREE, **rest: object) -> tuple[np.ndarray, np.ndarray]:
        """Those of one of the markers of records."""
        draw = getattr(self.markers, kind)
        return self.drawn(lambda target: draw(target, self.view, records, settings=settings, scene=self.scene, **rest))


@pytest.fixture
def stage(ctx: moderngl.Context) -> Iterator[Callable[..., Stage]]:
    """Makes stages of meshes and a camera."""
    made: list[Stage] = []

    def stage(*meshes: object, camera: Camera = OBLIQUE) -> Stage:
        renderer = Renderer(worlds.scene(*meshes, camera=camera), SIZE, ctx=ctx, bounces=0)  # type: ignore[arg-type]
        made.append(Stage(renderer, renderer.frame()[0], Markers(ctx), Target(ctx, SIZE, (4,))))
        return made[-1]

    yield stage
    ctx.detect_framebuffer(0).use()
    for one in made:
        one.renderer.release()
        one.markers.release()
        one.target.release()


def records(ctx: moderngl.Context, p: object, n: object = (0.0, 1.0, 0.0), R: object = 0.5) -> Records:
    """Records at p (N, 3) with radii R, of unit irradiance that changes nowhere."""
    where = worlds.sites(p, n)
    values = np.concatenate([np.ones((len(where), 3)), np.broadcast_to(R, len(where))[:, None]], axis=1)  # type: ignore[call-overload]
    cache = RecordCache(ctx)
    cache.append(where, values.astype("f4"))
    return cache.records


def project(camera: Camera, p: np.ndarray) -> np.ndarray:
    """(N, 2) pixels, x and y from the upper left corner, of world points (N, 3)."""
    x, y, z = camera.axes @ (np.atleast_2d(p) - camera.eye).T
    half = np.tan(np.radians(camera.fov) / 2.0) * -z
    width, height = SIZE
    return np.stack([(x / half * height / width + 1.0) * width / 2.0, (1.0 - y / half) * height / 2.0], -1)


def texels(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels that points (N, 2) lie in."""
    x, y = np.floor(points).astype(int).T
    return y, x


def distance_to(points: np.ndarray, lit: np.ndarray) -> np.ndarray:
    """Of every lit pixel the distance in pixels from its centre to the nearest of `points` (N, 2)."""
    y, x = np.nonzero(lit)
    centres = np.stack([x, y], -1) + 0.5
    return np.linalg.norm(centres[:, None] - points[None], axis=-1).min(1)


def grown(lit: np.ndarray) -> np.ndarray:
    """Where a pixel or one of its eight neighbours is lit."""
    return np.any([np.roll(lit, (dy, dx), (0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)], axis=0)


# ---- dots -------------------------------------------------------------------------------------------------------------


def test_a_dot_marks_its_record_s_pixel(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """In the colour of its radius: of a·R on a logarithmic scale; nothing lies farther from it than a dot's few pixels."""
    world = stage(worlds.floor())
    p, R = np.array([(-0.8, 0, 0.4), (0.3, 0, -0.5), (0.9, 0, 0.9)]), np.array([0.05, 0.4, 1.2])
    picture, lit = world.marks("points", records(ctx, p, R=R))
    low, high = radius_range(FREE, world.scene)
    expected = viridis(np.log(FREE.a * R / low) / np.log(high / low))
    at = project(OBLIQUE, p)
    assert np.abs(picture[texels(at)] - expected).max() < 0.02
    assert distance_to(at, lit).max() < 6.0 and 3 * 20 < lit.sum() < 3 * 100
    bar = radius_legend(FREE, world.scene, "radius", 3)
    assert (float(bar.low), float(bar.high)) == pytest.approx((low, high), rel=0.05) and bar.unit == "m"


def test_old_and_new_records_have_the_ends_of_the_scale(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    world = stage(worlds.floor())
    p = np.array([(-0.8, 0, 0), (0, 0, 0), (0.8, 0, 0)])
    picture, _ = world.marks("points", records(ctx, p), by="age")
    assert np.abs(picture[texels(project(OBLIQUE, p))] - viridis(np.array([0.0, 0.5, 1.0]))).max() < 0.02
    assert radius_legend(FREE, world.scene, "age", 3).high == "2"
    _, lit = world.marks("points", records(ctx, p[:1]), by="age")
    assert lit.any(), "one alone is old and new"


@pytest.mark.parametrize("kind", ["points", "discs", "normals"])
def test_what_a_surface_hides_is_not_marked(ctx: moderngl.Context, stage: Callable[..., Stage], kind: str) -> None:
    """A wall stands at z = 1 between the eye and the first record; the second lies under the floor, the third behind the eye."""
    world = stage(worlds.floor(3.0), worlds.quad((-2, 0, 1), (4, 0, 0), (0, 1, 0)))
    _, lit = world.marks(kind, records(ctx, [(0.2, 0, 0.5), (0.1, -0.4, 1.5), (0, 1.6, 8)], R=0.3))
    assert not lit.any()
    _, lit = world.marks(kind, records(ctx, [(0.2, 0, 1.5)], R=0.3))
    assert lit.any(), "before the wall it is seen"
    assert not world.marks(kind, records(ctx, np.zeros((0, 3))))[1].any(), "and no records are no marks"


def test_no_dot_hides_in_its_own_surface(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """The floor is seen at two degrees, where its depth differs by half a metre from one pixel's row to the next."""
    world = stage(worlds.floor(), camera=GRAZING)
    rng = np.random.default_rng(4)
    p = np.stack([rng.uniform(-0.9, 0.9, 40), np.zeros(40), rng.uniform(-1.9, 1.9, 40)], -1)
    for one in p:
        picture, _ = world.marks("points", records(ctx, one, R=1.0))
        assert np.ptp(picture[texels(project(GRAZING, one))]) > 0.1, f"no coloured dot at {one}"


def test_no_dot_hides_in_a_curved_surface(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """Where a ball of 48 by 24 facets is seen, each facet's centre is a dot: a pixel's own centre may lie on the next facet."""
    ball, camera = worlds.sphere((0, 0, 0), 1.0), Camera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov=40.0)
    world = stage(ball, camera=camera)
    centres = ball.positions[ball.faces].astype(float).mean(1)
    facing = ((camera.eye - centres) * centres).sum(1) > 0.5
    for one in centres[facing][::7]:
        picture, _ = world.marks("points", records(ctx, one, one, R=1.0))
        assert np.ptp(picture[texels(project(camera, one))]) > 0.1, f"no coloured dot at {one}"


# ---- circles and normals ----------------------------------------------------------------------------------------------


def circle(p: np.ndarray, r: float, count: int = 4000) -> np.ndarray:
    """Points of the circle of radius r about p in the plane of the floor."""
    return ellipse(p, np.array([r, 0.0, 0.0]), np.array([0.0, 0.0, r]), count)


def ellipse(p: np.ndarray, along: np.ndarray, across: np.ndarray, count: int = 4000) -> np.ndarray:
    """Points of the ellipse of these half axes about p."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    return p + np.cos(angle) * along + np.sin(angle) * across


@pytest.mark.parametrize(
    "settings",
    [FREE, replace(FREE, a=0.8), replace(FREE, radius_max=6.0), replace(FREE, radius_min=20.0)],
    ids=["a·R", "another a", "greatest", "least"],
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
    at = project(camera, circle(p, r))
    assert distance_to(at, lit).max() < 2.3 + 0.5  # half a line's width, half a pixel's diagonal, and straight pieces
    assert grown(lit)[texels(at)].all()


@pytest.mark.parametrize("n", [(0, 0, 1), (0, 0, -1)])
def test_a_wall_just_before_a_disc_hides_it(ctx: moderngl.Context, stage: Callable[..., Stage], n: tuple[int, int, int]) -> None:
    """The disc stands upright, half a metre wide, a tenth of a metre behind the wall, whichever way its record looks."""
    wall = worlds.quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))
    _, lit = stage(wall).marks("discs", records(ctx, (0, 0, -0.1), n, R=1.0))
    assert not lit.any()
    _, lit = stage(wall).marks("discs", records(ctx, (0, 0, 0), n, R=1.0))
    assert lit.any()


def test_a_wall_far_before_a_disc_hides_it(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """The floor is seen at half a degree, so that a wall two metres nearer is hardly in front of the disc's plane."""
    flat = Camera((0.0, 0.03, 4.0), (0.0, 0.0, 0.0), fov=40.0)
    world = stage(worlds.floor(3.5), worlds.quad((-2, 0, 1), (4, 0, 0), (0, 1, 0)), camera=flat)
    _, lit = world.marks("discs", records(ctx, (0.1, 0, -1.0), R=0.6))
    assert not lit.any()


def test_no_disc_hides_in_a_curved_surface(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """A disc touches a ball from outside; inside a ball of radius 1 it dips under by r²/2: more than a pixel for r = 0.2."""
    for radius, inside, r in ((1.0, False, 0.4), (1.0, True, 0.2)):
        ball = worlds.sphere((0, 0, 0), radius, rings=64, segments=128)
        camera = Camera((0.0, 0.4 if inside else 4.0, 0.0), (0.0, -1.0, 0.02), fov=60.0 if inside else 40.0)
        world, p = stage(ball, camera=camera), np.array([0.0, -radius if inside else radius, 0.0])
        _, lit = world.marks("discs", records(ctx, p, R=r / FREE.a))
        assert lit[texels(project(camera, circle(p, r)))].mean() > 0.99


def test_a_disc_reaches_less_far_where_light_changes_fast(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """R ≤ E/|∇E|: E is 1 and the gradient 4 per metre in all channels, so that R is ¼ m instead of 0.9."""
    world, p = stage(worlds.floor(4.0)), np.array([0.2, 0.0, 0.3])
    made = records(ctx, p, R=0.9)
    worlds.write_columns(made, 0, gradient=np.tile([4.0, 0.0, 0.0], (1, 3, 1)))
    for settings, r in ((FREE, FREE.a * 0.25), (replace(FREE, gradients=False), FREE.a * 0.9)):
        _, lit = world.marks("discs", made, settings)
        assert distance_to(project(OBLIQUE, circle(p, r)), lit).max() < 2.5
        assert lit.any()


@pytest.mark.parametrize("camera", [OBLIQUE, GRAZING], ids=["oblique", "grazing"])
def test_a_disc_of_a_record_with_known_curvature_is_an_ellipse(
    ctx: moderngl.Context, stage: Callable[..., Stage], camera: Camera
) -> None:
    """Of a·√(2/|bend|) along its axis and across it, the share that is allowed of both; a circle of R_k by `radius` harmonic."""
    world, p = stage(worlds.floor(4.0), camera=camera), np.array([0.2, 0.0, 0.3])
    axis, radii, share = np.array([0.8, 0.0, 0.6]), np.array([2.0, 0.5]), 0.75
    made = records(ctx, p, R=0.9)

    curvature = np.array([[2.0, -2.0]]) / radii**2
    worlds.write_columns(made, 0, axis=axis[None], curvature=curvature, max_radius=np.array([100.0]), limit=np.array([share]))
    along, across = FREE.a * share * radii[:, None] * np.stack([axis, np.cross((0, 1, 0), axis)])
    rounds = {"hessian": ellipse(p, along, across), "harmonic": circle(p, FREE.a * share * 0.9)}
    for radius, around in rounds.items():
        _, lit = world.marks("discs", made, replace(FREE, radius=radius))
        at = project(camera, around)
        assert distance_to(at, lit).max() < 2.3 + 0.5, radius
        inside = at[(at >= 0.0).all(-1) & (at < SIZE).all(-1)]
        assert grown(lit)[texels(inside)].all()


def test_a_normal_rises_from_its_record(ctx: moderngl.Context, stage: Callable[..., Stage]) -> None:
    """By 3 % of the image's height at the record's distance, straight up from the floor: no pixel is lit far from that line."""
    world, p = stage(worlds.floor()), np.array([0.3, 0.0, 0.2])
    rise = 0.03 * 2.0 * np.tan(np.radians(OBLIQUE.fov) / 2.0) * np.linalg.norm(p - OBLIQUE.eye)
    line = p + np.linspace(0.0, rise, 200)[:, None] * np.array([0.0, 1.0, 0.0])
    _, lit = world.marks("normals", records(ctx, p))
    at = project(OBLIQUE, line)
    assert distance_to(at, lit).max() < 2.3
    assert lit[texels(at[5:-20])].all() and np.ptp(np.nonzero(lit)[0]) >= 2


# ---- edges ------------------------------------------------------------------------------------------------------------


def edges_of(world: Stage, **rest: object) -> tuple[np.ndarray, np.ndarray]:
    geometry = world.renderer.world.geometry
    return world.drawn(lambda target: world.markers.wireframe(target, world.view, geometry, **rest))  # type: ignore[arg-type]


def test_the_wireframe_is_the_visible_edges(stage: Callable[..., Stage]) -> None:
    """Of a square floor its four sides and one diagonal; a box that stands behind a wall shows nothing of itself."""
    world = stage(worlds.floor(1.0))
    c = np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], float)
    t = np.linspace(0.0, 1.0, 500)[:, None]
    edges = np.concatenate([a + t * (b - a) for a, b in ((c[0], c[1]), (c[1], c[2]), (c[2], c[3]), (c[3], c[0]), (c[0], c[2]))])
    at = project(OBLIQUE, edges)
    _, lit = edges_of(world)
    assert distance_to(at, lit).max() < 1.5
    assert grown(lit)[texels(at)].all(), "no edge is missing"

    wall = worlds.quad((-3, -1, 2), (6, 0, 0), (0, 4, 0))
    alone, hiding = stage(wall), stage(wall, worlds.box((-0.3, 0.2, -0.3), (0.3, 0.8, 0.3)))
    assert np.array_equal(edges_of(alone)[0], edges_of(hiding)[0])
    assert not alone.renderer.ctx.wireframe


# ---- what a record serves ---------------------------------------------------------------------------------------------


def served(frame: irrsplat.Frame, records: Records, number: int, camera: Camera, settings: Settings) -> np.ndarray:
    """(2, H, W): the pixels that a record speaks for, by Ward et al. 1988's w > 1/a, and those where rounding decides."""
    names = ("position", "normal", "irradiance", "axis", "curvature", "max_radius", "walls", "limit")
    p, n, e, axis, curvature, max_radius, walls, share = (
        column[number].astype(float) for column in records.read(*names).values()
    )
    percent = 2.0 * np.tan(np.radians(camera.fov) / 2.0) * np.linalg.norm(p - camera.eye) / 100.0
    Y = e @ (0.2126, 0.7152, 0.0722)
    radii = np.minimum(np.sqrt(2.0 * worlds.error_scale(Y, records.luminance_floor) / Y / np.abs(curvature)), max_radius) * share
    R = np.clip(settings.a * radii, settings.radius_min * percent, settings.radius_max * percent) / settings.a
    apart, cosine = frame.position - p, frame.normal @ n
    along = apart @ axis
    distance = np.sqrt((along / R[0]) ** 2 + ((apart**2).sum(-1) - along**2) / R[1] ** 2)
    w = 1.0 / np.maximum(distance + np.sqrt(np.maximum(0.0, 1.0 - cosine)), 1e-3)
    place = np.stack([along, apart @ np.cross(n, axis)], -1)
    beyond = np.maximum(place @ walls[:2], place @ walls[2:])
    front = 0.05 * R[1] - np.abs((apart * (frame.normal + n)).sum(-1)) / 2.0
    seen = np.isfinite(frame.depth)
    # 1 - n·n_k of float32 normals is off by some 1e-7, its root by some 3e-4
    unsure = seen & ((np.abs(w * settings.a - 1.0) < 2e-3) | (np.abs(front) < 1e-4 * R[1]) | (np.abs(beyond - 1.0) < 1e-4))
    return np.stack([seen & (w > 1.0 / settings.a) & (front >= 0.0) & (cosine > 0.0) & (beyond <= 1.0), unsure])


def test_what_a_record_serves_is_tinted_and_counted(ctx: moderngl.Context) -> None:
    with Renderer(irrsplat.load("cornell"), SIZE, ctx=ctx, bounces=1, gather_size=16, shadow_size=128) as renderer:
        for _ in range(3):
            view, _ = renderer.frame()
        frame = read(view, renderer.cache.read(), {})
        settings, made = renderer.settings, renderer.cache.records
        world = Stage(renderer, view, Markers(ctx), Target(ctx, SIZE, (4,)))
        counts: list[int] = []

        def draw(number: int, **rest: object) -> np.ndarray:
            def serve(target: Target) -> None:
                counts.append(world.markers.serves(target, view, made, number, settings=settings, **rest))  # type: ignore[arg-type]

            return world.drawn(serve)[1]

        for number in np.random.default_rng(5).integers(0, made.count, 25):
            expected, unsure = served(frame, made, int(number), view.camera, settings)
            lit = draw(int(number))
            assert np.array_equal(lit[~unsure], expected[~unsure])
            assert counts[-1] == lit.sum() > 0
            left = draw(int(number), region=(0, 0, 70, SIZE[1]))
            draw(int(number), region=(70, 0, SIZE[0] - 70, SIZE[1]))
            assert not left[:, 70:].any() and counts[-1] + counts[-2] == counts[-3]
        assert not draw(made.count).any() and counts[-1] == 0, "there is no such record"
        world.target.release()
        world.markers.release()


@pytest.mark.parametrize("kind", ["points", "discs", "normals", "wireframe"])
def test_a_region_bounds_the_markers(ctx: moderngl.Context, stage: Callable[..., Stage], kind: str) -> None:
    """And what lies inside is what lies there without it."""
    world, region = stage(worlds.floor()), (30, 20, 60, 50)
    p = np.stack(np.meshgrid(np.linspace(-1.5, 1.5, 9), [0.0], np.linspace(-1.5, 1.5, 9)), -1).reshape(-1, 3)
    inside = np.zeros((SIZE[1], SIZE[0]), bool)
    inside[SIZE[1] - 20 - 50 : SIZE[1] - 20, 30 : 30 + 60] = True
    pictures = []
    for within in (None, region):
        drawn = edges_of(world, region=within) if kind == "wireframe" else world.marks(kind, records(ctx, p), region=within)
        picture, _ = drawn
        pictures.append(picture.copy())
    whole, part = pictures
    assert (part[~inside] == np.array(GROUND, "f4")).all() and np.array_equal(part[inside], whole[inside])
    assert (whole[~inside] != np.array(GROUND, "f4")).any()
