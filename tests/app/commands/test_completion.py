"""Tab: what a shell is told about commands, flags, words, scenes, presets, cameras and buffers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from irrsplat.app import cli
from irrsplat.scene import bundled
from irrsplat.settings import PRESETS


def offered(line: str, place: Path) -> set[str]:
    """The words that the shell is told for the end of `line`, as its own script asks for them."""
    answer = place / "answer"
    asked = {"COMP_LINE": line, "COMP_POINT": str(len(line)), "COMP_TYPE": "9", "IFS": "\v", "_ARGCOMPLETE": "1"}
    environment = {**os.environ, **asked, "_ARGCOMPLETE_SHELL": "bash", "_ARGCOMPLETE_STDOUT_FILENAME": str(answer)}
    command = [sys.executable, "-m", "irrsplat"]
    done = subprocess.run(command, env=environment, cwd=place, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return {word.strip() for word in answer.read_text().split("\v") if word.strip()}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("irrsplat re", {"render"}),
        ("irrsplat render --gath", {"--gather", "--gather-size"}),
        ("irrsplat render --gather tr", {"trace"}),
        ("irrsplat render --smooth ", {"on", "off"}),
        ("irrsplat render --exposure ", {"auto"}),
        ("irrsplat view --preset ", set(PRESETS)),
        ("irrsplat view cor", {name for name in bundled() if name.startswith("cor")}),
        ("irrsplat bench cornell fu", {"furnace"}),
        ("irrsplat view plain.scene --camera ", {"side", "top"}),
        ("irrsplat view missing.scene --camera ", set()),
        ("irrsplat render cornell -o a.npz --buffers depth,w", {"depth,weight"}),
        ("irrsplat render cornell -o a.png --overt", set()),  # a former flag
        ("irrsplat completion ", {"--help", "bash", "zsh", "fish"}),
    ],
)
def test_what_is_offered(line: str, words: set[str], place: Path) -> None:
    (place / "plain.scene").write_text("cam side 5 0 0 0 0 0 0 0 1\ncam top 0 5 0 0 0 0 0 0 1\nobj triangle.obj\n")
    assert offered(line, place) == words


def test_scene_files_are_offered_and_others_are_not(place: Path) -> None:
    assert offered("irrsplat info pl", place) == {"plain.scene"}
    (place / "notes.txt").touch()
    assert offered("irrsplat info no", place) == set()


@pytest.mark.parametrize(
    ("shell", "words"), [("bash", "complete "), ("zsh", "compdef "), ("fish", "complete --command irrsplat")]
)
def test_the_scripts(shell: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["completion", shell]) == 0
    out, err = capsys.readouterr()
    assert words in out and "_ARGCOMPLETE" in out and err == ""


def test_bash_takes_its_script() -> None:
    script = subprocess.run([sys.executable, "-m", "irrsplat", "completion", "bash"], capture_output=True, text=True, check=True)
    asked = script.stdout + "\ncomplete -p irrsplat"
    done = subprocess.run(["bash", "--norc", "-c", asked], capture_output=True, text=True, timeout=60, check=True)
    assert "irrsplat" in done.stdout and done.stderr == ""
