"""Dialogs for opening and saving scenes, and framing of a scene."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from irrsplat.app.viewer.window import Desktop
from tests.support.viewing import Driver, push, write_room


def test_a_scene_is_opened_by_the_line(driver: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The prompt accepts a relative path, an absolute path and a bundled name; Esc closes the prompt."""
    (tmp_path / "inner").mkdir()
    whole = write_room(tmp_path / "inner").rename(tmp_path / "inner" / "found.scene")
    driver.session.options.frozen = True
    for typed, name in (("inner/found.scene", "found"), (str(whole), "found"), ("furnace", "furnace")):
        push(driver, "Ctrl+O")
        driver.frame(3)
        driver.type(typed)
        driver.press("ENTER")
        driver.frame(2)
        assert driver.session.scene.name == name and driver.actions.prompt is None
    driver.resize((640, 400), density=0.25)
    monkeypatch.setattr(Desktop, "scale", 2.0)
    push(driver, "Ctrl+O")
    driver.frame(6)
    assert driver.find("").box[0] > 0.0, "the line is not scrolled out of the prompt"
    push(driver, "Esc")
    assert driver.actions.prompt is None


def test_a_scene_is_opened_and_saved_by_the_dialog_of_the_desktop(
    driver: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in for zenity receives the open scene's folder and returns a path; without a path nothing happens."""
    other, program = write_room(tmp_path).rename(tmp_path / "other.scene"), tmp_path / "zenity"
    driver.session.options.frozen = True
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setattr(driver.actions.dialog, "native", True)

    def answer(line: str, key: str) -> str:
        program.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/asked\n{line}\n')
        program.chmod(0o755)
        push(driver, key)
        while driver.actions.dialog._open is not None:
            driver.frame()
        return (tmp_path / "asked").read_text()

    folder = str(Path(driver.source).parent)
    assert folder in answer("exit 1", "Ctrl+O") and driver.actions.source == driver.source
    answer(f"echo {other}", "Ctrl+O")
    assert driver.actions.source == str(other)
    answer(f"echo {tmp_path}/kept.scene", "Ctrl+Shift+S")
    assert (tmp_path / "kept.scene").exists() and driver.actions.saved_as == f"{tmp_path}/kept.scene"
