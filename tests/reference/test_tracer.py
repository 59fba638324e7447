"""The path tracer itself, where Mitsuba is installed: against formulas, against the references, and in the command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import irrsplat
from irrsplat.app import cli
from irrsplat.core.color import LUMINOUS_EFFICACY
from irrsplat.meter.light_meter import LightMeter
from irrsplat.reference.truth import MOST_BOUNCES, traced
from irrsplat.scene.model import Camera, Light, Scene
from tests.app.work.test_verify import rows
from tests.support.luminaires import bilinear, lambert, lopsided, photometry, steps
from tests.support.truth import load_reference
from tests.support.worlds import box, material, point_light, quad

CAMERA = Camera((0.0, 0.0, 0.9), (0.0, 0.0, 0.0))


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty cache folder."""
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))


def inside(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points spread evenly over the inner sides of the cube from -1 to 1, count² a side, and their normals; (N, 3) each."""
    s = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    u, v = (x.ravel() for x in np.meshgrid(s, s))
    sides = [(np.roll(np.stack([np.full_like(u, end), u, v], 1), axis, 1), axis, end) for axis in range(3) for end in (-1.0, 1.0)]
    normals = [np.tile(-end * np.eye(3)[axis], (count * count, 1)) for _, axis, end in sides]
    return np.concatenate([p for p, _, _ in sides]).astype("f4"), np.concatenate(normals).astype("f4")


def test_random_numbers_of_lanes_and_seeds_are_independent(mitsuba: Any) -> None:
    """Pairs of first numbers fill the cells of a square evenly: χ² of 63 degrees of freedom is 63 ± 11."""
    import drjit as dr
    from mitsuba import UInt32

    a, b = (np.array(mitsuba.generator(seed, 7, dr.arange(UInt32, 1 << 18)).next_float32()) for seed in (1, 2))
    for pair in ((a[:-1], a[1:]), (a[:-23], a[23:]), (a, b)):
        counts, expected = np.histogram2d(*pair, bins=8)[0], len(pair[0]) / 64.0
        assert ((counts - expected) ** 2).sum() / expected < 120.0


@pytest.mark.parametrize("bounces", [0, 1, 3, MOST_BOUNCES])
def test_a_furnace_of_many_bounces(mitsuba: Any, bounces: int) -> None:
    """Every direction brings L_e + ρ/π·E_(N-1), so that E_N = π·L_e·(1 + ρ + … + ρ^(N-1)), and of all π·L_e/(1-ρ).

    Without noise as long as no path may end: while the brightest channel's ρ^k is above LEAST_WEIGHT. (In thousands of paths one
    may slip out through an edge of the room.) With noise, 1024 paths have a standard error of 0.7 %.
    """
    albedo, emission = np.array([0.3, 0.8, 0.5]), np.array([1.0, 2.0, 3.0])
    path_tracer = mitsuba.Tracer(Scene((box((-1, -1, -1), (1, 1, 1), material(tuple(albedo), tuple(emission))),), (), (CAMERA,)))
    p, n = inside(2)
    E = path_tracer.irradiance(p, n, n, 32, 5, bounces)
    expected = np.pi * emission * (1.0 - albedo**bounces) / (1.0 - albedo)
    assert E.shape == (24, 3)
    exact = 0.8**bounces > mitsuba.LEAST_WEIGHT
    assert np.allclose(E, expected, rtol=1e-3 if exact else 0.03)
    assert np.allclose(E.mean(axis=0), expected, rtol=1e-4 if exact else 0.006)


@pytest.mark.parametrize(
    ("light", "bounces"),
    [
        ("in the middle", 1),
        ("by the wall", 2),
        ("spot", 4),
        ("of the OpenGL kind", 2),
        ("downlight", 1),
        ("luminaire", MOST_BOUNCES),
    ],
)
def test_a_light_in_a_closed_room(mitsuba: Any, bounces: int, light: str) -> None:
    """All emitted flux arrives, Φ = A·mean(E_direct), and every bounce reflects ρ of it: mean(E_N) = mean(E_direct)·Σ ρ^k.

    k from 1 to N. A light of I emits 4π·I; a spot I·2π·(1 - cos 40°); a luminaire its lumens by the efficacy; for OpenGL's light,
    E_direct is summed over the room.
    """
    downlight, all_around = (
        photometry(steps(0, 60, 13), [0.0], lambert),
        photometry(steps(0, 180, 25), steps(0, 360, 25), lopsided),
    )
    point_light = {
        "in the middle": Light((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), physical=True),
        "by the wall": Light((0.2, 0.95, -0.3), (1.0, 2.0, 3.0), physical=True),
        "spot": Light(
            (0.2, 0.9, -0.3), (1.0, 2.0, 3.0), physical=True, spot_target=(0, -1, 0), spot_cutoff=40.0, spot_inner=40.0
        ),
        "of the OpenGL kind": Light((0.2, 0.5, -0.3), (1.0, 2.0, 3.0), attenuation=(1.0, 0.5, 0.2)),
        "downlight": Light((0.2, 0.9, -0.3), (1.0, 2.0, 3.0), physical=True, photometry=downlight, spot_target=(0.4, -1, 0)),
        "luminaire": Light((0.2, 0.4, -0.3), (1.0, 2.0, 3.0), physical=True, photometry=all_around, spot_target=(1, 0, 0)),
    }[light]
    albedo = np.array([0.3, 0.9, 0.6])
    path_tracer = mitsuba.Tracer(Scene((box((-1, -1, -1), (1, 1, 1), material(tuple(albedo))),), (point_light,), (CAMERA,)))
    flux = {"spot": 2.0 * np.pi * (1.0 - np.cos(np.radians(40.0)))}.get(light, 4.0 * np.pi)
    flux = flux if point_light.photometry is None else point_light.photometry.flux / LUMINOUS_EFFICACY
    direct = flux / 24.0 * np.array([1.0, 2.0, 3.0])
    if light == "of the OpenGL kind":
        q, m = (mitsuba.mi.Vector3f(a.T) for a in inside(100))
        direct = np.array(path_tracer.unoccluded(point_light, mitsuba.mi.Point3f(q), m, m)[0]).mean(axis=1)
    p, n = inside(12)
    E = path_tracer.irradiance(p, n, n, 16, 3, bounces).mean(axis=0)
    assert np.allclose(E, direct * albedo * (1.0 - albedo**bounces) / (1.0 - albedo), rtol=0.01)


@pytest.mark.parametrize("kind", ["all around", "half", "one plane"])
def test_a_luminaire_s_direct_light_is_what_its_table_says(mitsuba: Any, kind: str) -> None:
    """E = color·I·cosθ/(179·d²), I by an interpolation of another kind in the turned frame; beyond the table's ends nothing."""
    vertical, around = {
        "all around": (steps(0, 180, 19), steps(0, 360, 25)),
        "half": ([0.0, 20.0, 33.0, 70.0], steps(0, 360, 25)),
        "one plane": (steps(0, 90, 7), [0.0]),
    }[kind]
    table = photometry(vertical, around, lopsided)
    point_light = Light(
        (0.1, 0.5, 0.2), (1.0, 0.5, 0.0), physical=True, photometry=table, spot_target=(0.4, -1, 0.1), across=(0, 0, 2)
    )
    path_tracer, mi = mitsuba.Tracer(Scene((box((-1, -1, -1), (1, 1, 1)),), (point_light,), (CAMERA,))), mitsuba.mi
    p, n = inside(40)
    E, _, _ = path_tracer.unoccluded(point_light, mi.Point3f(p.T), mi.Vector3f(n.T), mi.Vector3f(n.T))
    z = -np.subtract((0.4, -1, 0.1), point_light.position)
    z /= np.linalg.norm(z)
    x = np.array([0, 0, 1.0]) - z[2] * z
    x /= np.linalg.norm(x)
    way = p - np.asarray(point_light.position)
    intensity = bilinear(lopsided, vertical, around, way @ np.stack([x, np.cross(z, x), z], axis=1))
    d = np.linalg.norm(way, axis=1)
    expected = intensity / 179.0 * np.maximum(-(way * n).sum(1), 0.0) / d**3
    angle = np.degrees(np.arccos(np.clip(-(way @ z) / d, -1.0, 1.0)))
    kept = np.abs(angle - min(vertical[-1], 179.0)) > 0.02  # at a table's end a float's rounding decides
    assert (expected[kept] > 0.0).sum() > 1000
    found, expected = np.array(E).T[kept], expected[kept, None] * (1.0, 0.5, 0.0)
    assert np.allclose(found, expected, rtol=1e-3, atol=1e-5 * expected.max())


def test_a_second_bounce_is_the_first_one_seen_from_there(mitsuba: Any) -> None:
    """E_2(p) = E_1(p) + mean over cosine-distributed rays from p of ρ(q)·E_1(q): with a sky, a light, and open space between."""
    room = [box((-1, -1, -1), (1, 1, 1), material((0.7, 0.5, 0.2))), quad((-0.4, -0.5, 0.4), (0.8, 0, 0), (0, 0.1, -0.8))]
    positions = room[0].positions[room[0].faces].mean(axis=1)
    room[0] = irrsplat.Mesh(room[0].positions, room[0].normals, room[0].faces[positions[:, 2] < 0.9], room[0].material)
    scene = Scene(tuple(room), (Light((0.5, 0.9, 0.0), (1.0, 1.0, 2.0), physical=True),), (CAMERA,), sky=(0.2, 0.1, 0.3))
    path_tracer, mi = mitsuba.Tracer(scene), mitsuba.mi
    p, up = np.array([[0.1, -1.0, 0.2]], "f4"), np.array([[0.0, 1.0, 0.0]], "f4")
    found = path_tracer.irradiance(p, up, up, 256, 1, 2)
    u = (np.indices((64, 64)).reshape(2, -1) + np.random.default_rng(0).random((2, 4096))) / 64
    directions = mi.Frame3f(mi.Vector3f(0.0, 1.0, 0.0)).to_world(mitsuba.cosine_hemisphere(mi.Point2f(u)))
    q = path_tracer.hit(mi.Point3f(*p[0].tolist()), directions)
    at, n, g, albedo = (np.array(x).T for x in (q.p, q.n, q.g, q.albedo))
    hit = np.array(q.valid)
    further = np.zeros((4096, 3))
    further[hit] = albedo[hit] * path_tracer.irradiance(at[hit], n[hit], g[hit], 16, 7)
    expected = path_tracer.irradiance(p, up, up, 256, 2) + further.mean(axis=0)
    assert 0.5 < hit.mean() < 1.0 and (further.mean(axis=0) > 0.1 * expected).all()
    assert np.allclose(found, expected, rtol=0.01)


def test_a_panel_close_to_a_vast_ground_lights_it_unless_a_sheet_is_between(mitsuba: Any) -> None:
    """A square of side 4 cm at a height of 1 cm, on a ground of 200 m: E is L times the integral of (h/(x² + y² + h²))² dA.

    An offset in proportion to the scene, 6 mm, had rays begin above a sheet at 3 mm, and end close to the panel.
    """
    up, side, h = np.array([[0.0, 1.0, 0.0]], "f4"), 0.04, 0.01
    ground = quad((-100, 0, -100), (0, 0, 200), (200, 0, 0), material(0.0))
    panel = quad((-side / 2, h, -side / 2), (side, 0, 0), (0, 0, side), material(0.0, 1.0))
    sheet = quad((-0.5, 0.003, -0.5), (1, 0, 0), (0, 0, 1), material(0.0))
    x, y = ((np.indices((400, 400)) + 0.5) / 400 - 0.5) * side
    expected = ((h / (x**2 + y**2 + h**2)) ** 2).mean() * side**2
    for between, E in ([], expected), ([sheet], 0.0):
        tracer = mitsuba.Tracer(Scene((ground, panel, *between), (), (CAMERA,)))
        assert np.allclose(tracer.irradiance(np.zeros((1, 3), "f4"), up, up, 128, 1), E, rtol=0.02)


@pytest.mark.parametrize("bounces", [1, pytest.param("all", marks=pytest.mark.long)])
def test_a_traced_view_is_that_of_the_references(mitsuba: Any, bounces: int | str) -> None:
    """Pixel i of 80 has its centre where pixel 5i + 2 of 400 has: (i + ½)/80 = (5i + 2 + ½)/400."""
    scene, reference = irrsplat.load("cornell"), load_reference("cornell")
    truth = traced(scene, scene.cameras[0], (80, 80), bounces, 2048)
    common = (reference.pixels % 5 == 2).all(axis=1)
    at = tuple(reference.pixels[common].T // 5)
    E_ref, agreement = reference.of(bounces)
    E, E_ref = truth.irradiance[at].astype(float), E_ref[common].astype(float)
    noise = truth.noise
    assert common.sum() > 50 and noise is not None and noise < 0.03
    # 3·(the two noises together) for the RMS over so many pixels; the mean is known better by the root of their number
    off = np.hypot(noise, agreement / 2.0)
    assert np.sqrt(np.mean((E - E_ref) ** 2)) / E_ref.mean() <= 3.0 * off
    assert abs(E.mean() / E_ref.mean() - 1.0) <= 4.0 * off / np.sqrt(common.sum())
    clear = common & (reference.edge > 3)
    assert np.allclose(truth.direct[tuple(reference.pixels[clear].T // 5)], reference.direct[clear], rtol=2e-3, atol=1e-5)


def test_the_command_on_a_real_scene(mitsuba: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The renderer sees what the tracer sees: direct light agrees, and the irradiance within what the default promises."""
    assert (
        cli.main(
            ["verify", "cornell", "--size", "64", "64", "--samples", "512", "--bounces", "1", "-o", str(tmp_path / "out.png")]
        )
        == 0
    )
    out, _ = capsys.readouterr()
    found = {name: float(value.split()[0].replace(",", "")) for name, value in rows(out).items()}
    assert found["relative RMSE"] <= 8.0 and abs(found["bias of the mean"]) <= 2.0
    assert found["direct light RMSE"] <= 1.0
    assert found["noise of reference"] <= 3.0
    assert (tmp_path / "out.png").is_file()


def test_a_meter_above_a_suspended_panel_agrees_with_paths(mitsuba: Any) -> None:
    """A panel of 2 m hangs 8 cm below a ceiling, so that all light there has two bounces or more.

    The sites of the first level are 20 cm apart: readings are up to 40 % too bright. Those of the finest level have half the
    distance. 8192 paths per point have a standard error of 2 %.
    """
    paint = material(0.7)
    panel = box((1.0, 2.4, 1.0), (3.0, 2.42, 2.0), paint)
    room = Scene((box((0, 0, 0), (4, 2.5, 3), paint, outward=False), panel), (point_light((2.0, 2.0, 1.5), 5.0),), (CAMERA,))
    points = np.array([[x, y, z] for y in (2.42, 2.5) for x, z in ((2.0, 1.5), (2.0, 1.2), (1.3, 1.5))], "f4")
    normals = np.array([[0, 1, 0]] * 3 + [[0, -1, 0]] * 3, "f4")
    traced = [mitsuba.Tracer(room).irradiance(points + 1e-5 * normals, normals, normals, 64, seed, 40) for seed in (1, 2)]
    with LightMeter(room) as meter:
        measured = meter.measure(points, normals).indirect
    assert measured.mean(1) == pytest.approx(np.mean(traced, axis=(0, 2)), rel=0.15)


def _as_of_mitsuba(mi: Any, scene: irrsplat.Scene, side: int) -> Any:
    """Return an opaque scene of plain colours with point lights, and its first camera, in Mitsuba's terms."""
    parts: dict[str, Any] = {}
    for i, mesh in enumerate(scene.meshes):
        diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(mesh.material.albedo)}}
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict({"type": "twosided", "both": diffuse})
        made = mi.Mesh("mesh", vertex_count=len(mesh.positions), face_count=len(mesh.faces), props=properties)
        parameters = mi.traverse(made)
        parameters["vertex_positions"] = mesh.positions.ravel()
        parameters["faces"] = mesh.faces.astype(np.uint32).ravel()
        parameters.update()
        parts[f"mesh{i}"] = made
    for i, light in enumerate(scene.lights):
        intensity = {"type": "rgb", "value": list(light.color)}
        parts[f"light{i}"] = {"type": "point", "position": list(light.position), "intensity": intensity}
    camera = scene.camera()
    view = mi.ScalarTransform4f().look_at(list(camera.eye), list(camera.target), list(camera.up))
    film = {"type": "hdrfilm", "width": side, "height": side, "rfilter": {"type": "box"}}
    sensor = {"type": "perspective", "to_world": view, "fov": camera.fov, "fov_axis": "y", "film": film}
    return mi.load_dict({"type": "scene", "sensor": sensor, **parts})


@pytest.mark.long
def test_pictures_agree_with_mitsubas_own_path_tracer() -> None:
    """Radiance with all bounces, by code that shares nothing with ours: the mean of each colour, and of 4×4 pixels.

    At a pixel, 512 paths leave a noise of 4 %; 16 pixels together leave 1 %. The scalar variant needs no LLVM.
    """
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    scene = irrsplat.load("cornell")
    low, high = scene.bounds
    middle = tuple((0.5 * (low + high) + [0.0, 0.2 * (high - low)[1], 0.0]).tolist())  # away from the ceiling: little noise
    scene = replace(scene, lights=(replace(scene.lights[0], position=middle),))
    integrator = mi.load_dict({"type": "path", "max_depth": 24})
    truth = np.array(mi.render(_as_of_mitsuba(mi, scene, 48), spp=512, integrator=integrator))
    image = irrsplat.render(scene, (48, 48), samples=16, backdrop="sky").image
    np.testing.assert_allclose(image.mean((0, 1)), truth.mean((0, 1)), rtol=0.006)
    ours, theirs = (picture.reshape(12, 4, 12, 4, 3).mean((1, 3)) for picture in (image, truth))
    assert np.median(np.abs(ours - theirs) / np.maximum(theirs, 0.01)) < 0.02
