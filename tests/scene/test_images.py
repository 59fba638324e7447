"""Images of every kind become the same RGBA bytes, and files are found under the names that other programs write."""

from __future__ import annotations

import io
import warnings

import numpy as np
import PIL.Image
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene.io import images
from irrsplat.scene.io.images import find_file, read_image
from irrsplat.scene.model import Image

RGBA = np.array(
    [[[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]], [[10, 20, 30, 255], [9, 9, 9, 255], [0, 0, 0, 255]]], np.uint8
)


def encoded(picture: PIL.Image.Image, kind: str, **options) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, kind, **options)
    return stream.getvalue()


@pytest.mark.parametrize("kind", ["PNG", "BMP", "TGA", "TIFF", "GIF", "WebP"])
@pytest.mark.parametrize("mode", ["RGB", "P"])
def test_formats_without_loss_give_the_same_pixels(kind, mode):
    picture = PIL.Image.fromarray(RGBA)
    picture = picture.convert("RGB").quantize(8) if mode == "P" else picture.convert(mode)
    image = read_image(encoded(picture, kind, **({"lossless": True} if kind == "WebP" else {})), "a")
    assert image.pixels.dtype == np.uint8 and image.name == "a"
    np.testing.assert_array_equal(image.pixels, RGBA)


def test_greys_of_any_depth_and_alpha_are_told_apart():
    # 16 bits: 65535 is 255 and 257·n is n; linear floats are sRGB-encoded (0.2140 is 127.5/255); a palette may have alpha
    deep = PIL.Image.fromarray(np.array([[0, 257 * 77, 65535]], np.uint16))
    np.testing.assert_array_equal(read_image(encoded(deep, "PNG"), "a").pixels[0, :, 0], [0, 77, 255])
    floats = PIL.Image.fromarray(np.array([[0.0, 0.21404, 5.0]], np.float32))
    np.testing.assert_allclose(read_image(encoded(floats, "TIFF"), "a").pixels[0, :, 1], [0, 127.5, 255], atol=0.51)
    pair = PIL.Image.fromarray(np.array([[[9, 0], [9, 128]]], np.uint8), "LA")
    np.testing.assert_array_equal(read_image(encoded(pair, "PNG"), "a").pixels, [[[9, 9, 9, 0], [9, 9, 9, 128]]])
    palette = PIL.Image.fromarray(np.array([[0, 1]], np.uint8), "P")
    palette.putpalette([1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(
        read_image(encoded(palette, "PNG", transparency=1), "a").pixels, [[[1, 2, 3, 255], [4, 5, 6, 0]]]
    )


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


def test_several_images_come_back_in_their_order_and_a_broken_one_spoils_no_other():
    size, filters = PIL.Image.MAX_IMAGE_PIXELS, list(warnings.filters)
    files = [(encoded(PIL.Image.new("RGB", (8, 8), (i, 0, 0)), "PNG"), f"{i}.png") for i in range(9)]
    files[4] = b"no image", "4.png"
    found = images.read_images(files)
    assert [image.pixels[0, 0, 0] for image in found if isinstance(image, Image)] == [0, 1, 2, 3, 5, 6, 7, 8]
    assert isinstance(found[4], InputError) and "4.png" in str(found[4])
    assert size == PIL.Image.MAX_IMAGE_PIXELS and filters == warnings.filters
    assert images.read_images([]) == []


def test_a_picture_beyond_pillows_bound_is_read_and_one_beyond_ours_is_refused(monkeypatch):
    monkeypatch.setattr(PIL.Image, "MAX_IMAGE_PIXELS", 10)  # it raises at twice this
    monkeypatch.setattr(images, "GREATEST_PIXELS", 64)
    assert read_image(encoded(PIL.Image.new("1", (8, 8)), "PNG"), "a").pixels.shape == (8, 8, 4)
    with pytest.raises(InputError, match="'a' has 8 × 9 pixels, more than"):
        read_image(encoded(PIL.Image.new("1", (8, 9)), "PNG"), "a")
    assert PIL.Image.MAX_IMAGE_PIXELS == 10


@pytest.mark.parametrize(
    ("there", "written"),
    [
        ("wood.png", "wood.png"),
        ("a b/wood.png", "a%20b/wood.png"),
        ("a%20b/wood.png", "a%20b/wood.png"),
        ("Maps/Wood.PNG", "maps\\wood.png"),
        ("wood.png", "C:\\Users\\me\\Wood.png"),
        ("wood.png", "/home/somebody/wood.png"),
        ("wood.png", "textures/wood.png"),
        ("maps/wood.png", "./maps//wood.png"),
        ("wood.png", "file:///nowhere/wood.png"),
        ("grün.png", "gru\u0308n.png"),
    ],
)
def test_a_file_is_found_under_the_name_that_another_machine_wrote(tmp_path, there, written):
    (tmp_path / there).parent.mkdir(exist_ok=True)
    (tmp_path / there).write_bytes(b"x")
    found = find_file(tmp_path, written)
    assert found is not None and found.samefile(tmp_path / there)


def test_the_whole_path_wins_over_a_file_beside(tmp_path):
    (tmp_path / "A b").mkdir()
    for name in ("A b/wood.png", "wood.png"):
        (tmp_path / name).write_bytes(b"x")
    assert find_file(tmp_path, "a%20b/wood.png") == tmp_path / "A b" / "wood.png"


@pytest.mark.parametrize("written", ["", "gone.png", "folder", "/dev/zero", "a\0b", "x" * 5000, "wood.png/more"])
def test_what_is_no_file_is_not_found(tmp_path, written):
    (tmp_path / "folder").mkdir()
    (tmp_path / "wood.png").write_bytes(b"x")
    assert find_file(tmp_path, written) is None
