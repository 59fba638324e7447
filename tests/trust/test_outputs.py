"""Independent outputs: a failed one affects no other, all failures are reported, and duplicates are refused.

Temporary files of a killed process are removed.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.app import cli
from irrsplat.core import files
from tests.app.conftest import fake as fake
from tests.app.conftest import place as place
from tests.app.conftest import refused as refused
from tests.app.film.test_cli_path import FLIGHT
from tests.app.film.test_cli_path import flight as flight

RENDER = ["render", "plain.scene", "--size", "3", "2"]
NAMES = {"a.png", "b.exr", "c.npz", "folder", "s.json"}


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Return the changeable names of files whose renaming fails, as on a full disk."""
    names: set[str] = set()
    replace = os.replace

    def full(source: Any, target: Any) -> None:
        if Path(target).name in names:
            raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    return names


def written(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {"plain.scene", "triangle.obj"}


@pytest.mark.parametrize("bad", [{"a.png"}, {"b.exr", "c.npz"}, {"folder"}, {"s.json"}, NAMES])
def test_a_failed_output_affects_no_other(
    bad: set[str], broken: set[str], fake: Any, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All other files are written, and one line names each failed one."""
    broken |= bad
    outputs = ["-o", "a.png", "-o", "b.exr", "-o", "c.npz", "-o", "folder/", "--stats", "s.json"]
    assert cli.main([*RENDER, *outputs]) == 1
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert err.count("No space left on device") == len(bad) and all(f"{name}" in err for name in bad)
    assert written(place) == NAMES - bad


def test_failed_outputs_do_not_lose_the_cache(
    broken: set[str], place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken |= {"a.png"}
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    quick = ["--gather-size", "8", "--shadow-size", "64", "--bounces", "1"]
    assert cli.main([*RENDER, *quick, "-o", "a.png", "-o", "a.exr", "--cache", "a.cache", "--stats", "s.json"]) == 1
    err = capsys.readouterr().err
    assert "a.png: cannot write: No space left on device" in err and "a.exr: this needs the Python module 'OpenEXR'" in err
    assert written(place) == {"a.cache", "s.json"}


def test_a_path_continues_with_its_remaining_outputs(
    broken: set[str], fake: Any, flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A failed output is not tried again; without outputs, the path ends with the statistics of the written frames."""
    broken |= {"a1.png"}
    assert cli.main([*FLIGHT, "-o", "a{frame}.png", "-o", "b{frame}.png", "--stats", "s.json"]) == 1
    assert capsys.readouterr().err == "irrsplat: a1.png: cannot write: No space left on device\n"
    assert {path.name for path in flight.glob("[ab]*.png")} == {"a0.png", "b0.png", "b1.png", "b2.png", "b3.png"}
    assert len(json.loads((flight / "s.json").read_text())["frames"]) == 4
    broken |= {"c2.png"}
    assert cli.main([*FLIGHT, "-o", "c{frame}.png", "--stats", "t.json"]) == 1
    assert len(json.loads((flight / "t.json").read_text())["frames"]) == 2


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["-o", "a.png", "-o", "a.png"], "-o a.png and -o a.png are one file"),
        (["-o", "link.png", "-o", "real.png"], "-o link.png and -o real.png are one file"),
        (["-o", "a.npz", "--stats", "a.npz"], "-o a.npz and --stats a.npz are one file"),
        (["-o", "a.png", "--stats", "s", "--cache", "s"], "--stats s and --cache s are one file"),
    ],
)
def test_the_same_file_twice_is_refused(argv: list[str], words: str, refused: Callable[..., str], place: Path) -> None:
    (place / "link.png").symlink_to("real.png")
    assert words in refused([*RENDER, *argv])


def test_patterns_with_equal_names_at_a_later_frame_are_refused(refused: Callable[..., str], fake: Any, flight: Path) -> None:
    path = flight / "a.path"
    path.write_text(path.read_text().replace("frames 4", "frames 12"))
    line = refused([*FLIGHT, "-o", "f{frame}.png", "-o", "f{frame:02d}.png"])
    assert "f{frame:02d}.png: frame 10 would go to a file of 'f{frame}.png'" in line


@pytest.mark.parametrize("rows", [1, 16, 33])
def test_a_truncated_exr_is_detected(rows: int, tmp_path: Path) -> None:
    """OpenEXR's writer does not report a full disk; missing or zeroed data at the end is detected."""
    import OpenEXR

    path = tmp_path / "a.exr"
    pixels = np.random.default_rng(1).random((rows, 8, 3), dtype="f4")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "stats": "{}"}
    with OpenEXR.File(header, {"image": pixels}) as file:
        file.write(str(path))
    files.check_exr(path, rows)
    whole = path.read_bytes()
    for length in (0, 5, 100, len(whole) // 2, len(whole) - 1):
        for padded in (b"", b"\0" * (len(whole) - length)) if length < len(whole) // 2 else (b"",):
            path.write_bytes(whole[:length] + padded)
            with pytest.raises(OSError):
                files.check_exr(path, rows)


def test_permissions_and_links_stay(tmp_path: Path) -> None:
    """A private file stays private, also in a folder of pictures; a link leads to the new content."""
    file, link, folder = tmp_path / "a.txt", tmp_path / "link", tmp_path / "pictures"
    folder.mkdir()
    for private in (file, folder / "a.png"):
        private.touch(0o600)
    link.symlink_to(file)
    files.write_text(link, "new")
    files._write_folder(folder, iter([("a.png", np.zeros((1, 1, 3)))]))
    assert link.is_symlink() and file.read_text() == "new"
    assert [path.stat().st_mode & 0o777 for path in (file, folder / "a.png")] == [0o600, 0o600]
