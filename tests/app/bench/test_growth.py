"""`irrsplat bench --growth`: its rows are what they say, each of a process of its own, and tables, JSON and plot hold them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from irrsplat.app import cli
from irrsplat.app.bench import scaling

ROW = scaling.Row(
    1008, (32, 32), 0.5, 0.25, 2.0, 3.0, 0.125, 1.5, 400, 300.0, 120.0, {"gather": 500.0}, "wall", {"renderer": "R"}
)


def test_a_row_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """About as many triangles as asked for, and every time is one."""
    monkeypatch.setattr(scaling, "REPETITIONS", 1)
    row = scaling.measured(1000, 12)
    assert row.triangles == pytest.approx(1000, rel=0.1) and row.size == (12, 12) and row.pixels == 144
    assert min(row.load, row.build, row.surface, row.empty, row.moved, row.record) > 0.0
    assert row.records > 0 and row.stages["gather"] > 0.0
    assert row.record == pytest.approx((row.stages["gather"] + row.stages["reduce"]) / row.records)
    assert row.process is None or row.process > 50.0


def test_series_tables_json_and_plot(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []

    def apart(triangles: int, side: int) -> scaling.Row:
        asked.append((triangles, side))
        return replace(ROW, triangles=triangles, size=(side, side), record=1.5 if triangles < 10**6 else 3.0)

    monkeypatch.setattr(scaling, "_apart", apart)
    files = ["--json", str(tmp_path / "g.json"), "-o", str(tmp_path / "g.png")]
    assert cli.main(["bench", "--growth", *files]) == 0
    assert asked == [(n, 400) for n in scaling.TRIANGLES] + [(scaling.OWN, n) for n in scaling.SIDES]
    out = capsys.readouterr().out
    assert "a record costs 2.0 times as much with 1,000,000 triangles as with 10,000" in out
    (cells,) = [line.split() for line in out.splitlines() if line.split()[:2] == ["6,360", "3200x3200"]]
    assert cells[2:] == ["0.500", "0.250", "2.000", "3.000", "0.125", "1.500", "400", "300", "120"]
    written = json.loads((tmp_path / "g.json").read_text())
    assert written["machine"] == {"renderer": "R"} and len(written["runs"]) == 5 * len(asked)
    keys = {"scene", "preset", "size", "case", "seconds", "records", "rmse", "stages_ms", "clock"}
    assert all(keys <= set(run) for run in written["runs"])
    of = {(r["scene"], r["size"][0], r["case"]): r for r in written["runs"]}
    assert of["curved, 1000000 triangles", 400, "growth empty"]["seconds"] == 3.0
    picture = np.asarray(Image.open(tmp_path / "g.png").convert("RGB"))
    assert (picture < 100).any(-1).sum() > 5000, "lines and words"

    asked.clear()
    assert cli.main(["bench", "--growth", "--quick"]) == 0
    assert len(asked) == sum(map(len, scaling.QUICK)) and max(asked) < (10**4, 100)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["cornell", "--growth"], "of its own"),
        (["--growth", "--peers"], "of its own"),
        (["--growth", "-o", "no/such/folder/a.png"], "does not exist"),
        (["--quick"], "--growth"),
        (["-o", "a.png"], "--growth"),
    ],
)
def test_what_does_not_go_together(words: list[str], said: str, refused: Callable[..., str]) -> None:
    assert said in refused(["bench", *words])


def test_a_row_that_fails_says_why(refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scaling, "QUICK", ((1000,), (0,)))
    assert "1000 triangles at 0x0" in refused(["bench", "--growth", "--quick"], 1)
