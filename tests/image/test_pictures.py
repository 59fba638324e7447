"""Pictures with more than pixels: the camera and settings in an EXR, PNGs of 16 bits, and notebooks."""

from __future__ import annotations

import io
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

import irrsplat
from irrsplat.core.files import png_16


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


def test_a_notebook_shows_frame_and_view(frame: irrsplat.Frame) -> None:
    shown = frame._repr_png_()
    assert shown is not None and repr(frame).startswith("<Frame 40x30, ")
    with Image.open(io.BytesIO(shown)) as picture:
        np.testing.assert_array_equal(np.asarray(picture), np.round(255.0 * frame.picture))
    with irrsplat.Renderer(irrsplat.load("cornell"), (40, 30), gather_size=8, shadow_size=64, bounces=1) as renderer:
        shown = renderer.frame()[0]._repr_png_()
    with Image.open(io.BytesIO(shown)) as picture:
        assert picture.size == (40, 30) and 20 < np.asarray(picture).mean() < 235
