"""--cache: the records of a render, and of the viewer's window, in a file; and what is said where that cannot be."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.app import cli
from irrsplat.app.viewer import preferences, viewer
from irrsplat.app.viewer.window import open_window
from irrsplat.indirect.scheduler import RecordScheduler
from irrsplat.records import cache_file
from irrsplat.renderer.rounds import Rounds
from irrsplat.surface_cache.cache import SurfaceCache
from tests.support.viewing import write_room

FAST = ["--size", "40", "30", "--gather-size", "8", "--shadow-size", "64", "--bounces", "1"]
RENDER = ["render", "room.scene", *FAST, "--cache", "room.cache"]
VIEW = ["view", "room.scene", *FAST, "--viewer-samples", "0", "--viewer-quality", "0", "--cache", "room.cache"]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a room in it."""
    write_room(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    return tmp_path


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[viewer.Viewer], None]], None]:
    """Has the viewer's window in memory, and what is given done in it before it closes."""
    monkeypatch.setattr(viewer, "open_window", lambda size: open_window(size, headless=True))

    def do(act: Callable[[viewer.Viewer], None]) -> None:
        monkeypatch.setattr(viewer.Viewer, "loop", act)

    return do


def settle(shown: viewer.Viewer) -> None:
    """Frames until nothing is left to do."""
    for _ in range(400):
        shown.frame(0.1)
        if shown.actions.session.at_rest:
            return
    pytest.fail(f"not at rest: {shown.actions.session.progress}")


def stats(name: str) -> dict[str, Any]:
    return dict(json.loads(Path(name).read_text()))


def test_a_second_render_gathers_nothing(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    RENDER_ALL = [*RENDER, "--bounces", "all"]  # whose surface cache is not made a second time either
    assert cli.main([*RENDER_ALL, "-o", "a.npz", "--stats", "a.json"]) == 0
    assert (place / "room.cache").is_file()
    advanced: list[int] = []
    advance = SurfaceCache.advance
    monkeypatch.setattr(SurfaceCache, "advance", lambda *args: advanced.append(1) or advance(*args))
    assert cli.main([*RENDER_ALL, "-o", "b.npz", "--stats", "b.json"]) == 0
    assert not advanced and stats("b.json")["rounds"] == 1 and "gather" not in stats("b.json")["stages_ms"]
    assert stats("a.json")["records"] == stats("b.json")["records"] > 0
    with np.load("a.npz") as one, np.load("b.npz") as other:
        assert all(np.array_equal(one[name], other[name]) for name in one.files if name != "stats")
    assert capsys.readouterr() == ("", "")


def test_a_path_keeps_its_records_and_uses_those_that_there_are(place: Path) -> None:
    (place / "a.path").write_text("cam 0 0 0.9 0 0 -1 0 1 0\ncam 0.2 0 0.9 0.3 0 -1 0 1 0\nframes 3\n")
    path = [*RENDER, "--path", "a.path", "-o", "f{frame}.png", "--stats"]
    assert cli.main([*path, "a.json"]) == 0
    assert cli.main([*path, "b.json"]) == 0
    first, again = stats("a.json")["frames"], stats("b.json")["frames"]
    assert first[0]["records"] < first[-1]["records"] == again[0]["records"] == again[-1]["records"]
    assert cli.main([*RENDER, "--eye", "0", "0", "0.9", "--target", "0", "0", "-1", "-o", "c.png", "--stats", "c.json"]) == 0
    assert stats("c.json")["records"] >= first[-1]["records"]


def test_an_interrupted_render_keeps_what_it_has(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    advance, rounds = Rounds.__call__, iter(range(10))

    def interrupted(*args: Any, **rest: Any) -> Any:
        if next(rounds) == 2:
            raise KeyboardInterrupt
        return advance(*args, **rest)

    with monkeypatch.context() as patched:
        patched.setattr(Rounds, "__call__", interrupted)
        assert cli.main([*RENDER, "-o", "a.png", "--stats", "a.json"]) == 130
    assert cli.main([*RENDER, "-o", "b.png", "--stats", "b.json"]) == 0
    assert 0 < stats("a.json")["records"] < stats("b.json")["records"] and stats("b.json")["converged"]


@pytest.mark.parametrize("kept", [False, True])
def test_a_render_that_is_interrupted_in_its_first_round_writes_nothing(
    kept: bool, place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first round has gathered some records, which are dropped; a cache file that is there stays as it is."""
    gather = RecordScheduler.gather_missing

    def interrupted(*args: Any, **rest: Any) -> Any:
        gather(*args, **rest)
        raise KeyboardInterrupt

    if kept:
        assert cli.main([*RENDER, "-o", "first.png"]) == 0
    before = {path.name: path.read_bytes() for path in place.iterdir() if path.is_file()}
    monkeypatch.setattr(RecordScheduler, "gather_missing", interrupted)
    elsewhere = ["--eye", "0", "0", "0.9", "--target", "0", "0", "-1"]
    assert cli.main([*RENDER, *elsewhere, "-o", "a.png", "-o", "folder", "--stats", "a.json"]) == 130
    assert capsys.readouterr().err == "irrsplat: interrupted before the first round was complete; nothing was written\n"
    assert {path.name: path.read_bytes() for path in place.iterdir() if path.is_file()} == before
    assert not (place / "folder").exists()


SETTINGS = {  # what is given besides, and what is said of it
    "another setting": (["--gather-size", "12"], "made with --gather-size 8, not --gather-size 12"),
    "another preset": (["--preset", "paper"], "made with"),
    "a setting of rays": (["--bounces", "2"], "made with --bounces 1"),
}
FILES = (  # which file is changed, from what to what, and what is said of it
    ("lamp.light", "3 3 3", "4 3 3", "other lights"),
    ("room.scene", "0.8 0.7 0.6 1", "0.8 0.7 0.5 1", "materials"),
    ("box.obj", "v 1 1 1", "v 1 1.1 1", "another scene"),
    ("room.cache", "", "", "not a record cache"),
)


def test_what_does_not_belong_together_is_refused_and_stays(place: Path, refused: Callable[..., str]) -> None:
    """A cache of other settings, of another scene, and a file that is none."""
    assert cli.main([*RENDER, "-o", "a.png"]) == 0
    for flags, said in SETTINGS.values():
        for command in ([*RENDER, *flags, "-o", "b.png"], [*VIEW, *flags]):
            err = refused(command)
            assert err.startswith("irrsplat: room.cache: ") and said in err
    for file, old, new, said in FILES:
        before = (place / file).read_bytes()
        (place / file).write_bytes(before.replace(old.encode(), new.encode()) if old else b"mine")
        for command in ([*RENDER, "-o", "b.png"], VIEW):
            assert said in refused(command)
        (place / file).write_bytes(before)


def test_where_nothing_can_be_written(place: Path, refused: Callable[..., str]) -> None:
    """It is said before any work."""
    for cache in ("none/room.cache", ".", "a.png"):
        refused([*RENDER[:-1], cache, "-o", "a.png"])
        if cache != "a.png":
            refused([*VIEW[:-1], cache])


def test_without_records_no_file_is_made(place: Path) -> None:
    assert cli.main([*RENDER, "--bounces", "0", "-o", "a.png"]) == 0
    assert not (place / "room.cache").exists()


# ---- the window -------------------------------------------------------------------------------------------------------


def test_the_window_goes_on_where_it_was_closed(place: Path, window: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """The second time the first frame is the picture, and at rest there are as many records as at first; a render takes them."""
    counts: list[int] = []

    def look(shown: viewer.Viewer) -> None:
        settle(shown)
        counts.append(shown.actions.session.renderers[0].cache.count)

    window(look)
    assert cli.main(VIEW) == 0

    def again(shown: viewer.Viewer) -> None:
        shown.frame(0.1)
        assert shown.actions.session.progress[0].coverage == 1.0
        look(shown)
        assert shown.actions.session.renderers[0].cache.refresh_count == 0

    window(again)
    assert cli.main(VIEW) == 0 and counts[0] == counts[1] > 0
    assert cli.main([*RENDER, "-o", "a.png", "--stats", "a.json"]) == 0
    assert stats("a.json")["records"] >= counts[0]
    assert capsys.readouterr() == ("", "")


def cleared(shown: viewer.Viewer) -> None:
    shown.frame(0.1)
    shown.actions.toggle("frozen")
    shown.actions.clear()
    shown.frame(0.1)
    assert shown.actions.session.renderers[0].cache.count == 0


def elsewhere(shown: viewer.Viewer) -> None:
    shown.frame(0.1)
    shown.actions.open("other.scene")
    settle(shown)


def relit(shown: viewer.Viewer) -> None:
    shown.frame(0.1)
    editor = shown.actions.editor
    editor.set_lamp(0, replace(editor.lamps[0], stops=1.0))
    settle(shown)


@pytest.mark.parametrize(
    ("act", "said"), [(cleared, ""), (elsewhere, "another scene was opened"), (relit, "no longer the scene's own")]
)
def test_a_good_file_stays(
    place: Path, window: Any, capsys: pytest.CaptureFixture[str], act: Callable[[viewer.Viewer], None], said: str
) -> None:
    """Not overwritten by nothing, by another scene's records, or by such as the next start would refuse."""
    assert cli.main([*RENDER, "-o", "a.png"]) == 0
    content = (place / "room.cache").read_bytes()
    (place / "other.scene").write_text((place / "room.scene").read_text().replace("0.8 0.7 0.6 1", "0.1 0.2 0.3 1"))
    window(act)
    assert cli.main(VIEW) == 0
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == (1 if said else 0)
    assert (place / "room.cache").read_bytes() == content


def test_a_file_that_cannot_be_written_at_the_end_is_said(
    place: Path, window: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    window(lambda shown: monkeypatch.setattr(Path, "write_bytes", fails) or settle(shown))
    assert cli.main(VIEW) == 0
    err = capsys.readouterr().err
    assert "room.cache: cannot write: No space left" in err and err.count("\n") == 1
    assert not (place / "room.cache").exists() and not list(place.glob(".irrsplat*"))


def test_settings_of_the_window_are_those_of_its_file(place: Path, window: Any) -> None:
    """What is set in the window is remembered, and so the file goes with it the next time."""

    def change(shown: viewer.Viewer) -> None:
        shown.actions.session.change(0, gather_size=12, shadow_size=128)
        settle(shown)

    window(change)
    assert cli.main(VIEW) == 0
    remembered, _ = preferences.load()
    assert remembered.values["gather_size"] == 12
    window(settle)
    assert cli.main(["view", "room.scene", "--cache", "room.cache"]) == 0
    header, arrays = cache_file._read(place / "room.cache")
    assert header["key"]["settings"]["gather_size"] == 12 and len(arrays["name"]) > 0
