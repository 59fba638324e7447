"""Pictures with more than pixels: the camera and settings in an EXR, PNGs of 16 bits, sheets of all buffers, and notebooks."""

from __future__ import annotations

import io
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

import irrsplat
from irrsplat.app import cli
from irrsplat.core.buffers import CHANNELS
from irrsplat.core.errors import InputError
from irrsplat.core.files import png_16
from irrsplat.image.output.contact_sheet import NARROW, contact_sheet
from irrsplat.image.tonemap import show

QUICK = ["--gather-size", "8", "--shadow-size", "64", "--bounces", "1", "--size", "40", "30"]


@pytest.fixture(scope="module")
def frame() -> irrsplat.Frame:
    scene = irrsplat.load("cornell")
    return irrsplat.render(scene, (40, 30), gather_size=8, shadow_size=64, bounces=1)


def test_the_camera_in_an_exr_finds_every_pixel(frame: irrsplat.Frame, software: bool, tmp_path: Path) -> None:
    """worldToNDC takes the position at a pixel's centre to that pixel, and worldToCamera to minus its depth along z."""
    frame.save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        header = dict(file.header())
    seen = np.isfinite(frame.depth)
    places = np.dstack([frame.position, np.ones_like(frame.depth)])[seen].astype(float)
    np.testing.assert_allclose(-(places @ header["worldToCamera"])[:, 2], frame.depth[seen], rtol=1e-5)
    ndc = places @ header["worldToNDC"]
    rows, columns = np.nonzero(seen)
    x, y = (ndc[:, :2] / ndc[:, 3:]).T
    off = 1e-4 if software else 2.0 / 256.0 / 15.0
    np.testing.assert_allclose(x, (columns + 0.5) / 20.0 - 1.0, atol=off)
    np.testing.assert_allclose(y, 1.0 - (rows + 0.5) / 15.0, atol=off)
    eye = np.linalg.inv(header["worldToCamera"].astype(float))[3, :3]
    np.testing.assert_allclose(eye, irrsplat.load("cornell").camera().eye, atol=1e-4)
    tangent = header["screenWindowWidth"] / 2.0 / (4.0 / 3.0)
    assert 2.0 * np.degrees(np.arctan(tangent)) == pytest.approx(irrsplat.load("cornell").camera().fov, rel=1e-6)
    assert header["irrsplat:gather_size"] == 8.0 and header["irrsplat:gradients"] == "on"
    assert header["irrsplat:preset"] == "default" and header["software"].startswith("irrsplat ")


def test_an_exr_has_blenders_names(frame: irrsplat.Frame, tmp_path: Path) -> None:
    """The names are those of Blender 5: VIEWLAYER.PASS.CHANNEL, with its letters for depth and vectors."""
    frame.save(tmp_path / "a.exr", exr_names="blender")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        found = {name: channel.pixels for name, channel in file.channels().items()}
    requested = {f"ViewLayer.Combined.{c}": frame.image[..., i] for i, c in enumerate("RGB")}
    requested |= {f"ViewLayer.Normal.{c}": frame.normal[..., i] for i, c in enumerate("XYZ")}
    requested |= {f"ViewLayer.irradiance.{c}": frame.irradiance[..., i] for i, c in enumerate("RGB")}
    requested |= {"ViewLayer.Depth.Z": np.where(np.isfinite(frame.depth), frame.depth, 1e10).astype("f4")}
    requested |= {"ViewLayer.Combined.A": np.ones_like(frame.depth), "ViewLayer.weight.X": frame.weight}
    for name, values in requested.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    assert len(found) == 1 + sum(channel.components for channel in CHANNELS.values())


@pytest.mark.parametrize("channels", [3, 4])
def test_16_bits_are_read_back(channels: int) -> None:
    """Pillow, which has 8 bits a channel, reads the upper halves. All 16 bits are sums down the columns (filter "Up")."""
    display = np.random.default_rng(1).random((5, 7, channels))
    display[0, 0], display[0, 1] = 0.0, 1.0
    data = png_16(display)
    values = np.round(65535.0 * display).astype(np.uint16)
    with Image.open(io.BytesIO(data)) as picture:
        assert picture.size == (7, 5)
        np.testing.assert_array_equal(np.asarray(picture), values >> 8)
    packed = data[data.index(b"IDAT") + 4 : data.index(b"IEND") - 8]
    rows = np.frombuffer(zlib.decompress(packed), "u1").reshape(5, -1)
    assert (rows[:, 0] == 2).all()
    read = np.cumsum(rows[:, 1:], axis=0, dtype="u1").view(">u2")
    np.testing.assert_array_equal(read.reshape(5, 7, channels), values)


def test_a_sheet_shows_every_buffer(frame: irrsplat.Frame) -> None:
    """Each buffer's picture is somewhere on it, enlarged by a whole factor; a choice has but those."""
    sheet = np.round(255.0 * frame.contact_sheet()).astype(int)
    factor = -(-NARROW // 40)
    small = np.round(255.0 * frame.contact_sheet(["albedo"])).astype(int)
    assert small.shape[1] < 2 * factor * 40 < sheet.shape[1]
    requested = np.round(255.0 * np.clip(frame.picture, 0.0, 1.0)).astype(int).repeat(factor, 0).repeat(factor, 1)
    corners = np.argwhere((sheet[: -requested.shape[0], : -requested.shape[1]] == requested[0, 0]).all(-1))
    assert any((sheet[y : y + requested.shape[0], x : x + requested.shape[1]] == requested).all() for y, x in corners[:2000])
    assert sheet.reshape(-1, 3).max() > 200 and frame.contact_sheet().dtype == np.float32
    with pytest.raises(InputError, match="unknown buffer 'colour'"):
        frame.contact_sheet(["colour"])


def test_a_notebook_shows_frame_and_view(frame: irrsplat.Frame) -> None:
    shown = frame._repr_png_()
    assert shown is not None and repr(frame).startswith("<Frame 40x30, ")
    with Image.open(io.BytesIO(shown)) as picture:
        np.testing.assert_array_equal(np.asarray(picture), np.round(255.0 * frame.picture))
    with irrsplat.Renderer(irrsplat.load("cornell"), (40, 30), gather_size=8, shadow_size=64, bounces=1) as renderer:
        shown = renderer.frame()[0]._repr_png_()
    with Image.open(io.BytesIO(shown)) as picture:
        assert picture.size == (40, 30) and 20 < np.asarray(picture).mean() < 235


def test_the_flags_say_how_files_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sheet, layers = tmp_path / "sheet.png", tmp_path / "a.exr"
    words = ["render", "cornell", *QUICK, "-o", str(sheet), "-o", str(layers), "--contact-sheet", "--exr-names", "blender"]
    assert cli.main(words) == 0
    with Image.open(sheet) as picture:
        assert picture.width > 2 * NARROW
    with OpenEXR.File(str(layers), separate_channels=True) as file:
        assert "ViewLayer.Combined.R" in file.channels()
    for flags, said in (
        (["--contact-sheet", "-o", str(layers)], "is for a .png"),
        (["--exr-names", "blender", "-o", str(sheet)], "is for an .exr"),
        (["--falsecolor", "--png-bits", "16", "-o", str(sheet)], "two kinds of .png"),
    ):
        assert cli.main(["render", "cornell", *QUICK, *flags]) == 2
        assert said in capsys.readouterr().err


def test_a_sheet_of_what_is_not_there(frame: irrsplat.Frame) -> None:
    """Buffers that were left out are no sheet. Where nothing is seen there is no scale. A wide frame is reduced to 480 pixels."""
    with pytest.raises(InputError, match="holds none of these buffers"):
        contact_sheet(replace(frame, normal=frame.normal[:0, :0]), ["normal"])
    empty = replace(frame, depth=np.full_like(frame.depth, np.inf), position=0.0 * frame.position)
    lines = [contact_sheet(one, ["depth", "position"]) for one in (empty, frame)]
    assert lines[0].shape == lines[1].shape and lines[0].max(-1).astype(bool).sum() < lines[1].max(-1).astype(bool).sum()
    assert not show("position", frame.position, 0.0, np.zeros(frame.depth.shape, bool)).any()
    wide = replace(frame, albedo=frame.albedo.repeat(40, 1), depth=frame.depth.repeat(40, 1))
    assert contact_sheet(wide, ["albedo"]).shape[1] == 480 + 2 * 14


def test_what_no_file_can_be_is_refused_before_it_is_written(frame: irrsplat.Frame, tmp_path: Path) -> None:
    for options, words in (({"png_bits": 12}, "8 or 16, not 12"), ({"exr_names": "maya"}, "blender, not 'maya'")):
        with pytest.raises(InputError, match=words):
            frame.save(tmp_path / "a.png", **options)
    assert not list(tmp_path.iterdir())
