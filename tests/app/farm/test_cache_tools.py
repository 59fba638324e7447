"""`irrsplat cache info`, `merge` and `prune`, and `--cache-mode update`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from irrsplat.app import cli
from irrsplat.app.viewer import viewer, window
from irrsplat.records import cache_file
from tests.support.viewing import write_room

FAST = ["--size", "40", "30", "--gather-size", "8", "--shadow-size", "64", "--bounces", "1"]


def render(cache: str, *more: str) -> int:
    return cli.main(["render", "room.scene", *FAST, "--cache", cache, "-o", "a.png", *more])


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a room, and two caches of it from two views."""
    write_room(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert render("a.cache") == 0
    assert render("b.cache", "--eye", "0.3", "0", "0.6", "--target", "0.3", "0", "-1") == 0
    return tmp_path


def count(name: str) -> int:
    return len(cache_file.read_any(name).state.records["name"])


def test_the_tools(place: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., str]) -> None:
    """What each says, and what is in its file; then what they refuse, which leaves all files as they are."""
    a, b = count("a.cache"), count("b.cache")
    capsys.readouterr()
    assert cli.main(["cache", "merge", "a.cache", "b.cache", "-o", "c.cache"]) == 0
    c = count("c.cache")
    assert max(a, b) < c < a + b
    assert capsys.readouterr().out == f"c.cache: {c} of {a + b} records; {a + b - c} were left out, served by others\n"
    assert cli.main(["cache", "prune", "c.cache", "-o", "d.cache", "--most", "100"]) == 0 and count("d.cache") == 100
    size = (place / "c.cache").stat().st_size
    assert cli.main(["cache", "prune", "c.cache", "-o", "d.cache", "--most", f"{0.6e-3 * size:.3f}kB"]) == 0
    assert 0.55 * size < (place / "d.cache").stat().st_size <= 0.6 * size
    assert cli.main(["cache", "prune", "d.cache", "-o", "d.cache"]) == 0
    capsys.readouterr()
    assert cli.main(["cache", "info", "c.cache", "a.cache"]) == 0
    told = capsys.readouterr().out
    assert f"records      {c}\n" in told and "room: 3 meshes, 22 triangles" in told and "--gather-size 8" in told
    assert cli.main(["cache", "info", "c.cache", "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)
    assert (one["records"], one["bytes"], one["bounces"], one["settings"]["gather_size"]) == (c, size, 1, 8)

    assert render("e.cache", "--seed", "1") == 0
    before = {path: path.read_bytes() for path in place.iterdir()}
    for words, said in (
        (["merge", "a.cache", "e.cache", "-o", "f.cache"], "e.cache: this record cache was made with --seed 1, not --seed 0"),
        (["merge", "a.cache", "room.scene", "-o", "f.cache"], "room.scene: this is not a record cache"),
        (["merge", "a.cache", "-o", "none/f.cache"], "none"),
        (["prune", "a.cache", "-o", "f.cache", "--most", "1kB"], "allow some more"),
        (["prune", "a.cache", "-o", "f.cache", "--most", "few"], "a number of records, or a size such as 20MB"),
        (["inform", "a.cache"], "did you mean 'info'?"),
    ):
        assert said in refused(["cache", *words])
    assert {path: path.read_bytes() for path in place.iterdir()} == before


def test_a_changed_scene_renews_its_file(place: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., str]) -> None:
    """By --cache-mode update, which says why; then the file belongs to the scene as it is."""
    lamp = place / "lamp.light"
    lamp.write_text(lamp.read_text().replace("3 3 3", "4 3 3"))
    assert "made for other lights" in refused(["render", "room.scene", *FAST, "--cache", "a.cache", "-o", "a.png"])
    assert render("a.cache", "--cache-mode", "update") == 0
    assert "notice: a.cache was made for other lights; what that concerns is gathered again" in capsys.readouterr().err
    assert render("a.cache") == 0 and render("a.cache", "--cache-mode", "update") == 0
    assert capsys.readouterr().err == ""


def test_the_viewer_renews_a_changed_scenes_file(
    place: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    """By the same flag: it opens with the file's records, says what it was made for, and leaves one of the scene as it is."""
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(place / "config"))
    monkeypatch.setattr(viewer, "open_window", lambda size: window.open_window(size, headless=True))
    seen: list[tuple[int, list[str]]] = []

    def loop(self: viewer.Viewer) -> None:
        renderer = self.session.renderers[0]
        seen.append((renderer.cache.count, [message.text for message in self.actions.messages.lines]))
        self.frame(0.05)

    monkeypatch.setattr(viewer.Viewer, "loop", loop)
    lamp, records = place / "lamp.light", count("a.cache")
    lamp.write_text(lamp.read_text().replace("3 3 3", "4 3 3"))
    view = ["view", "room.scene", *FAST, "--cache", "a.cache"]
    said = refused(view)
    assert "made for other lights" in said and "--cache-mode update renews it" in said and not seen
    assert cli.main([*view, "--cache-mode", "update"]) == 0
    [(taken, messages)] = seen
    assert taken == records and any("a.cache was made for other lights" in message for message in messages)
    assert render("a.cache") == 0, "the file belongs to the scene as it is"
