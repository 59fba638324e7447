"""GLSL made from Python: a fact stands in one place, and a record's columns have places of their own."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from irrsplat.core import glsl, paths
from irrsplat.core.record_layout import COLUMNS, GATHERED, TEXTURES, pack, unpack

ROOT = Path(__file__).resolve().parents[2]
COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/|#[^\n]*", re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])(?:\d+\.\d*|\.?\d+)(?:e[+-]?\d+)?", re.IGNORECASE)


def shaders() -> Iterator[tuple[str, str]]:
    """Every shader file's name, and its text without comments and directives."""
    root = paths.folder("shaders")
    for path in sorted(root.rglob("*")):
        if path.suffix in (".glsl", ".vert", ".frag"):
            yield str(path.relative_to(root)), COMMENT.sub("", path.read_text(encoding="utf-8"))


def distinctive() -> set[float]:
    """The constants that nothing else would happen to equal, and what shaders might be tempted to write in place of them."""
    values = np.concatenate([np.atleast_1d(value) for value in glsl.CONSTANTS.values()]).tolist()
    srgb = 1.0 + glsl.CONSTANTS["SRGB_OFFSET"]  # type: ignore[operator]
    return {v for v in values if v < 1e6 and (v >= 1000.0 or len(f"{v:g}".strip("0.")) > 3)} | {glsl.TABLE_COLUMNS - 1.0, srgb}


def test_no_shader_repeats_a_constant_of_python() -> None:
    looked_for = distinctive()
    assert {1023.0, 1024.0, 4096.0, 0.2126, 12.92, 1.055, 0.0031308} <= looked_for
    found = {
        f"{name}: {number}" for name, text in shaders() for number in NUMBER.findall(text) if float(number) in looked_for
    } | {
        f"{name}: {constant}"
        for name, text in shaders()
        for constant in re.findall(r"const\s+\w+\s+(\w+)\s*=", text)
        if constant in glsl.CONSTANTS
    }
    assert not found, f"include generated/constants.glsl instead of writing {sorted(found)}"


def test_no_module_repeats_the_weights_of_luminance_or_the_srgb_curve() -> None:
    elsewhere = [path for room in ("irrsplat", "app") for path in (ROOT / room).rglob("*.py") if path.name != "color.py"]
    found = [path.name for path in elsewhere if re.search(r"0\.2126|0\.0722|0\.0031308|12\.92", path.read_text(encoding="utf-8"))]
    assert not found, f"{found}: import it from core/color.py"


def test_every_generated_include_is_included() -> None:
    root = paths.folder("shaders")
    texts = "".join(path.read_text(encoding="utf-8") for path in root.rglob("*.*") if path.suffix in (".glsl", ".vert", ".frag"))
    assert set(re.findall(r'#include "(generated/[^"]+)"', texts)) == set(glsl.INCLUDES)


def test_the_columns_of_a_record_come_back_as_they_were_packed() -> None:
    """Each has channels of its own: packed one after the other, none overwrites another; and a gather fills its textures."""
    rng = np.random.default_rng(0)
    texels = {name: np.full((5, channels), np.nan, "f4") for name, channels in TEXTURES.items()}
    values = {name: rng.normal(size=(5, *column.shape)).astype("f4") for name, column in COLUMNS.items()}
    for name, column in values.items():
        pack(texels, name, column)
    assert all(np.array_equal(unpack(texels, name), column) for name, column in values.items())
    assert all(np.isfinite(texels[name]).all() for name in GATHERED)
