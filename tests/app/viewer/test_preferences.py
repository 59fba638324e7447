"""The viewer's memory: what is saved comes back, and nothing in a file stops the viewer."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from irrsplat.app.viewer.preferences import Preferences, load, save
from irrsplat.scene import load as load_scene
from irrsplat.settings import SETTINGS, SettingValues, preset

FULL = Preferences(
    size=(1280, 720),
    fullscreen=True,
    preset="paper",
    values=cast(SettingValues, {name: getattr(preset("default"), name) for name in SETTINGS}),
    ui={"panel": True, "overlay": None, "places": [1, 2.5, {"x": "é"}]},
    recent=["/scenes/one.scene", "cornell", os.fsdecode(b"/caf\xe9.obj")],  # the last is not Unicode
)


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of this test, which does not exist yet, inside one that is empty otherwise."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config" / "irrsplat"))
    return tmp_path / "config" / "irrsplat"


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def one_line(text: Any) -> bool:
    return isinstance(text, str) and text != "" and len(text.splitlines()) == 1 and text.isprintable()


def test_what_is_saved_comes_back(place: Path) -> None:
    """Types come back, too; no partial file stays. Without files there are defaults, and reading makes no folder."""
    assert load() == (Preferences(), []) and not place.parent.exists()
    assert save(FULL) is None
    back, notices = load()
    assert (back, notices) == (FULL, [])
    assert [type(v) for v in back.values.values()] == [type(v) for v in FULL.values.values()]
    for source in ("a.obj", "cornell", load_scene("cornell").path, "a.obj"):
        back.opened(source)
    assert back.recent == [os.path.abspath("a.obj"), "cornell", FULL.recent[0], FULL.recent[2]], "each once, the newest first"
    assert save(Preferences()) is None
    assert load() == (Preferences(), []) and names(place) == {"viewer.json"}


@pytest.mark.parametrize("content", [
    bytes(range(256)), b"[1]", b'{"version": 2, "size": [100, 100]}',
    b'{"version": 1, "size": [0, 100]}', b'{"version": 1, "ui": 7}',
])  # fmt: skip
def test_defaults_replace_a_damaged_file(place: Path, content: bytes) -> None:
    place.mkdir(parents=True)
    (place / "viewer.json").write_bytes(content)
    back, notices = load()
    assert back == Preferences() and len(notices) == 1 and one_line(notices[0])
    assert save(FULL) is None and load() == (FULL, [])


def test_settings_of_another_version_are_left_out(place: Path) -> None:
    values: Any = {"a": 99, "splines": 3, "seed": 7, "gather": "photons", "viewer_samples": 8, "samples": 10**400}
    save(replace(FULL, values=values, recent=["relative.obj", "/kept.obj"]))
    assert load() == (replace(FULL, values={"seed": 7, "viewer_samples": 8}, recent=["/kept.obj"]), [])


def test_what_cannot_be_written_or_read_is_told_and_nothing_is_lost(place: Path) -> None:
    """A file stands where the folder should be, a folder where the file; JSON cannot hold the value."""
    place.parent.write_text("kept")
    said = save(FULL)
    assert one_line(said) and str(place) in str(said)
    assert load()[0] == Preferences() and place.parent.read_text() == "kept"
    place.parent.unlink()
    assert save(FULL) is None
    assert one_line(save(Preferences(ui={"x": float("nan")}))) and load() == (FULL, [])
    (place / "viewer.json").unlink()
    (place / "viewer.json").mkdir()
    assert one_line(save(FULL)) and load()[0] == Preferences() and names(place) == {"viewer.json"}
