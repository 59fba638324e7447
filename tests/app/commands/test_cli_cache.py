"""`--cache` stores the records of a render or of the viewer in a file; `irrsplat cache` merges and prunes files."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np
import pytest
from PIL import Image

from irrsplat.app import cli
from irrsplat.app.common.kept_cache import KeptCache
from irrsplat.app.viewer import viewer
from irrsplat.app.viewer.window import open_window
from irrsplat.core.errors import IrrsplatError
from irrsplat.records import cache_file
from irrsplat.renderer.frames import Frames
from tests.support.viewing import brighter, write_room

FAST = ["--size", "20", "16", "--gather-size", "8", "--shadow-size", "64", "--bounces", "1"]
RENDER = ["render", "room.scene", *FAST, "--cache", "room.cache"]
VIEW = ["view", "room.scene", *FAST, "--viewer-samples", "0", "--viewer-quality", "0", "--cache", "room.cache"]

OnViewer = Callable[[viewer.Viewer], None]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to a working folder with a room; return the folder."""
    write_room(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IRRSPLAT_CONFIG", str(tmp_path / "config"))
    return tmp_path


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch) -> Callable[[OnViewer], None]:
    """Return a function that replaces the loop of an off-screen viewer by `act`."""
    monkeypatch.setattr(viewer, "open_window", lambda size: open_window(size, headless=True))

    def do(act: OnViewer) -> None:
        monkeypatch.setattr(viewer.Viewer, "loop", act)

    return do


def settle(shown: viewer.Viewer) -> None:
    """Render frames until the view has converged."""
    for _ in range(400):
        shown.frame(0.1)
        if shown.actions.session.at_rest:
            return
    pytest.fail(f"not converged: {shown.actions.session.progress}")


def stats(name: str) -> dict[str, Any]:
    return dict(json.loads(Path(name).read_text()))


def test_a_picture_beside_arrays_is_refined(place: Path) -> None:
    """A PNG has samples per pixel, and arrays have none: both show the refined records of `--quality`, as a PNG alone does."""
    refined = [*RENDER[:-2], "--quality", "5", "-o", "a.png"]
    assert cli.main(refined) == 0
    alone = np.asarray(Image.open("a.png"), int)
    assert cli.main([*refined, "-o", "a.npz"]) == 0
    assert np.abs(np.asarray(Image.open("a.png"), int) - alone).max() <= 1, "sums of rays may differ in their last digit"


@pytest.mark.few_sites
def test_a_second_render_gathers_nothing(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The second render has the same records and pictures without gathering and without a new surface cache."""
    all_bounces = [*RENDER, "--bounces", "all"]
    assert cli.main([*all_bounces, "-o", "a.npz", "--stats", "a.json"]) == 0
    assert cli.main([*all_bounces, "-o", "b.npz", "--stats", "b.json"]) == 0
    first, second = stats("a.json"), stats("b.json")
    assert {"gather", "surface"} <= set(first["stages_ms"]) and not {"gather", "surface"} & set(second["stages_ms"])
    assert second["rounds"] == 1 and first["records"] == second["records"] > 0
    with np.load("a.npz") as one, np.load("b.npz") as other:
        assert all(np.array_equal(one[name], other[name]) for name in one.files if name != "stats")
    assert capsys.readouterr() == ("", "")
    assert cli.main(["render", "room.scene", "--bounces", "0", "--size", "2", "2", "--cache", "none.cache", "-o", "c.png"]) == 0
    assert not (place / "none.cache").exists(), "a render without records writes no file"


def test_an_interrupted_render_keeps_its_records(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C in the third round keeps the records of two rounds, and a second render completes them."""
    advance, rounds = Frames.round, iter(range(10))

    def in_the_third(*args: Any, **rest: Any) -> Any:
        if next(rounds) == 2:
            raise KeyboardInterrupt
        return advance(*args, **rest)

    with monkeypatch.context() as patched:
        patched.setattr(Frames, "round", in_the_third)
        assert cli.main([*RENDER, "-o", "a.png", "--stats", "a.json"]) == 130
    assert cli.main([*RENDER, "-o", "b.png", "--stats", "b.json"]) == 0
    assert 0 < stats("a.json")["records"] < stats("b.json")["records"] and stats("b.json")["converged"]


def test_a_cache_of_another_render_is_refused(place: Path, refused: Callable[..., str]) -> None:
    """A cache of other settings or of another scene, a file without records and an unwritable path are refused unchanged."""
    assert cli.main([*RENDER, "-o", "a.png"]) == 0
    for command in ([*RENDER, "-o", "b.png"], VIEW):
        err = refused([*command, "--gather-size", "12"])
        assert err.startswith("irrsplat: room.cache: ") and "made with --gather-size 8, not --gather-size 12" in err
    for file, old, new, message in (
        ("lamp.light", "3 3 3", "4 3 3", "other lights"),
        ("room.scene", "0.8 0.7 0.6 1", "0.8 0.7 0.5 1", "materials"),
        ("box.obj", "v 1 1 1", "v 1 1.1 1", "another scene"),
    ):
        before = (place / file).read_text()
        (place / file).write_text(before.replace(old, new))
        assert message in refused([*RENDER, "-o", "b.png"])
        (place / file).write_text(before)
    assert "not a record cache" in refused([*RENDER[:-1], "lamp.light", "-o", "b.png"])
    for cache in ("none/room.cache", ".", "a.png"):
        refused([*RENDER[:-1], cache, "-o", "a.png"])
    refused([*VIEW[:-1], "none/room.cache"])


def places(path: Path) -> set[tuple[float, ...]]:
    return set(map(tuple, cache_file.read_any(path).state.records["position"]))


def test_processes_with_one_file_keep_the_records_of_both(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The second process adds only records that the first ones do not cover; a third with other settings is refused."""
    files = [place / f"{i}.cache" for i in range(3)]
    for file, more in zip(files, ([], ["--eye", ".5", ".5", ".5", "--target", "0", "0", "0"], ["--bounces", "2"]), strict=True):
        assert cli.main([*RENDER[:-1], str(file), *more, "-o", "a.png"]) == 0
    one, two, three = (KeptCache("room.cache") for _ in files)
    for kept, file in ((one, files[0]), (two, files[1]), (two, files[1])):
        kept.save(partial(copyfile, file))
    found, *parts = map(places, (Path("room.cache"), *files))
    assert parts[0] < found <= parts[0] | parts[1]
    assert capsys.readouterr().err.count("the records of both are in it") == 1
    with pytest.raises(IrrsplatError, match="another process has since made it with --bounces 1, not --bounces 2"):
        three.save(partial(copyfile, files[2]))
    assert places(Path("room.cache")) == found


# ---- the window ----------------------------------------------------------------------------------------------------------


def test_the_viewer_reuses_its_records(
    place: Path, window: Callable[[OnViewer], None], capsys: pytest.CaptureFixture[str]
) -> None:
    """After reopening, the first frame is covered without new records, and a render uses the same file."""
    counts: list[int] = []

    def look(shown: viewer.Viewer) -> None:
        settle(shown)
        counts.append(shown.actions.session.renderers[0].cache.count)

    def again(shown: viewer.Viewer) -> None:
        shown.frame(0.1)
        assert shown.actions.session.progress[0].coverage == 1.0
        look(shown)

    window(look)
    assert cli.main(VIEW) == 0
    window(again)
    assert cli.main(VIEW) == 0 and counts[0] == counts[1] > 0
    assert cli.main([*RENDER, "-o", "a.png", "--stats", "a.json"]) == 0
    assert stats("a.json")["records"] >= counts[0]
    assert capsys.readouterr() == ("", "")


def test_edited_lights_keep_the_file(place: Path, window: Callable[[OnViewer], None], capsys: pytest.CaptureFixture[str]) -> None:
    """Records of edited lights do not overwrite the records of the scene's own lights."""

    def relit(shown: viewer.Viewer) -> None:
        shown.frame(0.1)
        editor = shown.actions.editor
        editor.set_light(0, brighter(editor.scene.lights[0]))
        settle(shown)

    assert cli.main([*RENDER, "-o", "a.png"]) == 0
    content = (place / "room.cache").read_bytes()
    window(relit)
    assert cli.main(VIEW) == 0
    err = capsys.readouterr().err
    assert "no longer the loaded one" in err and err.count("\n") == 1
    assert (place / "room.cache").read_bytes() == content


def test_update_refreshes_the_cache_of_a_changed_scene(
    place: Path, window: Callable[[OnViewer], None], capsys: pytest.CaptureFixture[str], refused: Callable[..., str]
) -> None:
    """A render and the viewer with --cache-mode update refresh the file for the changed scene; later runs accept it."""
    assert cli.main([*RENDER, "-o", "a.png"]) == 0
    point_light, shown = place / "lamp.light", list[str]()
    dim = point_light.read_text()
    window(lambda it: shown.extend(message.text for message in it.actions.messages.lines))
    for color, command in (("4 3 3", [*RENDER, "-o", "a.png"]), ("5 3 3", VIEW)):
        point_light.write_text(dim.replace("3 3 3", color))
        message = refused(command)
        assert "made for other lights" in message
        assert cli.main([*command, "--cache-mode", "update"]) == 0
        shown += capsys.readouterr().err.splitlines()
        assert "room.cache was made for other lights" in shown.pop()
        assert cli.main([*RENDER, "-o", "a.png"]) == 0
        assert capsys.readouterr().err == ""


# ---- irrsplat cache ------------------------------------------------------------------------------------------------------


def render(cache: str, *more: str) -> None:
    assert cli.main([*RENDER[:-1], cache, "-o", "a.png", *more]) == 0


def count(name: str) -> int:
    return len(cache_file.read_any(name).state.records["id"])


def test_merge_prune_and_info(place: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., str]) -> None:
    """`merge` joins two views without redundant records, `prune` keeps a number, and refusals change no file."""
    render("a.cache")
    render("b.cache", "--eye", "0.3", "0", "0.6", "--target", "0.3", "0", "-1")
    a, b = count("a.cache"), count("b.cache")
    capsys.readouterr()
    assert cli.main(["cache", "merge", "a.cache", "b.cache", "-o", "c.cache"]) == 0
    c = count("c.cache")
    assert max(a, b) < c < a + b
    assert capsys.readouterr().out.startswith(f"c.cache: {c} of {a + b} records; {a + b - c} were left out")
    assert cli.main(["cache", "prune", "c.cache", "-o", "d.cache", "--most", "100"]) == 0 and count("d.cache") == 100
    capsys.readouterr()
    assert cli.main(["cache", "prune", "d.cache", "-o", "d.cache"]) == 0
    assert capsys.readouterr().out == "d.cache: 100 of 100 records; none was left out\n"
    assert cli.main(["cache", "info", "c.cache", "a.cache"]) == 0
    out = capsys.readouterr().out
    assert f"records      {c}\n" in out and "room: 3 meshes, 22 triangles" in out and "--gather-size 8" in out
    render("e.cache", "--seed", "1")
    for words, message in (
        (["merge", "a.cache", "e.cache", "-o", "f.cache"], "e.cache: this record cache was made with --seed 1, not --seed 0"),
        (["merge", "a.cache", "room.scene", "-o", "f.cache"], "room.scene: this is not a record cache"),
        (["merge", "a.cache", "-o", "none/f.cache"], "none"),
        (["prune", "a.cache", "-o", "f.cache", "--most", "20MB"], "a whole number, at least 1"),
    ):
        assert message in refused(["cache", *words])
