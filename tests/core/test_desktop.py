"""The entry in a desktop's menu: valid, complete, taken away again; and the icon, which is the same at all sizes."""

from __future__ import annotations

import configparser
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from irrsplat.app import cli
from irrsplat.app.common import desktop_entry
from irrsplat.app.common.icon import SIZES, SPLATS, icon, svg
from irrsplat.core.errors import IrrsplatError


def test_it_is_installed_and_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert cli.main(["desktop", "install"]) == 0
    told = {Path(line) for line in capsys.readouterr().out.splitlines()}
    assert told == {path for path in tmp_path.rglob("*") if path.is_file()} and len(told) == 2 + len(SIZES)
    for side in SIZES:
        with Image.open(tmp_path / f"icons/hicolor/{side}x{side}/apps/irrsplat.png") as picture:
            assert picture.size == (side, side) and picture.mode == "RGBA"
    assert cli.main(["desktop", "remove"]) == 0
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_the_entry_runs_irrsplat_wherever_it_is(tmp_path: Path) -> None:
    folder = tmp_path / 'with a blank, $HOME, 100% and a "quote"'
    folder.mkdir()
    script = folder / "irrsplat"
    script.write_text("#!/bin/sh\n")
    script.chmod(0o755)
    text = desktop_entry.entry([str(script)])
    parsed = configparser.ConfigParser(interpolation=None)
    parsed.optionxform = str  # type: ignore[assignment,method-assign]  # case counts
    parsed.read_string(text)
    value = re.sub(r"\\(.)", r"\1", parsed["Desktop Entry"]["Exec"])  # the file's own escapes; those of Exec are a shell's
    words = subprocess.run(
        ["sh", "-c", f"printf '%s\\n' {value}"], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert [word.replace("%%", "%") for word in words] == [str(script), "view", "%f"]
    if shutil.which("desktop-file-validate"):
        (tmp_path / "irrsplat.desktop").write_text(text)
        done = subprocess.run(
            ["desktop-file-validate", tmp_path / "irrsplat.desktop"], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stdout) == (0, "")


def test_other_systems_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(IrrsplatError, match="shortcut"):
        desktop_entry.data_home()


def test_the_icon_is_one_picture_at_all_sizes() -> None:
    """Its mean over blocks of a larger one is the smaller one, but for pixels at the corners, which alpha weighs."""
    large = icon(128).reshape(32, 4, 32, 4, 4).mean((1, 3))
    small = icon(32)
    solid = large[..., 3] == 1.0
    assert np.abs(large - small)[solid].max() < 0.01
    assert small[0, 0, 3] < 0.2 and small[16, 16, 3] == 1.0


def test_the_svg_has_the_same_splats() -> None:
    found = ET.fromstring(svg()).findall(".//{*}circle")
    places = [[float(circle.get(key, "0")) / 256 for key in ("cx", "cy", "r")] for circle in found]
    np.testing.assert_allclose(places, [splat[:3] for splat in SPLATS], atol=1e-3)
