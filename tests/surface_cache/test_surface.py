"""Surface cache: cells and their points, shared sites, visibility, and lookups."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from irrsplat import Renderer, irradiance, make_mesh, render
from irrsplat.core.buffers import Sites
from irrsplat.core.vertex_layout import PARTS, WIDTH, vertex_column
from irrsplat.gpu.target import pixels
from irrsplat.gpu.time_budget import Budget
from irrsplat.gpu.world import World
from irrsplat.scene.appearance import flatten
from irrsplat.scene.emitters import unlit_interiors
from irrsplat.scene.model import Camera, Scene
from irrsplat.surface_cache import clustering, tessellation
from irrsplat.surface_cache.cache import SurfaceCache
from irrsplat.surface_cache.clustering import Clusters
from irrsplat.surface_cache.site_layout import Detail, SiteChooser, detail_for
from irrsplat.surface_cache.site_rays import VisibilityPass
from irrsplat.surface_cache.tessellation import Grading, Tessellation, steps, tessellate
from tests.renderer.test_renderer import FAST
from tests.support.worlds import box, floor, gather, material, point_light, quad, scene, sites, sphere

SIZE = (80, 60)
INSET = 1e-4  # metres


def cut(world: Scene, spacing: float) -> Tessellation:
    return tessellate(*flatten(world), spacing, INSET)


# ---- cells ------------------------------------------------------------------------------------------------------------


def test_a_triangle_has_as_many_steps_as_its_longest_edge_needs() -> None:
    """1000 triangles of 100 m have fewer steps than 10 000 each: together they have half of the most cells or more."""
    assert steps(np.array([0.1, 1.0, 1.01, 7.5]), np.ones(4)).tolist() == [1, 1, 2, 8]
    many = steps(np.full(1000, 100.0), np.full(1000, 0.01))
    assert 1000 + (1 << 16) < (many**2).sum() <= 1000 + (1 << 17)


def test_slivers_do_not_widen_the_steps_of_other_triangles() -> None:
    """200 planks of 60 m by 1 cm would have 18 million cells of a lattice, nearly all of which lie within 1 cm of another.

    Other triangles, of 10 m, have 50 steps of 0.2 m.
    """
    planks = [quad((0, 0, i), (60, 0, 0), (0, 0, 0.01)) for i in range(200)]
    found = cut(scene(*planks, *(quad((0, i, 0), (6, 0, 0), (0, 0, 8)) for i in range(5))), 0.2)
    assert (found.table[400:410, 0] == 50).all() and (found.table[:400, 0] <= -100).all()


def test_cells_fill_their_triangles() -> None:
    """A floor of 4×2 m in steps of at most 1 m (n = 5 for edges of √20 m) has n² cells per triangle, of (n + 1)(n + 2)/2 points.
    Each point has a third of the cells at it, and every point of the triangle lies in a cell."""
    found = cut(scene(quad((0, 0, 0), (0, 0, 2), (4, 0, 0))), 1.0)
    assert len(found.corners) == 50 and len(found.position) == 42 and found.table.tolist() == [[5, 0], [5, 25]]
    assert np.allclose(found.area, np.bincount(found.corners.ravel()) * 8.0 / 150) and (found.face[found.corners[25:]] == 1).all()
    assert np.allclose(found.geometric, (0, 1, 0)) and np.allclose(found.normal, (0, 1, 0))
    corners = found.position[found.corners][..., [0, 2]].astype(float)
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    assert np.allclose(0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]), 8.0 / 50, rtol=1e-2)
    points = np.random.default_rng(0).uniform((0.01, 0.01), (3.99, 1.99), (400, 2))
    share, _ = inside(corners[None], points[:, None])
    assert ((share.min(-1) > -0.002).sum(1) >= 1).all() and ((share.min(-1) > 0.002).sum(1) <= 1).all()


def inside(corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return barycentric coordinates (…, 3) of points (…, 2) in triangles (…, 3, 2), and the triangles' doubled areas."""
    a, b, c = (corners[..., k, :] - points for k in range(3))
    parts = np.stack([x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0] for x, y in ((b, c), (c, a), (a, b))], axis=-1)
    whole = parts.sum(-1, keepdims=True)
    return parts / whole, whole[..., 0]


@pytest.mark.parametrize("corner", range(3))
def test_strips_cross_the_long_edges_of_a_sliver(corner: int) -> None:
    """A sliver of 10 m by 10 cm, whose longest edge is √100.01 m, has 21 strips for steps of 0.5 m: 2·21 - 1 parts of one cell.

    The parts fill the sliver, wherever its corners begin. In place of 21² cells, none is longer than a step.
    """
    sliver = np.zeros((3, WIDTH), np.float32)
    sliver[:, PARTS["position"]], sliver[:, PARTS["normal"]] = [(10, 0, 0.1), (0, 0, 0), (10, 0, 0)], (0, -1, 0)
    found = tessellate(np.roll(sliver, corner, axis=0), np.array([[0, 1, 2]]), 0.5, 0.0)
    parts = found.position[found.corners]
    size = 0.5 * np.linalg.norm(np.cross(parts[:, 1] - parts[:, 0], parts[:, 2] - parts[:, 0]), axis=1)
    assert found.table[0].tolist() == [-21 - 0.25 * ((corner + 1) % 3 + 1), 1] and len(found.corners) == 41
    longest = max(np.linalg.norm(parts[:, k] - parts[:, k - 1], axis=-1).max() for k in range(3))
    assert size.sum() == pytest.approx(0.5) and longest <= 0.5 and np.allclose(found.geometric, (0, -1, 0))
    many = tessellate(sliver, np.tile([0, 1, 2], (10_000, 1)), 0.5, 0.0)
    assert len(many.corners) <= 2 * tessellation._MAX_CELLS, "wires, such as a fence, have no strips beyond the limit of cells"


def test_planks_of_a_corridor_give_the_light_of_one_floor() -> None:
    """A floor of 100 planks of 60 m has the light of one rectangle within 4 %.

    With cells longer than wide, the corridor is 5 to 8 % brighter with 50 to 200 planks.
    """
    found = []
    for count in (1, 100):
        width = 2.0 / count
        planks = [quad((-1 + i * width, 0, -30), (0, 0, 60), (width, 0, 0)) for i in range(count)]
        shell = [quad((-1, 2.6, -30), (2, 0, 0), (0, 0, 60), material(0.8))]
        shell += [quad((x, 0, -30), (0, 0, 60), (0, 2.6, 0), material(0.8)) for x in (-1, 1)]
        shell += [quad((-1, 0, z), (2, 0, 0), (0, 2.6, 0), material(0.8)) for z in (-30, 30)]
        lights = tuple(point_light((0, 2.3, z), 4.0) for z in (-20, 0, 20))
        eye = Camera((0.6, 1.5, 29), (0, 1.2, 0), fov=65.0)
        found.append(render(scene(*planks, *shell, lights=lights, camera=eye), (32, 24)).irradiance.mean())
    assert found[1] == pytest.approx(found[0], rel=0.04)


def test_a_camera_in_a_wall_has_no_effect_on_the_light_of_a_room() -> None:
    """Rays of a camera in a wall end at once. Without a least density of cells, each triangle was one cell.

    Only reflected skylight reaches the floor behind the partition. With one cell per triangle, it was 2.5 times as bright.
    """
    paint, light = material(0.8), []
    shell = [quad((0, 0, 0), (0, 0, 4), (8, 0, 0), paint), quad((2, 3, 0), (6, 0, 0), (0, 0, 4), paint)]
    shell += [quad((x, 0, 0), (0, 3, 0), (0, 0, 4), paint) for x in (0, 8)]
    shell += [quad((0, 0, z), (8, 0, 0), (0, 3, 0), paint) for z in (0, 4)]
    for eye in ((2.0, 1.5, 1.0), (0.0, 1.5, 1.0)):
        room = scene(*shell, box((3.9, 0, 0), (4.1, 3, 2.9), paint), sky=10.0, camera=Camera(eye, (4, 1.2, 2)))
        light.append(irradiance(room, [(6.0, 0.0, 2.0)], (0.0, 1.0, 0.0), "default"))
    assert light[1] == pytest.approx(light[0], rel=0.05)


def test_steps_are_short_near_a_small_light() -> None:
    """Above a floor of two triangles, steps close to a light 10 cm away are an eighth of the usual 0.5 m: 0.0625 < 0.1 < 0.125.

    The parts fill both triangles, and their cells come after those of no other triangle: each has its own row of the table.
    """
    ground = scene(quad((0, 0, 0), (0, 0, 4), (4, 0, 0)))
    found = tessellate(*flatten(ground), 0.5, INSET, np.array([[1.0, 0.1, 2.0, 0.0]]))
    whole, parts = found.table[:2], found.table[2:]
    assert (whole[:, 0] == [-12, -12]).all() and whole[:, 1].tolist() == [2, 2 + 12**2], "n = 12 for edges of √32 m"
    assert (
        len(parts) == 2 * 12**2 and (np.diff(parts[:, 1]) == parts[:-1, 0] ** 2).all() and found.area.sum() == pytest.approx(16)
    )
    corners = found.position[found.corners].astype(float)
    longest = max(np.linalg.norm(corners[:, i] - corners[:, j], axis=-1).max() for i, j in ((0, 1), (1, 2), (2, 0)))
    middle = corners.mean(1)
    edges = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=-1)
    near, far = (
        edges[(np.linalg.norm(middle - (1, 0.1, 2), axis=-1) < r) == inside].max() for r, inside in ((0.15, True), (1, False))
    )
    assert near < 0.07 and far > 0.3 and longest <= 0.5
    assert found.level.max() == 3 and not found.level[found.position[:, 0] > 2.5].any()


def test_steps_on_a_vast_ground_are_short_around_a_view() -> None:
    """A ground of 400 m is two triangles. Steps of 0.5 m are at most twice as long up to three times the extent of the room.

    With one density for each triangle, cells had tens of metres there: furniture hid the few values of a room's floor.
    """
    ground = scene(quad((-200, 0, -200), (0, 0, 400), (400, 0, 0)))
    vertices, faces = flatten(ground)
    graded, area = Grading(np.array([[0.0, 1.6, 0.0]]), np.array([3.0])).graded(vertex_column(vertices, "position")[faces])
    found = tessellate(vertices, faces, 0.5, INSET, graded=graded)
    corners = found.position[found.corners].astype(float)
    longest = np.max([np.linalg.norm(corners[:, k] - corners[:, k - 1], axis=-1) for k in range(3)], axis=0)
    away = np.linalg.norm(corners.mean(1)[:, [0, 2]], axis=-1)
    assert longest[away < 7.0].max() <= 1.0 and np.count_nonzero(away > 100.0) < 2000, "a part has one cell there"
    assert found.area.sum() == pytest.approx(160_000, rel=1e-4) and area < 2000.0 and len(found.corners) < 20_000


def site_positions(renderer: Renderer) -> np.ndarray:
    """Return (S, 3) the positions of the sites of the full surface cache."""
    surface = renderer.scheduler.gatherer.surface
    assert surface is not None and surface.level.shown is not None
    return surface.level.shown.records.positions.copy()


def test_sites_follow_the_view_and_not_the_cameras_of_the_scene() -> None:
    """A view of a room has the sites of a scene with its camera, also after a view of the vast ground around the room."""
    shell = [quad((-3, 0, -3), (0, 2.5, 0), (6, 0, 0)), quad((-3, 2.5, -3), (0, 0, 6), (6, 0, 0)), floor(100.0)]
    inside, outside = Camera((1, 1.6, 2), (0, 1, -3)), Camera((40, 20, 60), (0, 1, 0))
    found = []
    for own, before in ((inside, None), (outside, None), (outside, outside)):
        with Renderer(scene(*shell, sky=1.0, camera=own), size=(24, 16), preset="preview") as renderer:
            if before is not None:
                renderer.render(before)
            renderer.render(inside)
            found.append(site_positions(renderer))
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])


def test_a_distant_town_leaves_a_room_its_sites() -> None:
    """A town of 1591 houses has 32 000 corners of its own, as many as sites at most. One cell spans a distant house.

    A room of 6 m has 100 m² of surfaces and steps of 6 m/9 or less: at least 2·100·(9/6)² = 450 corners, 100 of them visible as
    sites in preview's coarse surface cache. Where all clusters grew until the town fitted, the room had 9.
    """
    town = [(x, z) for x in range(-200, 200, 10) for z in range(-200, 200, 10) if max(abs(x), abs(z)) > 12]
    houses = [box((x, 0, z), (x + 7, 12 + x % 5, z + 7)) for x, z in town]
    corners = len(houses[0].positions)
    faces = np.concatenate([house.faces + k * corners for k, house in enumerate(houses)])
    far = make_mesh(np.concatenate([house.positions for house in houses]), faces, crease_angle=0.0)
    shell = [quad((-3, 0, -3), (0, 2.5, 0), (6, 0, 0)), quad((-3, 2.5, -3), (0, 0, 6), (6, 0, 0)), floor(200.0)]
    with Renderer(
        scene(far, *shell, sky=1.0, camera=Camera((1, 1.6, 2), (0, 1, -3))), size=(24, 16), preset="preview"
    ) as renderer:
        renderer.render()
        found = site_positions(renderer)
    assert np.count_nonzero(np.linalg.norm(found - [0, 1, 0], axis=1) < 4.0) >= 100


@pytest.mark.parametrize(("room", "suits"), [(20.0, True), (2.0, True), (1.0, False)])
def test_sites_stay_unless_a_view_would_shorten_their_steps_to_a_quarter(room: float, suits: bool) -> None:
    """The first place has surroundings of 8 m, and its steps have one length up to 24 m; at 48 m, they are four times as long."""
    grading = Grading(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.array([8.0, 1.0]))
    assert grading.suits(np.array([20.0, 0.0, 0.0]), room, 1000.0) == suits
    assert grading.suits(np.array([48.0, 0.0, 0.0]), 4.0 * room, 1000.0) == suits
    assert grading.suits(np.array([20.0, 0.0, 0.0]), room, 12.0), "a smaller scene than the reach has one length of steps"


def test_a_luminous_dome_leaves_the_sites_in_the_room() -> None:
    """The middle of the dome is a place, too. Its surroundings of 300 m took sites from the room."""
    paint, dome = material(0.8), sphere((0, 40, 0), 300.0, material(0.0, 1.0))
    room = [box((-3, 0, -2), (3, 2.5, 2), paint, outward=False), box((0, 0, 0), (1, 1, 1), paint), floor(200.0)]
    found = []
    for around in ([], [dome]):
        world = scene(*room, *around, lights=(point_light((0, 2, 0), 1.0),), camera=Camera((-2, 1.6, 1), (0, 1, 0)))
        with Renderer(world, size=(8, 8)) as renderer:
            renderer.render()
            found.append(np.count_nonzero((np.abs(site_positions(renderer)) <= (3.1, 2.6, 2.1)).all(1)))
    assert found[1] > 0.5 * found[0], found


# ---- sites ------------------------------------------------------------------------------------------------------------


def test_what_no_light_reaches() -> None:
    """The inside of a closed box is dark unless it emits or contains a light or an emitter; that of an open box may be lit."""
    case = box((0, 0, 0), (1, 1, 1))
    assert unlit_interiors(scene(floor(), case)) == (True, False), "closed ones come first"
    assert not unlit_interiors(scene(case, lights=(point_light((0.5, 0.5, 0.5)),)))[0]
    assert unlit_interiors(scene(case, lights=(point_light((0.5, 1.5, 0.5)),)))[0]
    assert not unlit_interiors(scene(box((0, 0, 0), (1, 1, 1), material(0.5, 1.0))))[0]
    assert not unlit_interiors(scene(case, quad((0.2, 0.2, 0.2), (0.1, 0, 0), (0, 0, 0.1), material(0.0, 1.0))))[0]
    assert not unlit_interiors(scene(box((0, 0, 0), (1, 1, 1), outward=False)))[0]


def test_what_stands_in_the_way(ctx: moderngl.Context) -> None:
    """Straight lines past a wall, through it and below it; tangents over a ball, by rays in a shader and by Embree."""
    wall, sight = World(ctx, scene(quad((0, 0, -1), (0, 0, 2), (0, 1, 0)))), VisibilityPass(ctx)
    ends = np.tile([[0.5, 0.5, 0.0], [0.0, 1.2, 0.0], [-0.5, 0.5, 0.0]], (300, 1))
    for reach in (lambda *ends: sight(wall.ray_uniforms, *ends), wall.caster.reach):
        assert np.allclose(reach(np.tile(ends[2], (900, 1)), ends), np.tile([0.5, 1.0, 1.0], 300), atol=1e-6)
    tessellation = cut(scene(sphere((0, 0, 0), 1.0)), 2.0)
    every, high = np.arange(len(tessellation.face)), scene(quad((-5, 0, 0), (10, 0, 0), (0, 0, 0.1)))  # eyes a millimetre up
    some, ball = clustering.both_sides(tessellation, every), World(ctx, scene(sphere((0, 0, 0), 1.0)))
    pairs = np.random.default_rng(4).integers(0, len(every), (2000, 2)).T
    near = pairs[:, (some.geometric[pairs[0]] * some.geometric[pairs[1]]).sum(1) > 0.5]
    near = np.concatenate([near, near + len(every)], axis=1)
    for reach in (lambda *ends: sight(ball.ray_uniforms, *ends), ball.caster.reach):
        chooser = SiteChooser(high, reach, Detail(), np.zeros((0, 3)))
        assert np.all(Budget(None).advance(chooser.see(some, near[0], near[1]))), "outside over the bulge, inside straight"
        assert not np.any(Budget(None).advance(chooser.see(some, pairs[0], pairs[0] + len(every)))), "never through it"
    for gap, through in ((0.05, False), (0.5, True)):  # metres below a wall between two points that are 1 m apart on a floor
        gate, up = World(ctx, scene(quad((0, gap, -1), (0, 0, 2), (0, 1, 0)))), np.tile(np.array([0, 1, 0], np.float32), (2, 1))
        at = np.array([[-0.5, 0, 0], [0.5, 0, 0]], np.float32)
        points = Sites(at, up, up)
        chooser = SiteChooser(high, gate.caster.reach, Detail(), np.zeros((0, 3)))
        assert Budget(None).advance(chooser.see(points, np.array([0]), np.array([1]))) == [through]


# ---- lookups ----------------------------------------------------------------------------------------------------------


def clusters(world: World, detail: Detail) -> Clusters:
    """Return the members that the sites of a surface cache of this `detail` represent."""
    chooser = SiteChooser(world.scene, world.caster.reach, detail, world.eyes)
    grading = Budget(None).advance(chooser.grading())
    assert grading is not None
    made = chooser.clusters(grading)
    assert made is not None
    return made


def test_steps_are_short_along_a_long_strip_light(ctx: moderngl.Context) -> None:
    """Below a strip of 30 m by 4 cm, steps of 18 cm are halved twice everywhere, not only below every second part."""
    strip = quad((-15, 0.05, -0.02), (30, 0, 0), (0, 0, 0.04), material(0.5, 10.0))
    world = World(ctx, scene(quad((-16, 0, -1), (32, 0, 0), (0, 0, 2)), strip))
    cells = clusters(world, Detail()).tessellation
    below = (np.abs(cells.position) < (14.5, 0.01, 0.1)).all(1)
    assert (cells.level[below] == 2).all()


def oracle(
    cache: SurfaceCache, cut: Tessellation, values: np.ndarray, p: np.ndarray, triangle: np.ndarray, side: np.ndarray
) -> np.ndarray:
    """Return (N, 3): the mean of the corner values of the cell that contains the point, among all cells of its triangle."""
    triangles = cache.world.geometry.corners.astype(float)
    assert cache.in_use.shown is not None
    numbers = np.frombuffer(cache.in_use.shown.cells.read(), "f4").reshape(-1, 2, 4)
    n = cut.table[:, 0].astype(int)
    out = np.zeros((len(p), 3))
    for i, (point, t, s) in enumerate(zip(p, triangle, side, strict=True)):
        rows = int(cut.table[t, 1]) + np.arange(n[t] ** 2) if n[t] < 0 else np.array([t])  # of its parts, if it has any
        first = int(cut.table[rows[0], 1])
        cells = slice(first, int(cut.table[rows[-1], 1]) + n[rows[-1]] ** 2)
        right, up = triangles[t, 1:] - triangles[t, 0]
        basis = np.stack([right, np.cross(np.cross(right, up), right)], axis=1)
        basis /= np.linalg.norm(basis, axis=0)
        corners = (cut.position[cut.corners[cells]] - triangles[t, 0]) @ basis
        if n[t] == 1 and len(np.unique(cut.corners[cells])) == 1:
            out[i] = values[int(numbers[first, s, 0])]
            continue
        share, _ = inside(corners, ((point - triangles[t, 0]) @ basis)[None])
        best = int(np.argmax(share.min(1)))
        weight = np.maximum(share[best], 0.0) * (numbers[first + best, s, :3] >= 0.0)
        out[i] = weight @ values[numbers[first + best, s, :3].astype(int)] / max(weight.sum(), 1e-9)
    return out


def test_a_lookup_is_what_plain_sums_give(ctx: moderngl.Context) -> None:
    """A floor with a light close to it and a ball of small triangles; each site has a distinct value."""
    eye = Camera((0.5, 3.0, 2.5), (0.3, 0.0, 0.0), fov=60.0)
    world = scene(floor(1.5), sphere((0.6, 0.8, 0.2), 0.4), lights=(point_light((-0.4, 0.1, 0.5)),), camera=eye)
    with Renderer(world, SIZE, ctx=ctx, **{**FAST, "bounces": 2}) as renderer:
        renderer.frame(gather=False)
        cache = renderer.scheduler.gatherer.surface
        assert renderer.shadows is not None and cache is not None
        renderer.scheduler.gatherer.prepare(renderer.shadows, Budget(None))
        assert cache.in_use.shown is not None
        table = cache.in_use.shown.values
        values = np.random.default_rng(0).uniform(0.0, 1.0, (table.width * table.height, 3)).astype("f4")
        table.write(np.pad(values, ((0, 0), (0, 1))).tobytes())
        view, _ = renderer.frame(gather=False)
        found = pixels(cache.view(view.gbuffer)).reshape(-1, 4)
        position, normal, emission = (
            pixels(t).reshape(-1, 4) for t in (view.gbuffer.position, view.gbuffer.normal, view.gbuffer.emission)
        )
        seen = position[:, 3] > 0.0
        assert 0.2 < seen.mean() < 1.0 and (found[:, 3] == seen).all() and not found[~seen].any()
        triangle = emission[seen, 3].astype(int)
        right, up = (cache.world.geometry.corners[triangle, 1:] - cache.world.geometry.corners[triangle, :1]).swapaxes(0, 1)
        facing = np.cross(right, up)
        side = ((facing * normal[seen, :3]).sum(1) < 0.0).astype(int)
        tessellation = clusters(renderer.world, detail_for(renderer.settings)).tessellation
        assert (tessellation.table[triangle, 0] < 0.0).mean() > 0.3, "pixels of triangles that are cut into parts"
        expected = oracle(cache, tessellation, values, position[seen, :3].astype(float), triangle, side)
    off = np.abs(found[seen, :3] - expected).max(1)
    assert (off < 0.01).mean() > 0.99 and np.median(off) < 3e-3, "but for the inset of the points"


def test_no_dark_rim_about_a_box(ctx: moderngl.Context) -> None:
    """The floor under a box is dark, invisibly from outside: lookups next to the box are close to gathers."""
    grey = material(0.6)
    eye = Camera((1.2, 1.6, 1.4), (0.1, 0.0, 0.0), fov=50.0)
    parts = (box((-2, 0, -2), (2, 2, 2), grey, outward=False), box((-0.41, 0, -0.33), (0.37, 0.5, 0.29), grey))
    world = scene(*parts, lights=(point_light((0.6, 1.7, 0.8), 4.0),), camera=eye)
    with Renderer(world, (60, 60), ctx=ctx, **{**FAST, "bounces": 2, "shadow_size": 512, "gather_size": 32}) as renderer:
        view, _ = renderer.frame(gather=False)
        assert renderer.shadows is not None and renderer.scheduler.gatherer.surface is not None
        renderer.scheduler.gatherer.prepare(renderer.shadows, Budget(None))
        found = pixels(renderer.scheduler.gatherer.surface.view(view.gbuffer))[..., :3]
        p = pixels(view.gbuffer.position)
    beyond = np.max(np.abs(p[..., :3] - (-0.02, 0.0, -0.02)) - (0.39, 9.0, 0.31), axis=-1)  # metres from the box's foot
    rim = (p[..., 3] > 0.0) & (np.abs(p[..., 1]) < 1e-3) & (beyond > 0.002) & (beyond < 0.15)
    assert rim.sum() > 60
    E = gather(ctx, world, sites(p[rim, :3], (0, 1, 0)), 32, shadow=512).E
    ratio = found[rim].mean(1) / E.mean(1)
    assert ratio.min() > 0.6 and ratio.max() < 1.7 and np.median(ratio) == pytest.approx(1.0, abs=0.1)
