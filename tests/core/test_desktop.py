"""The entry in a desktop's menu: valid, complete, and taken away again."""

from __future__ import annotations

import configparser
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from irrsplat.app import cli
from irrsplat.app.common import desktop_entry


def test_it_is_installed_and_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert cli.main(["desktop", "install"]) == 0
    told = {Path(line) for line in capsys.readouterr().out.splitlines()}
    assert told == {path for path in tmp_path.rglob("*") if path.is_file()} and len(told) == 2
    assert ElementTree.parse(tmp_path / "icons/hicolor/scalable/apps/irrsplat.svg").getroot().tag.endswith("svg")
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
