"""`irrsplat verify`: error measures, stored references, the table and the picture."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture

import irrsplat
from irrsplat.app import cli
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.image.tonemap import BRIGHT
from irrsplat.reference import disk_cache, worker
from irrsplat.reference.truth import MOST_BOUNCES, Traced, compare, key_of, side_of, traced
from irrsplat.scene.model import Camera, Image, Light, Scene, Texture
from tests.support.luminaires import lambert, photometry

VERIFY = ["verify", "plain.scene", "--size", "6", "4", "--samples", "8", "--bounces", "1"]


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Set a cache folder that does not exist yet, without a path tracer except that of `child`; return the folder."""
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "mitsuba" else find(name, *rest))
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def plain(width: int, height: int, E: float = 0.8, spread: float = 0.02) -> dict[str, np.ndarray]:
    """Return a reference of constant irradiance; its halves are higher and lower by `spread`, its left column is an edge."""
    grey, yes = np.full((height, width, 3), 0.5, np.float32), np.ones((height, width), bool)
    inner = yes.copy()
    inner[:, 0] = False
    halves = np.stack([np.full_like(grey, E * (1 + spread)), np.full_like(grey, E * (1 - spread))])
    normal, flags = np.zeros_like(grey) + np.array([0, 0, 1], np.float32), {"seen": yes, "valid": inner, "clear": inner}
    surface = {
        "albedo": grey,
        "normal": normal,
        "tint": np.ones_like(grey),
        "glow": 0 * grey,
        "opacity": np.ones_like(grey[..., 0]),
    }
    return {"halves": halves, "direct": grey, "emission": 0 * grey, **surface, **flags}


def store(name: str, arrays: dict[str, np.ndarray], bounces: int | str = 1) -> Path:
    """Store a reference of 8 samples for the scene's own view in the cache folder of `traced`; return its file."""
    scene, (height, width) = irrsplat.load(name).recentred.local, arrays["seen"].shape
    path = disk_cache.folder() / f"truth-{key_of(scene, scene.camera(), (width, height), side_of(8), bounces)}.npz"
    disk_cache.write(path, arrays)
    return path


def test_the_noise_of_a_reference_is_that_of_the_mean_of_its_halves() -> None:
    """Halves have independent errors of 10 %: their mean is off by 10 %/√2, as estimated from the two halves alone."""
    random = np.random.default_rng(2)
    reference = Traced(**plain(100, 100) | {"halves": (1.0 + 0.1 * random.standard_normal((2, 100, 100, 3))).astype("f4")})
    off = np.sqrt(np.mean((reference.irradiance[reference.valid] - 1.0) ** 2))
    assert off == pytest.approx(0.1 / np.sqrt(2), rel=0.02)
    assert reference.noise == pytest.approx(off, rel=0.02)


def test_spots_exclude_smooth_errors() -> None:
    """A spot of 0.15 counts only on the valid right side, where it is 150 % of 0.1."""
    arrays = plain(200, 100, E=1.0, spread=0.0)
    arrays["halves"][:, :, 100:] = 0.1
    reference = Traced(**arrays)
    spotted = reference.irradiance.copy()
    spotted[50, [0, 30, 150]] += np.float32(0.15)
    frame: Any = SimpleNamespace(irradiance=spotted, direct=reference.direct, albedo=reference.albedo, normal=reference.normal)
    assert compare(frame, reference)["spots"] == 1 / reference.valid.sum()


# ---- stored references ---------------------------------------------------------------------------------------------------


def test_the_key_depends_on_all_inputs_of_the_reference() -> None:
    """Each change of an input of the reference changes the key; names and equal copies of arrays do not."""
    scene = irrsplat.load("cornell")
    camera, mesh = scene.cameras[0], scene.meshes[0]
    worn, shape = Texture(Image(np.full((2, 2, 4), 200, np.uint8))), photometry([0, 90], [0], lambert)
    spot = Light((0, 1, 0), (1, 1, 1), spot_target=(0, 0, 0), spot_cutoff=40.0, spot_inner=20.0)
    textures: list[Any] = [worn, Texture(Image(np.full((1, 4, 4), 200, np.uint8))), replace(worn, nearest=True)]
    materials: list[Any] = [{"albedo_texture": texture} for texture in textures]
    materials += [{"opacity": 0.5}, {"alpha_mode": "mask"}, {"emission": (0.1, 0.2, 0.3)}, {"normal_texture": worn}]
    meshes: list[Any] = [{"material": replace(mesh.material, **change)} for change in materials]
    meshes += [{"positions": mesh.positions + np.float32(1e-6)}, {"faces": mesh.faces[::-1]}]
    meshes += [{"uvs": np.zeros((len(mesh.positions), 4), "f4")}, {"colors": np.full_like(mesh.positions, 0.123)}]
    lights = [spot, replace(spot, color=(1.0, 2.0, 3.0)), replace(spot, spot_inner=30.0), replace(spot, photometry=shape)]
    scenes = [scene, *(replace(scene, meshes=(replace(mesh, **change), *scene.meshes[1:])) for change in meshes)]
    scenes += [replace(scene, lights=(one,)) for one in lights]
    scenes += [replace(scene, sky=(1.0, 1.0, 1.0)), replace(scene, sky_gradient=(1.0, 1.0, 1.0)), replace(scene, up=(0, 0, 1))]
    keys = {key_of(it, camera, (6, 4), 2, 1) for it in scenes} | {key_of(scene, replace(camera, fov=50.0), (6, 4), 2, 1)}
    keys |= {
        key_of(scene, camera, size, side, bounces) for size, side, bounces in (((4, 6), 2, 1), ((6, 4), 3, 1), ((6, 4), 2, 2))
    }
    assert len(keys) == len(scenes) + 4
    assert key_of(scene, camera, (6, 4), 2, MOST_BOUNCES) == key_of(scene, camera, (6, 4), 2, "all")
    copied = replace(mesh, positions=mesh.positions.copy())
    renamed = replace(scene, meshes=(copied, *scene.meshes[1:]), name="other", path="elsewhere", notices=("x",))
    assert key_of(renamed, replace(camera, name="other"), (6, 4), 2, 1) == key_of(scene, camera, (6, 4), 2, 1)


def _flip_a_bit(data: bytes) -> bytes:
    """Return a zip with one flipped bit in its first array's data, after the header of 30 bytes, the name and extra field."""
    name, extra = (int.from_bytes(data[k : k + 2], "little") for k in (26, 28))
    k = 30 + name + extra + 20
    return data[:k] + bytes([data[k] ^ 1]) + data[k + 1 :]


@pytest.mark.parametrize(
    "damage",
    [lambda data: b"", lambda data: data[:-30], lambda data: b"junk" * 99, _flip_a_bit],
    ids=["empty", "cut", "junk", "bit"],
)
def test_a_damaged_reference_is_refused(damage: Callable[[bytes], bytes]) -> None:
    """An intact file gives its arrays exactly; a damaged file gives a notice and requires the path tracer."""
    scene, notices = irrsplat.load("cornell"), list[str]()
    path = store("cornell", plain(40, 30))
    kept = traced(scene, scene.camera(), (40, 30), 1, 7, notice=notices.append)  # 7 samples are rounded to 8 = 2·2²
    assert all(np.array_equal(array, getattr(kept, name)) for name, array in plain(40, 30).items()) and not notices
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(IrrsplatError, match="there is no path tracer here"):
        traced(scene, scene.camera(), (40, 30), 1, 8, notice=notices.append)
    assert notices == [f"{path}: damaged; the reference is computed again"]


# ---- the process ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def child(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Return a function that replaces the path tracer's process by a script; the script finds its input in `job`."""
    head = "import os, pickle, sys; job = pickle.load(sys.stdin.buffer)\ndef say(*it): pickle.dump(it, sys.stdout.buffer)\n"

    def put(script: str) -> None:
        monkeypatch.setattr(worker, "require", lambda: None)
        monkeypatch.setattr(worker, "_CODE", (head + script).replace("{", "{{").replace("}", "}}"))

    return put


def test_a_traced_result_is_stored(child: Callable[[str], None], cache: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The process receives the view and the samples. The output of its libraries is hidden; a failure to store is a notice."""
    child("""import numpy as np
say('progress', 0.5); print('noise', file=sys.stderr)
(width, height), grey, yes = job[2], np.full((4, 6, 3), job[1].fov, 'f4'), np.ones((4, 6), bool)
names = 'direct', 'albedo', 'emission', 'normal', 'tint', 'glow'
answer = dict.fromkeys(names, grey) | dict.fromkeys(('seen', 'valid', 'clear'), yes)
say('done', answer | {'halves': np.stack([grey * job[3], grey * job[4]]), 'opacity': grey[..., 0] * job[0].triangles})
""")
    scene, shares, notices = irrsplat.load("cornell"), list[float](), list[str]()
    cache.write_text("a file where the folder should be")
    found = traced(scene, scene.camera(), (6, 4), 3, 8, shares.append, notices.append)
    fov = scene.camera().fov
    assert found.opacity == pytest.approx(fov * scene.triangles)
    assert (found.halves[:, 0, 0, 0] == np.float32(fov) * np.array([2, 3], np.float32)).all(), "2² of 8 samples per half"
    assert 0.5 in shares and capfd.readouterr() == ("", "")
    assert notices and all(str(cache) in line for line in notices)
    cache.unlink()
    traced(scene, scene.camera(), (6, 4), 3, 8)
    child("sys.exit(3)")
    again = traced(scene, scene.camera(), (6, 4), 3, 8)
    assert np.array_equal(again.halves, found.halves) and len(list(cache.glob("*.npz"))) == 1


def test_a_failed_process_is_one_line(child: Callable[[str], None]) -> None:
    scene = irrsplat.load("cornell")
    child("print('Cannot select: fmaximum', file=sys.stderr, flush=True); os.abort()")
    with pytest.raises(IrrsplatError, match=r"SIGABRT: Cannot select: fmaximum.*libllvm19") as caught:
        traced(scene, scene.camera(), (6, 4), 1, 8)
    assert "\n" not in str(caught.value)


# ---- the command ---------------------------------------------------------------------------------------------------------


def rows(text: str) -> dict[str, str]:
    """Return the table's values by name."""
    return {match[1]: match[2] for line in text.splitlines()[1:] if (match := re.match(r"  (\S.*?)\s{2,}(\S.*?)(  |$)", line))}


def test_the_table(fake: Any, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The frame is 1 everywhere, the reference 0.8 ± 2 % and 0.5 direct: the errors are 1/0.8 − 1 = 25 % and 100 %."""
    store("plain.scene", plain(6, 4))
    fake.stats = {"records": 1234}
    assert cli.main([*VERIFY, "--preset", "preview", "--a", "0.3"]) == 0
    out, _ = capsys.readouterr()
    assert out.startswith("plain, 6 x 4, preset preview, one indirect bounce, against a path-traced reference\n")
    found = rows(out)
    assert found["pixels compared"] == "20"
    assert found["records"] == "1,234"
    assert (found["relative RMSE"], found["bias of the mean"]) == ("25.00 %", "+25.00 %")
    assert (found["noise of reference"], found["RMSE without it"]) == ("2.00 %", "24.92 %")  # 25² = 2² + 24.92²
    assert found["off by > 30 %"] == "0.00 %"
    assert found["direct light RMSE"] == "100.00 %"
    assert found["albedo"] == "0.5000"
    assert found["reference"] == "8" and "traced before and kept" in out
    assert (fake.arguments.size, fake.arguments.preset, fake.arguments.settings) == ((6, 4), "preview", {"bounces": 1, "a": 0.3})
    assert list(place.glob("*.png")) == []


def test_the_picture(fake: Any, place: Path) -> None:
    """The output is a strip of reference, picture and error, with a legend: too bright by 25 %."""
    store("plain.scene", plain(6, 4))
    assert cli.main([*VERIFY, "-o", "strip.png"]) == 0
    reference, picture, error = np.hsplit(np.asarray(Picture.open(place / "strip.png"))[:4], 3)
    assert (picture > reference).all() and (error == BRIGHT).all()


def test_views_without_a_reference_are_refused(fake: Any, place: Path, refused: Callable[..., str]) -> None:
    """A missing path tracer, a view without valid pixels and an empty scene are refused."""
    err = refused([*VERIFY, "-o", "a.png"], 1)
    assert "pip install 'irrsplat[reference]'" in err
    store("plain.scene", plain(6, 4) | {"valid": np.zeros((4, 6), bool)})
    assert "no smooth surface" in refused(VERIFY)
    camera = Camera((0, 0, 1), (0, 0, 0))
    with pytest.raises(InputError, match="no surfaces"):
        traced(Scene((), (), (camera,)), camera, (6, 4), 1)
