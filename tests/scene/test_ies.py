"""Luminaires: files of ANSI/IES LM-63 written from numbers, their flux and symmetries, their places, and errors."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene import Light, Scene
from irrsplat.scene.io.lights.ies import load_ies
from irrsplat.scene.model import Photometry
from tests.support.luminaires import bilinear, ies_text, isotropic, lambert, lopsided, steps, street

CAM = "cam 0 0 5  0 0 0  0 1 0\n"
V, V2 = steps(0, 180, 73), steps(0, 90, 37)


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., Photometry]:
    """Read the text of a file."""

    def read(text: str | bytes, notices: list[str] | None = None, files: list[Path] | None = None) -> Photometry:
        path = tmp_path / "a.ies"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load_ies(path, [] if notices is None else notices, [] if files is None else files)

    return read


def directions(count: int = 500) -> np.ndarray:
    """Return (N, 3) unit directions on the whole sphere, and along the axes."""
    found = np.random.default_rng(1).normal(size=(count, 3))
    return np.concatenate([found / np.linalg.norm(found, axis=1, keepdims=True), np.eye(3), -np.eye(3)])


def test_the_flux_is_the_integral(read: Callable[..., Photometry]) -> None:
    """A uniform intensity of 100 cd has a flux of 400π lm; 1000·cos γ downwards has 1000π. Linear interpolation between angles of
    2.5° is slightly less for a curve: a chord lies below it by at most Δ²/8 of it, 2.4e-4, and by Δ²/12 on average."""
    assert read(ies_text(V, [0], isotropic)).flux == pytest.approx(400.0 * np.pi, rel=1e-9)
    assert read(ies_text(V2, [0], lambert)).flux == pytest.approx(1000.0 * np.pi, rel=2e-4)
    assert read(ies_text([0, 90], [0], isotropic)).flux == pytest.approx(200.0 * np.pi, rel=1e-9)
    assert read(ies_text([90, 180], [0, 90], isotropic)).flux == pytest.approx(200.0 * np.pi, rel=1e-9)


QUARTERS = [0, 20, 45, 90, 135, 160, 180, 200, 225, 270, 315, 340, 360]


@pytest.mark.parametrize(
    ("vertical", "horizontal", "candela", "around"),
    [
        ([0, 13, 50, 90], [0], lambert, [0]),
        (V2, steps(0, 180, 37), street, steps(0, 360, 73)),
        (V, steps(0, 360, 25), lopsided, steps(0, 360, 25)),
        (V, steps(0, 345, 24), lopsided, steps(0, 360, 25)),
        (V, [0, 20, 45, 90], lambda v, h: 500.0 + 200.0 * np.cos(2.0 * h) * np.sin(v), QUARTERS),
        (
            V,
            [90, 135, 180, 200, 270],
            lambda v, h: 500.0 + 200.0 * np.sin(h) * np.sin(v),
            [0, 45, 90, 135, 180, 200, 270, 340, 360],
        ),
    ],
    ids=["few angles", "bilateral", "all around", "without 360°", "quadrants", "about the 90° plane"],
)
def test_symmetric_parts_are_completed(
    read: Callable[..., Photometry], vertical: list[float], horizontal: list[float], candela: Any, around: list[float]
) -> None:
    """The reference is an interpolation over all angles, of intensities that have the symmetry by their formula."""
    found = read(ies_text(vertical, horizontal, candela))
    expected = bilinear(candela, vertical, around, directions())
    np.testing.assert_allclose(found.intensity(directions()), expected, rtol=1e-6, atol=1e-6 * found.peak)


@pytest.mark.parametrize(("kind", "one_sided"), [(2, False), (3, True)])
def test_floodlights(read: Callable[..., Photometry], kind: int, one_sided: bool) -> None:
    """Type B turns the plane by the vertical angle and has the horizontal one within it, type A the other way round. With +x up,
    the direction is (cos H·sin V, −sin H, −cos H·cos V), or (sin V, −cos V·sin H, −cos V·cos H)."""
    vertical, horizontal = steps(-90, 90, 37), steps(0, 90, 19) if one_sided else steps(-90, 90, 37)

    def candela(v: np.ndarray, h: np.ndarray) -> np.ndarray:
        side = np.abs(h) if one_sided else h
        inner, outer = (v, h) if kind == 2 else (h, v)
        return np.cos(outer) * np.cos(inner) * (500.0 + 100.0 * np.sin(v) + 50.0 * side)

    found = read(ies_text(vertical, horizontal, candela, kind))
    v, h = np.radians(np.random.default_rng(2).uniform(-89, 89, (2, 300)))
    way = [np.cos(h) * np.sin(v), -np.sin(h), -np.cos(h) * np.cos(v)]
    if kind == 3:
        way = [np.sin(v), -np.cos(v) * np.sin(h), -np.cos(v) * np.cos(h)]
    np.testing.assert_allclose(found.intensity(np.stack(way, -1)), candela(v, h), rtol=3e-3, atol=0.5)
    assert found.intensity(np.array([0.0, 0.0, 1.0])) == 0.0 and found.reach == pytest.approx(90.0)
    if kind == 2 and not one_sided:  # 500·cos of the angle to the aim, and terms that cancel on the other side
        assert found.flux == pytest.approx(500.0 * np.pi, rel=2e-3)


def test_multiplier_factors_and_units(read: Callable[..., Photometry]) -> None:
    """The ballast-lamp factor applies until 1991; its field since 1995 is no factor. Feet are 0.3048 m."""
    text = ies_text([0, 90], [0], isotropic, multiplier=2.0, units=1, factors="0.9 0.5 100")
    assert read(text).peak == pytest.approx(180.0)
    assert read(text).opening == pytest.approx((0.1524, 0.1524, 0.0))
    for header, factor in (("IESNA91", 0.5), ("IESNA:LM-63-1986", 0.5), ("IESNA95", 1.0), ("\nIES:LM-63-2019", 1.0)):
        old = ies_text([0, 90], [0], isotropic, header=header, multiplier=2.0, factors="0.9 0.5 100")
        assert read(old).peak == pytest.approx(180.0 * factor)


def test_line_breaks_commas_encodings_and_what_ends_old_files(read: Callable[..., Photometry]) -> None:
    plain = ies_text(V2, steps(0, 180, 37), street)
    head, tail = plain.split("TILT=NONE\n")
    words = tail.split()
    numbers = [",\n".join(words[:3]), " , ".join(words[3:40]), "", "\t" + "\n".join(words[40:])]
    broken = head + "tilt = none\n" + "\n".join(numbers) + "\x1a"
    odd_primitive = broken.replace("made for a test", "f\xfcr 30\xb0 TILT=NONE").encode("latin-1").replace(b"\n", b"\r\n")
    expected = read(plain).candela
    assert np.array_equal(read(broken).candela, expected) and np.array_equal(read(odd_primitive).candela, expected)


def test_a_tilt_table_counts_as_it_is_at_0(read: Callable[..., Photometry], tmp_path: Path) -> None:
    """It is interpolated there, with a notice; the table may be in a separate file."""
    table = "1\n3\n-30 30, 90\n0.8 1.0 0.5\n"
    (tmp_path / "lamp tilt.tlt").write_text(table)
    notices: list[str] = []
    files: list[Path] = []
    for tilt in ("TILT=INCLUDE\n" + table, "TILT=lamp tilt.tlt"):
        assert read(ies_text([0, 90], [0], isotropic, tilt=tilt), notices, files).peak == pytest.approx(90.0)
    assert ["a factor of 0.9" in n and "0.5 to 1" in n for n in notices] == [True, True], "how far it may be off"
    same = "TILT=INCLUDE\n3\n2\n-90 90\n0.8 0.8\n"
    assert read(ies_text([0, 90], [0], isotropic, tilt=same), notices).peak == pytest.approx(80.0)
    assert len(notices) == 2, "where every angle has one factor, nothing is left out"
    assert files == [tmp_path / "lamp tilt.tlt"]


GOOD = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 3 2 1 2 0 0 0\n1 1 10\n0 45 90\n0 90\n1 2 3\n4 5 6\n"


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("TILT=NONE\n", "", None, "no line TILT="),
        ("TILT=NONE", "TILT=", 2, "TILT= has no value"),
        ("TILT=NONE", "TILT=INCLUDE\n1\n2\n0 90\n1 -1", 6, "TILT factor is negative"),
        ("TILT=NONE", "TILT=no.tlt", 2, "no TILT file 'no.tlt'"),
        ("TILT=NONE", "TILT=INCLUDE\n4\n1\n0\n1", 3, "geometry is 4; expected 1, 2 or 3"),
        ("TILT=NONE", "TILT=INCLUDE\n1\n2\n0 0\n1 1", 5, "expected angles that rise"),
        ("TILT=NONE", "TILT=INCLUDE\n1\n2\n0 90\n0 1", 6, "TILT factor at 0 degrees is 0"),
        ("1 -1 1 3", "0 -1 1 3", 3, "number of lamps is 0; expected a number above 0"),
        ("1 3 2 1 2", "1 1 2 1 2", 3, "number of vertical angles is 1; expected a whole number of at least 2"),
        ("1 3 2 1 2", "1 3 2 1 0", 3, "units of lengths is 0; expected 1 or 2"),
        ("1 3 2 1 2", "1 3 2 C 2", 3, "'C' is not a number; expected the photometric type"),
        ("0 45 90\n", "0 45 45\n", 5, "vertical angles: 45 is out of order; expected angles that rise"),
        ("0 45 90\n", "0 45 190\n", 5, "190 is out of order; expected 0 to 180 degrees"),
        ("\n0 90\n", "\n0 80\n", 6, "horizontal angles go from 0 to 80; expected 0 alone, 0 to 90, 180 or 360, or 90 to 270"),
        ("1 2 3\n", "1 -2 3\n", 7, "an intensity is -2 candela"),
        ("1 2 3\n", "1 x 3\n", 7, "'x' is not a number; expected the candela values"),
        ("4 5 6\n", "4 5\n", 8, "the file ends in the candela values, after 5 of 6"),
        ("1 3 2 1 2", "1 3 2 2 2", 6, "vertical angles of type B begin at 0; expected -90 to 90"),
        ("3 2 1 2 0 0 0\n1 1 10\n0 45 90\n0 90", "3 2 2 2 0 0 0\n1 1 10\n-90 0 90\n10 90", 6, "begin at 10; expected -90 to 90"),
    ],
)  # fmt: skip
def test_a_malformed_file_is_one_line_with_its_place(
    read: Callable[..., Photometry], tmp_path: Path, old: str, new: str, line: int | None, message: str
) -> None:
    assert old in GOOD
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read(GOOD.replace(old, new))
    place = f"{tmp_path / 'a.ies'}:" + ("" if line is None else f"{line}:")
    assert str(caught.value).startswith(place) and "\n" not in str(caught.value)


def lights(write: Callable[..., Scene], text: str, **files: str) -> tuple[Light, ...]:
    """Return the lights of a scene with this text and the file a.ies, an asymmetric one."""
    return write("obj t.obj\n" + CAM + text, a_ies=ies_text(V2, steps(0, 180, 37), street), **files).lights


def intensity_along(light: Light, way: np.ndarray) -> np.ndarray:
    """Return (N,) cd along directions (N, 3) in world space."""
    assert light.photometry is not None
    return light.photometry.intensity(way @ light.frame.T)


def test_the_matrix_stack_places_turns_mirrors_and_scales_it(write: Callable[..., Scene]) -> None:
    """Theta is from −z, phi from +x towards +y, as in ies2rad. With OpenGL's matrices written out, the intensity along M·d is
    that along d, at any scale."""
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    about_x = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # by -90°
    M = about_x @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    text = "push\ntrans 1 2 3\nrotate -90 1 0 0\nrotate 30 0 0 1\nlight a.ies\nscale -2 2 2\nlight a.ies\npop\nlight a.ies\n"
    turned, mirrored, plain = lights(write, text)
    assert plain.kind == "luminaire" and plain.position == (0, 0, 0) and turned.position == mirrored.position == (1, 2, 3)
    way, expected = directions(), bilinear(street, V2, steps(0, 360, 73), directions())
    for light, ways in ((plain, way), (turned, way @ M.T), (mirrored, way @ (M @ np.diag([-1, 1, 1])).T)):
        np.testing.assert_allclose(intensity_along(light, ways), expected, rtol=1e-6, atol=1e-3)
    assert turned.photometry is plain.photometry, "a file is read once"


def test_a_light_file_sets_place_and_brightness(write: Callable[..., Scene]) -> None:
    """Aimed at a point; 0° is towards +x, or the requested direction, projected across the aim."""
    body = "ies a.ies\nposition 1 4 1 1\nspotDirection 1 0 1\n"
    other_body = body + "zeroDirection 0 5 -2\nintensity 0.5 0.25 0\n"
    level_body = "ies a.ies\nposition 0 0 0 1\nspotDirection 2 0 0\n"
    text = "light a.light\nlight b.light\nlight c.light\n"
    one, other, level = lights(write, text, a_light=body, b_light=other_body, c_light=level_body)
    np.testing.assert_allclose(one.frame, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(other.frame, [[0, 0, -1], [-1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(level.frame[0], [0, 1, 0], atol=1e-12)  # aimed along +x: 0° towards +y
    assert one.color == (1, 1, 1) and other.color == (0.5, 0.25, 0)


@pytest.mark.parametrize(
    ("text", "file", "line", "message"),
    [
        ("scale 1 2 1\nlight a.ies\n", "a.scene", 4, "stretches the luminaire"),
        ("light t.ldt\n", "t.ldt", None, "convert EULUMDAT (.ldt) to .ies"),
        ("ies a.ies\nposition 0 0 0 1\n", "a.light", 1, "add: spotDirection X Y Z"),
        ("ies a.ies\nposition 0 0 0 0\nspotDirection 0 0 1\n", "a.light", 2, "expected W 1"),
        ("ies a.ies\nposition 0 0 0 1\nspotDirection 0 0 0\n", "a.light", 3, "its own position"),
        ("ies a.ies\nposition 0 0 0 1\nspotDirection 0 0 1\nspotCutoff 30\n", "a.light", 4, "'spotCutoff' and 'ies' exclude"),
        ("ies a.ies\nposition 0 0 0 1\nspotDirection 0 0 1\nintensity -1 0 0\n", "a.light", 4, "negative"),
        ("ies a.ies\nposition 0 0 0 1\nspotDirection 0 0 1\nzeroDirection 0 0 2\n", "a.light", 4, "lies along the aim"),
        ("ies b.ies\nposition 0 0 0 1\nspotDirection 0 0 1\n", "a.light", 1, "no file 'b.ies'"),
        ("position 0 0 0 1\nintensity 1 1 1\nzeroDirection 1 0 0\n", "a.light", 3, "expected as well: ies FILE.ies"),
    ],
)  # fmt: skip
def test_a_luminaire_s_malformed_line_is_an_error_with_its_place(
    write: Callable[..., Scene], text: str, file: str, line: int | None, message: str
) -> None:
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        if text.startswith(("scale", "light")):
            lights(write, text, t_ldt="Maker\n1\n1\n24\n15\n")
        else:
            lights(write, "light a.light\n", a_light=text)
    assert f"{file}:" + ("" if line is None else f"{line}:") in str(caught.value) and "\n" not in str(caught.value)
