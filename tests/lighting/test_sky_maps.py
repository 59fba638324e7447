"""Sky maps: files, mappings of the sphere, orientation, and extraction of suns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import irrsplat
from irrsplat.core.color import LUMINANCE
from irrsplat.core.errors import InputError
from irrsplat.sky.environment import Environment, frame_of
from irrsplat.sky.map_file import MOST_ROWS, read_map
from irrsplat.sky.sphere import equirectangular, from_square, solid_angles, square, texel_directions
from irrsplat.sky.split import split
from tests.support.skies import save_exr

CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1)) + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\n"


def noise(height: int, width: int) -> np.ndarray:
    """Return a map of random radiance, 0.1 to 1.1."""
    return (0.1 + np.random.default_rng(2).random((height, width, 3))).astype("f4")


def test_both_maps_of_the_sphere_have_inverses() -> None:
    ways = np.random.default_rng(0).normal(size=(2000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    assert np.allclose(from_square(*square(ways)), ways, atol=1e-12)
    u, v = equirectangular(texel_directions(16, 32))
    assert np.allclose(u * 32 - 0.5, np.arange(32)) and np.allclose((v * 16 - 0.5).T, np.arange(16))
    assert solid_angles(16, 32).sum() * 32 == pytest.approx(4.0 * np.pi)


def test_the_middle_is_north_and_its_right_is_east() -> None:
    """The map is not mirrored for a camera along -z with y up; a rotation of 90° brings the centre to +x."""
    u, v = equirectangular(np.array([(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]))
    assert np.allclose(u[:3], (0.5, 0.75, 0.25)) and np.allclose(v, (0.5, 0.5, 0.5, 0.0))
    assert np.allclose(frame_of(np.eye(3), 90.0).T @ (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
    up_is_z = frame_of(np.array([(1.0, 0, 0), (0, 0, 1.0), (0, -1.0, 0)]), 0.0)
    assert np.allclose(up_is_z.T @ (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)), "north is y where z is up"
    assert np.linalg.det(up_is_z) == pytest.approx(1.0)


def test_rays_find_all_light_of_a_map() -> None:
    """The mean over the sphere is the map's at every level; each colour is in its direction."""
    radiance = noise(24, 48)
    sky = Environment(radiance, radiance)
    exact = (radiance * solid_angles(24, 48)[:, None, None]).sum((0, 1)) / (4.0 * np.pi)
    assert np.allclose(sky.mean, exact, rtol=1e-5)
    for level in sky.light_levels:
        assert np.allclose(level.mean((0, 1)), exact, rtol=1e-5)
    assert np.allclose(sky.seen(texel_directions(24, 48)), radiance, atol=1e-5)
    ways = texel_directions(64, 128)
    smooth = (1.0 + 0.5 * ways).astype("f4")  # red to the east, green above, blue to the south
    assert np.allclose(Environment(smooth, smooth).lit_by(ways, 1e-4), smooth, atol=0.02)


def whole(radiance: np.ndarray) -> np.ndarray:
    """Return the total light (3,) of a map."""
    return np.asarray((radiance * solid_angles(*radiance.shape[:2])[:, None, None]).sum((0, 1), dtype=float))


def test_a_split_keeps_all_light() -> None:
    """Two coloured discs of 1.4° over a noisy sky, one across the seam: suns hold exactly the removed light, at its position.

    The remaining map is at most 16 times as bright as its mean.
    """
    radiance = noise(256, 512)
    ways = texel_directions(256, 512)
    places = np.array([(0.5, 0.7, -0.2), (0.02, 0.3, 1.0)])
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    for place, colour in zip(places, ((3e4, 2e4, 1e4), (2e3, 4e3, 8e3)), strict=True):
        radiance[ways @ place > np.cos(np.radians(0.7))] = colour
    rest, suns = split(radiance)
    assert len(suns) == 2
    assert np.allclose(whole(rest) + np.sum([sun.irradiance for sun in suns], axis=0), whole(radiance), rtol=1e-6)
    assert (rest @ LUMINANCE).max() < 17.0 * (rest @ LUMINANCE).mean()
    for sun, place in zip(suns, places, strict=True):
        assert np.degrees(np.arccos(np.dot(sun.direction, place))) < 0.2  # texels of 0.7°: the disc has only a few
    assert np.array_equal(rest[200:], radiance[200:]), "elsewhere nothing has changed"


def test_what_is_large_or_weak_is_no_sun() -> None:
    """A window of 20°, a strip light of 1° by 60°, and a disc with half a percent of the light are no suns."""
    ways = texel_directions(256, 512)
    window, strip, weak = (np.full((256, 512, 3), 0.5, "f4") for _ in range(3))
    window[ways @ (0.0, 0.6, -0.8) > np.cos(np.radians(10.0))] = 100.0
    strip[100:102, 200:285] = 60.0
    weak[ways @ (0.0, 0.6, -0.8) > np.cos(np.radians(1.0))] = 30.0
    for radiance in (window, strip, weak):
        rest, suns = split(radiance)
        assert suns == () and rest is radiance


def save_hdr(path: Path, radiance: np.ndarray, kind: str = "runs", head: bytes = b"", line: bytes = b"") -> Path:
    """Write a Radiance picture: flat, or by components with runs and literals."""
    height, width, _ = radiance.shape
    most = np.maximum(radiance.max(-1, keepdims=True), 1e-32)
    mantissa, exponent = np.frexp(most)
    pixels = np.concatenate([radiance * mantissa * 256.0 / most, np.where(most > 1e-32, exponent + 128, 0)], -1).astype(np.uint8)
    data = b""
    if kind == "flat":
        data = pixels.tobytes()
    else:
        for row in pixels:
            data += bytes((2, 2, width >> 8, width & 255))
            for values in row.T:  # a run, or literals
                data += bytes((128 + width, values[0])) if (values == values[0]).all() else bytes((width,)) + values.tobytes()
    size = line or b"-Y %d +X %d" % (height, width)
    path.write_bytes(b"#?RADIANCE\n# made by a test\n" + head + b"FORMAT=32-bit_rle_rgbe\n\n" + size + b"\n" + data)
    return path


@pytest.mark.parametrize("kind", ["runs", "flat"])
def test_a_radiance_picture_is_read(tmp_path: Path, kind: str) -> None:
    """The error is within half a step of the 8-bit mantissa of the brightest channel; EXPOSURE is applied."""
    radiance = noise(12, 24) * np.logspace(-3, 5, 24, dtype="f4")[None, :, None]
    radiance[4] = radiance[4, 3]
    radiance[7, 5:9] = 0.0
    found, notices = read_map(save_hdr(tmp_path / "a.hdr", radiance, kind))
    assert notices == [] and found.dtype == np.float32
    assert (np.abs(found - radiance) <= radiance.max(-1, keepdims=True) / 255.0).all()
    assert not found[7, 5:9].any()
    halved, _ = read_map(save_hdr(tmp_path / "a.hdr", radiance, kind, b"EXPOSURE=2\n"))
    assert np.allclose(halved, found / 2.0)
    turned, _ = read_map(save_hdr(tmp_path / "a.hdr", radiance, kind, line=b"+Y 12 -X 24"))
    assert np.array_equal(turned, found[::-1, ::-1])


def test_an_exr_is_read_and_a_large_one_halved(tmp_path: Path) -> None:
    radiance = noise(8, 16)
    assert np.array_equal(read_map(save_exr(tmp_path / "a.exr", radiance))[0], radiance)
    grey = read_map(save_exr(tmp_path / "b.exr", radiance[..., :1], "Y"))[0]
    assert np.array_equal(grey, np.repeat(radiance[..., :1], 3, -1))
    large = np.zeros((2 * MOST_ROWS, 4, 3), "f4")
    large[::2] = 2.0
    large[0, 0, 0] = -1e-3
    found, notices = read_map(save_exr(tmp_path / "a.exr", large))
    assert found.shape == (MOST_ROWS, 2, 3) and (found[1:] == 1.0).all() and found.min() >= 0.0
    assert ["4x4096 pixels are not twice as wide as high" in n or "slightly negative" in n for n in notices] == [True, True]


HEAD, ROW = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n", b"-Y 2 +X 8\n\2\2\0\x08"


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        ("a.png", b"x", r"ends in \.hdr"),
        ("a.exr", b"x" * 100, "no OpenEXR file"),
        ("a.exr", np.full((8, 16, 3), np.nan), r"a\.exr: 128 of its pixels are not finite"),
        ("a.exr", np.full((8, 16, 3), -5.0), r"a\.exr: 128 of its pixels are negative"),
        ("XZW.exr", noise(8, 16), "no channels R, G and B, but 3 others, 'W' first"),
        ("a.hdr", HEAD.replace(b"rgbe", b"xyze") + b"-Y 2 +X 8\n", "its pixels are XYZ, and RGB is expected"),
        ("a.hdr", HEAD + b"-Y 0 +X 8\n", "8x0 pixels are none, or too many"),
        ("a.hdr", HEAD + b"-Y 8192 +X 16384\n\1\2\3\x80" + b"\1\1\1\xff" * 4, "or too many in 72 bytes"),
        ("a.hdr", HEAD + ROW + b"\x88\0" * 4 + b"no row", "cut off or damaged"),
        ("a.hdr", HEAD + ROW + b"\0" * 64, "cut off or damaged"),  # a run of length 0
        ("a.hdr", HEAD + ROW + b"\x89\0" * 64, "cut off or damaged"),  # runs of nine in a row of eight
        ("runs.hdr", 10, "this is no"),
        ("runs.hdr", -60, "the picture is cut off"),
        ("flat.hdr", -200, "the picture is cut off"),
        ("a.hdr", HEAD + b"-Y 1 +X 2\n\x80\2\3\x80\1\1\1\1", "cut off or damaged"),  # a repeat, in the format before 1991
    ],
)
def test_other_and_damaged_maps_are_refused_in_one_line(
    tmp_path: Path, name: str, data: bytes | int | np.ndarray, says: str
) -> None:
    """An int: the end of a slice of a valid picture."""
    path = tmp_path / name
    if isinstance(data, bytes):
        path.write_bytes(data)
    elif isinstance(data, int):
        path.write_bytes(save_hdr(path, noise(12, 24), path.stem).read_bytes()[:data])
    else:
        save_exr(path, data, path.stem if len(path.stem) == 3 else "RGB")
    with pytest.raises(InputError, match=says) as raised:
        read_map(path)
    assert "\n" not in str(raised.value)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A cube, and a map with a sun."""
    radiance = noise(32, 64)
    radiance[8, 40] = 1e4
    save_exr(tmp_path / "my sky.exr", radiance)
    (tmp_path / "cube.obj").write_text(CUBE)
    (tmp_path / "plain.scene").write_text("obj cube.obj\ncam 0 0 5 0 0 0 0 1 0\n")
    return tmp_path


def scene_with(folder: Path, sky: str) -> irrsplat.Scene:
    """Return the cube under this sky."""
    (folder / "a.scene").write_text(f"sky {sky}\nobj cube.obj\ncam 0 0 5 0 0 0 0 1 0\n")
    return irrsplat.load(folder / "a.scene")


def test_a_scene_names_its_map(folder: Path) -> None:
    """The map is among the scene's files, its sun among the lights, with the given gain and rotation."""
    plain, made = scene_with(folder, "my sky.exr"), scene_with(folder, "my sky.exr gain 2 rotate 90")
    assert str(folder / "my sky.exr") in made.files and made.own_sky
    assert made.environment is not None and plain.environment is not None
    assert np.allclose(made.environment.mean, 2.0 * plain.environment.mean)
    assert made.environment.digest != plain.environment.digest, "caches know the sky"
    (sun,), (before,) = made.lights, plain.lights
    assert sun.name == "sun" and sun.directional and np.allclose(sun.color, np.multiply(before.color, 2.0))
    assert np.allclose(sun.position, (-before.position[2], before.position[1], before.position[0])), "clockwise from above"


def test_any_file_may_be_put_under_a_sky(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The option replaces a stand-in and a scene's own sky; paths are relative to the current folder."""
    monkeypatch.chdir(folder)
    mapped, plain = irrsplat.load("cube.obj", sky="my sky.exr"), irrsplat.load("plain.scene", sky="1 2 3")
    assert mapped.environment is not None and len(mapped.lights) == 1 and not any(mapped.sky)
    assert not any("stand" in notice and "sky" in notice for notice in mapped.notices)
    assert plain.sky == (1.0, 2.0, 3.0) and plain.environment is None and plain.own_sky and not any(plain.sky_gradient)
    standing = irrsplat.load("cube.obj", up_axis="z", sky="cie clear sun 30 90").lights[0]
    assert np.allclose(standing.position, (np.cos(np.radians(30)), 0.0, 0.5)), "east is x, and up z"


@pytest.mark.parametrize(
    ("sky", "said"),
    [
        ("", "nothing is said about it"),
        ("none.hdr", "there is no file 'none.hdr'"),
        ("my sky.exr gain 1e12", "brighter than"),
        ("my sky.exr gain 1 gain 2", "'gain' is given twice"),
        ("-1 1 1", "expected values of 0 or more"),
        ("cie clear sun 95 100", "expected -90 to 90"),
        ("cie clear at 48 11 0001-01-01T00:00+14:00", "lies beyond the years 1 to 9999"),
        ("cie clear", "needs the sun's place"),
        ("cie overcast", "or lux E"),
        ("cie clear sun -4 100", "4.0° below the horizon"),
        ("cie clear sun 4 100 at 1 2 3", "both define the position of the sun"),
        ("cie clear at 50 10 2026-06-21T12:00", "has no offset from UTC"),
        ("cie clear sun 40 100 ground 2", "ground is 2; expected 0 to 1"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(folder: Path, sky: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With file and line in a scene, and with the option's name elsewhere."""
    with pytest.raises(InputError) as raised:
        scene_with(folder, sky)
    assert said in str(raised.value) and "\n" not in str(raised.value)
    assert str(raised.value).startswith(f"{folder / 'a.scene'}:1: ")
    monkeypatch.chdir(folder)
    with pytest.raises(InputError) as raised:
        irrsplat.load(folder / "cube.obj", sky=sky)
    assert said in str(raised.value) and str(raised.value).startswith("sky: ")
