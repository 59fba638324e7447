"""`irrsplat bench --compare`: which rows it sets beside each other, what it calls noise, and which files it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from irrsplat.app.bench import compare


def row(case: str = "empty", seconds: float = 1.0, **more: Any) -> dict[str, Any]:
    return {"scene": "a", "preset": "default", "size": [8, 8], "case": case, "seconds": seconds, "rmse": None} | more


def test_a_row_says_how_many_times_faster() -> None:
    """2 s then and 0.5 s now: 4 times; a row of one bounce is none of two, and what has no counterpart is named."""
    then = [row(seconds=2.0, rmse=0.02), row("warm"), row("moved")]
    now = [row(seconds=0.5, rmse=0.01), row("warm", bounces=2), row("moved", bounces=1)]
    head, *lines = compare.table(then, now)
    assert head.split()[:4] == ["scene", "preset", "size", "bounces"]
    assert lines[0].split() == ["a", "default", "8x8", "1", "empty", "2.000", "0.500", "4.00", "2.0%", "1.0%", "faster"]
    assert lines[1].split()[4:] == ["moved", "1.000", "1.000", "1.00", "-", "-"]
    assert lines[2:] == ["only then: a default 8x8 1 warm", "only now: a default 8x8 2 warm"]
    assert list(compare.table([], now[:1])) == ["only now: a default 8x8 1 empty"]


@pytest.mark.parametrize(
    ("then", "now", "word"),
    [
        ([1.0, 1.1, 1.2], [0.5, 0.6, 0.7], "faster"),
        ([0.5, 0.6, 0.7], [1.0, 1.1, 1.2], "slower"),
        ([1.0, 1.1, 1.2], [0.7, 0.8, 1.05], ""),  # one of them took as long
        ([1.0, 1.0, 1.0], [0.95, 0.95, 0.95], ""),  # apart, but by less than noise
        ([1.0], [0.85], ""),  # once is not enough for so little
        ([1.0], [0.7], "faster"),
    ],
)
def test_noise(then: list[float], now: list[float], word: str) -> None:
    middle = [row(seconds=times[len(times) // 2], seconds_all=times) for times in (then, now)]
    assert compare.verdict(*middle) == word


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        '{"runs": {}}',
        '{"runs": [1]}',
        '{"machine": {}, "peers": []}',
        json.dumps({"runs": [row(seconds=0.0)]}),
        json.dumps({"runs": [row(seconds=float("nan"))]}),
        json.dumps({"runs": [row(size=[8])]}),
        json.dumps({"runs": [row(seconds_all=["1"])]}),
        json.dumps({"runs": [row(rmse="small")]}),
        "\udcff",
    ],
)
def test_a_foreign_file_is_refused_in_one_line(tmp_path: Path, refused: Callable[..., str], text: str) -> None:
    path = tmp_path / "then.json"
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
    assert str(path) in refused(["bench", "--compare", str(path)])
    assert "cannot read" in refused(["bench", "--compare", "none.json"])


def test_a_file_of_before_is_read(tmp_path: Path) -> None:
    """What the contract has, and no more."""
    contract = row(stages_ms={"splat": 1.0}, clock="wall", records=7)
    (tmp_path / "then.json").write_text(json.dumps({"machine": {}, "runs": [contract]}))
    assert compare.read(str(tmp_path / "then.json")) == [contract]
