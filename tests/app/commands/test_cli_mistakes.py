"""Mistakes of a command line: what was probably meant, all of them in one line, and which help page has more."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from irrsplat.app import grammar
from irrsplat.core.errors import InputError

RENDER = ["render", "plain.scene", "-o", "a.png"]


@pytest.mark.parametrize(
    ("argv", "meant"),
    [
        (["rendr"], "did you mean 'render'?"),
        (["RENDER"], "did you mean 'render'?"),
        ([*RENDER, "--exposre", "auto"], "unknown flag --exposre (did you mean --exposure?)"),
        ([*RENDER, "--exposre=auto"], "unknown flag --exposre (did you mean --exposure?)"),
        (["bench", "--peer"], "did you mean --peers?"),
        ([*RENDER, "--preset", "papr"], "did you mean 'paper'?"),
        ([*RENDER, "--gather", "trase"], "did you mean 'trace'?"),
        ([*RENDER, "--exposure", "aut"], "did you mean 'auto'?"),
        ([*RENDER, "--buffers", "depth,irradiancee"], "'irradiancee' (did you mean 'irradiance'?)"),
        (["render", "cornel", "-o", "a.png"], "did you mean 'cornell'?"),
        (["info", "atrim"], "did you mean 'atrium'?"),
        (["bench", "curved", "dor"], "did you mean 'door'?"),
        (["verify", "--truth", "gathers"], "did you mean 'gather'?"),
        (["completion", "zhs"], "did you mean 'zsh'?"),
    ],
)
def test_what_was_meant_is_told(argv: list[str], meant: str, refused: Callable[..., str], place: Path) -> None:
    line = refused(argv)
    assert meant in line and line.count("did you mean") == 1


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["desktop"], "irrsplat: desktop takes install|remove, and none is given; see irrsplat desktop --help\n"),
        (["desktop", "put"], "irrsplat: desktop takes install|remove, not 'put'; see irrsplat desktop --help\n"),
        (["completion"], "irrsplat: completion takes bash|zsh|fish, and none is given; see irrsplat completion --help\n"),
        (["completion", "shell"], "irrsplat: completion takes bash|zsh|fish, not 'shell'; see irrsplat completion --help\n"),
        (["cache"], "irrsplat: a command is missing; the commands are info, merge, prune; see irrsplat cache --help\n"),
        (["cache", "x"], "irrsplat: there is no command 'x'; the commands are info, merge, prune; see irrsplat cache --help\n"),
        (["cache", "info"], "irrsplat: FILE is missing; see irrsplat cache info --help\n"),
    ],
)
def test_what_may_follow_is_told(argv: list[str], said: str, refused: Callable[..., str]) -> None:
    assert refused(argv) == said


def test_without_a_command_all_are_told(refused: Callable[..., str]) -> None:
    assert f"a command is missing; the commands are {', '.join(grammar.COMMANDS)};" in refused([])


def test_a_camera_that_was_meant_is_told(refused: Callable[..., str], place: Path, fake: Any) -> None:
    (place / "plain.scene").write_text((place / "plain.scene").read_text() + "cam gallery 5 0 0 0 0 0 0 0 1\n")
    assert "no camera 'galery' (did you mean 'gallery'?); the named cameras here: 'gallery'" in refused(
        [*RENDER, "--camera", "galery"]
    )


@pytest.mark.parametrize("argv", [["xyzzy"], [*RENDER, "--xyzzy"], [*RENDER, "--preset", "xyzzy"], ["info", "xyzzy"]])
def test_nothing_is_suggested_where_nothing_is_like_it(argv: list[str], refused: Callable[..., str], place: Path) -> None:
    assert "did you mean" not in refused(argv)


def test_a_former_flag_is_not_suggested() -> None:
    with pytest.raises(InputError, match="unknown flag --overtur") as told:
        grammar.parse([*RENDER, "--overtur"])
    assert "--overture" not in str(told.value)


@pytest.mark.parametrize(
    ("argv", "page"),
    [
        (["rendr"], "irrsplat --help"),
        ([], "irrsplat --help"),
        ([*RENDER, "--siz", "4", "4"], "irrsplat render --help"),
        (["bench", "--size", "4"], "irrsplat bench --help"),
        (["info", "cornell", "curved"], "irrsplat info --help"),
    ],
)
def test_the_help_page_is_named(argv: list[str], page: str, refused: Callable[..., str], place: Path) -> None:
    assert refused(argv).endswith(f"; see {page}\n")


def test_all_mistakes_are_told_in_one_line(refused: Callable[..., str], place: Path) -> None:
    argv = [
        "render",
        "cornel",
        "--exposre",
        "auto",
        "--a",
        "9",
        "--size",
        "4",
        "--preset",
        "fast",
        "--blend",
        "x",
        "--up",
        "0",
        "1",
    ]
    line = refused([*argv, "0", "-o", "b.mp4", "-o", "missing/c.png", "--buffers", "dpth,colour", "--stats", "missing/s.json"])
    wanted = (
        *(
            "(1) unknown flag --exposre",
            "--size: expected 2 arguments",
            "--preset: takes default|paper",
            "'a' takes 0.01..2, not 9",
        ),
        *(
            "--blend takes 0..1, not 'x'",
            "--up needs --eye",
            "no file 'cornel'",
            "b.mp4: a film needs a flight",
            "missing/c.png: cannot",
        ),
        *("'dpth' (did you mean 'depth'?), 'colour'", "missing/s.json: cannot write"),
    )
    assert not [words for words in wanted if words not in line]
    assert line.startswith("irrsplat: 11 mistakes: (1) ") and "(11) " in line and "(12)" not in line


@pytest.mark.parametrize(
    ("argv", "count"),
    [
        ([*RENDER, "--eye", "0", "0", "x", "--target", "0", "0", "0"], 1),  # not: --target without --eye
        ([*RENDER, "--eye", "0", "0", "5", "--targt", "0", "0", "0"], 1),  # nor --eye without --target
        (["render", "--outpt", "a.png"], 1),  # nor: -o is missing
        ([*RENDER, "--presett", "paper", "--sizes", "4", "4"], 2),  # the values of wrong flags are no scenes
        ([*RENDER, "--xyzzy", "paper", "4"], 1),
        ([*RENDER, "--smoth", "on"], 1),
        (["render", "--smoth", "plain.scene"], 2),  # --smoth has no value, so that -o alone is missing
        ([*RENDER, "--size", "x", "y"], 1),
        ([*RENDER, "--crease-angle", "x", "--up-axis", "w"], 2),
        (["verify", "--curve", "--techniques"], 1),
    ],
)
def test_a_mistake_is_told_once_without_those_that_follow_from_it(argv: list[str], count: int) -> None:
    _, mistakes = grammar.read(argv)
    assert len(mistakes.found) == count, mistakes.found


def test_help_comes_before_mistakes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        grammar.parse(["render", "--xyzzy", "--help"])
    assert done.value.code == 0 and "usage: irrsplat render" in capsys.readouterr().out
