"""Images of every kind become the same RGBA bytes, and files are found under the names that other programs write."""

from __future__ import annotations

import io

import numpy as np
import PIL.Image
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene.io.images import find_file
from tests.support.gltf_files import read_image

RGBA = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255]], [[10, 20, 30], [9, 9, 9], [0, 0, 0]]], np.uint8)
RGBA = np.dstack([RGBA, np.full((2, 3), 255, np.uint8)])


def encoded(picture: PIL.Image.Image, kind: str, **options) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, kind, **options)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("kind", "mode"), [("PNG", "RGB"), ("PNG", "P"), ("BMP", "RGB"), ("TGA", "P"), ("TIFF", "RGB"), ("GIF", "P"), ("WebP", "RGB")]
)
def test_formats_without_loss_give_the_same_pixels(kind, mode):
    picture = PIL.Image.fromarray(RGBA)
    picture = picture.convert("RGB").quantize(8) if mode == "P" else picture.convert(mode)
    image = read_image(encoded(picture, kind, **({"lossless": True} if kind == "WebP" else {})), "a")
    assert image.pixels.dtype == np.uint8 and image.name == "a"
    np.testing.assert_array_equal(image.pixels, RGBA)


def test_depths_of_grey_and_alpha_are_distinguished():
    # 16 bits: 65535 is 255 and 257·n is n; linear floats are sRGB-encoded (0.2140 is 127.5/255); a palette may have alpha
    deep = PIL.Image.fromarray(np.array([[0, 257 * 77, 65535]], np.uint16))
    np.testing.assert_array_equal(read_image(encoded(deep, "PNG"), "a").pixels[0, :, 0], [0, 77, 255])
    floats = PIL.Image.fromarray(np.array([[0.0, 0.21404, 5.0]], np.float32))
    np.testing.assert_allclose(read_image(encoded(floats, "TIFF"), "a").pixels[0, :, 1], [0, 127.5, 255], atol=0.51)
    pair = PIL.Image.fromarray(np.array([[[9, 0], [9, 128]]], np.uint8), "LA")
    np.testing.assert_array_equal(read_image(encoded(pair, "PNG"), "a").pixels, [[[9, 9, 9, 0], [9, 9, 9, 128]]])
    palette = PIL.Image.fromarray(np.array([[0, 1]], np.uint8), "P")
    palette.putpalette([1, 2, 3, 4, 5, 6])
    clear = read_image(encoded(palette, "PNG", transparency=1), "a").pixels
    np.testing.assert_array_equal(clear, [[[1, 2, 3, 255], [4, 5, 6, 0]]])


def test_cmyk_jpegs_are_read_as_rgb():
    flat = PIL.Image.new("CMYK", (8, 8), (0, 255, 255, 0))  # red
    red = read_image(encoded(flat, "JPEG"), "a").pixels
    np.testing.assert_allclose(red.reshape(-1, 4).mean(0), [255, 0, 0, 255], atol=3)


@pytest.mark.parametrize(
    "data", [b"", b"no image", encoded(PIL.Image.fromarray(RGBA), "PNG")[:60], b"\xabKTX 20\xbb\r\n\x1a\nrest"]
)
def test_a_broken_image_is_one_line_that_names_it(data):
    with pytest.raises(InputError, match=r"wood\.png") as caught:
        read_image(data, "wood.png")
    assert "\n" not in str(caught.value)


def test_an_image_of_too_many_pixels_is_refused_by_its_header():
    with pytest.raises(InputError, match=r"'wood\.png' has 65536 × 65536 pixels, more than 16384²"):
        read_image(b"\xabKTX 20\xbb\r\n\x1a\n" + b"\0" * 8 + b"\0\0\1\0" * 2, "wood.png")


@pytest.mark.parametrize(
    ("there", "written"),
    [
        ("a b/wood.png", "a%20b/wood.png"),
        ("a%20b/wood.png", "a%20b/wood.png"),
        ("Maps/Wood.PNG", "maps\\wood.png"),
        ("wood.png", "C:\\Users\\me\\Wood.png"),
        ("maps/wood.png", "/home/me/maps/wood.png"),
        ("wood.png", "file:///nowhere/wood.png"),
        ("grün.png", "gru\u0308n.png"),
    ],
)
def test_a_file_is_found_under_the_name_that_another_machine_wrote(tmp_path, there, written):
    (tmp_path / there).parent.mkdir(exist_ok=True)
    (tmp_path / there).write_bytes(b"x")
    found = find_file(tmp_path, written)
    assert found is not None and found.samefile(tmp_path / there)
