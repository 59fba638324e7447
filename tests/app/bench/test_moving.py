"""`irrsplat bench --moving`: what is carried, and what the errors are held against."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from irrsplat.app import cli
from irrsplat.app.bench import moving


@pytest.mark.long
def test_counted_ticks_give_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All but the time that they take; and records that few rays leave stale wait at the end of each frame."""
    monkeypatch.setattr(moving, "FRAMES", 2)
    monkeypatch.setattr(moving, "EVERY", 2)
    monkeypatch.setattr(moving, "SIZE", (40, 30))
    monkeypatch.setattr(moving, "PACE", 2e5)  # rays a second
    monkeypatch.setattr(moving, "CASES", moving.CASES[:1])
    found = []
    for name in ("a.json", "b.json"):
        assert cli.main(["bench", "cornell", "--moving", "--counted", "--json", str(tmp_path / name)]) == 0
        steps = json.loads((tmp_path / name).read_text())["moving"]
        assert all(step.pop("milliseconds") > 0.0 for step in steps)
        found.append(steps)
    assert found[0] == found[1]
    assert [step["frame"] for step in found[0]] == [2] and found[0][0]["stale"] > 0


def test_counting_is_for_what_moves(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bench", "--counted"]) == 2
    assert "--counted is for --moving" in capsys.readouterr().err
