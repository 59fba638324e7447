"""`irrsplat verify`: what it measures, what it keeps, and what it says; the path tracer itself where Mitsuba is installed."""

from __future__ import annotations

import importlib.util
import re
import sys
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
from irrsplat.app.common.error_colours import BRIGHT, DARK, GREY
from irrsplat.app.verify import error_image, measure, verify
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.reference import worker
from irrsplat.reference.truth import MOST_BOUNCES, Traced, compare, folder, key_of, side_of, traced
from irrsplat.scene.model import Camera, Image, Light, Material, Scene, Texture
from tests.support.luminaires import lambert, photometry
from tests.support.truth import SIZE, load_reference
from tests.support.truth import compare as compare_pixels

VERIFY = ["verify", "plain.scene", "--size", "6", "4", "--samples", "8", "--bounces", "1"]


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder, not there yet."""
    monkeypatch.setenv("IRRSPLAT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def plain(width: int, height: int, E: float = 0.8, spread: float = 0.02) -> dict[str, np.ndarray]:
    """A truth of one irradiance, whose halves lie `spread` above and below it; its leftmost column is an edge."""
    grey, yes = np.full((height, width, 3), 0.5, np.float32), np.ones((height, width), bool)
    inner = yes.copy()
    inner[:, 0] = False
    halves = np.stack([np.full_like(grey, E * (1 + spread)), np.full_like(grey, E * (1 - spread))])
    normal, flags = np.zeros_like(grey) + np.float32([0, 0, 1]), {"seen": yes, "valid": inner, "clear": inner}
    surface = {
        "albedo": grey,
        "normal": normal,
        "tint": np.ones_like(grey),
        "glow": 0 * grey,
        "opacity": np.ones_like(grey[..., 0]),
    }
    return {"halves": halves, "direct": grey, "emission": 0 * grey, **surface, **flags}


@pytest.fixture
def tracer(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Stands in for the path tracer: `calls` holds what it was asked, `make` makes what it answers."""
    it = SimpleNamespace(calls=[], make=plain)

    def trace(
        scene: Scene, camera: Camera, size: tuple[int, int], side: int, bounces: int, progress: Any = None
    ) -> dict[str, np.ndarray]:
        it.calls.append((scene, camera, size, side, bounces))
        if progress is not None:
            progress(1.0)
        return it.make(*size)

    monkeypatch.setattr(worker, "trace", trace)
    return it


# ---- measures ------------------------------------------------------------------------------------------------------------


def test_the_measures_are_those_of_the_references() -> None:
    """The reference's pixels as a picture with a mask: the same sums over the same pixels as tests/truth.py makes of them."""
    reference = load_reference("cornell")
    at, random = tuple(reference.pixels.T), np.random.default_rng(1)
    channels = {name: np.zeros((SIZE, SIZE, 3), np.float32) for name in ("irradiance", "direct", "position")}
    for name in channels:
        values = getattr(reference, name)
        channels[name][at] = values * (1.0 + 0.2 * random.standard_normal(values.shape))
    masks = {"valid": np.zeros((SIZE, SIZE), bool), "clear": np.zeros((SIZE, SIZE), bool)}
    masks["valid"][at], masks["clear"][at] = True, reference.edge > 3
    E, L = np.zeros((2, SIZE, SIZE, 3), np.float32), np.zeros((SIZE, SIZE, 3), np.float32)
    E[:, *at], L[at] = reference.irradiance, reference.direct
    truth = Traced(**plain(SIZE, SIZE) | {"halves": E, "direct": L} | masks)
    frame: Any = SimpleNamespace(**channels, albedo=truth.albedo, normal=truth.normal)
    found, wanted = compare(frame, truth), compare_pixels(frame, reference)
    assert wanted["outliers"] > 0.05
    for name, other in (("rmse", "rmse"), ("bias", "bias"), ("outliers", "outliers"), ("direct", "direct_rms")):
        assert found[name] == pytest.approx(wanted[other], rel=1e-6), name


def test_the_noise_is_that_of_both_halves_together() -> None:
    """Halves with independent errors of 10 % of the mean: their mean is off by 10 %/√2, and the halves alone tell so."""
    random = np.random.default_rng(2)
    truth = Traced(**plain(100, 100) | {"halves": (1.0 + 0.1 * random.standard_normal((2, 100, 100, 3))).astype("f4")})
    off = np.sqrt(np.mean((truth.irradiance[truth.valid] - 1.0) ** 2))
    assert off == pytest.approx(0.1 / np.sqrt(2), rel=0.02)
    assert truth.noise == pytest.approx(off, rel=0.02)


def test_a_dark_truth_has_no_relative_error() -> None:
    dark = Traced(**plain(4, 4, E=0.0) | {"direct": np.zeros((4, 4, 3), "f4")})
    frame: Any = SimpleNamespace(irradiance=0 * dark.albedo, direct=0 * dark.albedo, albedo=dark.albedo, normal=dark.normal)
    assert {name for name, value in compare(frame, dark).items() if value is not None} == {"albedo", "normal"}
    assert dark.noise is None


def test_albedo_and_normal_are_compared_by_medians() -> None:
    """Two thirds of the pixels are off by 0.03 in albedo, and tilted by 2° about x; the rest by far more."""
    truth = Traced(**plain(31, 20))
    columns, (sine, cosine) = np.arange(31), (np.sin(np.radians(2.0)), np.cos(np.radians(2.0)))
    albedo, normal = truth.albedo + np.float32(0.03), np.zeros_like(truth.normal) + np.float32([0.0, sine, cosine])
    albedo[:, columns > 21], normal[:, columns > 21] = 0.0, (1.0, 0.0, 0.0)
    frame: Any = SimpleNamespace(irradiance=truth.irradiance, direct=truth.direct, albedo=albedo, normal=normal)
    found = compare(frame, truth)
    assert found["albedo"] == pytest.approx(0.03, rel=1e-4) and found["normal"] == pytest.approx(2.0, rel=1e-4)


def test_spots_and_grain_are_told_from_what_is_smooth() -> None:
    """A truth of 1 left and 0.1 right. Spots of 0.15: one too little where it is bright, one 150 % where it is dark, and one off
    the valid pixels. A chessboard of ±0.05 is fine to the last digit but at the rims; a slope across 200 pixels, many times as
    strong, hardly is."""
    arrays = plain(200, 100, E=1.0, spread=0.0)
    arrays["halves"][:, :, 100:] = 0.1
    truth = Traced(**arrays)
    spotted = truth.irradiance.copy()
    spotted[50, [0, 30, 150]] += np.float32(0.15)
    frame: Any = SimpleNamespace(irradiance=spotted, direct=truth.direct, albedo=truth.albedo, normal=truth.normal)
    mean, count = truth.irradiance[truth.valid].mean(), truth.valid.sum()
    assert compare(frame, truth)["spots"] == 1 / count
    row, column = np.indices((100, 200))
    frame.irradiance = truth.irradiance + (0.05 * (-1.0) ** (row + column) + 0.01 * (column - 100))[..., None]
    fine = compare(frame, truth)["fine"]
    assert fine is not None and 1.0 < fine * mean / 0.05 < 1.1
    noise = 0.2 * np.random.default_rng(3).standard_normal((2, 100, 200, 3))
    noisy = compare(frame, Traced(**arrays | {"halves": (arrays["halves"] + noise).astype("f4")}))["fine"]
    assert noisy == pytest.approx(fine, rel=0.05)


def test_filters_tint_the_picture_of_the_truth() -> None:
    """0.25 + 0.5·0.8/π + 2 behind a filter that lets a half, nothing and all of red, green and blue through, and adds 1/8."""
    arrays = plain(2, 2, spread=0.0) | {"direct": np.full((2, 2, 3), 0.25, "f4"), "emission": np.full((2, 2, 3), 2.0, "f4")}
    tint, glow = np.zeros((2, 2, 3), "f4") + np.float32([0.5, 0.0, 1.0]), np.full((2, 2, 3), 0.125, "f4")
    picture = Traced(**arrays | {"tint": tint, "glow": glow}).picture
    assert np.allclose(picture, (2.25 + 0.4 / np.pi) * np.array([0.5, 0.0, 1.0]) + 0.125, rtol=1e-6)


def test_every_sample_asked_for_is_taken() -> None:
    for samples in range(2, 3000):
        side = side_of(samples)
        assert 2 * (side - 1) ** 2 < samples <= 2 * side**2
    for samples in (1, 131_073):
        with pytest.raises(InputError, match="131072"):
            side_of(samples)


def test_the_colours_of_an_error() -> None:
    """0 is white, +20 % of the mean and more red, −10 % half way from white to blue; where nothing is seen it is grey."""
    truth = Traced(**plain(4, 1, E=1.0) | {"seen": np.array([[True, True, True, False]])})
    E = np.ones((1, 4, 3), np.float32) * np.array([1.0, 1.5, 0.9, 9.0], np.float32)[None, :, None]
    white, red, pale, grey = error_image.signed_error(E, truth)[0] * 255.0
    assert np.allclose(white, 255.0, atol=0.01)
    assert np.allclose(red, BRIGHT, atol=0.01)
    assert np.allclose(pale, (255.0 + np.array(DARK)) / 2.0, atol=0.01)
    assert np.allclose(grey, GREY, atol=0.01)


# ---- the cache folder ----------------------------------------------------------------------------------------------------


def test_a_view_is_traced_once(tracer: SimpleNamespace, cache: Path) -> None:
    scene = irrsplat.load("cornell")
    first = traced(scene, scene.cameras[0], (6, 4), 3, 8)
    again = traced(irrsplat.load("cornell"), scene.cameras[0], (6, 4), 3, 7)  # 7 samples are 2·2², as 8 are
    assert [call[2:] for call in tracer.calls] == [((6, 4), 2, 3)]
    for name, array in vars(first).items():
        assert np.array_equal(array, getattr(again, name)) and array.dtype == getattr(again, name).dtype
    assert len(list(cache.iterdir())) == 1  # and no part of a file


def test_the_key_sees_all_that_the_truth_depends_on() -> None:
    scene = irrsplat.load("cornell")
    camera, mesh, light = scene.cameras[0], scene.meshes[0], scene.lights[0]
    spot = Light((0, 1, 0), (1, 1, 1), spot_target=(0, 0, 0), spot_cutoff=40.0, spot_inner=20.0)
    shape = photometry([0, 90], [0], lambert)

    def meshes(**change: Any) -> Scene:
        return replace(scene, meshes=(replace(mesh, **change), *scene.meshes[1:]))

    texels = np.full((2, 2, 4), 200, np.uint8)
    worn = Texture(Image(texels))

    def materials(**change: Any) -> Scene:
        return meshes(material=replace(mesh.material, **change))

    scenes = [
        scene,
        materials(albedo_texture=worn),
        materials(emission_texture=worn),
        materials(normal_texture=worn),
        materials(albedo_texture=Texture(Image(np.full((2, 2, 4), 201, np.uint8)))),
        materials(albedo_texture=Texture(Image(np.full((1, 4, 4), 200, np.uint8)))),
        *(
            materials(albedo_texture=replace(worn, **change))
            for change in (
                {"uv_set": 1},
                {"transform": (1.0, 0.0, 0.5, 0.0, 1.0, 0.0)},
                {"wrap": ("clamp", "repeat")},
                {"wrap": ("repeat", "clamp")},
                {"nearest": True},
            )
        ),
        materials(normal_scale=0.5),
        materials(opacity=0.5),
        materials(alpha_mode="mask"),
        materials(alpha_mode="blend"),
        materials(alpha_cutoff=0.4),
        materials(transmission=0.2),
        materials(double_sided=False),
        meshes(uvs=np.zeros((len(mesh.positions), 4), "f4")),
        meshes(opacities=np.ones(len(mesh.positions), "f4")),
        replace(scene, sky_gradient=(1.0, 1.0, 1.0)),
        replace(scene, up=(0.0, 0.0, 1.0)),
        replace(scene, own_sky=False),
        meshes(positions=mesh.positions + np.float32(1e-6)),
        meshes(normals=-mesh.normals),
        meshes(faces=mesh.faces[::-1]),
        meshes(material=Material((0.1, 0.2, 0.3))),
        meshes(material=replace(mesh.material, emission=(0.1, 0.2, 0.3))),
        meshes(colors=np.full_like(mesh.positions, 0.123)),
        replace(scene, sky=(1.0, 1.0, 1.0)),
        replace(scene, lights=(replace(light, color=(1.0, 2.0, 3.0)),)),
        replace(scene, lights=(replace(light, physical=not light.physical),)),
        replace(scene, lights=(replace(light, attenuation=(1.0, 2.0, 3.0)),)),
        replace(scene, lights=(spot,)),
        replace(scene, lights=(replace(spot, spot_inner=30.0),)),
        replace(scene, lights=(replace(spot, spot_exponent=2.0),)),
        replace(scene, lights=(replace(spot, photometry=shape),)),
        replace(scene, lights=(replace(spot, photometry=replace(shape, candela=shape.candela * 2.0)),)),
        replace(scene, lights=(replace(spot, photometry=shape, across=(0.0, 0.0, 1.0)),)),
    ]
    keys = {key_of(it, camera, (6, 4), 2, 1) for it in scenes}
    keys |= {
        key_of(scene, replace(camera, fov=50.0), (6, 4), 2, 1),
        key_of(scene, camera, (4, 6), 2, 1),
        key_of(scene, camera, (6, 4), 3, 1),
        key_of(scene, camera, (6, 4), 2, 2),
        key_of(scene, camera, (6, 4), 2, "all"),
    }
    assert len(keys) == len(scenes) + 5
    assert key_of(scene, camera, (6, 4), 2, MOST_BOUNCES) == key_of(scene, camera, (6, 4), 2, "all")
    renamed = replace(scene, name="other", path="elsewhere", notices=("x",))
    assert key_of(renamed, replace(camera, name="other"), (6, 4), 2, 1) == key_of(scene, camera, (6, 4), 2, 1)
    copied = materials(albedo_texture=Texture(Image(texels.copy(), "other.png")))
    assert key_of(copied, camera, (6, 4), 2, 1) == key_of(materials(albedo_texture=worn), camera, (6, 4), 2, 1)


def _flip_a_bit(data: bytes) -> bytes:
    """One bit of the first array's own bytes is wrong: those behind the 30 bytes, name and extra field that head it in a zip."""
    name, extra = (int.from_bytes(data[k : k + 2], "little") for k in (26, 28))
    k = 30 + name + extra + 20
    return data[:k] + bytes([data[k] ^ 1]) + data[k + 1 :]


@pytest.mark.parametrize(
    "damage",
    [lambda data: b"", lambda data: data[:-30], lambda data: b"junk" * 99, _flip_a_bit],
    ids=["empty", "cut", "junk", "bit"],
)
def test_a_damaged_file_is_traced_again(tracer: SimpleNamespace, cache: Path, damage: Callable[[bytes], bytes]) -> None:
    scene, said = irrsplat.load("cornell"), []
    traced(scene, scene.cameras[0], (40, 30), 1, 8)
    (path,) = cache.iterdir()
    path.write_bytes(damage(path.read_bytes()))
    traced(scene, scene.cameras[0], (40, 30), 1, 8, notice=said.append)
    assert len(tracer.calls) == 2
    assert said == [f"{path}: damaged; the truth is traced again"]
    traced(scene, scene.cameras[0], (40, 30), 1, 8, notice=said.append)  # it is whole again
    assert (len(tracer.calls), len(said)) == (2, 1)


def test_a_file_with_other_arrays_is_damaged(tracer: SimpleNamespace, cache: Path) -> None:
    scene, said = irrsplat.load("cornell"), []
    traced(scene, scene.cameras[0], (6, 4), 1, 8)
    (path,) = cache.iterdir()
    bad = plain(6, 4)["halves"].copy()
    bad[0, 0, 0, 0] = np.nan
    for change in ({"valid": np.ones((9, 9), bool)}, {"halves": bad}, {"seen": np.ones((4, 6), np.float32)}):
        np.savez(path, **plain(6, 4) | change)
        traced(scene, scene.cameras[0], (6, 4), 1, 8, notice=said.append)
    assert (len(tracer.calls), len(said)) == (4, 3)


def test_a_folder_that_takes_nothing_is_a_notice(tracer: SimpleNamespace, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, said = irrsplat.load("cornell"), []

    def full(file: Any, **_: Any) -> None:
        file.write(b"half of it")
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(np, "savez_compressed", full)
        traced(scene, scene.cameras[0], (6, 4), 1, 8, notice=said.append)
    assert list(cache.iterdir()) == []
    cache.rmdir()
    cache.write_text("a file where the folder should be")
    traced(scene, scene.cameras[0], (6, 4), 1, 8, notice=said.append)
    assert len(tracer.calls) == 2
    assert "No space left on device" in said[0] and all(str(cache) in line for line in said)


def test_the_folder_is_the_users_unless_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, cache: Path) -> None:
    assert folder() == cache
    monkeypatch.delenv("IRRSPLAT_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    assert folder().name == "irrsplat" or folder().parent.name == "irrsplat"
    if sys.platform == "linux":
        assert folder() == tmp_path / "home" / "irrsplat"


def test_a_scene_without_surfaces_cannot_be_traced(tracer: SimpleNamespace) -> None:
    camera = Camera((0, 0, 1), (0, 0, 0))
    with pytest.raises(InputError, match="no surfaces"):
        traced(Scene((), (), (camera,)), camera, (6, 4), 1)
    assert not tracer.calls


# ---- the process ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def child(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[Any]]:
    """Runs a script in the path tracer's place, which has read its job as `job`; returns the shares done, then the answer.

    Each share once, and not the 0 before there is any: how often they are told is a matter of time.
    """

    def run(script: str) -> list[Any]:
        monkeypatch.setattr(worker, "require", lambda: None)
        head = "import os, pickle, sys; job = pickle.load(sys.stdin.buffer)\ndef say(*it): pickle.dump(it, sys.stdout.buffer)\n"
        monkeypatch.setattr(worker, "_MAIN", head + script)
        scene, shares = irrsplat.load("cornell"), []
        answer = worker.trace(scene, scene.cameras[0], (6, 4), 3, 2, shares.append)
        return [*(share for share in dict.fromkeys(shares) if share), answer]

    return run


def test_the_process_gets_the_view_and_answers(child: Any, capfd: pytest.CaptureFixture[str]) -> None:
    script = "say('progress', 0.5); print('noise', file=sys.stderr); say('done', (job[0].triangles, job[1].fov, job[2:]))"
    scene = irrsplat.load("cornell")
    assert child(script) == [0.5, (scene.triangles, scene.cameras[0].fov, ((6, 4), 3, 2))]
    assert capfd.readouterr() == ("", "")  # what its libraries print is kept from the user


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("say('error', 'LLVM is missing')", "^LLVM is missing$"),
        (
            "print('Cannot select: fmaximum', file=sys.stderr, flush=True); os.abort()",
            "SIGABRT: Cannot select: fmaximum.*libllvm19",
        ),
        ("sys.exit(3)", "status 3: it said nothing"),
        ("print('not an answer')", "status 0"),
    ],
)
def test_a_process_that_fails_is_one_line(child: Any, script: str, words: str) -> None:
    with pytest.raises(IrrsplatError, match=words) as caught:
        child(script)
    assert "\n" not in str(caught.value)


def test_without_mitsuba_it_says_what_to_install(
    fake: Any, place: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "mitsuba" else find(name, *rest))
    err = refused([*VERIFY, "-o", "a.png"], 1)
    assert "pip install 'irrsplat[reference]'" in err and "--truth gather --bounces 1" in err


# ---- the command ---------------------------------------------------------------------------------------------------------


def rows(text: str) -> dict[str, str]:
    """The table's values by their names."""
    return {match[1]: match[2] for line in text.splitlines()[1:] if (match := re.match(r"  (\S.*?)\s{2,}(\S.*?)(  |$)", line))}


def test_the_table(fake: Any, tracer: SimpleNamespace, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The stand-in frame is 1 everywhere, the truth 0.8 ± 2 % and 0.5 direct: too much by 1/0.8 − 1 = 25 %, and by 100 %."""
    fake.stats = {"records": 1234}
    assert cli.main([*VERIFY, "--preset", "preview", "--a", "0.3"]) == 0
    out, _ = capsys.readouterr()
    assert out.startswith("plain, 6 x 4, preset preview, one indirect bounce, against path-traced truth\n")
    found = rows(out)
    assert found["pixels compared"] == "20"
    assert found["records"] == "1,234"
    assert (found["relative RMSE"], found["bias of the mean"]) == ("25.00 %", "+25.00 %")
    assert (found["noise of the truth"], found["RMSE without it"]) == ("2.00 %", "24.92 %")  # 25² = 2² + 24.92²
    assert found["off by > 30 %"] == "0.00 %"
    assert found["direct light RMSE"] == "100.00 %"
    assert found["albedo"] == "0.5000"
    assert found["truth"] == "8"
    assert "traced in" in out
    assert (fake.asked.size, fake.asked.preset, fake.asked.settings) == ((6, 4), "preview", {"bounces": 1, "a": 0.3})
    assert cli.main(VERIFY) == 0
    assert "traced before and kept" in capsys.readouterr().out
    assert len(tracer.calls) == 1
    assert list(place.glob("*.png")) == []


@pytest.mark.parametrize(("bounces", "traced_as", "said"), [(2, 2, "2 bounces"), ("all", MOST_BOUNCES, "all bounces")])
def test_more_bounces(
    fake: Any,
    tracer: SimpleNamespace,
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    bounces: int | str,
    traced_as: int,
    said: str,
) -> None:
    """The truth is of the settings' bounces, whether or not they are given by flag; a fine gather knows one of them only."""
    words = [word for word in VERIFY if word not in ("--bounces", "1")]
    assert cli.main(VERIFY) == 0
    for module in (verify, measure):
        monkeypatch.setattr(module, "preset", lambda *_, **__: SimpleNamespace(bounces=bounces))
    assert cli.main(words) == cli.main(words) == 0
    assert f"preset default, {said}, against path-traced truth" in capsys.readouterr().out
    assert [call[-1] for call in tracer.calls] == [1, traced_as]
    assert cli.main([*words, "--truth", "gather"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "--bounces 1" in err and f"not {bounces}" in err


def test_pixels_far_off_are_counted(fake: Any, tracer: SimpleNamespace, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One of the 20 pixels has E = 0.2 in one channel; the mean is then (59·0.8 + 0.2)/60 = 0.79 and 1 − 0.2 > 30 % of it."""

    def make(width: int, height: int) -> dict[str, np.ndarray]:
        arrays = plain(width, height, spread=0.0)
        arrays["halves"][:, 1, 1, 2] = 0.2
        return arrays

    tracer.make = make
    assert cli.main(VERIFY) == 0
    assert rows(capsys.readouterr().out)["off by > 30 %"] == "5.00 %"


def test_pictures(fake: Any, tracer: SimpleNamespace, place: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    asked: list[tuple[np.ndarray, np.ndarray, str]] = []

    def evaluate(truth: np.ndarray, picture: np.ndarray, kind: str, parameters: dict[str, Any]) -> Any:
        asked.append((truth, picture, kind))
        return np.zeros((4, 6, 3), np.float32), 0.125, parameters

    monkeypatch.setitem(sys.modules, "flip_evaluator", SimpleNamespace(evaluate=evaluate))
    assert cli.main([*VERIFY, "-o", "shown"]) == 0
    assert rows(capsys.readouterr().out)["FLIP"] == "0.1250"
    truth, picture, kind = asked[0]
    assert kind == "LDR" and truth.dtype == picture.dtype == np.float32
    assert truth.shape == picture.shape == (4, 6, 3) and truth.max() <= 1.0 and (picture > truth).all()
    assert sorted(path.name for path in (place / "shown").iterdir()) == ["error.png", "flip.png", "picture.png", "truth.png"]
    assert np.array_equal(np.asarray(Picture.open(place / "shown/truth.png")), np.round(truth * 255.0))
    error = np.asarray(Picture.open(place / "shown/error.png"))
    assert error.shape[0] > 4 and error.shape[1:] == (6, 3)  # the legend is below
    assert (error[:4] == BRIGHT).all()  # too bright by 25 %
    assert cli.main([*VERIFY, "-o", "strip.png"]) == 0
    strip = np.asarray(Picture.open(place / "strip.png"))
    assert strip.shape[1] == 18
    assert np.array_equal(strip[:4, :6], np.round(truth * 255.0)) and np.array_equal(strip[:4, 12:], error[:4])


def test_without_flip_its_line_is_left_out(
    fake: Any, tracer: SimpleNamespace, place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert cli.main([*VERIFY, "-o", "shown"]) == 0
    out, err = capsys.readouterr()
    assert "FLIP" not in out
    assert err == "notice: FLIP is left out; run: pip install 'irrsplat[reference]'\n"
    assert sorted(path.name for path in (place / "shown").iterdir()) == ["error.png", "picture.png", "truth.png"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--bounces", "0"], "--bounces 0"),
        (["-o", "a.exr"], "a.exr"),
        (["-o", "nowhere/a.png"], "nowhere"),
        (["--truth", "gather", "-o", "a.png"], "--truth gather"),
        (["--truth", "guess"], "guess"),
        (["--samples", "1"], "'1'"),
        (["--samples", "200000"], "131072"),
        (["--eye", "0", "0", "1"], "--target"),
        (["--a", "99"], "0.01..2"),
        (["--buffers", "depth"], "--buffers"),
        (["--curve", "--a", "0.3"], "--a"),
        (["--curve", "--techniques"], "--techniques"),
        (["--curve", "-o", "folder"], "folder"),
        (["--techniques", "-o", "a.png"], "-o"),
    ],
)
def test_wrong_command_lines(
    fake: Any, tracer: SimpleNamespace, place: Path, refused: Callable[..., str], words: list[str], said: str
) -> None:
    assert said in refused(["verify", "plain.scene", *([] if "--bounces" in words else ["--bounces", "1"]), *words])
    assert not tracer.calls


def test_a_view_of_nothing_is_an_error(
    fake: Any, tracer: SimpleNamespace, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tracer.make = lambda width, height: plain(width, height) | {"valid": np.zeros((height, width), bool)}
    assert cli.main(VERIFY) == 2
    assert "no smooth surface" in capsys.readouterr().err


def test_interrupted_and_unconverged_renderings(
    fake: Any, tracer: SimpleNamespace, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fake.stats = {"converged": False}
    assert cli.main(VERIFY) == 0
    assert "--max-rounds" in capsys.readouterr().err
    fake.stats = {"converged": False, "interrupted": True}
    assert cli.main([*VERIFY, "-o", "a.png"]) == cli.INTERRUPTED
    assert not (place / "a.png").exists()


def test_the_truth_of_a_fine_gather(capsys: pytest.CaptureFixture[str]) -> None:
    """In the closed furnace each record and each pixel of the truth is π·L_e = π, by the same rasters."""
    assert cli.main(["verify", "furnace", "--size", "16", "12", "--truth", "gather", "--gather-size", "8", "--bounces", "1"]) == 0
    out, _ = capsys.readouterr()
    assert "against a fine gather" in out and "3.142 W/m² where 3.142 is true" in out
    found = rows(out)
    assert float(found["relative RMSE"].split()[0]) <= 0.2
    assert int(found["pixels compared"]) > 20
