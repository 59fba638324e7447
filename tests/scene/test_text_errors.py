"""The .scene, .light and .obj grammar: each malformed line is an error with its place."""

from __future__ import annotations

import re

import pytest

from irrsplat.core.errors import InputError
from irrsplat.scene import load

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
CAM = "cam 0 0 5  0 0 0  0 1 0\n"


def refused(write, text, file, line, says, **files):
    """Reading `text`, a .scene, fails with one line that begins with the place and contains `says`."""
    with pytest.raises(InputError, match=re.escape(says)) as caught:
        write(text, **files)
    place = f"{file}: " if line is None else f"{file}:{line}: "
    assert place in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("\nfoo 1\n", 2, "unknown word 'foo'"),
        ("_light\n", 1, "unknown word"),
        ("cam 1 2 3\n", 1, "'cam' has 3 values"),
        ("cam 0 0 5 0 0 0 0 1\n", 1, "'cam' has 8 values"),
        ("cam 1 0 0 5 0 0 0 0 1 0\n", 1, "10 numbers"),
        ("cam 0 0 5 0 0 0 0 one 0\n", 1, "'one' is not a number"),
        (CAM + CAM, 2, "'cam' is given twice; first in line 1"),
        ("cam a" + CAM[3:] + "cam a" + CAM[3:], 2, "'cam a' is given twice"),
        ("cam 1 2 3 1 2 3 0 1 0\n", 1, "eye lies at its target"),
        ("cam 0 5 0 0 0 0 0 1 0\n", 1, "parallel"),
        ("cam 0 0 5 0 0 0 0 0 0\n", 1, "parallel"),
        ("proj 0 1 1 10\n", 1, "between 0 and 180"),
        ("proj 180 1 1 10\n", 1, "between 0 and 180"),
        ("proj 45 0 1 10\n", 1, "ASPECT"),
        ("proj 45 1 10 1\n", 1, "NEAR < FAR"),
        ("proj 45 1 1\n", 1, "'proj' has 3 values"),
        ("proj 45 1 1 10\nproj 45 1 1 10\n", 2, "given twice"),
        ("brdf\n", 1, "no kind of brdf"),
        ("brdf glossy 1 1 1\n", 1, "'glossy' is no kind of brdf"),
        ("brdf diffuse 1 1 1\n", 1, "3 values"),
        ("brdf diffuse 1.1 0 0 1\n", 1, "from 0 to 1"),
        ("brdf diffuse 0 -0.1 0 1\n", 1, "from 0 to 1"),
        ("brdf diffuse 0 nan 0 1\n", 1, "not a finite number"),
        ("brdf emission -1 0 0\n", 1, "0 or more"),
        ("brdf emission inf 0 0\n", 1, "not a finite number"),
        ("sky 1 1\n", 1, "'sky' has 2 values"),
        ("sky -1 1 1\n", 1, "0 or more"),
        ("sky 1 1 1\nsky 1 1 1\n", 2, "given twice"),
        ("push 1\n", 1, "'push' has 1 values"),
        ("push\npush\npop\n", 1, "'push' has no 'pop'"),
        ("push\npop\n\npop\n", 4, "'pop' has no 'push'"),
        ("trans 1 2\n", 1, "'trans' has 2 values"),
        ("trans 1 2 3 4\n", 1, "'trans' has 4 values"),
        ("trans 1 2 1_0\n", 1, "'1_0' is not a number"),
        ("rotate 90 0 0 0\n", 1, "axis is 0 0 0"),
        ("scale 1 0 1\n", 1, "scale of 0"),
        ("scale 1 1 1e999\n", 1, "not a finite number"),
        ("obj\n", 1, "names no file"),
        ("obj nope.obj\n", 1, "there is no file 'nope.obj'"),
        ("obj .\n", 1, "is a directory"),
        ("light nope.light\n", 1, "there is no file 'nope.light'"),
        ("scale 1e30 1 1\n", 1, "beyond 1e+15"),
        ("scale 1e14 1e14 1e14\nscale 1e14 1 1\nscale 1e14 1 1\nobj t.obj\n", 4, "32-bit"),
    ],
)  # fmt: skip
def test_a_malformed_scene_line_is_an_error_with_its_place(write, text, line, says):
    refused(write, text, "a.scene", line, says)


POINT = "position 0 5 0 1\n"


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        (POINT + "colour 1 1 1\n", 2, "unknown word 'colour'"),
        ("position 1 2 3\n", 1, "'position' has 3 values"),
        (POINT + POINT, 2, "given twice"),
        ("position 0 0 0 2\n", 1, "W is 2"),
        ("diffuse 1 1 1 1\nposition 0 0 0 0\n", 2, "other than 0 0 0"),
        ("diffuse 1 1 1 1\n", None, "no position"),
        (POINT, None, "no colour"),
        (POINT + "diffuse 1 1 1\n", 2, "'diffuse' has 3 values"),
        (POINT + "diffuse 1 -1 1 1\n", 2, "negative"),
        (POINT + "ambient 1 1 x 1\n", 2, "'x' is not a number"),
        (POINT + "intensity 1 1 -1\n", 2, "negative"),
        (POINT + "intensity 1 1 1\ndiffuse 1 1 1 1\n", 3, "exclude each other"),
        (POINT + "intensity 1 1 1\nconstantAttenuation 1\n", 3, "exclude each other"),
        ("position 0 1 0 0\nintensity 1 1 1\n", 2, "W 0"),
        (POINT + "diffuse 1 1 1 1\nlinearAttenuation -1\n", 3, "negative"),
        (POINT + "diffuse 1 1 1 1\nconstantAttenuation 0\n", 3, "division by zero"),
        (POINT + "diffuse 1 1 1 1\nspotCutoff 30\n", 3, "needs the point"),
        (POINT + "diffuse 1 1 1 1\nspotCutoff 0\n", 3, "half angle"),
        (POINT + "diffuse 1 1 1 1\nspotCutoff 91\n", 3, "half angle"),
        (POINT + "diffuse 1 1 1 1\nspotExponent -1\n", 3, "negative"),
        (POINT + "diffuse 1 1 1 1\nspotInner 10\n", 3, "needs a cone"),
        (POINT + "diffuse 1 1 1 1\nspotDirection 0 0 0\nspotCutoff 20\nspotInner 21\n", 5, "spotInner is 21"),
        (POINT + "diffuse 1 1 1 1\nspotDirection 0 5 0\nspotCutoff 20\n", 3, "its own position"),
        ("position 0 1 0 0\ndiffuse 1 1 1 1\nspotDirection 0 0 0\nspotCutoff 20\n", 4, "has no cone"),
        ("\n", None, "empty"),
    ],
)  # fmt: skip
def test_a_malformed_light_is_an_error_with_its_place(write, text, line, says):
    refused(write, "light a.light\n", "a.light", line, says, a_light=text)


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("v 1 2\n", 1, "'v' has 2 values"),
        ("v 1 2 3 4 5\n", 1, "'v' has 5 values"),
        ("v 1 2 3\n\nv 1 x 3\n", 3, "'x' is not a number"),
        ("v 1 2 nan\n", 1, "not a finite number"),
        ("v 1 2 1_0\n", 1, "'1_0' is not a number"),
        ("v 1 \\\n 2 3\nv 1 inf 2\n", 3, "not a finite number"),
        ("vn 0 0\n", 1, "'vn' has 2 values"),
        (TRIANGLE + "f 1 2\n", 5, "a face has 2 corners"),
        (TRIANGLE + "f\n", 5, "a face has 0 corners"),
        (TRIANGLE + "f 1 2 0\n", 5, "vertex 0, but indices start at 1"),
        (TRIANGLE + "f 1 2 4\n", 5, "vertex 4, but there are 3"),
        (TRIANGLE + "f 1 2 -4\n", 5, "vertex -4, but there are 3"),
        (TRIANGLE + "f 1//1 2//1 3//1\n", 5, "normal 1, but there are 0"),
        (TRIANGLE + "f 1/1/2 2/1/1 3/1/1\nvn 0 0 1\n", 5, "normal 2, but there are 1"),
        (TRIANGLE + "f 1 2//1 3\n", 5, "different kinds"),
        (TRIANGLE + "f 1/ 2/ 3/\n", 5, "'1/' is no corner"),
        (TRIANGLE + "f 1/1/1/1 2 3\n", 5, "'1/1/1/1' is no corner"),
        (TRIANGLE + "f 1 2 3.5\n", 5, "'3.5' is no corner"),
        ("v 0 0 0\nf / / /\n", 2, "'/' is no corner"),
        (TRIANGLE + "f 1 2 x\n", 5, "'x' is no corner"),
        (TRIANGLE + "f 1 2 99999999999999999999\n", 5, "is no corner"),
        ("hello\nworld\n", None, "no line of this file is OBJ"),
        ("", None, "empty"),
    ],
)  # fmt: skip
def test_a_malformed_obj_line_is_an_error_with_its_place(write, text, line, says):
    refused(write, "obj x.obj\n", "x.obj", line, says, x_obj=text)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "empty"),
        (b" \n\n", "empty"),
        ("cam 0 0 5 0 0 0 0 1 0".encode("utf-16"), "UTF-16"),
        ("cam 0 0 5 0 0 0 0 1 0".encode("utf-16-be"), "UTF-16"),
        (b"sky 1 1 1\n\0\1\2garbage", "binary"),
        (bytes(range(1, 256)), "not UTF-8"),
        (b"sky 1 1 1\n# caf\xe9\n", "a.scene:2: this is not UTF-8"),
        (b"\x1b[31m 1 2\n", "unknown word"),
    ],
)  # fmt: skip
def test_what_is_no_text_is_an_error(write, data, says):
    with pytest.raises(InputError, match=re.escape(says)) as caught:
        write(data)
    assert "a.scene" in str(caught.value) and str(caught.value).isprintable()


def test_a_light_or_obj_that_is_no_text_is_an_error_too(tmp_path):
    (tmp_path / "a.scene").write_text("light a.light\n")
    (tmp_path / "a.light").write_bytes("position 0 0 0 1".encode("utf-16"))
    with pytest.raises(InputError, match=r"a\.light: the text is UTF-16"):
        load(tmp_path / "a.scene")
    (tmp_path / "a.scene").write_text("obj a.obj\n")
    (tmp_path / "a.obj").write_bytes(b"\x00\x01\x02\x03 v 1 2 3")
    with pytest.raises(InputError, match=r"a\.obj: this is binary data"):
        load(tmp_path / "a.scene")
