"""The viewer's memory: what is saved comes back, what is damaged is kept aside, and nothing in a file stops the viewer."""

from __future__ import annotations

import copy
import errno
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import platformdirs
import pytest

from irrsplat.app.viewer.preferences import Preferences, bookmarks, load, save, set_bookmarks
from irrsplat.scene import Camera
from irrsplat.scene import load as load_scene
from irrsplat.settings import PRESETS, SETTINGS, SettingValues, preset

FULL = Preferences(
    size=(1280, 720),
    fullscreen=True,
    preset="paper",
    values={"a": 0.3, "tolerance": "auto", "gather": "raster", "gradients": True, "seed": 7},
    ui={"panel": True, "overlay": None, "places": [1, 2.5, {"x": "é"}]},
    recent=["/scenes/one.scene", "cornell", "/a folder/zwei ö.glb"],
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


def test_missing_files_give_defaults_and_no_notice(place: Path) -> None:
    assert load() == (Preferences(), [])
    assert bookmarks("cornell") == []
    assert not place.parent.exists()  # reading makes no folder


def test_what_is_saved_comes_back(place: Path) -> None:
    assert save(FULL) is None
    assert load() == (FULL, [])
    assert save(Preferences()) is None
    assert load() == (Preferences(), [])
    assert names(place) == {"viewer.json"}  # and no partial file


@pytest.mark.parametrize("name", PRESETS)
def test_each_presets_values_come_back_with_their_types(name: str) -> None:
    values = cast(SettingValues, {key: getattr(preset(name), key) for key in SETTINGS})
    assert save(Preferences(preset=name, values=values)) is None
    back, notices = load()
    assert (back.preset, back.values, notices) == (name, values, [])
    assert [type(v) for v in back.values.values()] == [type(v) for v in values.values()]


def test_the_files_lie_in_the_users_configuration_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("IRRSPLAT_CONFIG")
    asked: dict[str, object] = {}

    def config(name: str, **options: Any) -> Path:
        asked.update(options, name=name)
        return tmp_path / "home" / name

    monkeypatch.setattr(platformdirs, "user_config_path", config)
    assert save(FULL) is None
    assert names(tmp_path / "home" / "irrsplat") == {"viewer.json"}
    assert asked == {"name": "irrsplat", "appauthor": False}
    monkeypatch.setattr(platformdirs, "user_config_path", lambda name, **_: Path("~/.config") / name)  # nobody's home is known
    monkeypatch.chdir(tmp_path)
    failed = save(FULL)
    assert one_line(failed) and "IRRSPLAT_CONFIG" in str(failed)
    assert load() == (Preferences(), [failed])
    assert bookmarks("cornell") == []
    assert not (tmp_path / "~").exists()


DAMAGED = {
    "empty": b"",
    "cut": b'{"version": 1, "size": [12',
    "binary": bytes(range(256)),
    "list": b"[1, 2]",
    "null": b"null",
    "later": b'{"version": 2, "size": [100, 100]}',
    "none": b'{"size": [100, 100]}',
    "nan": b'{"version": 1, "ui": {"x": NaN}}',
    "infinite": b'{"version": 1, "ui": {"x": 1e999}}',
    "deep": b'{"version": 1, "ui": ' + b"[" * 200_000 + b"]" * 200_000 + b"}",
    "long": b'{"version": 1, "values": {"a": ' + b"9" * 10_000 + b"}}",
}


@pytest.mark.parametrize("content", DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_file_is_kept_aside(place: Path, content: bytes) -> None:
    place.mkdir(parents=True)
    (place / "viewer.json").write_bytes(content)
    back, notices = load()
    assert back == Preferences()
    assert len(notices) == 1 and one_line(notices[0]) and "viewer.json.broken" in notices[0]
    assert (place / "viewer.json.broken").read_bytes() == content
    assert names(place) == {"viewer.json.broken"}
    assert save(FULL) is None
    assert load() == (FULL, [])


def test_no_earlier_broken_file_is_lost(place: Path) -> None:
    place.mkdir(parents=True)
    for n in range(4):
        (place / "viewer.json").write_text(f"damage {n}")
        load()
    kept = {name: (place / name).read_text() for name in names(place)}
    assert sorted(kept.values()) == [f"damage {n}" for n in range(4)]
    assert kept["viewer.json.broken"] == "damage 0"


def test_saving_over_a_file_damaged_since_keeps_that_aside_too(place: Path) -> None:
    assert save(FULL) is None
    (place / "viewer.json").write_text('{"version": 99}')
    said = save(FULL)
    assert one_line(said) and "viewer.json.broken" in str(said)
    assert load() == (FULL, [])
    assert (place / "viewer.json.broken").read_text() == '{"version": 99}'


def test_a_byte_order_mark_is_accepted(place: Path) -> None:
    assert save(FULL) is None
    (place / "viewer.json").write_bytes(b"\xef\xbb\xbf" + (place / "viewer.json").read_bytes())
    assert load() == (FULL, [])


def leaves(tree: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The paths to every node of a JSON tree but its root, branches too."""
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ():
        yield (*at, key)
        yield from leaves(value, (*at, key))


def replaced(tree: Any, path: tuple[Any, ...], value: Any) -> Any:
    tree = copy.deepcopy(tree)
    node = tree
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    return tree


WRONG: tuple[Any, ...]
WRONG = (None, "wrong", "1", [], [[]], {}, {"x": 1}, True, -1, 0, 1, 1.5, 10**400, 1e60, 1e300, "\ud800", "line\nline")


def test_a_wrong_value_is_dropped_and_the_others_stay(place: Path) -> None:
    save(FULL)
    good = json.loads((place / "viewer.json").read_text())
    for path in [p for p in leaves(good) if p[0] != "version"]:
        for value in WRONG:
            (place / "viewer.json").write_text(json.dumps(replaced(good, path, value)))
            back, notices = load()
            assert all(map(one_line, notices)) and len(notices) <= 1
            for name in ("size", "fullscreen", "preset", "values", "ui", "recent"):
                if name != path[0]:
                    assert getattr(back, name) == getattr(FULL, name), (path, value)
            # what came through is legal: the settings take it, and it can be saved and is the same then
            preset(back.preset, **back.values)
            assert back.size is None or (back.size[0] > 0 and back.size[1] > 0 and type(back.size) is tuple)
            assert isinstance(back.fullscreen, bool) and isinstance(back.ui, dict)
            assert all(os.path.isabs(source) or source == "cornell" for source in back.recent)
            if path[0] == "values" and len(path) > 1:  # the other settings are kept
                assert {k: v for k, v in FULL.values.items() if k != path[1]}.items() <= back.values.items()
            if path[0] != "ui" and not notices:  # nothing said: all of it was taken
                assert json.loads(json.dumps(vars(back)))[path[0]] == json.loads((place / "viewer.json").read_text())[path[0]]
            assert save(back) is None
            assert load() == (back, [])


def test_settings_remembered_by_their_former_names_are_taken(place: Path) -> None:
    save(FULL)
    data = json.loads((place / "viewer.json").read_text())
    data["values"] = {"overture": False, "rest": 8}
    (place / "viewer.json").write_text(json.dumps(data))
    back, notices = load()
    assert (back.values, notices) == ({"fill_holes": False, "viewer_samples": 8}, [])


def test_a_dropped_value_gives_a_notice(place: Path) -> None:
    save(FULL)
    data = json.loads((place / "viewer.json").read_text())
    data |= {"preset": "gone", "later": 1, "size": [0, 100], "fullscreen": "yes", "recent": ["relative.obj", "/kept.obj", 7]}
    data["values"] = {"a": 99, "splines": 3, "seed": 7, "bounces": True, "gather": "photons"}
    (place / "viewer.json").write_text(json.dumps(data))
    back, notices = load()
    assert back == Preferences(ui=FULL.ui, values={"seed": 7}, recent=["/kept.obj"])
    for word in ("preset", "size", "fullscreen", "relative.obj", "recent scene", "'a'", "splines", "bounces", "gather"):
        assert any(word in notice for notice in notices), word
    assert len(notices) == 9  # three choices, four settings, two scenes; nothing of the unknown key
    assert all(map(one_line, notices))


def test_recent_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    it = Preferences()
    for source in ["a.obj", "cornell", "b.obj", load_scene("cornell").path, "a.obj"]:
        it.opened(source)
    assert it.recent == [str(tmp_path / "a.obj"), "cornell", str(tmp_path / "b.obj")]
    for n in range(20):
        it.opened(f"{n}.obj")
    assert it.recent == [str(tmp_path / f"{n}.obj") for n in range(19, 9, -1)]
    it.recent = [*it.recent, "/eleventh.obj", it.recent[0]]
    assert save(it) is None
    assert load()[0].recent == it.recent[:10]


def test_bookmarks_come_back(place: Path) -> None:
    assert set_bookmarks("cornell", CAMERAS) is None
    assert bookmarks("cornell") == CAMERAS
    assert bookmarks("door") == []
    assert load() == (Preferences(), [])
    assert names(place) == {"bookmarks.json"}
    assert set_bookmarks("cornell", []) is None
    assert bookmarks("cornell") == []
    numbers = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]], "f4")  # as a loader may leave them in a Camera
    made = Camera(tuple(numbers[0]), tuple(numbers[1]), fov=np.float32(40.0))  # type: ignore[arg-type]
    assert set_bookmarks("cornell", [made]) is None
    assert bookmarks("cornell") == [made]


def test_a_scene_has_one_set_of_bookmarks_whatever_it_is_called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tmp_path / "scenes" / "room.scene"
    scene.parent.mkdir()
    scene.write_text("")
    (tmp_path / "link.scene").symlink_to(scene)
    monkeypatch.chdir(scene.parent)
    assert set_bookmarks(str(scene), CAMERAS) is None
    for called in ("room.scene", "../link.scene", str(tmp_path / "link.scene"), "../scenes/./room.scene"):
        assert bookmarks(called) == CAMERAS
    assert set_bookmarks("cornell", CAMERAS[:1]) is None
    assert bookmarks(load_scene("cornell").path) == CAMERAS[:1]
    # a file of that name wins over the bundled scene, as it does when loading
    (scene.parent / "cornell").write_text("")
    assert bookmarks("cornell") == []


def test_another_viewers_bookmarks_are_kept(place: Path) -> None:
    assert set_bookmarks("/one.obj", CAMERAS) is None
    seen = bookmarks("/one.obj")
    other = json.loads((place / "bookmarks.json").read_text())  # the other viewer adds two scenes, one newer than we know
    other["scenes"] |= {"/two.obj": other["scenes"]["/one.obj"][:1], "/three.obj": [{"shape": "of tomorrow"}]}
    (place / "bookmarks.json").write_text(json.dumps(other))
    assert set_bookmarks("/one.obj", seen[1:]) is None
    assert bookmarks("/one.obj") == CAMERAS[1:]
    assert bookmarks("/two.obj") == CAMERAS[:1]
    assert json.loads((place / "bookmarks.json").read_text())["scenes"]["/three.obj"] == [{"shape": "of tomorrow"}]


def test_a_wrong_bookmark_is_dropped_and_the_others_stay(place: Path) -> None:
    set_bookmarks("/one.obj", CAMERAS)
    set_bookmarks("/two.obj", CAMERAS)
    good = json.loads((place / "bookmarks.json").read_text())
    for path in [p for p in leaves(good) if p[:2] == ("scenes", "/one.obj")]:
        for value in WRONG:
            (place / "bookmarks.json").write_text(json.dumps(replaced(good, path, value)))
            back = bookmarks("/one.obj")
            for camera in back:
                assert np.isfinite(camera.view_from_world.astype("f4")).all()
                assert {type(x) for x in (*camera.eye, *camera.target, *camera.up, camera.fov)} <= {int, float}
            if len(path) > 2:
                assert CAMERAS[1 - path[2]] in back
            assert bookmarks("/two.obj") == CAMERAS
            notices = load()[1]
            whole = len(back) == len(CAMERAS) or value == []
            assert len(notices) <= 1 and all(map(one_line, notices))
            assert whole or "/one.obj" in notices[0]
    assert names(place) == {"bookmarks.json"}


@pytest.mark.parametrize("content", [*DAMAGED.values(), b'{"version": 1, "scenes": [1]}'], ids=[*DAMAGED, "scenes"])
def test_damaged_bookmarks_are_kept_aside(place: Path, content: bytes) -> None:
    for reads in (lambda: bookmarks("cornell"), load, lambda: set_bookmarks("cornell", CAMERAS)):
        place.mkdir(parents=True, exist_ok=True)
        (place / "bookmarks.json").write_bytes(content)
        reads()
    kept = names(place) - {"bookmarks.json"}
    assert [(place / name).read_bytes() for name in kept] == [content] * 3
    assert bookmarks("cornell") == CAMERAS


def test_a_folder_that_cannot_be_made_is_reported(place: Path) -> None:
    place.parent.write_text("a file where the folder should be")
    for said in (save(FULL), set_bookmarks("cornell", CAMERAS)):
        assert one_line(said) and str(place) in str(said)
    assert bookmarks("cornell") == []
    back, notices = load()
    assert back == Preferences() and all(map(one_line, notices))
    assert place.parent.read_text() == "a file where the folder should be"


@pytest.mark.skipif(sys.platform == "win32", reason="a folder is not made read-only by its mode there")
def test_a_folder_that_is_read_only_is_reported(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(Preferences(recent=["/old.obj"]))
    (place / "bookmarks.json").write_text("damaged")
    before = {name: (place / name).read_bytes() for name in names(place)}
    if os.geteuid() == 0:  # nothing is read-only to root: refuse as the system would

        def refuse(*_: Any, **__: Any) -> None:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

        for name in ("rename", "replace"):
            monkeypatch.setattr(os, name, refuse)
    place.chmod(0o500)
    try:
        for said in (save(FULL), set_bookmarks("cornell", CAMERAS)):
            assert one_line(said) and os.strerror(errno.EACCES) in str(said)
        assert bookmarks("cornell") == []
        back, notices = load()
        assert back.recent == ["/old.obj"]
        assert len(notices) == 1 and one_line(notices[0]) and "bookmarks.json" in notices[0]
    finally:
        place.chmod(0o700)
    # what could not be put aside was not written over, and no partial file stays
    assert {name: (place / name).read_bytes() for name in names(place)} == before


def test_a_file_that_cannot_be_read_is_not_overwritten(place: Path) -> None:
    (place / "viewer.json").mkdir(parents=True)
    (place / "viewer.json" / "kept").write_text("")
    assert one_line(save(FULL))
    back, notices = load()
    assert back == Preferences() and len(notices) == 1 and one_line(notices[0])
    assert names(place) == {"viewer.json"} and names(place / "viewer.json") == {"kept"}


@pytest.mark.parametrize("ui", [{"x": float("nan")}, {"x": object()}, {"x": np.float32(1)}, {(1, 2): 3}])
def test_values_that_json_cannot_hold_are_reported_and_the_old_file_stays(place: Path, ui: dict[Any, Any]) -> None:
    save(FULL)
    assert one_line(save(Preferences(ui=ui)))
    assert load() == (FULL, [])
    assert names(place) == {"viewer.json"}


def test_an_interrupted_write_leaves_the_old_file(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(FULL)

    def full(self: Path, text: str, **_: Any) -> int:
        with open(self, "w") as file:
            file.write(text[: len(text) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text", full)
    said = save(Preferences())
    assert one_line(said) and os.strerror(errno.ENOSPC) in str(said)
    assert load() == (FULL, [])
    assert names(place) == {"viewer.json"}


def test_paths_that_are_not_unicode_come_back() -> None:
    path = os.fsdecode(b"/caf\xe9.obj")
    it = Preferences()
    it.opened(path)
    assert save(it) is None
    assert load() == (it, [])
    assert set_bookmarks(path, CAMERAS) is None
    assert bookmarks(path) == CAMERAS
