"""Direct light and shadows against formulas: no shadow acne and no leaks, at any slope and winding."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from irrsplat import irradiance as lit
from irrsplat import make_mesh, render
from irrsplat.gpu.world import World
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.lighting.direct import DirectPass
from irrsplat.lighting.light_table import light_defines, sheet
from irrsplat.lighting.shadow_maps import ShadowPass
from irrsplat.scene.model import Camera, Light, Mesh, Scene
from tests.gather.test_analytic import LIGHTS, irradiance, rim_distance
from tests.support.luminaires import isotropic, photometry
from tests.support.worlds import ABOVE, assert_pictures, box, floor, material, on_plane, point_light, quad, scene, sphere

SIZE = (96, 96)
WHITE = material(1.0)
UP = np.array([0.0, 1.0, 0.0])


def directed(
    ctx: moderngl.Context, world: Scene, camera: Camera | None = None, shadow: int = 512, rays: bool = False
) -> dict[str, np.ndarray]:
    """Return direct outgoing radiance (H, W, 3), positions, normals and depth of a view of SIZE, top row first."""
    placed, draw, shadows = World(ctx, world), GBufferPass(ctx, SIZE), ShadowPass(ctx)
    light = DirectPass(ctx, SIZE, {**light_defines(world), **placed.material_defines})
    gbuffer = draw(placed, camera or world.cameras[0])
    light(gbuffer, shadows(placed, shadow), world=placed if rays else None)
    position, normal = draw.target.read(0), draw.target.read(1)
    found = {"direct": light.target.read()[..., :3].copy(), "position": position[..., :3], "depth": position[..., 3]}
    ctx.detect_framebuffer(0).use()
    shadows.release()
    return found | {"normal": normal[..., :3]}


def check_floor(
    ctx: moderngl.Context, name: str, world: Scene, light: Light, dark: np.ndarray | None = None, skip: np.ndarray | None = None
) -> None:
    """Assert E/π at every pixel of the floor y = 0, ρ = 1, to 0.5 %, and exactly 0 in the mask `dark`.

    Once with maps of 512 texels alone, and once with rays and maps of 64, whose texels are 40 mm wide on the floor.
    """
    p, _ = on_plane(world.cameras[0], SIZE, (0, 0, 0), UP)
    truth = irradiance(light, p, UP) / np.pi
    dark = np.zeros(p.shape[:2], bool) if dark is None else dark
    truth[dark] = 0.0
    limit = 5e-3 * truth + np.where(dark, 0.0, 1e-6)[..., None]
    for shadow, rays in ((512, False), (64, True)):
        found = directed(ctx, world, shadow=shadow, rays=rays)["direct"]
        assert_pictures(f"{name}_{shadow}", found, truth, limit, True if skip is None else ~skip)


@pytest.mark.parametrize("name", LIGHTS)
def test_a_lit_plane(ctx: moderngl.Context, name: str) -> None:
    """Every kind of light over a plane gives ρ/π·E, alone and together with all other kinds."""
    paint = material((0.2, 0.5, 0.9))
    others = tuple(mirrored(other) for n, other in LIGHTS.items() if n != name)
    p, _ = on_plane(ABOVE, SIZE, (0, 0, 0), UP)
    for lights in ((mirrored(LIGHTS[name]),), (mirrored(LIGHTS[name]), *others)):
        truth = sum(irradiance(one, p, UP) for one in lights) * np.array(paint.albedo) / np.pi
        near_rim = np.zeros(p.shape[:2], bool)
        for one in lights:  # a hard cone's rim cuts pixels, and its edge is as steep as rounding
            if one.spot_target is not None:
                near_rim |= np.abs(rim_distance(one, p)) < 0.1
        found = directed(ctx, scene(floor(2.0, 0.0, paint), lights=lights))["direct"]
        assert_pictures(f"plane_{name}", found, truth, 5e-3 * truth + 1e-4 * truth.max(), ~near_rim)


def mirrored(light: Light) -> Light:
    """Return the light of test_analytic, which points up at a roof at 2.5 m, turned to point down at the floor."""
    x, y, z = light.position
    target = None if light.spot_target is None else (light.spot_target[0], 1.5 - light.spot_target[1], light.spot_target[2])
    return Light(**{**vars(light), "position": (x, -y if light.directional else 1.5 - y, z), "spot_target": target})


@pytest.mark.parametrize("under", [0.0, 0.001])
def test_an_object_that_touches_a_light_does_not_shade_it(ctx: moderngl.Context, under: float) -> None:
    """A sheet of 2 m through a light casts no shadow; 1 mm below it shades 4 km of the floor, also with a ground of 400 m."""
    light, view = point_light((0.0, 2.0, 0.0), 7.0), Camera((0.0, 1.9, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 80.0)
    parts = (floor(r, y, WHITE) for r, y in ((4.0, 0.0), (1.0, 2.0 - under), (200.0, -1.0)))
    dark = np.full(SIZE, under > 0.0)
    check_floor(ctx, f"touching_{under}", scene(*parts, lights=(light,), camera=view), light, dark)


@pytest.mark.parametrize("low", [0.2, 0.03])
@pytest.mark.parametrize("kind", ["point", "sun"])
def test_grazing_light_on_a_sheet_has_no_acne(ctx: moderngl.Context, kind: str, low: float) -> None:
    """A floor of 4 m under grazing light: every pixel matches the formula, as no occluder exists."""
    sun = Light((1.0, low, 0.4), (2.0, 2.0, 2.0), directional=True)
    light = point_light((-1.8, low, 0.3), 3.0) if kind == "point" else sun
    check_floor(ctx, f"grazing_{kind}_{low}", scene(floor(2.0, 0.0, WHITE), lights=(light,)), light)


@pytest.mark.parametrize(
    ("kind", "order"), [("point", (0, 1, 2)), ("sun", (2, 1, 0)), ("spot", (1, 2, 0)), ("luminaire", (0, 1, 2))]
)
def test_stacked_sheets(ctx: moderngl.Context, kind: str, order: tuple[int, int, int]) -> None:
    """A small sheet and one just above the floor: exactly 0 in full shadow, the formula in light, in any drawing order.

    A light at (0.2, 3, 0.1) projects the sheet of ±0.5 m at 1 m onto the floor: light + (sheet - light)·3/2.
    """
    light = {
        "point": point_light((0.2, 3.0, 0.1), 5.0),
        "sun": Light((0.1, 1.0, 0.05), (1.0, 1.0, 1.0), directional=True),
        "spot": point_light((0.2, 3.0, 0.1), 5.0, spot_target=(0.2, 0.0, 0.1), spot_cutoff=60.0, spot_inner=59.0),
        "luminaire": replace(
            point_light((0.2, 3.0, 0.1), 5.0, spot_target=(0.2, 0, 0.1)), photometry=photometry([0, 90], [0], isotropic)
        ),
    }[kind]
    sheets = [floor(2.0, 0.0, WHITE), floor(0.5, 1.0, WHITE), floor(0.4, 0.995, WHITE)]
    below = Camera((0.0, 0.9, 1.9), (0.0, 0.0, -0.3), fov=70.0)  # view below the sheet
    world = scene(*(sheets[i] for i in order), lights=(light,), camera=below)
    p, t = on_plane(below, SIZE, (0, 0, 0), UP)
    centre = np.array([-0.1, 0.0, -0.05])
    half = 0.5 if kind == "sun" else 0.75
    inside = np.abs(p - centre)[..., [0, 2]].max(-1) - half  # negative: in the shadow
    on = (t > 0) & (np.abs(p[..., [0, 2]]).max(-1) < 1.9) & (p[..., 1] < below.eye[1])
    check_floor(ctx, f"sheets_{kind}", world, light, inside < 0.0, ~on | (np.abs(inside) < 0.03))


@pytest.mark.parametrize(
    ("side", "seen_from", "flipped", "kind"),
    [(1, 1, False, "point"), (1, 1, True, "sun"), (-1, -1, False, "sun"), (-1, -1, True, "point"), (1, -1, False, "point"),
     (1, -1, True, "sun"), (-1, 1, False, "sun"), (-1, 1, True, "point")],
)  # fmt: skip
def test_a_sheet_is_lit_on_the_light_s_side_only(
    ctx: moderngl.Context, side: float, seen_from: float, flipped: bool, kind: str
) -> None:
    """Two-sided Lambertian reflection: light on the eye's side counts for any winding, light on the other side gives exactly
    0.
    """
    turned = quad((-2, 0, -2), (4, 0, 0), (0, 0, 4), WHITE) if flipped else floor(2.0, 0.0, WHITE)
    light = point_light((0.5, side * 1.0, 0.4), 3.0) if kind == "point" else Light((0.5, side, 0.4), (1, 1, 1), directional=True)
    camera = Camera((0.1, seen_from * 3.0, 0.2), (0, 0, 0), (0, 0, -1), 45.0)
    found = directed(ctx, scene(turned, lights=(light,), camera=camera))["direct"]
    p, _ = on_plane(camera, SIZE, (0, 0, 0), UP)
    truth = irradiance(light, p, seen_from * UP) / np.pi
    assert (truth.max() == 0.0) == (side != seen_from)
    assert_pictures("two_sided", found, truth, 5e-3 * truth)


@pytest.mark.parametrize("u", [(1.0, 0.0, 0.0), (0.3, 0.5, 0.81)])
def test_a_light_in_a_surface_s_plane(ctx: moderngl.Context, u: tuple[float, float, float]) -> None:
    """The light does not illuminate the sheet, and the sheet casts no shadow: the floor matches the formula everywhere.

    cornell-paper has a light exactly in its ceiling's plane; this sheet at 1.5 m also contains lines off the axes.
    """
    light, level = point_light((0.0, 1.5, 0.0), 4.0), u == (1.0, 0.0, 0.0)
    u_, v = np.array(u), np.cross(u, (0.1, 0.2, 0.9))
    sheet = floor(1.0, 1.5, WHITE) if level else quad(np.array([0, 1.5, 0]) - 0.6 * u_ - 0.5 * v, 1.2 * u_, v, WHITE)
    camera = Camera((0.0, 1.2, 3.5), (0.0, 0.0, 0.0), fov=50.0)
    found = directed(ctx, scene(floor(2.0, 0.0, WHITE), sheet, lights=(light,), camera=camera))
    seen, way = found["depth"] > 0.0, found["position"] - light.position
    on = seen & (np.abs(found["position"][..., 1]) < 1e-4)
    # a tilted plane cuts the floor in a line: near it, the sheet's edge-on shadow is a texel wide
    n = np.cross(u_, v)
    aside = np.abs(way @ n) / np.linalg.norm(n)
    truth = irradiance(light, found["position"], UP) / np.pi
    assert_pictures("light_in_plane", found["direct"], truth, 5e-3 * truth, on & (level | (aside > 0.05)))
    if level:
        received = (found["direct"][..., 0] * (way**2).sum(-1))[seen & ~on]
        assert received.size and received.max() < 1e-4, "the sheet gets none, but for rounding"


@pytest.mark.parametrize(("kind", "rays"), [("point", False), ("sun", False), ("point", True), ("sun", True)])
def test_a_sphere_has_no_acne(ctx: moderngl.Context, kind: str, rays: bool) -> None:
    """On the lit side E follows the shading normal, on the far side it is 0; the strip of differing facets is left out.

    Shadow rays start on the curved surface. A curve through 16 × 32 facets lies up to 0.6·(1 - cos 5.6°) = 3 mm above them.
    At a distance of 2 m that changes E by 0.3 %, and the cosine by 0.002.
    """
    light = point_light((1.5, 2.0, 1.0), 5.0) if kind == "point" else Light((1.5, 2.0, 1.0), (1.0, 1.0, 1.0), directional=True)
    ball = sphere((0, 0, 0), 0.6, WHITE, *((16, 32) if rays else (48, 96)))
    camera, limit = Camera((0.5, 1.0, 3.0), (0, 0, 0), fov=25.0), 0.02 if rays else 5e-3
    found = directed(ctx, scene(ball, lights=(light,), camera=camera), rays=rays)
    truth = irradiance(light, found["position"], found["normal"]) / np.pi
    to = np.asarray(light.position) - (0.0 if light.directional else found["position"])
    cosine = np.where(found["depth"] > 0.0, (to * found["normal"]).sum(-1) / np.linalg.norm(to, axis=-1), 0.0)
    assert_pictures(f"sphere_{kind}", found["direct"], truth, limit * truth.max(), np.abs(cosine) > (0.03 if rays else 0.1))
    assert (cosine > 0.1).sum() > 1000 and (cosine < -0.1).sum() > 100


def bare(kind: str, at: tuple[float, float, float]) -> Light:
    """Return a point light at `at`, a sun there, or a spot there towards the origin."""
    spot = {"spot_target": (0.0, 0.0, 0.0), "spot_cutoff": 60.0, "spot_inner": 60.0} if kind == "spot" else {}
    return Light(at, (1, 1, 1), directional=True) if kind == "sun" else point_light(at, 20.0, **spot)


SHEET, SLAB = floor(500.0, 0.0, WHITE), box((-500, -2, -500), (500, 0, 500), WHITE)


@pytest.mark.parametrize(
    ("kind", "ground"),
    [(kind, floor(2.0, 0.0, WHITE)) for kind in ("point", "sun", "spot")] + [("sun", SHEET), ("sun", SLAB)],
    ids=["point", "sun", "spot", "sun and 1 km of ground", "sun and 1 km of slab"],
)
def test_no_light_leaks_where_a_box_stands(ctx: moderngl.Context, kind: str, ground: Mesh) -> None:
    """A closed box on the floor, lit from one side: behind it the shadow starts at the contact line and is exactly 0.

    The light at (-3, 2, 0) projects the box of ±0.5 m, 1 m high, to the right. The floor is dark up to the ray over the
    upper edges, x = 0.5 + 1·3.5/1 = 4 m for the point light; across, at least |z| < 0.5 is dark.
    """
    light, camera = bare(kind, (-3.0, 2.0, 0.0)), Camera((1.0, 4.0, 0.0), (1.0, 0.0, 0.0), (0, 0, -1), 30.0)
    world = scene(ground, box((-0.5, 0, -0.5), (0.5, 1, 0.5), WHITE), lights=(light,), camera=camera)
    found = directed(ctx, world)
    x, y, z = np.moveaxis(found["position"], -1, 0)
    behind = (y < 1e-4) & (x > 0.5) & (x < 1.4) & (np.abs(z) < 0.45)
    assert behind.sum() > 300
    assert not found["direct"][behind].any(), f"{(found['direct'][behind].max(-1) > 0).mean():.2%} of the shadow is lit"
    top = (y > 0.999) & (np.maximum(np.abs(x), np.abs(z)) < 0.48)
    truth = irradiance(light, found["position"], UP) / np.pi
    assert_pictures(f"box_top_{kind}", found["direct"], truth, 5e-3 * truth, top)


@pytest.mark.parametrize("kind", ["point", "sun", "spot"])
def test_no_light_leaks_into_the_corners_of_thin_walls(ctx: moderngl.Context, kind: str) -> None:
    """A closed room of sheets without thickness, lit from outside, is dark nearly up to its edges.

    A texel of the shadow map at an edge may see distant surfaces past the room, and must not light the wall. A texel
    centred on the edge cannot distinguish the walls. In views of eight corners 0.1, 1.6 and 0.8 % of the pixels are lit;
    with texels that see past the room it was 2, 9 and 4 %.
    """
    light = bare(kind, (2.3, 3.1, 1.7))
    lit = 0
    sheets = [wall(axis, side) for axis in range(3) for side in (-1.0, 1.0)]
    for corner in np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float):
        camera = Camera(tuple(0.8 * corner), tuple(corner), (0.3, 1.0, 0.2), 60.0)
        found = directed(ctx, scene(*sheets, floor(8.0, -3.0, WHITE), lights=(light,), camera=camera))
        assert (found["depth"] > 0.0).all()
        lit += (found["direct"].max(-1) > 0.0).sum()
    share = lit / (8 * found["depth"].size)
    assert share < {"point": 0.002, "sun": 0.02, "spot": 0.01}[kind], f"{share:.2%} of the room is lit"


def wall(axis: int, side: float) -> Mesh:
    """Return a wall of a room of ±1 m, without thickness, as a mesh."""
    across, up = np.eye(3)[axis - 2], np.eye(3)[axis - 1]
    return quad(side * np.eye(3)[axis] - across - up, 2.0 * across, 2.0 * up, WHITE)


def test_shadow_tiles_use_the_whole_texture() -> None:
    """All counts up to the square of the tiles along a side fit in full size; more of them have the greatest side that fits."""
    for count in (*range(1, 257), 360, 2400):
        side, columns, rows = sheet(count, 1024, 16384)
        assert columns * rows >= count and max(columns, rows) * side <= 16384
        assert side == 1024 or (count > 256 and (16384 // (side + 1)) ** 2 < count)


def test_no_sun_passes_the_walls_of_a_room_in_a_valley() -> None:
    """A sealed room with walls of 15 cm in a valley of 400 m is dark. One tile for the valley has texels of 40 cm.

    With this tile alone, rays found sunlight on the floor below the walls: E was up to 0.15 in sunlight of 1 W/m².
    """
    slope = [(x, y, z) for z in (-200.0, 200.0) for x, y in ((-200.0, 20.0), (-20.0, 0.0), (20.0, 0.0), (200.0, 20.0))]
    valley = make_mesh(slope, [face for k in range(3) for face in ((k, k + 4, k + 5), (k, k + 5, k + 1))])
    along = [box((-3, 0, z), (3, 2.6, z + 0.15)) for z in (-3.0, 2.85)]
    across = [box((x, 0, -3), (x + 0.15, 2.6, 3)) for x in (-3.0, 2.85)]
    roof, sun = box((-3, 2.6, -3), (3, 2.8, 3)), Light((0.5, 0.6, 0.6), (1.0, 1.0, 1.0), directional=True, physical=True)
    world = scene(valley, *along, *across, roof, lights=(sun,), camera=Camera((-2, 1.5, -2), (2, 0.5, 2), fov=75.0))
    assert render(world, size=(64, 48), bounces=1).irradiance.max() < 1e-4
    corners = [(x, 0.01, z) for x in (-2.8, 2.8) for z in (-2.8, 2.8)]
    assert lit(world, corners, UP).max() < 1e-4, "the light meter's sensors"


def test_light_between_slats_is_their_open_share() -> None:
    """Black slats take half of the sunlight from a floor. A point between them and the floor has half the indirect light, too.

    A slat is as wide as three texels of the shadow map. A texel's centre is as often in shadow as the point itself, at any slope
    of the floor. Where points whose texel's centre lies deeper also needed a lit neighbour, 3.6 % of the light was missing.
    """
    black, sun = material(0.0), Light((0.7, 1.0, 0.3), (1.0, 1.0, 1.0), directional=True, physical=True)
    width = 3.0 * 5.0 / 1024
    slats = [quad((x, 0.5, -2.0), (0, 0, 4.0), (width, 0, 0), black) for x in np.arange(-2.0, 2.0, 2.0 * width)]
    points = [(x, 0.25, z) for x in (-0.31, 0.0, 0.27) for z in (-0.23, 0.0, 0.34)]
    below, open_air = (
        lit(scene(floor(1.0, paint=WHITE), *parts, lights=(sun,)), points, -UP, bounces=1).mean() for parts in (slats, ())
    )
    assert below == pytest.approx(0.5 * open_air, rel=0.02)
