"""Files made from a Frame: they follow the contract, compare with what went in, and appear whole or not at all."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from irrsplat.core.buffers import CHANNELS
from irrsplat.core.color import srgb
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.core.files import write_text
from irrsplat.image.frame import BUFFERS, Frame, check_writable
from irrsplat.image.tonemap import heat, tonemap

WIDTH, HEIGHT, RECORDS = 7, 5, 3
FIGURES = {
    "figure1_quad.png",
    "figure2_direct.png",
    "figure3_first_samples.png",
    "figure4_splat_buffer.png",
    "figure5_normalized.png",
    "figure6_combined.png",
}


@pytest.fixture
def frame() -> Frame:
    """Random buffers, with one pixel that sees nothing, as the contract has them."""
    rng = np.random.default_rng(1)
    arrays: dict[str, Any] = {
        name: rng.random((HEIGHT, WIDTH, 3) if c.components == 3 else (HEIGHT, WIDTH), np.float32) for name, c in CHANNELS.items()
    }
    for name in set(arrays) - {"depth", "emission", "image"}:
        arrays[name][0, 0] = 0.0
    arrays["depth"][0, 0] = np.inf
    records: dict[str, Any] = {
        f"records_{name}": rng.random((RECORDS, 3), np.float32) for name in ("position", "normal", "irradiance")
    }
    figures = {name: rng.random((HEIGHT, WIDTH, 3), np.float32) for name in ("quad", "first_samples", "splat_buffer")}
    stats: Any = {"records": np.int64(RECORDS), "exposure": 1.5, "converged": True, "lost": np.nan}
    return Frame(**arrays, **records, records_radius=rng.random(RECORDS, np.float32), stats=stats, figures=figures)


def test_png_is_the_tone_mapped_picture_top_row_first(frame: Frame, tmp_path: Path) -> None:
    frame.save(tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.mode == "RGB"
        assert picture.size == (WIDTH, HEIGHT)
        np.testing.assert_allclose(np.asarray(picture), 255 * tonemap(frame.image, 1.5), atol=1.0)  # dithered


def test_exr_layers_are_the_buffers(frame: Frame, tmp_path: Path) -> None:
    import OpenEXR

    frame.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        requested = {f"{n}.{s}" for n, c in CHANNELS.items() if c.components == 3 for s in "RGB"}
        requested |= {"weight", "depth", "alpha", "opacity"}
        assert set(file.channels()) == requested
        for name, channel in file.channels().items():
            stem, _, component = name.partition(".")
            values = getattr(frame, stem)
            np.testing.assert_array_equal(channel.pixels, values[..., "RGB".index(component)] if component else values)
            assert channel.pixels.dtype == np.float32
        assert json.loads(file.header()["stats"])["records"] == RECORDS


def test_a_notebook_shows_a_frame(frame: Frame) -> None:
    shown = frame._repr_png_()
    assert shown is not None and repr(frame) == f"<Frame {WIDTH}x{HEIGHT}, {RECORDS} records>"
    with Image.open(io.BytesIO(shown)) as picture:
        np.testing.assert_array_equal(np.asarray(picture), np.round(255.0 * frame.picture))


def test_npz_holds_buffers_records_and_stats(frame: Frame, tmp_path: Path) -> None:
    frame.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        assert set(file) == {*BUFFERS, "stats"}
        for name in BUFFERS:
            assert file[name].dtype == np.float32
            np.testing.assert_array_equal(file[name], getattr(frame, name))
        stats = json.loads(str(file["stats"]))
    # strict JSON: numpy's integers are integers, and NaN, which JSON does not have, is null
    assert stats == {"records": RECORDS, "exposure": 1.5, "converged": True, "lost": None}


def test_folder_holds_every_buffer_and_the_figures_of_the_paper(frame: Frame, tmp_path: Path) -> None:
    frame.save(tmp_path / "out")
    assert {p.name for p in (tmp_path / "out").iterdir()} == {f"{name}.png" for name in CHANNELS} | FIGURES
    for path in (tmp_path / "out").iterdir():
        with Image.open(path) as picture:
            assert picture.size == (WIDTH, HEIGHT)
    for figure, buffer in (("figure2_direct", "direct"), ("figure5_normalized", "indirect"), ("figure6_combined", "image")):
        assert (tmp_path / f"out/{figure}.png").read_bytes() == (tmp_path / f"out/{buffer}.png").read_bytes()


def test_an_existing_folder_keeps_what_is_not_ours(frame: Frame, tmp_path: Path) -> None:
    folder = tmp_path / "v1.2"  # the dot is no ending, since the folder is there
    folder.mkdir()
    (folder / "mine.txt").write_text("keep")
    (folder / "image.png").write_text("replace")
    frame.save(folder, buffers=["image"])
    assert {p.name for p in folder.iterdir()} == {"mine.txt", "image.png"} | FIGURES
    assert (folder / "image.png").stat().st_size > 50


def test_buffers_restrict(frame: Frame, tmp_path: Path) -> None:
    import OpenEXR

    frame.save(tmp_path / "a.npz", buffers=["depth", "records_radius"])
    with np.load(tmp_path / "a.npz") as file:
        assert set(file) == {"depth", "records_radius", "stats"}
    frame.save(tmp_path / "a.exr", buffers=["depth", "records_radius"])
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        assert set(file.channels()) == {"depth"}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.jpg", "unknown ending '.jpg'"),
        ("a.mp4", ".png, .exr, .npz"),
        ("missing/a.png", "does not exist"),
        ("missing/folder", "does not exist"),
        ("folder.png", "is a folder"),
        ("file", "not a folder"),
        ("file/a.png", "Not a directory"),
        ("pipe.npz", "not a regular file"),
        ("n" * 300 + ".png", "too long"),
    ],
)
def test_what_cannot_be_written_is_said_before(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").write_text("x")
    os.mkfifo(tmp_path / "pipe.npz")
    before = sorted(p.name for p in tmp_path.iterdir())
    with pytest.raises(InputError, match=words):
        check_writable(tmp_path / name)
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_unknown_buffers_and_empty_choices(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown buffer 'colour'"):
        check_writable(tmp_path / "a.npz", ["colour"])
    with pytest.raises(InputError, match="nothing to write"):
        check_writable(tmp_path / "a.exr", ["records_radius"])


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.npz", "folder"])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_failed_write_leaves_the_old_file_and_no_part(
    name: str, error: BaseException, frame: Frame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name != "folder":
        (tmp_path / name).write_text("old")

    def fail(source: object, target: object) -> None:
        raise error

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(IrrsplatError if isinstance(error, OSError) else KeyboardInterrupt):
        frame.save(tmp_path / name)
    assert [p.read_text() for p in tmp_path.iterdir()] == ([] if name == "folder" else ["old"])


def test_links_and_permissions(frame: Frame, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link.png").symlink_to(tmp_path / "real/picture.png")
    frame.save(tmp_path / "link.png")
    assert (tmp_path / "link.png").is_symlink()
    assert (tmp_path / "real/picture.png").is_file()
    write_text(tmp_path / "plain", "x")
    plain = tmp_path / "direct"
    plain.touch()  # the mode that the umask gives
    assert (tmp_path / "real/picture.png").stat().st_mode == plain.stat().st_mode


def test_the_filmic_curve() -> None:
    """Mid grey keeps its place: sRGB(0.18) = 1.055·0.18^(1/2.4) − 0.055 = 0.4614; red walls (ρ = 0.63) under twice that
    light stay well below white; and the curve never falls."""
    x = np.linspace(0.0, 20.0, 4001)
    y = tonemap(x, 0.0)
    grey, bright, brightest = tonemap(np.array([0.18, 2.0, np.inf], "f4"), 0.0)
    assert (np.diff(y) >= 0).all()
    assert grey == pytest.approx(0.4614, abs=2e-3) and bright < 0.9 and brightest == pytest.approx(1.0)
    assert tonemap(np.array([0.0, 0.09], "f4"), 1.0) == pytest.approx([0.0, grey])


def test_the_colours_of_scalars() -> None:
    """Viridis runs from (0.267, 0.005, 0.329) by (0.128, 0.567, 0.551) to (0.993, 0.906, 0.144); infinity is black."""
    ramp = np.concatenate([np.linspace(0.0, 1.0, 101), [np.inf]])[None]
    colours = heat(ramp)[0]
    for index, requested in ((0, (0.267, 0.005, 0.329)), (50, (0.128, 0.567, 0.551)), (100, (0.993, 0.906, 0.144))):
        np.testing.assert_allclose(colours[index], requested, atol=0.02)
    assert (colours[101] == 0).all()
    assert np.isfinite(heat(np.full((2, 2), 3.0))).all()  # a constant has no range
    assert (heat(np.full((2, 2), np.inf)) == 0).all()


def test_srgb_is_the_standards() -> None:
    assert srgb(np.array(0.5)) == pytest.approx(0.7354, abs=1e-4)  # IEC 61966-2-1
