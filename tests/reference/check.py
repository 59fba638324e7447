"""Check the reference tracer itself: analytic scenes, and Mitsuba's own path tracer: `python -m tests.reference.check`."""

from __future__ import annotations

from typing import Any

import numpy as np

from irrsplat.reference.path_tracer import Tracer, choose_variant, image, look, mi
from irrsplat.scene.model import Camera, Light, Material, Mesh, Scene

SPP = 4096  # of Mitsuba's path, four times over
STRATA = 16  # each pixel is seen through STRATA² points
SIDE = 32  # pixels of the images that are compared
CAMERA = Camera(eye=(0.0, 0.0, 3.4), target=(0.0, 0.0, 0.0), fov=40.0)


def quad(corner: Any, u: Any, v: Any, material: Material) -> Mesh:
    """A parallelogram with the normal u × v."""
    corner, u, v = (np.asarray(x, np.float32) for x in (corner, u, v))
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal)
    positions = np.stack([corner, corner + u, corner + u + v, corner + v])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(positions, np.tile(normal, (4, 1)).astype(np.float32), faces, material)


def box(low: Any, high: Any, materials: dict[str, Material]) -> list[Mesh]:
    """The six sides of a box; `materials` by side (left right floor ceiling back front), 'all' for the rest."""
    (x, y, z), (X, Y, Z) = low, high
    dx, dy, dz = (X - x, 0, 0), (0, Y - y, 0), (0, 0, Z - z)
    sides = {
        "left": (low, dy, dz),
        "right": ((X, y, z), dz, dy),
        "floor": (low, dz, dx),
        "ceiling": ((x, Y, z), dx, dz),
        "back": (low, dx, dy),
        "front": ((x, y, Z), dy, dx),
    }
    return [quad(*sides[s], materials.get(s, materials["all"])) for s in sides if materials.get(s, materials["all"])]


def cornell(light: Light) -> Scene:
    """A box with a red and a green wall, open to the camera, and a white block."""
    white, red, green = Material((0.7, 0.7, 0.7)), Material((0.6, 0.1, 0.1)), Material((0.1, 0.5, 0.1))
    room = box((-1, -1, -1), (1, 1, 1), {"all": white, "left": red, "right": green})[:5]
    block = box((-0.5, -1, -0.6), (0.1, 0.2, 0.0), {"all": white})
    return Scene((*room, *block), (light,), (CAMERA,))


def analytic() -> None:
    """Furnace, light over a plane, sky beside a wall, and one bounce from a small lit patch, each with its derivation."""
    # Closed furnace: L_e everywhere and no other light, so E_1 = π·L_e, and E_N = π·L_e·(1 + ρ + … + ρ^(N−1)).
    glow = Material((0.5, 0.5, 0.5), (1.0, 2.0, 3.0))
    furnace = Tracer(Scene(tuple(box((-1, -1, -1), (1, 1, 1), {"all": glow})), (), (CAMERA,)))
    points = np.array([[0.3, -1.0, 0.2], [0.999, -1.0, 0.999]], np.float32)
    up = np.array([[0.0, 1.0, 0.0]] * 2, np.float32)
    for bounces in (1, 2, 64):
        E = furnace.irradiance(points, up, up, 32, 1, bounces)
        report(f"furnace, {bounces} bounces", E, np.pi * (2.0 - 0.5 ** (bounces - 1)) * np.array([[1.0, 2.0, 3.0]] * 2))

    # Point light at height 1 over a plane: L = ρ/π·I·cosθ/d², with cosθ = 1/d and d² = 1 + x².
    plane = quad((-5, 0, 5), (10, 0, 0), (0, 0, -10), Material((0.5, 0.5, 0.5)))
    lamp = Light((0, 1, 0), (2.0, 2.0, 2.0), physical=True)
    tracer = Tracer(Scene((plane,), (lamp,), (CAMERA,)))
    x = np.array([0.0, 0.5, 2.0])
    hit = tracer.hit(mi.Point3f(x, 2.0, 0.0), mi.Vector3f(0.0, -1.0, 0.0))
    E = np.array(tracer.lit(lamp, hit)[0]).T
    report("point light over a plane", E[:, :1], (2.0 / (1.0 + x**2) ** 1.5)[:, None])
    # The same light in OpenGL's terms: E = π·diffuse·cosθ/(1 + 2d + 3d²)
    gl = Light((0, 1, 0), (2.0, 2.0, 2.0), attenuation=(1.0, 2.0, 3.0))
    d = np.sqrt(1 + x**2)
    E = np.array(tracer.lit(gl, hit)[0]).T
    report("OpenGL light over a plane", E[:, :1], (np.pi * 2.0 / d / (1 + 2 * d + 3 * d**2))[:, None])

    # A wall of height h, so long that its ends do not matter, at distance x hides (1 − x/√(x²+h²))/2 of a uniform sky.
    wall = quad((0, 0, 4000), (0, 0, -8000), (0, 2, 0), Material((0.0, 0.0, 0.0)))
    tracer = Tracer(Scene((wall,), (), (CAMERA,), sky=(1.0, 1.0, 1.0)))
    tracer.epsilon = 1e-5
    E = tracer.irradiance(np.array([[-1.0, 0.0, 0.0]] * 2, np.float32), up, up, 64, 1)
    report("sky beside a wall", E[:, :1], np.full((2, 1), np.pi * (1 - (1 - 1 / np.sqrt(5)) / 2)))

    # A patch facing down, lit by a lamp close below it: E at a point r below is Σ ρ/π·I·cosθ/d²·cosθ_1·cosθ_2/r²·dA over it.
    patch = quad((-0.1, 1, -0.1), (0.2, 0, 0), (0, 0, 0.2), Material((0.5, 0.5, 0.5)))
    lamp = Light((0.05, 0.95, 0.0), (1.0, 1.0, 1.0), physical=True)
    tracer = Tracer(Scene((patch,), (lamp,), (CAMERA,)))
    E = np.mean([tracer.irradiance(points[:1] * 0, up[:1], up[:1], 256, k) for k in range(16)], axis=0)
    x, z = np.meshgrid(*[(np.arange(400) + 0.5) / 2000 - 0.1] * 2)
    d2, r2 = (x - 0.05) ** 2 + 0.05**2 + z**2, x**2 + 1 + z**2
    expected = np.sum(0.5 / np.pi * 0.05 / d2**1.5 / r2**2) / 2000**2
    report("patch lit from close by", E[:, :1], np.array([[expected]]))


def against_path(name: str, light: Light, emitter: dict[str, Any], bounces: int) -> None:
    """Indirect light as Mitsuba's `path` sees it, max_depth `bounces` + 2 less 2, against ρ/π·E on the same small image.

    Mitsuba's part runs in its scalar variant, so that nothing but the scene is shared; several seeds tell its own noise.
    """
    scene = cornell(light)
    mi.set_variant("scalar_rgb")
    world = mi.load_dict(description(scene, emitter))
    images = []
    for seed in range(4):
        integrators = [mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": 99}) for depth in (bounces + 2, 2)]
        bright, dark = (mi.render(world, integrator=i, spp=SPP, seed=mi.UInt32(seed)) for i in integrators)
        images.append(np.array(bright) - np.array(dark))
    theirs = np.mean(images, axis=0)
    noise = np.sqrt(np.mean(np.var(images, axis=0, ddof=1)) / len(images)) / theirs.mean()

    choose_variant()
    tracer = Tracer(scene)
    ours = np.zeros((SIDE, SIDE, 3))
    random = np.random.default_rng(0)
    for stratum in np.ndindex(STRATA, STRATA):
        dy, dx = (np.reshape(stratum, (2, 1, 1)) + random.random((2, SIDE, SIDE))) / STRATA
        hit = look(tracer, CAMERA, (SIDE, SIDE), dx, dy)
        p, n, g = (image(v, (SIDE, SIDE)).reshape(-1, 3) for v in (hit.p, hit.n, hit.g))
        E = tracer.irradiance(p, n, g, 8, int(random.integers(1, 20_000)), bounces).reshape(SIDE, SIDE, 3)
        ours += np.where(image(hit.valid, (SIDE, SIDE))[..., None], image(hit.albedo, (SIDE, SIDE)) / np.pi * E, 0.0) / STRATA**2
    print(
        f"{name:30} {bounces} bounces against path: mean {ours.mean() / theirs.mean() - 1:+.2%}, "
        f"RMS {np.sqrt(np.mean((ours - theirs) ** 2)) / theirs.mean():.2%}, of which path's own noise {noise:.2%}"
    )


def description(scene: Scene, emitter: dict[str, Any]) -> dict[str, Any]:
    """The scene in Mitsuba's terms, two-sided Lambertian, seen by CAMERA; its light is `emitter`."""
    look_at = mi.ScalarTransform4f().look_at(list(CAMERA.eye), list(CAMERA.target), list(CAMERA.up))
    film = {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "fov": CAMERA.fov, "fov_axis": "y", "to_world": look_at, "film": film}
    result: dict[str, Any] = {"type": "scene", "light": emitter, "sensor": sensor}
    for k, mesh in enumerate(scene.meshes):
        color = {"type": "rgb", "value": list(mesh.material.albedo)}
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict({"type": "twosided", "nested": {"type": "diffuse", "reflectance": color}})
        shape = mi.Mesh(f"mesh{k}", vertex_count=len(mesh.positions), face_count=len(mesh.faces), props=properties)
        parameters = mi.traverse(shape)
        parameters["vertex_positions"] = mesh.positions.ravel()
        parameters["faces"] = mesh.faces.astype(np.uint32).ravel()
        parameters.update()
        result[f"mesh{k}"] = shape
    return result


def report(what: str, found: Any, expected: Any) -> None:
    """Print the greatest relative error of what was found."""
    print(f"{what:30} off by at most {np.abs(found / expected - 1).max():.2%}")


def main() -> None:
    """Run all checks and print their results."""
    print(f"Mitsuba {mi.__version__}, {choose_variant()}")
    analytic()
    position, target = (0.3, 0.4, 0.5), (-0.2, -1.0, 0.0)
    point = {"type": "point", "position": list(position), "intensity": {"type": "rgb", "value": [1.0, 2.0, 3.0]}}
    mi.set_variant("scalar_rgb")
    spot = {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(position, target, [0.0, 0.0, 1.0]),
        "intensity": {"type": "rgb", "value": [1.0, 2.0, 3.0]},
        "cutoff_angle": 40.0,
        "beam_width": 25.0,
    }
    sun = {"type": "directional", "direction": [-0.3, -0.5, -1.0], "irradiance": {"type": "rgb", "value": [1.0, 2.0, 3.0]}}
    strength = (1.0 / np.pi, 2.0 / np.pi, 3.0 / np.pi)  # OpenGL's: E = π·diffuse·cosθ
    cone = Light(position, (1.0, 2.0, 3.0), physical=True, spot_target=target, spot_cutoff=40.0, spot_inner=25.0)
    for bounces in (1, 3):
        against_path("point light", Light(position, (1.0, 2.0, 3.0), physical=True), point, bounces)
        against_path("spot with a soft edge", cone, spot, bounces)
        against_path("directional light", Light((0.3, 0.5, 1.0), strength, directional=True), sun, bounces)


if __name__ == "__main__":
    main()
