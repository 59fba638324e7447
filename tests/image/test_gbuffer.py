"""The g-buffer against rays met with planes: position, depth, normals and material at the pixels' centres."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest
import trimesh

from irrsplat import make_mesh
from irrsplat.core.vectors import octahedral_decode
from irrsplat.gpu.target import Target
from irrsplat.gpu.world import World
from irrsplat.image.gbuffer import GBufferPass
from irrsplat.scene.model import Camera, Scene
from tests.support.worlds import box, floor, material, on_plane, quad, scene, sphere


def seen(ctx: moderngl.Context, world: Scene, camera: Camera, size: tuple[int, int]) -> dict[str, np.ndarray]:
    """The g-buffer as arrays, top row first."""
    drawer = GBufferPass(ctx, size)
    drawer(World(ctx, world), camera)
    target: Target = drawer.target
    position, normal, albedo, emission = (target.read(i) for i in range(4))
    return {
        "position": position[..., :3],
        "depth": position[..., 3],
        "normal": normal[..., :3],
        "geometric": octahedral_decode(normal[..., 3], albedo[..., 3]),
        "albedo": albedo[..., :3],
        "emission": emission[..., :3],
    }


CAMERAS = {
    "wide": (Camera((1.0, 1.5, 2.0), (0.0, 0.0, 0.0), fov=70.0), (160, 40)),
    "tall": (Camera((-0.5, 0.8, 2.0), (0.2, 0.1, 0.0), fov=100.0), (11, 47)),
    "rolled": (Camera((1.0, 1.5, 2.0), (0.0, 0.0, 0.0), (0.7, 0.7, 0.1), 50.0), (31, 23)),
    "long": (Camera((30.0, 40.0, 50.0), (0.0, 0.0, 0.0), fov=2.0), (24, 24)),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_a_plane_is_where_the_rays_meet_it(ctx: moderngl.Context, software: bool, name: str) -> None:
    """eye + t·ray with n·(eye + t·ray) = 0, t being the depth along the view axis; nothing beyond the plane's rim."""
    camera, size = CAMERAS[name]
    world = scene(floor(1.0, 0.0, material((0.2, 0.4, 0.6), (1, 2, 3))), camera=camera)
    found = seen(ctx, world, camera, size)
    p, t = on_plane(camera, size, (0, 0, 0), (0, 1, 0))
    pixel = 2.0 * np.tan(np.radians(camera.fov) / 2.0) / size[1] * np.abs(t)  # metres, across the view
    rim = np.abs(np.abs(p[..., [0, 2]]) - 1.0).min(-1) < 4.0 * pixel
    on = (np.abs(p[..., [0, 2]]) < 1.0).all(-1) & (t > 0.0)
    assert np.array_equal(found["depth"][~rim] > 0.0, on[~rim])
    on &= ~rim
    assert on.sum() > 20
    distance = np.linalg.norm(camera.eye)
    snapped = 0.0 if software else 4.0 / 256.0 * pixel[on].max()  # metres, along a plane seen aslant
    assert np.allclose(found["position"][on], p[on], atol=1e-5 * distance + snapped)
    assert np.allclose(found["depth"][on], t[on], rtol=1e-5, atol=snapped)
    assert np.allclose(found["normal"][on], (0, 1, 0), atol=1e-6)
    assert np.allclose(found["geometric"][on], (0, 1, 0), atol=1e-6)
    assert np.allclose(found["albedo"][on], (0.2, 0.4, 0.6)) and np.allclose(found["emission"][on], (1, 2, 3))


def test_up_is_up_and_right_is_right(ctx: moderngl.Context) -> None:
    """Four quads of four colours: red up left, green up right, blue down left, white down right."""
    camera = Camera((0, 0, 4), (0, 0, 0), fov=40.0)
    colours = {(-1, 0): (1, 0, 0), (0, 0): (0, 1, 0), (-1, -1): (0, 0, 1), (0, -1): (1, 1, 1)}
    world = scene(*(quad((x, y, 0), (1, 0, 0), (0, 1, 0), material(c)) for (x, y), c in colours.items()), camera=camera)
    albedo = seen(ctx, world, camera, (20, 20))["albedo"]
    for (row, column), colour in zip(((6, 6), (6, 13), (13, 6), (13, 13)), colours.values(), strict=True):
        assert tuple(albedo[row, column]) == colour


def test_smooth_normals_are_interpolated_and_face_the_eye(ctx: moderngl.Context) -> None:
    camera = Camera((0, 0, 4), (0, 0, 0), fov=30.0)
    found = seen(ctx, scene(sphere((0, 0, 0), 0.8), camera=camera), camera, (40, 40))
    on = found["depth"] > 0.0
    p = found["position"][on]
    radial = p / np.linalg.norm(p, axis=1, keepdims=True)
    inside = radial[:, 2] > 0.35  # at the silhouette facets and their normals part
    assert ((found["normal"][on] * radial).sum(1)[inside] > 0.998).all()
    assert np.allclose(np.linalg.norm(found["normal"][on], axis=1), 1.0, atol=1e-5)
    to_eye = np.asarray(camera.eye) - p
    assert ((found["geometric"][on] * to_eye).sum(1) > 0.0).all()
    assert ((found["geometric"][on] * found["normal"][on]).sum(1) >= 0.0).all()


def test_no_inner_side_shows_at_silhouettes(ctx: moderngl.Context) -> None:
    """At a pixel's centre on a silhouette, outer and inner side are equally far: the outer one is visible.

    Two equal bars at one place share their edges, so that their mesh is not closed and the eye may lie inside.
    """
    bars = [trimesh.creation.cylinder(0.01, 1.0, sections=8) for _ in range(60)]
    for number, bar in enumerate(bars):
        bar.apply_translation((0.12 * (number % 30) - 1.8, 0.0, 0.0))
    vertices = np.concatenate([bar.vertices for bar in bars])
    faces = np.concatenate([bar.faces + number * len(bar.vertices) for number, bar in enumerate(bars)])
    camera = Camera((4.2, -1.2, 0.9), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 50.0)
    world = scene(make_mesh(vertices, faces), camera=camera)
    assert not world.meshes[0].closed
    found = seen(ctx, world, camera, (640, 480))
    side = (found["depth"] > 0.0) & (np.abs(found["position"][..., 2]) < 0.49)
    p, g = found["position"][side], found["geometric"][side]
    across = (p[:, 0] + 1.8 + 0.06) % 0.12 - 0.06
    assert side.sum() > 5000 and ((g[:, 0] * across + g[:, 1] * p[:, 1]) > 0.0).all()


@pytest.mark.parametrize("distance", [1e-4, 1e3])
def test_nothing_is_too_near_or_too_far(ctx: moderngl.Context, software: bool, distance: float) -> None:
    """NEAR and FAR never clip: a wall right before the eye hides a small thing behind it, however far the scene reaches."""
    camera = Camera((0, 0, 0), (0, 0, -1), fov=60.0)
    half = 2.0 * distance
    near = quad((-half, -half, -distance), (2 * half, 0, 0), (0, 2 * half, 0), material((1, 0, 0)))
    world = scene(near, box((-50, -50, -2000), (50, 50, -1990), material((0, 1, 0))), camera=camera)
    found = seen(ctx, world, camera, (16, 16))
    assert np.allclose(found["depth"], distance, rtol=1e-4)
    assert np.allclose(found["albedo"], (1, 0, 0), rtol=0.0, atol=0.0 if software else 1e-6)
    alone = seen(ctx, scene(world.meshes[1], camera=camera), camera, (512, 512))
    assert (alone["depth"][alone["depth"] > 0] < 1990.1).all() and (alone["depth"] > 0).sum() > 20 * 20
