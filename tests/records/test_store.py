"""Record caches in files: exact continuation, and refusal of stale, foreign or damaged files with a reason."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat import Frame, InputError, Renderer
from irrsplat.core.buffers import CHANNELS
from irrsplat.core.errors import IrrsplatError
from irrsplat.gpu.target import pixels
from irrsplat.records import cache_file
from irrsplat.scene.model import Camera, Image, Light, Material, Scene, Texture
from irrsplat.settings import Settings, preset
from tests.renderer.test_persistence import turned
from tests.renderer.test_renderer import FAST, FRONT, room
from tests.support.luminaires import lambert, photometry
from tests.support.skies import mapped
from tests.support.worlds import box, material

SIZE = (40, 40)
ALL: dict[str, Any] = FAST | {"bounces": "all"}
RECORDS = ("records_position", "records_normal", "records_irradiance", "records_radius")


def same(one: Frame, other: Frame) -> bool:
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in (*CHANNELS, *RECORDS))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "room.cache"


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache file of `room`, seen from FRONT, with one bounce; read-only."""
    path = tmp_path_factory.mktemp("saved") / "room.cache"
    with Renderer(room(), SIZE, **FAST) as renderer:
        renderer.render()
        renderer.save_cache(path)
    return path


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    with Renderer(room(), SIZE, **FAST) as made:
        yield made


# ---- continuation -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param(ALL, marks=pytest.mark.few_sites),
        FAST | {"preset": "paper", "a": 0.4, "warmup": 60},
        FAST | {"max_records": 300},
    ],
)
def test_a_flight_goes_on_to_the_bit_in_another_process(path: Path, settings: dict[str, Any]) -> None:
    """Views, a file, and further views by a fresh renderer equal those of a single renderer."""
    cameras = [turned(FRONT, angle) for angle in (0.0, 40.0, 100.0, 160.0)]
    with Renderer(room(), SIZE, **settings) as whole:
        before = [whole.render(camera) for camera in cameras[:2]]
        whole.save_cache(path)
        after = [whole.render(camera) for camera in cameras[2:]]
    with Renderer(room(), SIZE, **settings) as fresh:
        fresh.load_cache(path)
        again = fresh.render(cameras[1])
        assert same(again, before[1]) and again.stats["rounds"] == 1, "the last view asks for nothing"
        for camera, frame in zip(cameras[2:], after, strict=True):
            assert same(fresh.render(camera), frame)


@pytest.mark.few_sites
def test_a_known_view_is_shown_at_once_without_any_ray(path: Path) -> None:
    """The first frame shows the file's records, before any surface cache; a render needs no gathering."""
    with Renderer(room(), SIZE, **ALL) as first:
        known = first.render()
        first.save_cache(path)
    with Renderer(room(), SIZE, **ALL) as fresh:
        fresh.load_cache(path)
        view, progress = fresh.frame(seconds=0.001)
        assert progress.coverage == 1.0 and progress.surface < 1.0 and not progress.done
        assert np.array_equal(pixels(view.image)[..., :3], known.image)
    with Renderer(room(), SIZE, **ALL) as again:
        again.load_cache(path)
        frame = again.render()
        assert same(frame, known) and not {"gather", "surface"} & set(frame.stats["stages_ms"])


def test_stale_records_stay_stale(path: Path) -> None:
    """A cache saved during a change of light: stale records, and records that wait for a probe, are stale after loading."""
    fine = {**FAST, "gather_size": 16}  # so that a tick of 0 s is too short for all records
    with Renderer(room(), SIZE, **fine) as first:
        first.render()
        lights = [replace(light, color=(1.0, 2.0, 3.0)) for light in first.scene.lights]
        first.relight(lights)
        first.frame(seconds=0.0)
        stale = np.union1d(first.cache.stale, np.flatnonzero(first.cache.column("due")))
        assert len(stale)
        first.save_cache(path)
        after, gathered = first.render(), first.cache.values[stale]
    with Renderer(replace(room(), lights=tuple(lights)), SIZE, **fine) as fresh:
        fresh.load_cache(path)
        assert np.isin(stale, fresh.cache.stale).all()
        frame = fresh.render()
        assert len(fresh.cache.stale) == 0 and np.allclose(fresh.cache.values[stale], gathered, rtol=0.05, atol=1e-4)
        # additional requests of the view lie elsewhere, since the first renderer had rendered it before
        off = np.linalg.norm(frame.irradiance - after.irradiance, axis=-1)
        assert off.mean() < 0.02 * np.linalg.norm(after.irradiance, axis=-1).mean()


def test_what_only_splatting_depends_on_may_be_another(saved: Path) -> None:
    """With other a, weights and radii, records stay and their radii are recomputed, as in one renderer."""
    other = {"a": 0.8, "adapt": 0.2, "weights": "paper", "blend": 0.7}
    with Renderer(room(), SIZE, **FAST) as whole:
        whole.render()
        whole.change(whole.settings.with_values(other))
        expected = whole.render()
    with Renderer(room(), SIZE, **FAST | other) as fresh:
        fresh.load_cache(saved)
        assert same(fresh.render(), expected)


# ---- refusals ---------------------------------------------------------------------------------------------------------


def relit(**values: Any) -> Scene:
    world = room()
    return replace(world, lights=(replace(world.lights[0], **values), *world.lights[1:]))


PAPER = Texture(Image(np.full((2, 2, 4), 128, "u1")))
SCENES: dict[str, tuple[Callable[[], Scene], str]] = {
    "geometry": (lambda: replace(room(), meshes=(*room().meshes, box((0, 0, 0), (0.1, 0.1, 0.1)))), "another scene"),
    "material": (
        lambda: replace(room(), meshes=(replace(room().meshes[0], material=material(0.1234)), *room().meshes[1:])),
        "materials",
    ),
    "image": (
        lambda: replace(room(), meshes=(replace(room().meshes[0], material=Material(albedo_texture=PAPER)), *room().meshes[1:])),
        "materials",
    ),
    "map": (lambda: mapped(room(), np.ones((4, 8, 3))), "another scene"),
    "sky": (lambda: replace(room(), sky=(0.1, 0.0, 0.0)), "another scene"),
    "light moved": (lambda: relit(position=(0.1, 0.1, 0.1)), "other lights"),
    "light dimmed": (lambda: relit(color=(0.1, 0.1, 0.1)), "other lights"),
    "luminaire of other light": (lambda: relit(photometry=photometry([0, 90], [0], lambert)), "other lights"),
    "one light more": (lambda: replace(room(), lights=(*room().lights, Light((0, 0, 0), (1, 1, 1)))), "other lights"),
}


@pytest.mark.parametrize("name", SCENES)
def test_another_scene_is_refused(saved: Path, name: str) -> None:
    world, said = SCENES[name]
    with pytest.raises(InputError, match=said) as error:
        cache_file.read(saved, cache_file.key(world(), preset(**FAST)))
    assert str(error.value).startswith(f"{saved}: ") and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"bounces": 2}, "--bounces 1, not --bounces 2"),
        ({"gather": "trace"}, "--gather auto, not --gather trace"),
        ({"gather_size": 16}, "--gather-size 8, not --gather-size 16"),
        ({"seed": 1}, "--seed 0, not --seed 1"),
        ({"shadow_size": 128}, "--shadow-size 64, not --shadow-size 128"),
        ({"gradients": False}, "--gradients on, not --gradients off"),
        ({"placement": "scan", "seed": 3}, "--seed 0 --placement tiles, not --seed 3 --placement scan --warmup 1000"),
    ],
)
def test_other_settings_are_refused_by_name(saved: Path, values: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        cache_file.read(saved, cache_file.key(room(), preset(**FAST | values)))


def test_what_records_do_not_depend_on_is_no_reason(saved: Path) -> None:
    """Names of lights, cameras, and the scene's origin; settings of splatting and examination."""
    world = replace(relit(name="lamp"), cameras=(Camera((0, 0, 1), (0, 0, 0)),), name="other", path="elsewhere")
    cache_file.read(saved, cache_file.key(world, preset(**FAST, a=0.1, adapt=0.0, spread=0.0, warmup=3, max_records=100)))
    known = cache_file.key(room(), Settings(placement="scan")).settings
    assert known["warmup"] == 1000, "the random first records of scan placement"


def refused(renderer: Renderer, path: Path) -> str:
    """Return the error for a file; assert that the renderer's records and the file are unchanged."""
    count, content = renderer.cache.count, path.read_bytes() if path.is_file() else b""
    with pytest.raises(InputError) as error:
        renderer.load_cache(path)
    assert renderer.cache.count == count and (path.read_bytes() if path.is_file() else b"") == content
    message = str(error.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    return message


def test_a_damaged_file_is_refused(saved: Path, path: Path, renderer: Renderer) -> None:
    """Truncated anywhere, with any flipped bit, or with appended data."""
    whole = saved.read_bytes()
    rng = np.random.default_rng(0)
    renderer.render()
    for length in (len(whole) - 1, len(whole) // 2, 60, 30):
        path.write_bytes(whole[:length])
        assert "damaged" in refused(renderer, path)
    for place in (30, 50, *rng.integers(60, len(whole), 5)):
        turned_bit = bytearray(whole)
        turned_bit[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(turned_bit)
        assert "damaged" in refused(renderer, path)
    path.write_bytes(whole + b"x")
    assert "damaged" in refused(renderer, path)


def test_a_foreign_file_is_refused(saved: Path, path: Path, renderer: Renderer) -> None:
    for content in (b"irrsplat", b"\x89PNG\r\n", b"cam 0 0 5 0 0 0 0 1 0\n" * 50, bytes(1000), saved.read_bytes()[:15]):
        path.write_bytes(content)
        assert "not a record cache" in refused(renderer, path)
    with Renderer(room(), SIZE, **FAST) as other:
        other.render().save(path.with_suffix(".npz"))
    assert "not a record cache" in refused(renderer, path.with_suffix(".npz"))
    path.write_bytes(b"")
    assert "the file is empty" in refused(renderer, path)
    assert "there is no such file" in refused(renderer, path.with_name("missing"))
    assert "this is a directory" in refused(renderer, path.parent)


def test_another_format_is_refused(saved: Path, path: Path, renderer: Renderer) -> None:
    whole = saved.read_bytes()
    path.write_bytes(whole.replace(b"cache %d\n" % cache_file.FORMAT, b"cache 99\n", 1))
    assert "format 99" in refused(renderer, path) and whole != path.read_bytes()


@pytest.mark.parametrize("missing", ["irradiance", "limit", "position", "about", None])
def test_a_file_that_lacks_something_is_refused(saved: Path, path: Path, renderer: Renderer, missing: str | None) -> None:
    """A valid checksum with invalid content: a missing array, or (None) one of another length."""
    whole = saved.read_bytes()
    head = whole.index(b"\n") + 1
    with np.load(io.BytesIO(whole[head + 32 :])) as arrays:
        kept = {name: arrays[name] for name in arrays.files if name != missing}
    if missing is None:
        kept["limit"] = kept["limit"][:-1]
    content = io.BytesIO()
    np.savez(content, **kept)
    data = content.getvalue()
    path.write_bytes(whole[:head] + hashlib.sha256(data).digest() + data)
    renderer.render()
    assert "damaged" in refused(renderer, path)


# ---- writing ----------------------------------------------------------------------------------------------------------


def test_a_file_is_written_whole_or_not_at_all(
    saved: Path, path: Path, renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk leaves the old file, and no other file next to it."""
    path.write_bytes(saved.read_bytes())
    renderer.load_cache(path)

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_bytes", full)
        with pytest.raises(IrrsplatError, match="No space left"):
            renderer.save_cache(path)
    assert path.read_bytes() == saved.read_bytes() and [p.name for p in path.parent.iterdir()] == [path.name]
    renderer.save_cache(path)
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    renderer.load_cache(path)
    for wrong in (path.parent, path.parent / "none" / "a.cache"):
        with pytest.raises(InputError, match="cannot write"):
            renderer.save_cache(wrong)


def test_an_empty_cache_is_a_cache(path: Path) -> None:
    with Renderer(room(), SIZE, **FAST) as fresh:
        fresh.save_cache(path)
        fresh.load_cache(path)
        assert fresh.cache.count == 0 and fresh.render().stats["converged"]


def test_a_file_of_wrong_content_is_refused(saved: Path, path: Path, renderer: Renderer) -> None:
    """A valid checksum with invalid content: wrong meshes, negative counts, an array of another format."""
    head, whole = saved.read_bytes().split(b"\n", 1)
    with zipfile.ZipFile(io.BytesIO(whole[32:])) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    right, mistaken = (text.encode("utf-32-le") for text in ('"order": [1, 0', '"order": [1, 1'))
    checked, unknown = (text.encode("utf-32-le") for text in ('"checked": 0', '"checked":-1'))
    compared, negative = (text.encode("utf-32-le") for text in ('"compared": ', '"compared":-'))
    renderer.render()
    for name, data in (
        ("about.npy", parts["about.npy"].replace(right, mistaken)),
        ("about.npy", parts["about.npy"].replace(compared, negative)),
        ("about.npy", parts["about.npy"].replace(checked, unknown)),
        ("limit.npy", parts["limit.npy"][:6] + b"\2" + parts["limit.npy"][7:]),
    ):
        with zipfile.ZipFile(stream := io.BytesIO(), "w") as archive:
            for part in parts:
                archive.writestr(part, data if part == name else parts[part])
        assert data != parts[name]
        path.write_bytes(head + b"\n" + hashlib.sha256(stream.getvalue()).digest() + stream.getvalue())
        assert "damaged record cache (ValueError)" in refused(renderer, path)
