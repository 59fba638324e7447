"""The tree of triangles: the nearest hits that the shader finds in it against those of every triangle tried."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import moderngl
import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.core.paths import folder
from irrsplat.core.vertex_layout import WIDTH
from irrsplat.gpu import shader_source
from irrsplat.gpu.bvh_table import BvhTable, TriangleTable
from irrsplat.gpu.geometry import Geometry
from irrsplat.gpu.target import Target, table_texture
from irrsplat.scene.spatial.bvh import Bvh, build, joined
from tests.support.worlds import sphere

MISS = np.inf


def soup(count: int, size: float = 0.2, seed: int = 1) -> np.ndarray:
    """(F, 3, 3) triangles of about `size`, strewn over a cube from -1 to 1."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (count, 1, 3)) + size * rng.normal(size=(count, 3, 3))


def rays(count: int, seed: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Origins in the cube and unit directions, some of them along the axes."""
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(count, 3))
    d[: count // 8] = np.sign(d[: count // 8]) * np.eye(3)[rng.integers(0, 3, count // 8)]
    return rng.uniform(-1.2, 1.2, (count, 3)), d / np.linalg.norm(d, axis=1, keepdims=True)


def crossing(o: np.ndarray, d: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """Return distances from the rays to their triangles (all broadcast, the last axes 3 and 3, 3); MISS without a hit."""
    a, u, v = triangle[..., 0, :], triangle[..., 1, :] - triangle[..., 0, :], triangle[..., 2, :] - triangle[..., 0, :]
    p, s = np.cross(d, v), o - a
    q = np.cross(s, u)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / (u * p).sum(-1)
        x, y, t = (s * p).sum(-1) * scale, (d * q).sum(-1) * scale, (v * q).sum(-1) * scale
        return np.where((x >= 0) & (y >= 0) & (x + y <= 1) & (t > 0), t, MISS)


def nearest(o: np.ndarray, d: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The oracle: (R,) the least of all crossings."""
    corners = corners.astype("f4").astype(float)
    each = [crossing(o[i : i + 256, None], d[i : i + 256, None], corners).min(1, initial=MISS) for i in range(0, len(o), 256)]
    return np.concatenate(each)


def shaded(
    ctx: moderngl.Context, tmp_path: Path, corners: np.ndarray, o: np.ndarray, d: np.ndarray, bvh: Bvh
) -> tuple[np.ndarray, np.ndarray]:
    """Return results of lib/rays/bvh.glsl: (R,) distances, MISS for none, and (R, 3) hit points from barycentric coordinates."""
    (tmp_path / "lib" / "rays").mkdir(parents=True, exist_ok=True)
    for name in ("rays/bvh.glsl", "rays/hit.glsl", "rays/triangles.glsl", "table.glsl", "texel.glsl"):
        (tmp_path / "lib" / name).write_text((folder("shaders") / "lib" / name).read_text())
    (tmp_path / "walk.frag").write_text(
        '#include "lib/rays/bvh.glsl"\nuniform sampler2D rays;\nlayout(location = 0) out vec4 out_hit;\nvoid main()\n{\n'
        "    int x = int(gl_FragCoord.x), y = int(gl_FragCoord.y);\n    vec3 o = texelFetch(rays, ivec2(2 * x, y), 0).xyz;\n"
        "    Hit hit = bvh_between(o, texelFetch(rays, ivec2(2 * x + 1, y), 0).xyz, 0.0, FARTHEST_HIT);\n"
        "    vec3 p = mat3(triangle_point(hit.triangle, 0), triangle_point(hit.triangle, 1), triangle_point(hit.triangle, 2))"
        " * hit.barycentric;\n    out_hit = hit.t < FARTHEST_HIT ? vec4(p, hit.t) : vec4(0.0, 0.0, 0.0, -1.0);\n}\n"
    )
    vertex = shader_source.load("lib/fullscreen.vert").text
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(shader_source, "folder", lambda name: tmp_path)
        source = shader_source.load("walk.frag")
    program = ctx.program(vertex_shader=vertex, fragment_shader=source.text)
    vertices = np.zeros((3 * len(corners), WIDTH), "f4")
    vertices[:, :3] = corners.reshape(-1, 3)
    tree, triangles = (BvhTable(ctx, bvh), TriangleTable(ctx, vertices, np.arange(3 * len(corners), dtype="i4").reshape(-1, 3)))
    width, both = 256, np.zeros((-(-len(o) // 256) * 256, 2, 4), "f4")
    both[: len(o), 0, :3], both[: len(o), 1, :3] = o, d
    uniforms: dict[str, Any] = {**tree.uniforms, **triangles.uniforms, "rays": table_texture(ctx, both.reshape(-1, 2 * width, 4))}
    for unit, name in enumerate(name for name, kind in source.uniforms.items() if "sampler" in kind):
        program[name].value = unit  # type: ignore[union-attr]
        uniforms[name].use(unit)
    for name in ("bvh_count", "bvh_start", "bvh_step"):
        program[name].value = uniforms[name] if name == "bvh_count" else tuple(uniforms[name])  # type: ignore[union-attr]
    target = Target(ctx, (width, len(both) // width), (4,))
    target.use()
    ctx.enable_only(moderngl.NOTHING)
    ctx.vertex_array(program, []).render(vertices=3)
    found = np.frombuffer(target.textures[0].read(), "f4").reshape(-1, 4)[: len(o)]
    for thing in (tree, triangles, target, uniforms["rays"], program):
        thing.release()
    return np.where(found[:, 3] < 0, MISS, found[:, 3]), found[:, :3]


def stretched(seed: int = 3) -> np.ndarray:
    """Triangles of very unlike sizes: two that fill everything, slivers, and dust."""
    large = np.array([[(-50, -0.9, -50), (50, -0.9, -50), (0, -0.9, 50)], [(-30, -40, 1.1), (30, -40, 1.1), (0, 60, 1.1)]])
    slivers = soup(60, 0.5, seed) * (1.0, 1e-3, 1.0)
    return np.concatenate([large, slivers, soup(300, 1e-3, seed), soup(200, 0.1, seed)])


def flat(seed: int = 4) -> np.ndarray:
    """All in one plane, and overlapping."""
    return soup(200, 0.3, seed) * (1.0, 0.0, 1.0) + (0.0, 0.3, 0.0)


def tiled(n: int = 12) -> np.ndarray:
    """A square of triangles that share edges, half of them wound the other way, twice in the same place."""
    x = np.linspace(-1, 1, n + 1)
    a, b, c, d = (np.stack([*np.meshgrid(x[i], x[j]), np.full((n, n), 0.25)], -1).reshape(-1, 3) for i, j in SHIFTS)
    once = np.concatenate([np.stack([a, b, c], 1), np.stack([a, d, c], 1)])
    return np.concatenate([once, once])


SHIFTS = tuple((slice(i, i - 1 or None), slice(j, j - 1 or None)) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
SETS = {
    "none": np.zeros((0, 3, 3)),
    "one": soup(1, 1.0),
    "two": soup(2, 1.0),
    "five": soup(5, 1.0),
    "many": soup(700),
    "far away": soup(400) + np.array((300.0, -200.0, 500.0)),
    "huge": 1e5 * soup(300),
    "unlike": stretched(),
    "flat": flat(),
    "tiled": tiled(),
    "points and lines": np.concatenate([np.repeat(soup(40)[:, :1], 3, 1), soup(40)[:, [0, 0, 1]], soup(40, 0.4)]),
    "all in one place": np.repeat(soup(1, 1.0), 50, 0),
}


def rays_for(corners: np.ndarray, count: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """Rays about where most of the triangles are."""
    o, d = rays(count)
    middle = np.median(corners.reshape(-1, 3), axis=0) if len(corners) else np.zeros(3)
    size = np.median(np.abs(corners.reshape(-1, 3) - middle)) * 2.0 if len(corners) else 1.0
    return (o * size + middle).astype("f4").astype(float), d


def in_two(corners: np.ndarray) -> Bvh:
    """Return the joined trees of every other triangle."""
    numbers, points = np.arange(len(corners)), np.concatenate([corners.astype("f4").reshape(-1, 3), np.zeros((1, 3))])
    trees = [(some, build(corners[some], np.stack([points.min(0), points.max(0)]))) for some in (numbers[::2], numbers[1::2])]
    return joined(*(replace(tree, order=some[tree.order]) for some, tree in trees))


@pytest.mark.parametrize("name", SETS)
def test_the_shader_finds_the_same(ctx: moderngl.Context, tmp_path: Path, name: str) -> None:
    """In float32 a ray close to an edge may pass on its other side: one in a thousand; the others agree in distance and place.

    Two joined trees find the hits of one tree.
    """
    corners = SETS[name]
    o, d = rays_for(corners)
    truth = nearest(o, d, corners)
    for bvh in (build(corners), in_two(corners)):
        t, p = shaded(ctx, tmp_path, corners, o, d, bvh)
        both = np.isfinite(t) & np.isfinite(truth)
        size = np.abs(o).max() + 1.0
        wrong = np.isfinite(t) != np.isfinite(truth)
        wrong[both] |= np.abs(t[both] - truth[both]) > 1e-5 * size + 1e-4 * truth[both]
        assert wrong.mean() <= 2e-3, f"{wrong.sum()} of {len(o)} rays"
        if both.any():
            away = np.linalg.norm(o[both] + t[both, None] * d[both] - p[both], axis=1)
            assert np.percentile(away, 99) < 1e-4 * size, "the shares of the corners say where it is"


def test_no_ray_slips_through_an_edge(ctx: moderngl.Context, tmp_path: Path) -> None:
    """From within a closed mesh every ray meets it: 300 000 rays, a third of them aimed at edges, a third 10 µm past vertices.

    At a vertex itself, within float32's last bit, the signs of six edges are rounding: there one ray in 500 does slip through.
    """
    ball = sphere((0.1, -0.2, 0.3), 1.7, rings=40, segments=80)
    corners, rng = ball.positions[ball.faces].astype(float), np.random.default_rng(6)
    count = 100_000
    o = (rng.uniform(-0.8, 0.8, (3 * count, 3)) + np.array((0.1, -0.2, 0.3))).astype("f4").astype(float)
    share = rng.dirichlet((1, 1, 1), len(o))
    share[:count] = (1, 5e-5, 5e-5) + 5e-5 * share[:count]
    share[count : 2 * count, 2] = 0.0
    goal = (corners[rng.integers(0, len(corners), len(o))] * (share / share.sum(1, keepdims=True))[..., None]).sum(1)
    d = goal - o
    t, _ = shaded(ctx, tmp_path, corners, o, d / np.linalg.norm(d, axis=1, keepdims=True), build(corners))
    assert np.isfinite(t).all(), f"{np.isinf(t).sum()} rays are out"
    assert np.allclose(t, np.linalg.norm(d, axis=1), atol=1e-4)


def test_tables_follow_moves_and_paint_and_have_an_end(ctx: moderngl.Context) -> None:
    """More triangles than a texture holds are refused by their number."""
    rows = np.zeros((6, WIDTH), "f4")
    rows[:, :3] = np.random.default_rng(1).uniform(size=(6, 3))
    faces = np.arange(6, dtype="i4").reshape(2, 3)
    with Geometry(ctx, rows, faces) as some, Geometry(ctx, rows[:0], faces[:0]) as none:
        some.update(2.0 * rows, faces[::-1])
        some.repaint(3.0 * rows)
        none.update(rows[:0], faces[:0])
        none.repaint(rows[:0])
        assert np.array_equal(some.corners, 2.0 * rows[faces[::-1], :3]) and not none.triangles
        assert np.frombuffer(some.vertices.read(), "f4").max() == pytest.approx(3.0 * rows.max())
    small: Any = SimpleNamespace(info={"GL_MAX_TEXTURE_SIZE": 1})
    for make in (lambda: TriangleTable(small, rows, faces), lambda: BvhTable(small, build(np.zeros((3000, 3, 3))))):
        with pytest.raises(InputError, match="triangles"):
            make()
