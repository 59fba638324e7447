"""The viewer's memory: what is saved comes back, what is damaged is kept aside, and nothing in a file stops the viewer."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, cast

import pytest

from irrsplat.app.viewer.preferences import Preferences, bookmarks, load, save, set_bookmarks
from irrsplat.scene import Camera
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
CAMERAS = [
    Camera((0.1, 1 / 3, -2e-7), (1.0, 2.0, 3.0), (0.0, 0.0, 1.0), 33.3, "the \n door"),
    Camera((1e6, 0.0, 5.0), (0.0, 0.0, 0.0), name=""),
]


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
    assert load() == (Preferences(), []) and bookmarks("cornell") == [] and not place.parent.exists()
    assert save(FULL) is None
    (place / "viewer.json").write_bytes(b"\xef\xbb\xbf" + (place / "viewer.json").read_bytes())  # an editor's byte order mark
    back, notices = load()
    assert (back, notices) == (FULL, [])
    assert [type(v) for v in back.values.values()] == [type(v) for v in FULL.values.values()]
    for source in ("a.obj", "cornell", load_scene("cornell").path, "a.obj"):
        back.opened(source)
    assert back.recent == [os.path.abspath("a.obj"), "cornell", FULL.recent[0], FULL.recent[2]], "each once, the newest first"
    assert save(Preferences()) is None
    assert load() == (Preferences(), []) and names(place) == {"viewer.json"}


DAMAGED = {
    "binary": bytes(range(256)),
    "later": b'{"version": 2, "size": [100, 100]}',
    "infinite": b'{"version": 1, "ui": {"x": 1e999}}',
    "deep": b'{"version": 1, "ui": ' + b"[" * 200_000 + b"]" * 200_000 + b"}",
    "scenes": b'{"version": 1, "scenes": [1]}',
}


@pytest.mark.parametrize("content", DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_file_is_kept_aside(place: Path, content: bytes) -> None:
    """Each gets a name of its own, also one that was damaged after it was read. Saving still works."""
    place.mkdir(parents=True)
    for name in ("viewer.json", "bookmarks.json"):
        (place / name).write_bytes(content)
    back, notices = load()
    assert back == Preferences() and len(notices) == 2 and all(map(one_line, notices))
    assert "viewer.json.broken" in notices[0] and names(place) == {"viewer.json.broken", "bookmarks.json.broken"}
    (place / "viewer.json").write_text('{"version": 99}')
    said = save(FULL)
    assert one_line(said) and "viewer.json.broken-2" in str(said)
    assert load() == (FULL, []) and set_bookmarks("cornell", CAMERAS) is None and bookmarks("cornell") == CAMERAS
    assert (place / "viewer.json.broken").read_bytes() == content


def test_a_wrong_value_is_dropped_with_a_notice_and_the_others_stay(place: Path) -> None:
    """There is no notice about the unknown key `later`."""
    save(FULL)
    data = json.loads((place / "viewer.json").read_text())
    data |= {"preset": "gone", "later": 1, "size": [0, 100], "fullscreen": "yes", "recent": ["relative.obj", "/kept.obj", 7]}
    data["values"] = {
        "a": 99,
        "splines": 3,
        "seed": 7,
        "bounces": True,
        "gather": "photons",
        "viewer_samples": 8,
        "samples": 10**400,
    }
    (place / "viewer.json").write_text(json.dumps(data))
    back, notices = load()
    assert back == Preferences(ui=FULL.ui, values={"seed": 7, "viewer_samples": 8}, recent=["/kept.obj"])
    for word in ("preset", "size", "fullscreen", "relative.obj", "scene", "'a'", "splines", "bounces", "gather", "samples"):
        assert any(word in notice for notice in notices), word
    assert len(notices) == 10 and all(map(one_line, notices))


def test_a_scene_has_one_set_of_bookmarks_whatever_it_is_called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By any path to it, links too. A file with the name of a bundled scene wins over that, as it does when loading."""
    (tmp_path / "room.scene").write_text("")
    (tmp_path / "link.scene").symlink_to(tmp_path / "room.scene")
    monkeypatch.chdir(tmp_path)
    assert set_bookmarks(str(tmp_path / "room.scene"), CAMERAS) is None
    for called in ("room.scene", "link.scene", f"../{tmp_path.name}/./room.scene"):
        assert bookmarks(called) == CAMERAS
    assert set_bookmarks("cornell", CAMERAS[:1]) is None and bookmarks(load_scene("cornell").path) == CAMERAS[:1]
    (tmp_path / "cornell").write_text("")
    assert bookmarks("cornell") == []


def test_another_viewers_bookmarks_and_good_ones_among_damaged_are_kept(place: Path) -> None:
    """The file is read again before it is written. A damaged entry is left out with a notice."""
    assert set_bookmarks("/one.obj", CAMERAS) is None
    other = json.loads((place / "bookmarks.json").read_text())  # the other viewer adds two scenes, one newer than we know
    cameras = other["scenes"]["/one.obj"]
    damaged = [
        {**cameras[0], key: wrong} for key, wrong in (("fov", "1"), ("eye", [1, 2]), ("up", None), ("target", [1e300] * 3))
    ]
    other["scenes"] |= {"/two.obj": [*damaged, cameras[0]], "/three.obj": [{"shape": "of tomorrow"}]}
    (place / "bookmarks.json").write_text(json.dumps(other))
    assert set_bookmarks("/one.obj", CAMERAS[1:]) is None
    assert bookmarks("/one.obj") == CAMERAS[1:] and bookmarks("/two.obj") == CAMERAS[:1]
    assert json.loads((place / "bookmarks.json").read_text())["scenes"]["/three.obj"] == [{"shape": "of tomorrow"}]
    assert "/two.obj" in load()[1][0]


def test_what_cannot_be_written_or_read_is_told_and_nothing_is_lost(place: Path) -> None:
    """A file stands where the folder should be, a folder where the file; JSON cannot hold the value."""
    place.parent.write_text("kept")
    for said in (save(FULL), set_bookmarks("cornell", CAMERAS)):
        assert one_line(said) and str(place) in str(said)
    assert load()[0] == Preferences() and place.parent.read_text() == "kept"
    place.parent.unlink()
    assert save(FULL) is None
    assert one_line(save(Preferences(ui={"x": float("nan")}))) and load() == (FULL, [])
    (place / "viewer.json").unlink()
    (place / "viewer.json").mkdir()
    assert one_line(save(FULL)) and load()[0] == Preferences() and names(place) == {"viewer.json"}
