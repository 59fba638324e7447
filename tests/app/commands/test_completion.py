"""Completion at Tab: commands, flags, words, scenes, presets, cameras and buffers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from irrsplat.app import cli
from irrsplat.scene import bundled
from irrsplat.settings import PRESETS
from tests.app.conftest import TRIANGLE

OFFERED = {
    "irrsplat re": {"render"},
    "irrsplat render --gath": {"--gather", "--gather-size"},
    "irrsplat render --gather tr": {"trace"},
    "irrsplat render --fill-holes ": {"on", "off"},
    "irrsplat render --exposure ": {"auto"},
    "irrsplat view --preset ": set(PRESETS),
    "irrsplat view cor": {name for name in bundled() if name.startswith("cor")},
    "irrsplat bench cornell fu": {"furnace"},
    "irrsplat view plain.scene --camera ": {"side", "top"},
    "irrsplat view missing.scene --camera ": set(),
    "irrsplat render cornell -o a.npz --buffers depth,w": {"depth,weight"},
    "irrsplat render cornell -o a.png --overt": set(),  # a former flag
    "irrsplat completion ": {"--help", "bash", "zsh", "fish"},
    "irrsplat info pl": {"plain.scene"},
    "irrsplat info no": set(),  # notes.txt is no scene
}
# the shell's own call, for each line in turn; argcomplete would end the process after the first
PROGRAM = """
import functools, json, os, sys
import argcomplete
from irrsplat.app import cli
argcomplete.autocomplete = functools.partial(argcomplete.autocomplete, exit_method=sys.exit)
for number, line in enumerate(json.load(sys.stdin)):
    os.environ |= {"COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_STDOUT_FILENAME": f"answer{number}"}
    assert cli.main() == 0
"""


def test_completions(tmp_path: Path) -> None:
    (tmp_path / "plain.scene").write_text("cam side 5 0 0 0 0 0 0 0 1\ncam top 0 5 0 0 0 0 0 0 1\nobj triangle.obj\n")
    (tmp_path / "triangle.obj").write_text(TRIANGLE)
    (tmp_path / "notes.txt").touch()
    shell = {**os.environ, "COMP_TYPE": "9", "IFS": "\v", "_ARGCOMPLETE": "1", "_ARGCOMPLETE_SHELL": "bash"}
    command = [sys.executable, "-c", PROGRAM]
    lines = json.dumps([*OFFERED])
    done = subprocess.run(command, input=lines, env=shell, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    for number, (line, words) in enumerate(OFFERED.items()):
        answer = (tmp_path / f"answer{number}").read_text().split("\v")
        assert {word.strip() for word in answer if word.strip()} == words, line


@pytest.mark.parametrize(
    ("shell", "words"), [("bash", "complete "), ("zsh", "compdef "), ("fish", "complete --command irrsplat")]
)
def test_the_scripts(shell: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["completion", shell]) == 0
    out, err = capsys.readouterr()
    assert words in out and "_ARGCOMPLETE" in out and err == ""
    if shell == "bash":
        asked = out + "\ncomplete -p irrsplat"
        done = subprocess.run(["bash", "--norc", "-c", asked], capture_output=True, text=True, check=True)
        assert "irrsplat" in done.stdout and done.stderr == ""
