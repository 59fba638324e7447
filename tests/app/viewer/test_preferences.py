"""Preferences of the viewer: saved values are restored, and a damaged file does not stop the viewer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from irrsplat.app.viewer.preferences import Preferences, load, save

FULL = Preferences((1280, 720), ["/scenes/one.scene", "cornell", os.fsdecode(b"/caf\xe9.obj")])  # the last is not Unicode


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of preferences, which does not exist yet, in an otherwise empty folder."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config" / "irrsplat"))
    return tmp_path / "config" / "irrsplat"


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def one_line(text: Any) -> bool:
    return isinstance(text, str) and text != "" and len(text.splitlines()) == 1 and text.isprintable()


def test_what_is_saved_comes_back(place: Path) -> None:
    """Values and their types are restored without temporary files. Missing files give defaults, and reading makes no folder."""
    assert load() == (Preferences(), []) and not place.parent.exists()
    assert save(FULL) is None
    (place / "viewer.json").write_bytes(b"\xef\xbb\xbf" + (place / "viewer.json").read_bytes())  # an editor's byte order mark
    back, notices = load()
    assert (back, notices) == (FULL, [])
    for source in ("a.obj", "cornell", "a.obj"):
        back.opened(source)
    assert back.recent == [os.path.abspath("a.obj"), "cornell", FULL.recent[0], FULL.recent[2]], "each once, the newest first"
    assert save(Preferences()) is None
    assert load() == (Preferences(), []) and names(place) == {"viewer.json"}


DAMAGED = {
    "binary": bytes(range(256)),
    "infinite": b'{"size": [1e999, 1]}',
    "deep": b'{"recent": ' + b"[" * 200_000 + b"]" * 200_000 + b"}",
    "size": b'{"size": [0, 100], "recent": []}',
}


@pytest.mark.parametrize("content", DAMAGED.values(), ids=DAMAGED)
def test_defaults_replace_a_damaged_file(place: Path, content: bytes) -> None:
    place.mkdir(parents=True)
    (place / "viewer.json").write_bytes(content)
    back, notices = load()
    assert back == Preferences() and len(notices) == 1 and one_line(notices[0])
    assert save(FULL) is None and load() == (FULL, [])


def test_what_cannot_be_written_or_read_is_told_and_nothing_is_lost(place: Path) -> None:
    """A file in place of the folder gives a message."""
    place.parent.write_text("kept")
    said = save(FULL)
    assert one_line(said) and str(place) in str(said)
    assert load()[0] == Preferences() and place.parent.read_text() == "kept"
